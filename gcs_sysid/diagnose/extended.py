"""An aircraft file with what was found wrong put right."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from gcs_sysid.aircraft import (
    Aircraft,
    CoefficientModel,
    Control,
    SensorError,
    Servo,
    StreamTiming,
    Value,
    Vector,
)
from gcs_sysid.model import servo_changes

OUTSIDE = ("heading", "shear")
"""No word of an aircraft file: the one is the autopilot's, the other the day's."""


Direction = Mapping[str, float]
"""Change of the flight model's parameters with one unit of a quantity."""


def corrected(
    aircraft: Aircraft,
    wrong: Mapping[str, tuple[float, float]],
    directions: Mapping[str, Direction] = MappingProxyType({}),
    limits: Mapping[str, float] = MappingProxyType({}),
) -> Aircraft:
    """The file with what was found put right.

    Args:
        aircraft: the file.
        wrong: value and standard deviation of each quantity that is wrong.
        directions: of quantities that are changes of the aerodynamics, or delays.
        limits: rate limit found [rad/s], by control.
    """
    for name, (value, deviation) in wrong.items():
        kind, _, which = name.partition(".")
        if kind in OUTSIDE:
            continue
        if kind in _SIMPLE:
            aircraft = _SIMPLE[kind](aircraft, value, deviation)
        elif kind in _OF_AXIS:
            aircraft = _OF_AXIS[kind](aircraft, int(which), value)
        elif kind == "skew":
            inertial = "sensors.surface_delay" in directions[name]
            skewed = (other.split(".") for other in directions if other.startswith("skew."))
            streams = dict.fromkeys(stream for _, stream, *_ in skewed)
            own = which.partition(".")[0]
            early = [stream for stream in streams if stream != own] if inertial else [own]
            aircraft = _late(aircraft, early, -value if inertial else value, deviation)
        elif kind == "rate_limit":
            control = which.partition(".")[0]
            change = servo_changes.rate_limit(limits[control])
            aircraft = servo_changes.changed(aircraft, control, change)
        elif kind in _OF_SERVO:
            aircraft = servo_changes.changed(aircraft, which, _OF_SERVO[kind](value))
        elif kind == "effectiveness" and f"aeroelastic.{which}" not in wrong:
            aircraft = _effectiveness(aircraft, which, 1.0 + value)
        elif name in directions:
            aircraft = _terms(aircraft, directions[name], value, deviation)
        else:
            raise ValueError(f"`{name}` has no place in an aircraft file")
    return aircraft


def _terms(aircraft: Aircraft, along: Direction, value: float, deviation: float) -> Aircraft:
    """The aerodynamics moved along a direction, uncertain by its size."""
    models = dict(aircraft.aerodynamics)
    for name, weight in along.items():
        kind, _, rest = name.partition(".")
        if kind != "aerodynamics" or weight == 0.0:
            continue
        coefficient, _, key = rest.partition(".")
        model = models.get(coefficient, CoefficientModel())
        old = model.terms.get(key, Value(0.0, 0.0))
        sigma = float(np.hypot(old.sigma, weight * deviation))
        terms = {**model.terms, key: Value(old.value + weight * value, sigma)}
        models[coefficient] = replace(model, terms=terms)
    return replace(aircraft, aerodynamics=models)


def _mass(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    body = aircraft.mass
    sigma = deviation / (1.0 + value)
    return replace(aircraft, mass=replace(body, mass=body.mass * (1.0 + value), mass_sigma=sigma))


def _cg(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    x, y, z = aircraft.mass.cg
    place = (x + value * aircraft.geometry.mean_chord, y, z)
    return replace(aircraft, mass=replace(aircraft.mass, cg=place))


def _airspeed_scale(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    error = aircraft.pitot.error
    scale = (1.0 + error.scale[0]) * (1.0 + value) - 1.0
    changed = replace(error, scale=(scale,), scale_sigma=deviation)
    return replace(aircraft, pitot=replace(aircraft.pitot, error=changed))


def _airspeed_lag(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    error = aircraft.pitot.error
    changed = replace(error, lag=max(error.lag + value, 0.0), lag_sigma=deviation)
    return replace(aircraft, pitot=replace(aircraft.pitot, error=changed))


def _thrust(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    engines = tuple(
        replace(
            engine,
            thrust=tuple(tuple((1.0 + value) * item for item in row) for row in engine.thrust),
            thrust_sigma=deviation / (1.0 + value),
        )
        for engine in aircraft.propulsion
    )
    return replace(aircraft, propulsion=engines)


def _thrust_drop(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    engines = tuple(
        replace(engine, position=_plus(engine.position, 2, value)) for engine in aircraft.propulsion
    )
    return replace(aircraft, propulsion=engines)


def _thrust_tilt(aircraft: Aircraft, value: float, deviation: float) -> Aircraft:
    cosine, sine = float(np.cos(value)), float(np.sin(value))
    engines = []
    for engine in aircraft.propulsion:
        x, y, z = engine.axis
        axis = (x * cosine + z * sine, y, z * cosine - x * sine)
        engines.append(replace(engine, axis=axis))
    return replace(aircraft, propulsion=tuple(engines))


def _inertia(aircraft: Aircraft, axis: int, value: float) -> Aircraft:
    name = ("Ixx", "Iyy", "Izz")[axis]
    moment = (1.0 + value) * getattr(aircraft.mass, name)
    return replace(aircraft, mass=replace(aircraft.mass, **{name: moment}))


def _accelerometer_bias(aircraft: Aircraft, axis: int, value: float) -> Aircraft:
    unit = aircraft.imu
    error = replace(unit.accelerometer, bias=_plus(_three(unit.accelerometer.bias), axis, value))
    return replace(aircraft, imu=replace(unit, accelerometer=error))


def _gyro_scale(aircraft: Aircraft, axis: int, value: float) -> Aircraft:
    unit = aircraft.imu
    error = replace(unit.gyro, scale=_plus(_three(unit.gyro.scale), axis, value))
    return replace(aircraft, imu=replace(unit, gyro=error))


def _imu_tilt(aircraft: Aircraft, axis: int, value: float) -> Aircraft:
    unit = aircraft.imu
    tilt = _plus(unit.misalignment, axis, value)
    return replace(aircraft, imu=replace(unit, misalignment=tilt))


def _imu_position(aircraft: Aircraft, axis: int, value: float) -> Aircraft:
    unit = aircraft.imu
    return replace(aircraft, imu=replace(unit, position=_plus(unit.position, axis, value)))


def _vane_bias(aircraft: Aircraft, axis: int, value: float) -> Aircraft:
    vanes = aircraft.vanes
    if vanes is None:
        return aircraft
    name = ("alpha", "beta")[axis]
    error: SensorError = getattr(vanes, name)
    biased = replace(error, bias=(error.bias[0] + value,))
    return replace(aircraft, vanes=replace(vanes, **{name: biased}))


def _effectiveness(aircraft: Aircraft, control: str, ratio: float) -> Aircraft:
    """In the servos where they move this control only, else in its mix."""
    mix = next(item.mix for item in aircraft.controls if item.name == control)
    elsewhere = {
        surface for item in aircraft.controls if item.name != control for surface in item.mix
    }
    if set(mix) & elsewhere:
        controls = tuple(_remixed(item, ratio, control) for item in aircraft.controls)
        return replace(aircraft, controls=controls)
    servos = tuple(_weakened(servo, ratio, mix) for servo in aircraft.servos)
    return replace(aircraft, servos=servos)


def _remixed(item: Control, ratio: float, control: str) -> Control:
    if item.name != control:
        return item
    return replace(item, mix={surface: ratio * gain for surface, gain in item.mix.items()})


def _weakened(servo: Servo, ratio: float, mix: Mapping[str, float]) -> Servo:
    if servo.surface not in mix:
        return servo
    return replace(servo, effectiveness=ratio * servo.effectiveness)


def _late(aircraft: Aircraft, late: list[str], value: float, deviation: float) -> Aircraft:
    """Streams later than the file says."""
    streams = dict(aircraft.streams)
    for name in late:
        old = streams.get(name, StreamTiming())
        streams[name] = replace(old, delay=old.delay + value, sigma=deviation)
    return replace(aircraft, streams=streams)


def _plus(vector: Vector, axis: int, value: float) -> Vector:
    moved = list(vector)
    moved[axis] += value
    x, y, z = moved
    return x, y, z


def _three(values: tuple[float, ...]) -> Vector:
    x, y, z = values if len(values) == 3 else (values[0],) * 3
    return x, y, z


_SIMPLE: Mapping[str, Callable[[Aircraft, float, float], Aircraft]] = {
    "mass": _mass,
    "cg": _cg,
    "airspeed": _airspeed_scale,
    "airspeed_lag": _airspeed_lag,
    "thrust": _thrust,
    "thrust_drop": _thrust_drop,
    "thrust_tilt": _thrust_tilt,
}
_OF_AXIS: Mapping[str, Callable[[Aircraft, int, float], Aircraft]] = {
    "inertia": _inertia,
    "accelerometer_bias": _accelerometer_bias,
    "gyro_scale": _gyro_scale,
    "imu_tilt": _imu_tilt,
    "imu_position": _imu_position,
    "vane_bias": _vane_bias,
}
_OF_SERVO: Mapping[str, Callable[[float], servo_changes.Change]] = {
    "lag": lambda value: servo_changes.lag(max(value, 0.0)),
    "backlash": lambda value: servo_changes.backlash(max(value, 0.0)),
    "offset": servo_changes.offset,
}
