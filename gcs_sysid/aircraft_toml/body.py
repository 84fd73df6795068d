"""What the aircraft is: mass, geometry, propulsion and the envelope it may be flown in."""

from __future__ import annotations

import numpy as np

from gcs_sysid.aircraft import Envelope, Geometry, Mass, Propulsion, Servo
from gcs_sysid.aircraft_toml.checks import lag, position, relative_sigma, vector
from gcs_sysid.aircraft_toml.keys import KEYS
from gcs_sysid.aircraft_toml.section import Section, describe, increasing

# Beyond these no aircraft's quantities can be in the unit they should be in.
_GYRATION_OVER_SPAN = (0.01, 3.0)
_CHORD_SPAN_OVER_AREA = (0.3, 3.0)
_LONGEST_SPOOL = 60.0
_NARROWEST_ANGLES = 1.1
_SMALLEST_BANK = 1.6


def read_geometry(section: Section) -> Geometry:
    """The table `[geometry]`."""
    section.allow_only(*KEYS["[geometry]"])
    geometry = Geometry(
        wing_area=section.number("wing_area", "m²", above=0.0),
        wing_span=section.number("wing_span", "m", above=0.0),
        mean_chord=section.number("mean_chord", "m", above=0.0),
    )
    rectangle = geometry.mean_chord * geometry.wing_span
    low, high = _CHORD_SPAN_OVER_AREA
    if not low <= rectangle / geometry.wing_area <= high:
        raise section.error(
            "wing_area",
            found=f"{geometry.wing_area:g} m² beside a span of {geometry.wing_span:g} m "
            f"and a mean chord of {geometry.mean_chord:g} m",
            allowed=f"an area near span times chord, {rectangle:.4g} m²",
            fix="give all three in metres and square metres",
        )
    return geometry


def read_mass(section: Section, geometry: Geometry) -> Mass:
    """The table `[mass]`."""
    section.allow_only(*KEYS["[mass]"])
    mass = Mass(
        mass=section.number("mass", "kg", above=0.0),
        Ixx=section.number("Ixx", "kg·m²", above=0.0),
        Iyy=section.number("Iyy", "kg·m²", above=0.0),
        Izz=section.number("Izz", "kg·m²", above=0.0),
        Ixz=section.number("Ixz", "kg·m²", default=0.0),
        Ixy=section.number("Ixy", "kg·m²", default=0.0),
        Iyz=section.number("Iyz", "kg·m²", default=0.0),
        cg=position(section, geometry, "cg"),
        mass_sigma=relative_sigma(section, "mass_sigma", Mass.mass_sigma),
        inertia_sigma=relative_sigma(section, "inertia_sigma", Mass.inertia_sigma),
    )
    _check_gyration(section, mass, geometry)
    if np.linalg.eigvalsh(mass.inertia)[0] <= 0.0:
        raise section.error(
            max(("Ixz", "Ixy", "Iyz"), key=lambda key: abs(getattr(mass, key))),
            found=f"products Ixz {mass.Ixz:g}, Ixy {mass.Ixy:g}, Iyz {mass.Iyz:g} too large for "
            f"Ixx {mass.Ixx:g}, Iyy {mass.Iyy:g}, Izz {mass.Izz:g}",
            allowed="a positive definite inertia tensor (Ixz² < Ixx·Izz and alike)",
            fix="check the products of inertia, ∫xz dm, and their unit kg·m²",
        )
    return mass


def _check_gyration(section: Section, mass: Mass, geometry: Geometry) -> None:
    low, high = (limit * geometry.wing_span for limit in _GYRATION_OVER_SPAN)
    for key in ("Ixx", "Iyy", "Izz"):
        gyration = (getattr(mass, key) / mass.mass) ** 0.5
        if not low <= gyration <= high:
            raise section.error(
                key,
                found=f"{getattr(mass, key):g} kg·m² for {mass.mass:g} kg, which is a radius of "
                f"gyration of {gyration:.3g} m",
                allowed=f"a radius from {low:.3g} to {high:.3g} m on this span",
                fix="give mass in kg and inertia in kg·m²",
            )


def read_propulsion(
    top: Section, geometry: Geometry, servos: tuple[Servo, ...]
) -> tuple[Propulsion, ...]:
    """The table `[propulsion]`, or the tables `[[propulsion]]`."""
    thrusters = []
    for section in top.children("propulsion"):
        thruster = _read_thruster(section, geometry)
        for servo in servos:
            if servo.channel == thruster.throttle_channel:
                raise section.error(
                    "throttle_channel",
                    found=f"channel {servo.channel}, which moves `{servo.surface}`",
                    allowed="a channel that no [[servos]] entry has",
                    fix="correct the channel here or in [[servos]]",
                )
        thrusters.append(thruster)
    return tuple(thrusters)


def _read_thruster(section: Section, geometry: Geometry) -> Propulsion:
    section.allow_only(*KEYS["[propulsion]"])
    throttle, rpm = _settings(section)
    airspeed = section.numbers("airspeed", "m/s", at_least=2)
    _check_breakpoints(section, "airspeed", airspeed)
    shape = (len(rpm or throttle), len(airspeed))
    return Propulsion(
        throttle_channel=section.whole("throttle_channel", least=1),
        pwm=_throttle_pulses(section),
        throttle=throttle,
        airspeed=airspeed,
        thrust=section.rows("thrust", "N", shape=shape),
        axis=_unit_vector(section),
        position=position(section, geometry),
        time_constant=lag(section, "time_constant", most=_LONGEST_SPOOL),
        thrust_sigma=relative_sigma(section, "thrust_sigma", Propulsion.thrust_sigma),
        torque=section.rows("torque", "N·m", shape=shape) if section.has("torque") else None,
        rpm=rpm,
        rpm_channel=section.whole("rpm_channel", least=1) if rpm else None,
    )


def _settings(section: Section) -> tuple[tuple[float, ...], tuple[float, ...] | None]:
    """What the rows of the thrust table are: throttle settings, or rotation speeds."""
    if section.has("rpm") == section.has("throttle"):
        both = section.has("rpm")
        raise section.error(
            "rpm" if both else "throttle",
            found="`rpm` beside `throttle`" if both else "nothing",
            allowed="`throttle` (0 to 1) or `rpm`, one entry for each row of `thrust`",
            fix=f"{'keep' if both else 'add'} the one that the rows of `thrust` belong to",
        )
    if section.has("rpm"):
        rpm = section.numbers("rpm", "rpm", at_least=2)
        _check_breakpoints(section, "rpm", rpm)
        return (), rpm
    if section.has("rpm_channel"):
        raise section.error(
            "rpm_channel",
            found="a motor number without `rpm`",
            allowed="`rpm_channel` beside `rpm`",
            fix="remove `rpm_channel`, or give the thrust over `rpm`",
        )
    throttle = section.numbers("throttle", "1", at_least=2)
    _check_breakpoints(section, "throttle", throttle)
    if throttle[-1] > 1.0:
        raise section.error(
            "throttle",
            found=describe(section.data["throttle"]),
            allowed="settings from 0 to 1",
            fix="write half throttle as 0.5",
        )
    return throttle, None


def _check_breakpoints(section: Section, key: str, values: tuple[float, ...]) -> None:
    if values[0] < 0.0 or not increasing(values):
        raise section.error(
            key,
            found=describe(section.data[key]),
            allowed="numbers from 0, increasing without repeats",
            fix=f"sort `{key}`, and the table with it",
        )


def _throttle_pulses(section: Section) -> tuple[float, float]:
    idle, full = section.numbers("pwm", "µs", count=2)
    if idle == full:
        raise section.error(
            "pwm",
            found=describe(section.data["pwm"]),
            allowed="the pulses of throttle 0 and of throttle 1",
            fix="for instance pwm = [1000, 2000]",
        )
    return idle, full


def _unit_vector(section: Section) -> tuple[float, float, float]:
    axis = vector(section, "axis", "1", default=Propulsion.axis)
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise section.error(
            "axis",
            found=describe(section.data["axis"]),
            allowed="the direction of thrust in body axes",
            fix="axis = [1.0, 0.0, 0.0] for thrust straight ahead",
        )
    # An axis that is a unit vector already stays as written, so that files round-trip.
    if abs(length - 1.0) < 1e-12:
        return axis
    x, y, z = (component / length for component in axis)
    return x, y, z


def read_envelope(section: Section | None) -> Envelope | None:
    """The table `[envelope]`, or None."""
    if section is None:
        return None
    section.allow_only(*KEYS["[envelope]"])
    airspeed = _limits(section, "airspeed", "m/s")
    if airspeed[0] < 0.0:
        raise section.error(
            "airspeed",
            found=describe(section.data["airspeed"]),
            allowed="limits from 0 m/s",
            fix="give the lowest and highest airspeed that may be flown",
        )
    return Envelope(
        airspeed=airspeed,
        alpha=_angle_limits(section, "alpha"),
        beta=_angle_limits(section, "beta"),
        load_factor=_limits(section, "load_factor", "1"),
        bank=_bank(section),
        height_min=section.number("height_min", "m", least=0.0),
    )


def _limits(section: Section, key: str, unit: str) -> tuple[float, float]:
    low, high = section.numbers(key, unit, count=2)
    if low >= high:
        raise section.error(
            key,
            found=describe(section.data[key]),
            allowed="[lowest, highest]",
            fix=f"{key} = {describe(section.data[key][::-1])}" if low > high else "widen it",
        )
    return low, high


def _angle_limits(section: Section, key: str) -> tuple[float, float]:
    limits = _limits(section, key, "deg")
    low, high = section.numbers(key, "1", count=2)
    if high - low < _NARROWEST_ANGLES or max(-low, high) > 180.0:
        degrees = [round(float(np.degrees(limit)), 2) for limit in (low, high)]
        raise section.error(
            key,
            found=f"{describe(section.data[key])} deg",
            allowed=f"limits in deg, at least {_NARROWEST_ANGLES:g} apart, within 180",
            fix=f"if these are radians: {key} = {degrees}",
        )
    return limits


def _bank(section: Section) -> float:
    bank = section.number("bank", "deg", above=0.0, most=180.0)
    written = section.number("bank", "1")
    if written < _SMALLEST_BANK:
        raise section.error(
            "bank",
            found=f"{written:g} deg",
            allowed=f"a number in deg from {_SMALLEST_BANK:g} up to 180",
            fix=f"if this is radians: bank = {np.degrees(written):.1f}",
        )
    return bank
