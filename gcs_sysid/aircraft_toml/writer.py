"""An aircraft as the text of its file: readable, with units, and read back to the same numbers."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping

from gcs_sysid.aircraft import (
    ZERO,
    Aircraft,
    CoefficientModel,
    Control,
    Envelope,
    Geometry,
    Imu,
    Mass,
    Pitot,
    Propulsion,
    SensorError,
    Servo,
    StreamTiming,
    TableTerm,
    Value,
    Vanes,
)
from gcs_sysid.aircraft_toml.aerodynamics import (
    DEFAULT_SIGMA,
    LARGEST_SIGMA,
    relative_to_absolute,
)
from gcs_sysid.aircraft_toml.section import quoted_key, quoted_text, to_si

_HEADER = """\
# SI units; angles in degrees, except in [aerodynamics], which is in radians.
# Body axes: x forward, y right, z down. Positions from one airframe point, about which the
# moments of [aerodynamics] are given."""

_COMMENT_COLUMN = 32
_RELATIVE_DIGITS = 6


def dumps(aircraft: Aircraft) -> str:
    """TOML text of an aircraft.

    What has its default is left out. `loads` reads the same numbers from it; an angle that no
    decimal number of degrees gives exactly is one unit in the last place off.
    """
    parts = [
        [_HEADER, f"schema = {aircraft.schema}", f"name = {quoted_text(aircraft.name)}"],
        _mass(aircraft.mass),
        _geometry(aircraft.geometry),
        *_imu(aircraft.imu),
        _pitot(aircraft.pitot),
        _vanes(aircraft.vanes) if aircraft.vanes else [],
        *(_stream(name, timing) for name, timing in aircraft.streams.items()),
        *(_servo(servo) for servo in aircraft.servos),
        *(_control(control) for control in aircraft.controls),
        *(_thruster(each, several=len(aircraft.propulsion) > 1) for each in aircraft.propulsion),
        _envelope(aircraft.envelope) if aircraft.envelope else [],
        *_aerodynamics(aircraft.aerodynamics),
    ]
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


def _mass(mass: Mass) -> list[str]:
    products = {"Ixz": "∫xz dm", "Ixy": "∫xy dm", "Iyz": "∫yz dm"}
    return [
        "[mass]",
        _line("mass", _number(mass.mass), "kg"),
        _line("Ixx", _number(mass.Ixx), "kg·m², about the centre of gravity"),
        _line("Iyy", _number(mass.Iyy)),
        _line("Izz", _number(mass.Izz)),
        *(
            _line(key, _number(getattr(mass, key)), f"kg·m², {meaning}")
            for key, meaning in products.items()
            if getattr(mass, key)
        ),
        *_unless(mass.cg == ZERO, "cg", _numbers(mass.cg), "m, from the airframe point"),
        _line("mass_sigma", _number(mass.mass_sigma), "relative, one sigma"),
        _line("inertia_sigma", _number(mass.inertia_sigma), "relative, one sigma"),
    ]


def _geometry(geometry: Geometry) -> list[str]:
    return [
        "[geometry]",
        _line("wing_area", _number(geometry.wing_area), "m²"),
        _line("wing_span", _number(geometry.wing_span), "m"),
        _line("mean_chord", _number(geometry.mean_chord), "m"),
    ]


def _imu(imu: Imu) -> list[list[str]]:
    accelerometer = _triad(imu.accelerometer, "m/s²")
    gyro = _triad(imu.gyro, "deg/s")
    return [
        [
            "[imu]",
            _line("position", _numbers(imu.position), "m"),
            *_unless(
                imu.misalignment == ZERO,
                "misalignment",
                _numbers(imu.misalignment, "deg"),
                "deg, roll pitch yaw of the unit",
            ),
            *_optional("misalignment_sigma", imu.misalignment_sigma, "deg"),
        ],
        ["[imu.accelerometer]", *accelerometer] if accelerometer else [],
        ["[imu.gyro]", *gyro] if gyro else [],
    ]


def _triad(error: SensorError, unit: str) -> list[str]:
    return [
        *_unless(error.bias == ZERO, "bias", _numbers(error.bias, unit), unit),
        *_optional("bias_sigma", error.bias_sigma, unit),
        *_unless(error.scale == ZERO, "scale", _numbers(error.scale), "reads (1 + scale) times"),
        *_optional("scale_sigma", error.scale_sigma, "1"),
        *_unless(error.lag == 0.0, "lag", _number(error.lag), "s"),
        *_optional("lag_sigma", error.lag_sigma, "s"),
    ]


def _pitot(pitot: Pitot) -> list[str]:
    error = pitot.error
    return [
        "[pitot]",
        _line("position", _numbers(pitot.position), "m"),
        _line("measures", quoted_text(pitot.measures), "equivalent, calibrated or true airspeed"),
        *_unless(error.bias == (0.0,), "bias", _number(error.bias[0]), "m/s"),
        *_optional("bias_sigma", error.bias_sigma, "m/s"),
        *_unless(
            error.scale == (0.0,), "scale", _number(error.scale[0]), "reads (1 + scale) times"
        ),
        *_optional("scale_sigma", error.scale_sigma, "1"),
        *_unless(error.lag == 0.0, "lag", _number(error.lag), "s"),
        *_optional("lag_sigma", error.lag_sigma, "s"),
    ]


def _vanes(vanes: Vanes) -> list[str]:
    alpha, beta = vanes.alpha, vanes.beta
    return [
        "[vanes]",
        _line("position", _numbers(vanes.position), "m"),
        *_unless(vanes.upwash == 0.0, "upwash", _number(vanes.upwash), "reads (1 + upwash) times"),
        *_optional("upwash_sigma", vanes.upwash_sigma, "1"),
        *_unless(
            alpha.bias == beta.bias == (0.0,),
            "bias",
            _numbers((*alpha.bias, *beta.bias), "deg"),
            "deg, alpha and beta",
        ),
        *_pair("bias_sigma", alpha.bias_sigma, beta.bias_sigma, "deg"),
        *_unless(
            alpha.scale == beta.scale == (0.0,),
            "scale",
            _numbers((*alpha.scale, *beta.scale)),
            "reads (1 + scale) times, alpha and beta",
        ),
        *_pair("scale_sigma", alpha.scale_sigma, beta.scale_sigma, "1"),
        *_unless(
            alpha.lag == beta.lag == 0.0,
            "lag",
            _numbers((alpha.lag, beta.lag)),
            "s, alpha and beta",
        ),
        *_pair("lag_sigma", alpha.lag_sigma, beta.lag_sigma, "s"),
    ]


def _pair(key: str, alpha: float | None, beta: float | None, unit: str) -> list[str]:
    known = {name: v for name, v in (("alpha", alpha), ("beta", beta)) if v is not None}
    entries = ", ".join(f"{name} = {_number(value, unit)}" for name, value in known.items())
    return [_line(key, f"{{ {entries} }}", "" if unit == "1" else unit)] if known else []


def _stream(name: str, timing: StreamTiming) -> list[str]:
    return [
        f"[streams.{quoted_key(name)}]",
        _line("delay", _number(timing.delay), "s"),
        *_optional("sigma", timing.sigma, "s"),
    ]


def _servo(servo: Servo) -> list[str]:
    return [
        "[[servos]]",
        f"channel = {servo.channel}",
        f"surface = {quoted_text(servo.surface)}",
        _line("pwm", _numbers(servo.pwm, "µs"), "µs"),
        _line("deflection", _numbers(servo.deflection, "deg"), "deg"),
        _line("time_constant", _number(servo.time_constant), "s"),
        *_unless(servo.delay == 0.0, "delay", _number(servo.delay), "s"),
        *_optional("rate_limit", servo.rate_limit, "deg/s"),
        *_unless(servo.backlash == 0.0, "backlash", _number(servo.backlash, "deg"), "deg"),
        *_unless(servo.offset == 0.0, "offset", _number(servo.offset, "deg"), "deg"),
        *_unless(servo.effectiveness == 1.0, "effectiveness", _number(servo.effectiveness)),
    ]


def _control(control: Control) -> list[str]:
    gains = ", ".join(f"{quoted_key(name)} = {_number(g)}" for name, g in control.mix.items())
    return ["[[controls]]", f"name = {quoted_text(control.name)}", f"mix = {{ {gains} }}"]


def _thruster(thruster: Propulsion, *, several: bool) -> list[str]:
    if thruster.rpm is None:
        setting = [_line("throttle", _numbers(thruster.throttle), "rows of the table")]
    else:
        setting = [
            f"rpm_channel = {thruster.rpm_channel}",
            _line("rpm", _numbers(thruster.rpm), "rows of the table"),
        ]
    torque = thruster.torque
    return [
        "[[propulsion]]" if several else "[propulsion]",
        f"throttle_channel = {thruster.throttle_channel}",
        _line("pwm", _numbers(thruster.pwm, "µs"), "µs at throttle 0 and at throttle 1"),
        _line("axis", _numbers(thruster.axis)),
        _line("position", _numbers(thruster.position), "m"),
        _line("time_constant", _number(thruster.time_constant), "s"),
        _line("thrust_sigma", _number(thruster.thrust_sigma), "relative, one sigma"),
        *setting,
        _line("airspeed", _numbers(thruster.airspeed), "m/s, columns of the table"),
        *_rows("thrust", thruster.thrust, "N at sea level"),
        *(_rows("torque", torque, "N·m at sea level, about the axis") if torque else []),
    ]


def _envelope(envelope: Envelope) -> list[str]:
    return [
        "[envelope]",
        _line("airspeed", _numbers(envelope.airspeed), "m/s"),
        _line("alpha", _numbers(envelope.alpha, "deg"), "deg"),
        _line("beta", _numbers(envelope.beta, "deg"), "deg"),
        _line("load_factor", _numbers(envelope.load_factor), "g"),
        _line("bank", _number(envelope.bank, "deg"), "deg"),
        _line("height_min", _number(envelope.height_min), "m above ground"),
    ]


def _aerodynamics(models: Mapping[str, CoefficientModel]) -> list[list[str]]:
    if not models:
        return []
    sigma = _usual_sigma(models)
    return [
        ["[aerodynamics]", _line("sigma", _number(sigma), "relative, one sigma of every value")],
        *itertools.chain.from_iterable(
            _coefficient(name, model, sigma) for name, model in models.items()
        ),
    ]


def _coefficient(name: str, model: CoefficientModel, usual_sigma: float) -> Iterator[list[str]]:
    yield [
        f"[aerodynamics.{name}]",
        *(f"{_term_key(key)} = {_value(v, usual_sigma)}" for key, v in model.terms.items()),
    ]
    for table in model.tables:
        yield _table(name, table)


def _table(coefficient: str, table: TableTerm) -> list[str]:
    names = ", ".join(quoted_text(key) for key in table.regressors)
    flat = [value for value in table.values if isinstance(value, float)]
    rows = [row for row in table.values if isinstance(row, tuple)]
    return [
        f"[aerodynamics.{coefficient}.{quoted_key(table.name)}]",
        f"regressors = [{names}]",
        f"breakpoints = [{', '.join(_numbers(points) for points in table.breakpoints)}]",
        *(_rows("values", rows, "") if rows else [f"values = {_numbers(flat)}"]),
        _line("sigma", _number(table.sigma), "relative, of a common scale"),
    ]


def _term_key(key: str) -> str:
    """The constant term in quotes too: a bare 1 is legal, but reads like a mistake."""
    return quoted_text(key) if key[0].isdigit() else quoted_key(key)


def _value(value: Value, usual_sigma: float) -> str:
    sigma = _relative_sigma(value)
    if sigma == usual_sigma:
        return _number(value.value)
    spread = f"sd = {_number(value.sigma)}" if sigma is None else f"sigma = {_number(sigma)}"
    return f"{{ value = {_number(value.value)}, {spread} }}"


def _usual_sigma(models: Mapping[str, CoefficientModel]) -> float:
    """The relative sigma that most terms have, so that they need not repeat it."""
    sigmas = [_relative_sigma(value) for model in models.values() for value in model.terms.values()]
    counted = Counter(sigma for sigma in sigmas if sigma is not None)
    return counted.most_common(1)[0][0] if counted else DEFAULT_SIGMA


def _relative_sigma(value: Value) -> float | None:
    """A short relative sigma that reads back to exactly the absolute one, or None."""
    ratio = value.sigma / relative_to_absolute(value.value, 1.0)
    for digits in range(1, _RELATIVE_DIGITS + 1):
        sigma = float(f"{ratio:.{digits}g}")
        if relative_to_absolute(value.value, sigma) == value.sigma and sigma < LARGEST_SIGMA:
            return sigma
    return None


def _line(key: str, text: str, comment: str = "") -> str:
    entry = f"{key} = {text}"
    return f"{entry.ljust(_COMMENT_COLUMN - 1)} # {comment}" if comment else entry


def _unless(skip: bool, key: str, text: str, comment: str = "") -> list[str]:
    return [] if skip else [_line(key, text, comment)]


def _optional(key: str, value: float | None, unit: str) -> list[str]:
    if value is None:
        return []
    return [_line(key, _number(value, unit), "relative" if unit == "1" else unit)]


def _rows(key: str, rows: Iterable[tuple[float, ...]], comment: str) -> list[str]:
    opening = f"{key} = [" + (f"   # {comment}" if comment else "")
    return [opening, *(f"  {_numbers(row)}," for row in rows), "]"]


def _numbers(values: Iterable[float], unit: str = "1") -> str:
    return "[" + ", ".join(_number(value, unit) for value in values) + "]"


def _number(value: float, unit: str = "1") -> str:
    if unit == "µs" and value == int(value):
        return str(int(value))
    return repr(_in_unit(float(value), unit))


def _in_unit(value: float, unit: str) -> float:
    """The shortest decimal number in `unit` that reads back to `value` in SI units."""
    if to_si(1.0, unit) == 1.0:
        return value
    nearest = value / to_si(1.0, unit)
    rounded = (float(f"{nearest:.{digits}g}") for digits in range(1, 18))
    beside = (math.nextafter(nearest, side) for side in (-math.inf, math.inf))
    exact = (number for number in (*rounded, *beside) if to_si(number, unit) == value)
    return next(exact, nearest)
