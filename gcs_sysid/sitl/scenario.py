"""Scenarios: flights written down as TOML, with what differs between the file and what flies.

    schema = 1
    name = "demo"
    aircraft = "../../data/aircraft/ultra_stick_25e.toml"   # what the engineer believes

    [flown.aerodynamics.Cm]      # what flies: the file's value times this factor
    alpha = 0.8
    [flown.imu]                  # sensor errors that the file does not know
    accelerometer_bias = [0.1, 0.0, -0.1]       # m/s²
    gyro_bias = [0.2, 0.0, 0.0]                 # deg/s

    [[flights]]
    name = "first"
    record = "first.tlog"
    truth = "first_truth.npz"    # optional, `truth_rate` rows a second
    seed = 1
    begins = 2026-10-03T09:12:00Z
    wind = { from = 250.0, speed = 4.0, gust = 0.5 }   # deg, m/s, m/s
    plan = "standard"            # or legs = [{name, duration, airspeed, height, heading, inputs}]

Paths are relative to the scenario's folder.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, CoefficientModel, Imu, Vector
from gcs_sysid.errors import InputError
from gcs_sysid.sitl import plan
from gcs_sysid.sitl.inputs import KINDS, TestInput
from gcs_sysid.sitl.jsbsim_aircraft import Start, Wind
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.record import Flight
from gcs_sysid.sitl.telemetry import TICK_RATE


@dataclass(frozen=True)
class PlannedFlight:
    """A flight of a scenario, and where its recording and truth belong."""

    name: str
    flight: Flight
    record: Path
    truth: Path | None
    truth_rate: int


@dataclass(frozen=True)
class Scenario:
    """An aircraft as believed and as flown, and the flights it makes."""

    name: str
    aircraft: Path
    believed: Aircraft
    flown: Aircraft
    flights: tuple[PlannedFlight, ...]


def load(path: Path) -> Scenario:
    """Read a scenario.

    Raises:
        InputError: the file cannot be used; the message names the key.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(str(path), f"{error.strerror}", fix="check the path") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(path), f"not TOML ({error})", fix="correct that line") from error
    table = _Table(str(path), "", document)
    table.number("schema", 1.0)
    name = table.text("name")
    aircraft = path.parent / table.text("aircraft")
    believed = aircraft_file.load(aircraft)
    flown = _flown(believed, table.table("flown"))
    flights = tuple(
        _flight(entry, path.parent, believed, flown) for entry in table.tables("flights")
    )
    table.done()
    return Scenario(name, aircraft, believed, flown, flights)


def _flown(believed: Aircraft, table: _Table) -> Aircraft:
    aerodynamics = dict(believed.aerodynamics)
    changes = table.table("aerodynamics")
    for coefficient in list(changes.left):
        factors = changes.table(coefficient)
        aerodynamics[coefficient] = _scaled(aerodynamics.get(coefficient), factors)
    changes.done()
    imu = _imu(believed.imu, table.table("imu"))
    table.done()
    return replace(believed, aerodynamics=aerodynamics, imu=imu)


def _scaled(model: CoefficientModel | None, factors: _Table) -> CoefficientModel:
    terms = dict(model.terms) if model else {}
    for key in list(factors.left):
        if key not in terms:
            raise factors.wrong(key, "no such term in the aircraft file", " ".join(terms))
        terms[key] = replace(terms[key], value=terms[key].value * factors.number(key))
    return CoefficientModel(terms, model.tables if model else ())


def _imu(imu: Imu, table: _Table) -> Imu:
    accelerometer = table.vector("accelerometer_bias")
    gyro = table.vector("gyro_bias")
    table.done()
    return replace(
        imu,
        accelerometer=replace(imu.accelerometer, bias=_sum(imu.accelerometer.bias, accelerometer)),
        gyro=replace(imu.gyro, bias=_sum(imu.gyro.bias, _radians(gyro))),
    )


def _flight(table: _Table, folder: Path, believed: Aircraft, flown: Aircraft) -> PlannedFlight:
    legs = _legs(table, believed)
    first = legs[0]
    flight = Flight(
        believed=believed,
        flown=flown,
        legs=legs,
        wind=_wind(table.table("wind")),
        start=Start(
            height=first.height,
            airspeed=first.airspeed,
            heading_deg=math.degrees(first.heading or 0.0),
        ),
        seed=int(table.number("seed", 0.0)),
        epoch_us=table.time_us("begins"),
    )
    truth = table.text("truth", "")
    planned = PlannedFlight(
        name=table.text("name"),
        flight=flight,
        record=folder / table.text("record"),
        truth=folder / truth if truth else None,
        truth_rate=int(table.number("truth_rate", float(TICK_RATE))),
    )
    table.done()
    return planned


def _wind(table: _Table) -> Wind:
    blows_from, speed = math.radians(table.number("from", 0.0)), table.number("speed", 0.0)
    gust = table.number("gust", 0.0)
    table.done()
    steady = (-speed * math.cos(blows_from), -speed * math.sin(blows_from), 0.0)
    return Wind(steady=steady, gust=gust)


def _legs(table: _Table, aircraft: Aircraft) -> tuple[Leg, ...]:
    if "legs" not in table.left:
        name = table.text("plan", "standard")
        if name != "standard":
            raise table.wrong("plan", f"found `{name}`", '"standard", or `legs` instead of it')
        return plan.standard(aircraft)
    return tuple(_leg(entry) for entry in table.tables("legs"))


def _leg(table: _Table) -> Leg:
    leg = Leg(
        name=table.text("name"),
        duration=table.number("duration"),
        airspeed=table.number("airspeed"),
        height=table.number("height"),
        heading=math.radians(table.number("heading")),
        bank=math.radians(table.number("bank", 35.0)),
        inputs=tuple(_input(entry) for entry in table.tables("inputs", ())),
    )
    table.done()
    return leg


def _input(table: _Table) -> TestInput:
    kind = table.text("kind")
    if kind not in KINDS:
        raise table.wrong("kind", f"found `{kind}`", ", ".join(KINDS))
    in_deg = "amplitude_deg" in table.left
    amplitude = math.radians(table.number("amplitude_deg")) if in_deg else table.number("amplitude")
    test = TestInput(
        control=table.text("control"),
        kind=kind,  # ty: ignore[invalid-argument-type] (checked above)
        start=table.number("start"),
        duration=table.number("duration"),
        amplitude=amplitude,
        lines=tuple(int(line) for line in table.value("lines", ())),
    )
    table.done()
    return test


_MISSING = object()


class _Table:
    """A TOML table being read: every key must be known, and is taken once."""

    def __init__(self, file: str, path: str, values: Mapping[str, Any]) -> None:
        self._file = file
        self._path = path
        self.left = dict(values)

    def wrong(self, key: str, found: str, allowed: str) -> InputError:
        where = f"{self._file}: {self._path}{key}"
        return InputError(where, f"{found}, allowed: {allowed}", fix="correct it")

    def value(self, key: str, default: Any = _MISSING) -> Any:
        if key not in self.left and default is _MISSING:
            raise self.wrong(key, "missing", "a value")
        return self.left.pop(key, default)

    def text(self, key: str, default: Any = _MISSING) -> str:
        value = self.value(key, default)
        if not isinstance(value, str):
            raise self.wrong(key, f"found {value!r}", "a text")
        return value

    def number(self, key: str, default: Any = _MISSING) -> float:
        value = self.value(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.wrong(key, f"found {value!r}", "a number")
        return float(value)

    def vector(self, key: str) -> Vector:
        value = self.value(key, (0.0, 0.0, 0.0))
        if len(value) != 3:
            raise self.wrong(key, f"found {value!r}", "three numbers")
        x, y, z = (float(v) for v in value)
        return x, y, z

    def time_us(self, key: str) -> int:
        value = self.value(key)
        if not isinstance(value, datetime) or value.tzinfo is None:
            raise self.wrong(key, f"found {value!r}", "a time such as 2026-10-03T09:12:00Z")
        return round(value.timestamp() * 1e6)

    def table(self, key: str) -> _Table:
        return _Table(self._file, f"{self._path}{key}.", self.value(key, {}))

    def tables(self, key: str, default: Any = _MISSING) -> list[_Table]:
        entries = self.value(key, default)
        return [
            _Table(self._file, f"{self._path}{key}[{i}].", entry) for i, entry in enumerate(entries)
        ]

    def done(self) -> None:
        if self.left:
            raise self.wrong(next(iter(self.left)), "unknown key", "the keys of the example")


def _radians(degrees: Vector) -> Vector:
    x, y, z = (math.radians(angle) for angle in degrees)
    return x, y, z


def _sum(first: tuple[float, ...], second: Vector) -> Vector:
    x, y, z = (a + b for a, b in zip(first, second, strict=True))
    return x, y, z
