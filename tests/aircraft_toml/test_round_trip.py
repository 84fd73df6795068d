"""Whatever aircraft the program can hold, its file says the same."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid import aircraft_file, regressors
from gcs_sysid.aircraft import (
    COEFFICIENTS,
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
from gcs_sysid.aircraft_toml.section import quoted_key, quoted_text, to_si

FULL = (Path(__file__).parents[1] / "reference" / "every_key.toml").read_text()
CONTROLS = ("elevator", "aileron")


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False).filter(lambda x: abs(x) > 1e-9)


def degrees(low: float, high: float, unit: str = "deg") -> st.SearchStrategy[float]:
    """Angles [rad] that some number of degrees gives, as every file's do."""
    return number(low, high).map(lambda angle: to_si(angle, unit))


def vector(component: st.SearchStrategy[float]) -> st.SearchStrategy[tuple]:
    return st.tuples(component, component, component)


def increasing(low: float, high: float, count: int) -> st.SearchStrategy[tuple]:
    return st.lists(number(low, high), min_size=count, max_size=count, unique=True).map(
        lambda values: tuple(sorted(values))
    )


def maybe(strategy: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | strategy


def rows(count: int, columns: int) -> st.SearchStrategy[tuple]:
    row = st.tuples(*[number(-50.0, 50.0)] * columns)
    return st.tuples(*[row] * count)


def recipe(kind: type, **parts: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Draws the arguments of `kind`; `build` makes it.

    The type checker of the tests picks random entries of containers to look at, which hypothesis
    forbids while it draws.
    """
    return st.fixed_dictionaries(parts).map(lambda arguments: (kind, arguments))


def build(drawn: Any) -> Any:
    if isinstance(drawn, tuple) and drawn and isinstance(drawn[0], type):
        return drawn[0](**build(drawn[1]))
    if isinstance(drawn, dict):
        return {key: build(value) for key, value in drawn.items()}
    return tuple(map(build, drawn)) if isinstance(drawn, tuple) else drawn


sigmas = number(0.001, 0.9)
names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1).filter(
    lambda text: bool(text.strip())
)
positions = vector(number(-2.0, 2.0))
masses = recipe(
    Mass,
    mass=number(1.0, 20.0),
    Ixx=number(0.5, 2.0),
    Iyy=number(0.5, 2.0),
    Izz=number(0.5, 2.0),
    Ixz=number(-0.2, 0.2),
    Ixy=number(-0.1, 0.1),
    Iyz=st.just(0.0),
    cg=positions,
    mass_sigma=sigmas,
    inertia_sigma=sigmas,
)


def errors(axes: int, bias: st.SearchStrategy[float]) -> st.SearchStrategy[SensorError]:
    return recipe(
        SensorError,
        bias=st.tuples(*[bias] * axes),
        scale=st.tuples(*[number(-0.3, 0.3)] * axes),
        lag=number(0.0, 1.0),
        bias_sigma=maybe(bias.map(abs)),
        scale_sigma=maybe(sigmas),
        lag_sigma=maybe(sigmas),
    )


imus = recipe(
    Imu,
    position=positions,
    misalignment=vector(degrees(-20.0, 20.0)),
    misalignment_sigma=maybe(degrees(0.0, 5.0)),
    accelerometer=errors(3, number(-1.0, 1.0)),
    gyro=errors(3, degrees(-5.0, 5.0, "deg/s")),
)
pitots = recipe(
    Pitot,
    position=positions,
    measures=st.sampled_from(["EAS", "CAS", "TAS"]),
    error=errors(1, number(-2.0, 2.0)),
)
vanes = recipe(
    Vanes,
    position=positions,
    upwash=number(-0.5, 0.5),
    alpha=errors(1, degrees(-5.0, 5.0)),
    beta=errors(1, degrees(-5.0, 5.0)),
    upwash_sigma=maybe(sigmas),
)
streams = st.dictionaries(
    names, recipe(StreamTiming, delay=number(-1.0, 1.0), sigma=maybe(sigmas)), max_size=2
)


@st.composite
def servos(draw: st.DrawFn) -> tuple[Any, ...]:
    surfaces = draw(st.lists(names, min_size=2, max_size=3, unique=True))
    return tuple(
        draw(
            recipe(
                Servo,
                channel=st.just(index + 5),
                surface=st.just(surface),
                pwm=increasing(800.0, 2200.0, 3),
                deflection=increasing(1.2, 90.0, 3).map(
                    lambda angles: tuple(to_si(angle, "deg") for angle in angles)
                ),
                time_constant=number(0.0, 1.0),
                delay=number(0.0, 1.0),
                rate_limit=maybe(degrees(1.0, 500.0, "deg/s")),
                backlash=degrees(0.0, 3.0),
                offset=degrees(-5.0, 5.0),
                effectiveness=number(0.1, 2.0),
            )
        )
        for index, surface in enumerate(surfaces)
    )


@st.composite
def thrusters(draw: st.DrawFn) -> tuple[type, dict[str, Any]]:
    over_rpm = draw(st.booleans())
    settings = draw(increasing(0.0, 1.0, 2))
    axis = np.array(draw(vector(number(0.1, 1.0))))
    return Propulsion, {
        "throttle_channel": draw(st.integers(1, 4)),
        "pwm": draw(increasing(800.0, 2200.0, 2)),
        "throttle": () if over_rpm else settings,
        "airspeed": draw(increasing(0.0, 60.0, 3)),
        "thrust": draw(rows(2, 3)),
        "axis": tuple(map(float, axis / np.linalg.norm(axis))),
        "position": draw(positions),
        "time_constant": draw(number(0.0, 1.0)),
        "thrust_sigma": draw(sigmas),
        "torque": draw(maybe(rows(2, 3))),
        "rpm": settings if over_rpm else None,
        "rpm_channel": draw(st.integers(1, 8)) if over_rpm else None,
    }


envelopes = recipe(
    Envelope,
    airspeed=increasing(0.0, 90.0, 2),
    alpha=st.tuples(degrees(-20.0, -1.0), degrees(1.0, 30.0)),
    beta=st.tuples(degrees(-20.0, -1.0), degrees(1.0, 30.0)),
    load_factor=increasing(-5.0, 9.0, 2),
    bank=degrees(5.0, 180.0),
    height_min=number(0.0, 500.0),
)
values = recipe(Value, value=st.just(0.0) | number(-90.0, 90.0), sigma=number(1e-6, 1e3)) | number(
    -90.0, 90.0
).map(lambda value: (Value, {"value": value, "sigma": 0.1 * abs(value)}))
keys = st.sampled_from(
    ["1", "alpha", "alpha^2", "phat", "Tc*elevator", "alpha*aileron", "max(0, alpha - 0.12)"]
)
tables = st.one_of(
    recipe(
        TableTerm,
        name=names.map(lambda name: f"table {name}"),
        regressors=st.just(("alpha", "elevator")),
        breakpoints=st.tuples(increasing(-1.0, 1.0, 2), increasing(-1.0, 1.0, 3)),
        values=rows(2, 3),
        sigma=sigmas,
    ),
    recipe(
        TableTerm,
        name=names.map(lambda name: f"curve {name}"),
        regressors=st.just(("qbar",)),
        breakpoints=st.tuples(increasing(0.0, 900.0, 3)),
        values=vector(number(-1.0, 1.0)),
        sigma=sigmas,
    ),
)
models = recipe(
    CoefficientModel,
    terms=st.dictionaries(keys, values, max_size=4),
    tables=st.lists(tables, max_size=2, unique_by=lambda table: table[1]["name"]).map(tuple),
)


@st.composite
def aircraft(draw: st.DrawFn) -> dict[str, Any]:
    moved = draw(servos())
    first, second = (arguments["surface"] for _, arguments in moved[:2])
    mixes = (
        {first: draw(number(0.1, 2.0))},
        {second: draw(number(0.1, 2.0)), first: draw(number(-1.0, 1.0))},
    )
    return {
        "name": draw(names),
        "mass": draw(masses),
        "geometry": draw(
            recipe(
                Geometry,
                wing_area=st.just(0.55),
                wing_span=st.just(2.8956),
                mean_chord=number(0.1, 0.4),
            )
        ),
        "imu": draw(imus),
        "pitot": draw(pitots),
        "vanes": draw(maybe(vanes)),
        "streams": draw(streams),
        "servos": moved,
        "controls": tuple(
            (Control, {"name": name, "mix": mix}) for name, mix in zip(CONTROLS, mixes, strict=True)
        ),
        "propulsion": tuple(draw(st.lists(thrusters(), max_size=2))),
        "envelope": draw(maybe(envelopes)),
        "aerodynamics": draw(st.dictionaries(st.sampled_from(COEFFICIENTS), models, max_size=3)),
    }


@given(aircraft())
@settings(deadline=None, max_examples=30)
def test_any_aircraft_is_read_back_as_it_was_written(drawn: dict[str, Any]) -> None:
    original = Aircraft(**build(drawn))
    text = aircraft_file.dumps(original)
    assert aircraft_file.loads(text) == original


@given(st.floats(-math.pi, math.pi))
@settings(deadline=None, max_examples=30)
def test_any_angle_is_kept_to_the_last_place(angle: float) -> None:
    """An angle that was never in a file may be one that no decimal number of degrees gives."""
    base = aircraft_file.loads(FULL)
    imu = replace(base.imu, misalignment=(angle, 0.0, 0.0))
    again = aircraft_file.loads(aircraft_file.dumps(replace(base, imu=imu)))
    assert again.imu.misalignment[0] == pytest.approx(angle, rel=2.3e-16, abs=1e-300)


@given(number(-90.0, 90.0), number(1e-6, 9.0))
@settings(deadline=None, max_examples=30)
def test_any_sigma_is_kept_exactly(value: float, sigma: float) -> None:
    base = aircraft_file.loads(FULL)
    model = CoefficientModel({"alpha": Value(value, sigma)})
    again = aircraft_file.loads(aircraft_file.dumps(replace(base, aerodynamics={"Cm": model})))
    assert again.aerodynamics["Cm"].terms["alpha"] == Value(value, sigma)


@given(names)
@settings(deadline=None)
def test_any_text_is_quoted_as_toml_wants_it(text: str) -> None:
    assert tomllib.loads(f"{quoted_key(text)} = {quoted_text(text)}") == {text: text}


def test_the_structure_of_an_aircraft_survives_its_file() -> None:
    base = aircraft_file.loads(FULL)
    again = aircraft_file.loads(aircraft_file.dumps(base))
    assert regressors.default_structure(again) == regressors.default_structure(base)
