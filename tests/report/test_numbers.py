from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.report.numbers import duration, for_people, number, plus_minus, probability, quantity

finite = st.floats(-1e9, 1e9).filter(lambda value: value == 0.0 or abs(value) > 1e-9)
SUPERSCRIPTS = str.maketrans("\u207b⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def read(text: str) -> float:
    mantissa, _, power = text.partition("×10")
    return float(mantissa.replace("\u2212", "-")) * 10.0 ** int(power.translate(SUPERSCRIPTS) or 0)


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0.0, "0"),
        (-4.6251, "\u22124.63"),
        (0.012345, "0.0123"),
        (999.6, "1000"),
        (123456.0, "123456"),
        (1.5e-7, "1.50×10\u207b⁷"),
        (None, "\u2013"),
        (math.nan, "\u2013"),
        (math.inf, "\u2013"),
    ],
)
def test_numbers_as_people_read_them(value: float | None, shown: str) -> None:
    assert number(value) == shown


@pytest.mark.parametrize(
    ("value", "half", "shown"),
    [
        (-4.5321, 0.2134, "\u22124.53 ± 0.21"),
        (-12.41, 2.351, "\u221212.4 ± 2.4"),
        (0.0661, 0.00297, "0.0661 ± 0.0030"),
        (1234.5, 100.0, "1234 ± 100"),
        (0.001, 9.96, "0 ± 10"),
        (1.2, 0.0, "1.20 ± 0"),
        (1.2, math.inf, "1.20 ± ?"),
        (1.2, None, "1.20 ± ?"),
        (math.nan, 1.0, "\u2013"),
    ],
)
def test_a_value_stops_where_its_interval_does(
    value: float, half: float | None, shown: str
) -> None:
    assert plus_minus(value, half) == shown


@settings(deadline=None)
@given(finite)
def test_a_number_is_right_to_three_digits(value: float) -> None:
    assert read(number(value)) == pytest.approx(value, rel=5.1e-3)


@settings(deadline=None)
@given(finite, st.floats(1e-8, 1e8))
def test_an_interval_is_right_to_two_digits_and_the_value_within_it(
    value: float, half: float
) -> None:
    text = plus_minus(value, half)
    power = 1.0
    if text.startswith("("):
        text, _, exponent = text[1:].partition(")×10")
        power = 10.0 ** int(exponent.translate(SUPERSCRIPTS))
    shown, _, around = text.partition(" ± ")
    resolution = max(0.051 * half, 0.51e-6 * abs(value))
    assert read(shown) * power == pytest.approx(value, abs=resolution)
    assert read(around) * power == pytest.approx(half, abs=resolution)


def test_a_negative_nothing_has_no_sign() -> None:
    assert plus_minus(-0.001, 1.0) == "0.0 ± 1.0"


@pytest.mark.parametrize(
    ("si", "people"),
    [
        ((math.pi, math.pi / 180, "rad"), (180.0, 1.0, "deg")),
        ((0.066, 0.003, "s"), (66.0, 3.0, "ms")),
        ((1.5, 0.1, "s"), (1.5, 0.1, "s")),
        ((0.031, 0.006, "1"), (3.1, 0.6, "%")),
        ((0.11, 0.03, "m/s²"), (0.11, 0.03, "m/s²")),
    ],
)
def test_units_for_people(si: tuple[float, float, str], people: tuple[float, float, str]) -> None:
    value, half, unit = for_people(*si)
    assert (value, half) == pytest.approx(people[:2])
    assert unit == people[2]


def test_a_quantity_carries_its_unit() -> None:
    assert quantity(0.031, 0.006, "1") == "3.10 ± 0.60 %"
    assert quantity(None, 1.0, "m/s") == "\u2013"
    assert quantity(2.0, None, "m/s") == "2.00 ± ? m/s"


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (1.0, "> 99.9 %"),
        (0.9996, "> 99.9 %"),
        (0.9982, "99.8 %"),
        (0.989, "99 %"),
        (0.47, "47 %"),
        (0.0099, "1.0 %"),
        (0.0004, "< 0.1 %"),
        (0.0, "< 0.1 %"),
    ],
)
def test_no_probability_is_told_as_certain(share: float, words: str) -> None:
    assert probability(share) == words


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(4.04, "4.0 s"), (59.7, "1 min 00 s"), (552.0, "9 min 12 s"), (9.99, "10 s"), (42.2, "42 s")],
)
def test_durations_in_words(seconds: float, words: str) -> None:
    assert duration(seconds) == words
