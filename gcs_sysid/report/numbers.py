"""Numbers as people read them: two or three significant digits, intervals to matching digits."""

from __future__ import annotations

import math

MINUS = "\u2212"
NOTHING = "\u2013"
_SUPERSCRIPT = str.maketrans("-0123456789", "\u207b⁰¹²³⁴⁵⁶⁷⁸⁹")
_DEGREE_UNITS = {"rad": "deg", "rad/s": "deg/s"}


def number(value: float | None, digits: int = 3) -> str:
    """A value to `digits` significant digits; a dash for what is missing or not a number."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    exponent = _exponent(value, digits)
    if not -4 <= exponent < 6:
        return _scientific(value, exponent, digits)
    return _fixed(value, max(digits - 1 - exponent, 0))


def plus_minus(value: float | None, half: float | None) -> str:
    """Value ± half: `half` to two significant digits, the value to the same decimal place."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if half is None or not math.isfinite(half) or half < 0.0:
        return f"{number(value)} ± ?"
    if half == 0.0:
        return f"{number(value)} ± 0"
    exponent = _exponent(half, 2)
    largest = max(exponent, _exponent(value, 3) if value else exponent)
    if not -4 <= exponent < 6 or largest >= 6:
        return _scientific_pair(value, half, largest, exponent)
    decimals = max(1 - exponent, 0)
    return f"{_fixed(value, decimals)} ± {_fixed(half, decimals)}"


def for_people(value: float, half: float, unit: str) -> tuple[float, float, str]:
    """SI to what people read: radians to degrees, ratios to percent, seconds under one to ms."""
    if unit in _DEGREE_UNITS:
        return math.degrees(value), math.degrees(half), _DEGREE_UNITS[unit]
    if unit == "1":
        return 100.0 * value, 100.0 * half, "%"
    if unit == "s" and max(abs(value), abs(half)) < 1.0:
        return 1000.0 * value, 1000.0 * half, "ms"
    return value, half, unit


def quantity(value: float | None, half: float | None, unit: str) -> str:
    """Value ± half with its unit, in units for people."""
    if value is None:
        return NOTHING
    shown, around, name = for_people(value, math.nan if half is None else half, unit)
    return f"{plus_minus(shown, around)} {name}".strip()


def probability(share: float) -> str:
    """In percent, never as certain: "97 %", "99.6 %", "> 99.9 %", "< 0.1 %"."""
    percent = 100.0 * share
    if percent > 99.9:
        return "> 99.9 %"
    if percent < 0.1:
        return "< 0.1 %"
    return f"{percent:.{0 if 1.0 <= percent <= 99.0 else 1}f} %"


def duration(seconds: float) -> str:
    """Minutes and seconds, for instance "9 min 12 s"; tenths below ten seconds."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _exponent(value: float, digits: int) -> int:
    """Decimal exponent after rounding to `digits` digits (9.99 to two digits is 10)."""
    return int(f"{abs(value):.{digits - 1}e}".partition("e")[2])


def _fixed(value: float, decimals: int) -> str:
    text = f"{abs(value):.{decimals}f}"
    return MINUS + text if value < 0.0 and float(text) != 0.0 else text


def power_of_ten(exponent: int) -> str:
    """10 to an exponent."""
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def _scientific(value: float, exponent: int, digits: int) -> str:
    return f"{_fixed(value / 10.0**exponent, digits - 1)}×{power_of_ten(exponent)}"


def _scientific_pair(value: float, half: float, largest: int, smallest: int) -> str:
    decimals = min(max(largest - smallest + 1, 0), 6)
    scaled = f"{_fixed(value / 10.0**largest, decimals)} ± {_fixed(half / 10.0**largest, decimals)}"
    return f"({scaled})×{power_of_ten(largest)}"
