"""Scenarios: flights written down as TOML, and how what flies differs from the aircraft file.

    schema = 1
    name = "demo"
    aircraft = "../../data/aircraft/ultra_stick_25e.toml"   # what the engineer believes

    [flown.aerodynamics.Cm]      # what flies: the aircraft file with these entries for its own
    alpha = -0.578
    [flown.imu.gyro]
    bias = [0.2, 0.0, 0.0]

    [[effects]]                  # optional: what else nobody is told, as in an effect file
    name = "cg_shift"
    cg_x_chord = -0.08

    [[flights]]
    name = "first"
    record = "first.tlog"        # optional: where the recording belongs
    truth = "first_truth.npz"    # optional, `truth_rate` rows a second
    seed = 1
    begins = 2026-10-03T09:12:00Z
    wind = { from = 250.0, speed = 4.0, gust = 0.5 }   # deg, m/s, m/s
    # optional, with these defaults: radio [s, s, 1], rates of messages [Hz, 0 for none], noise of
    # the sensors (see `Noise`), and when the flight computer restarts in flight [s]
    link = { latency = 0.004, jitter = 0.002, loss = 0.01 }
    rates = { ATTITUDE = 50, VFR_HUD = 25 }
    noise = { gyro = 0.004 }
    # fuel = { mass = 1.5, burn = 0.001 }      # kg of the aircraft's mass, kg/s at full throttle
    # reboot = 60
    # without `legs` those of the scenario, [[legs]], and without them the standard flight
    legs = [{ name = "out", duration = 20, airspeed = 17, height = 120, heading = 0 }]

    [[flights]]                  # or one that was recorded elsewhere
    name = "second"
    log = "second.tlog"

Paths are relative to the scenario's folder, angles in degrees.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.aircraft_toml.section import Section, describe
from gcs_sysid.errors import InputError
from gcs_sysid.sitl import plan, status
from gcs_sysid.sitl.effects import catalogue
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.inputs import KINDS, TestInput
from gcs_sysid.sitl.jsbsim_aircraft import Start, Wind
from gcs_sysid.sitl.jsbsim_xml import Fuel
from gcs_sysid.sitl.link import Link
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.sensors import Noise
from gcs_sysid.sitl.telemetry import RATES, TICK_RATE

Parts = TypeVar("Parts", Noise, Link)

_INPUT_KEYS = ("control", "kind", "start", "duration", "amplitude", "amplitude_deg", "lines")


@dataclass(frozen=True)
class PlannedFlight:
    """A flight, where its recording and truth belong, and what scoring may know of it."""

    name: str
    flight: Flight
    record: Path | None = None
    truth: Path | None = None
    truth_rate: int = TICK_RATE
    told: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Scenario:
    """An aircraft as believed and as flown, effects not counted, and the flights it makes.

    Attributes:
        name: of the scenario.
        aircraft: file of the aircraft as believed.
        believed: what it holds.
        flown: what flies.
        flights: to be flown.
        logs: recorded elsewhere, by name.
    """

    name: str
    aircraft: Path
    believed: Aircraft
    flown: Aircraft
    flights: tuple[PlannedFlight, ...]
    logs: Mapping[str, Path] = field(default_factory=dict)


def load(path: Path) -> Scenario:
    """Read a scenario.

    Raises:
        InputError: the scenario or its aircraft file cannot be used; the message names the key.
    """
    top = Section(str(path), "", _document(path))
    top.allow_only("schema", "name", "aircraft", "flown", "effects", "legs", "flights")
    top.whole("schema", least=1)
    source = path.parent / top.text("aircraft")
    believed = aircraft_file.load(source)
    changes = top.child("flown")
    merged = _merged(_document(source), changes.data if changes else {})
    flown = aircraft_file.from_table(merged, name=f"{path}: [flown] over {source.name}")
    entries = top.children("flights", name_key="name")
    flights = [entry for entry in entries if not entry.has("log")]
    effects = top.children("effects", name_key="name")
    told = {"flown": changes.data} if changes else {}
    legs = _legs(top)
    return Scenario(
        name=top.text("name"),
        aircraft=source,
        believed=believed,
        flown=flown,
        flights=tuple(
            hiding(_flight(entry, path.parent, believed, flown, legs), effects, told)
            for entry in flights
        ),
        logs=dict(_log(entry, path.parent) for entry in entries if entry.has("log")),
    )


def hiding(
    planned: PlannedFlight, effects: Sequence[Section], more: Mapping[str, Any] | None = None
) -> PlannedFlight:
    """The flight with effects hidden in it; `more` is told with the truth."""
    flight = catalogue.hide(planned.flight, effects)
    told = catalogue.truth(flight, effects, more or {})
    return replace(planned, flight=flight, told=told)


def _document(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(str(path), "no such file", fix="check the path") from error
    except ValueError as error:
        raise InputError(str(path), f"no TOML ({error})", fix="correct it there") from error


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """`base` with the entries of `changes` for its own, table by table."""
    merged = dict(base)
    for key, value in changes.items():
        old = base.get(key)
        both = isinstance(old, Mapping) and isinstance(value, Mapping)
        merged[key] = _merged(old, value) if both else value
    return merged


def _legs(entry: Section) -> tuple[Leg, ...]:
    return tuple(_leg(leg) for leg in entry.children("legs", name_key="name"))


def _flight(
    entry: Section, folder: Path, believed: Aircraft, flown: Aircraft, usual: tuple[Leg, ...]
) -> PlannedFlight:
    entry.allow_only(
        *("name", "record", "truth", "truth_rate", "seed", "begins", "wind", "legs"),
        *("link", "rates", "noise", "fuel", "reboot"),
    )
    legs = _legs(entry) or usual or plan.standard(believed)
    return PlannedFlight(
        name=entry.text("name"),
        flight=Flight(
            believed=believed,
            flown=flown,
            legs=legs,
            wind=_wind(entry.child("wind")),
            noise=_numbers(entry.child("noise"), Noise()),
            link=_numbers(entry.child("link"), Link()),
            rates=_rates(entry.child("rates")),
            fuel=_fuel(entry.child("fuel"), flown),
            reboot=entry.optional_number("reboot", "s", least=0.0),
            start=start(legs[0]),
            seed=entry.whole("seed", least=0),
            epoch_us=_time_us(entry, "begins"),
        ),
        record=folder / entry.text("record") if entry.has("record") else None,
        truth=folder / entry.text("truth") if entry.has("truth") else None,
        truth_rate=entry.whole("truth_rate", least=1) if entry.has("truth_rate") else TICK_RATE,
    )


def _numbers(entry: Section | None, usual: Parts) -> Parts:
    """A record of numbers from zero, with the entries of the file for its own."""
    if entry is None:
        return usual
    entry.allow_only(*(part.name for part in fields(usual)))
    return replace(usual, **{key: entry.number(key, "1", least=0.0) for key in entry.data})


def _fuel(entry: Section | None, flown: Aircraft) -> Fuel | None:
    if entry is None:
        return None
    entry.allow_only("mass", "burn")
    whole = flown.mass.mass
    return Fuel(entry.number("mass", "kg", above=0.0, most=whole), entry.number("burn", "kg/s"))


def _rates(entry: Section | None) -> Mapping[str, int]:
    """Message rates of a recording, those of a good link where the file says nothing."""
    if entry is None:
        return RATES
    entry.allow_only(*status.BUILDERS)
    rates = {**RATES, **{name: entry.whole(name, least=0) for name in entry.data}}
    for name, rate in rates.items():
        if rate and TICK_RATE % rate:
            raise entry.error(
                name,
                found=f"{rate} Hz",
                allowed=f"a divisor of {TICK_RATE} Hz, the rate of the main loop, or 0",
                fix="take the nearest of these",
            )
    return {name: rate for name, rate in rates.items() if rate}


def _log(entry: Section, folder: Path) -> tuple[str, Path]:
    entry.allow_only("name", "log")
    return entry.text("name"), folder / entry.text("log")


def start(leg: Leg) -> Start:
    """A start on the targets of the first leg."""
    return Start(
        height=leg.height,
        airspeed=leg.airspeed,
        heading=leg.heading,
    )


def _wind(entry: Section | None) -> Wind:
    if entry is None:
        return Wind()
    entry.allow_only("from", "speed", "gust")
    return wind(
        entry.number("from", "deg", default=0.0),
        entry.number("speed", "m/s", default=0.0, least=0.0),
        entry.number("gust", "m/s", default=0.0, least=0.0),
    )


def wind(blows_from: float, speed: float, gust: float) -> Wind:
    """Wind from a direction [rad] at a speed, with vertical gusts of sigma `gust` [m/s]."""
    steady = (-speed * math.cos(blows_from), -speed * math.sin(blows_from), 0.0)
    return Wind(steady=steady, gust=gust)


def _leg(entry: Section) -> Leg:
    entry.allow_only("name", "duration", "airspeed", "height", "heading", "bank", "inputs")
    return Leg(
        name=entry.text("name"),
        duration=entry.number("duration", "s", above=0.0),
        airspeed=entry.number("airspeed", "m/s", above=0.0),
        height=entry.number("height", "m", above=0.0),
        heading=entry.number("heading", "deg"),
        bank=entry.number("bank", "deg", default=math.radians(35.0), above=0.0, most=75.0),
        inputs=tuple(_input(test) for test in entry.children("inputs", name_key="control")),
    )


def _input(entry: Section) -> TestInput:
    entry.allow_only(*_INPUT_KEYS)
    key, unit = ("amplitude_deg", "deg") if entry.has("amplitude_deg") else ("amplitude", "1")
    kind = KINDS[KINDS.index(entry.text("kind", allowed=KINDS))]
    lines = entry.numbers("lines", "1") if kind == "multisine" else ()
    return TestInput(
        control=entry.text("control"),
        kind=kind,
        start=entry.number("start", "s", least=0.0),
        duration=entry.number("duration", "s", above=0.0),
        amplitude=entry.number(key, unit),
        lines=tuple(round(line) for line in lines),
    )


def _time_us(entry: Section, key: str) -> int:
    value = entry.data.get(key)
    if not isinstance(value, datetime) or value.tzinfo is None:
        raise entry.error(
            key,
            found=describe(value),
            allowed="a date and time with its zone",
            fix=f"for instance {key} = 2026-10-03T09:12:00Z",
        )
    return round(value.timestamp() * 1e6)
