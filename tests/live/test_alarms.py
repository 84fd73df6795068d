"""Sensors that stand still, fall silent, hold no number or disagree are told, and not believed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.live import document
from gcs_sysid.live.alarms import AGREED_S, FROZEN_S, SILENT_S, Alarms
from gcs_sysid.live.coefficients import KEPT
from gcs_sysid.live.commands import SILENT_S as SILENT_COMMANDS_S
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.live.warming import _flight
from gcs_sysid.model.kinematics import BLOCKS
from gcs_sysid.recording import NO_AUTOPILOT, Vehicle
from gcs_sysid.sources.link import now_us
from gcs_sysid.sources.samples import LiveClock, Sample

Fault = Callable[[Sample], Sample | None]
BEGINS_S = 5.0
"""When a fault begins: the filter has started."""


def longer(aircraft: Aircraft, seconds: float) -> Iterator[Sample]:
    """The made-up flight over and over, on a clock that goes on."""
    flight = list(_flight(aircraft))
    length = flight[-1].time_us + 20_000
    for lap in range(1 + int(seconds * 1e6) // length):
        for sample in flight:
            time_us = sample.time_us + lap * length
            if time_us < seconds * 1e6:
                yield Sample(sample.stream, time_us, time_us, True, sample.channels)


def flown(
    aircraft: Aircraft, compiled: Compiled, fault: Fault, seconds: float = 14.0
) -> tuple[Station, dict]:
    now = [0]
    station = Station(aircraft, compiled, prior=None, vehicle=None, clock_us=lambda: now[0])
    for sample in longer(aircraft, seconds):
        now[0] = sample.link_us
        given = fault(sample) if sample.time_us * 1e-6 >= BEGINS_S else sample
        station.take([] if given is None else [given])
        station.work(2**62)
    told = document.document(station, document.Outside(link="", phase="", now_us=now[0]))
    return station, told


def alarmed(told: dict) -> set[tuple[str, str]]:
    return {(one["kind"], one["what"]) for one in told["alarms"]}


@pytest.fixture(scope="module")
def healthy(aircraft: Aircraft, compiled: Compiled) -> tuple[Station, dict]:
    return flown(aircraft, compiled, lambda sample: sample)


def test_a_healthy_flight_has_no_alarms(healthy) -> None:
    station, told = healthy
    assert told["alarms"] == []
    assert station.updates > 400
    assert station.alarms.left_out == 0


def test_airspeed_that_freezes_is_left_out_and_its_uncertainty_shows(
    healthy, aircraft: Aircraft, compiled: Compiled
) -> None:
    held: dict[str, float] = {}

    def freeze(sample: Sample) -> Sample:
        if sample.stream != "VFR_HUD":
            return sample
        held.setdefault("airspeed", sample.channels["airspeed"])
        return Sample(sample.stream, sample.time_us, sample.link_us, True, dict(held))

    station, told = flown(aircraft, compiled, freeze)
    assert ("frozen", "VFR_HUD") in alarmed(told)
    (words,) = (one["words"] for one in told["alarms"] if one["kind"] == "frozen")
    assert words.startswith("VFR_HUD repeats itself for")
    airspeed = [one.time_us * 1e-6 for one in longer(aircraft, 14.0) if one.stream == "VFR_HUD"]
    left_out = sum(time_s > BEGINS_S + FROZEN_S for time_s in airspeed)
    assert left_out > 100
    assert station.alarms.left_out == pytest.approx(left_out, abs=3)
    sound, _ = healthy
    assert station.newest is not None
    assert sound.newest is not None
    assert station.newest.flow_covariance[0, 0] > 2.0 * sound.newest.flow_covariance[0, 0]
    apart = abs(station.newest.flow[0] - sound.newest.flow[0])
    assert apart < 3.0 * math.sqrt(station.newest.flow_covariance[0, 0])


def test_an_inertial_unit_that_freezes_stops_the_states_and_says_so(
    aircraft: Aircraft, compiled: Compiled
) -> None:
    held: dict[str, float] = {}

    def freeze(sample: Sample) -> Sample:
        if sample.stream != "RAW_IMU":
            return sample
        held.update({} if held else sample.channels)
        return Sample(sample.stream, sample.time_us, sample.link_us, True, dict(held))

    _, told = flown(aircraft, compiled, freeze)
    assert ("frozen", "RAW_IMU") in alarmed(told)
    # What is shown is old, and its age says so: the page strikes it through.
    assert told["state_age_s"] == pytest.approx(14.0 - BEGINS_S - FROZEN_S, abs=0.2)


def test_airspeed_that_vanishes_is_told_and_its_uncertainty_shows(
    healthy, aircraft: Aircraft, compiled: Compiled
) -> None:
    station, told = flown(aircraft, compiled, lambda s: None if s.stream == "VFR_HUD" else s)
    assert alarmed(told) == {("silent", "airspeed")}
    assert told["alarms"][0]["since_us"] == pytest.approx(BEGINS_S * 1e6, abs=1e5)
    assert station.newest is not None
    assert healthy[0].newest is not None
    spread = station.newest.flow_covariance[0, 0]
    assert spread > 2.0 * healthy[0].newest.flow_covariance[0, 0]
    assert told["state_age_s"] < 0.1


@pytest.mark.parametrize(
    ("stream", "what", "channels"),
    [
        ("VFR_HUD", "airspeed", ("airspeed",)),
        ("ATTITUDE", "attitude", ("roll", "pitch", "yaw")),
        ("GLOBAL_POSITION_INT", "velocity", ("v_north", "v_east", "v_down")),
        ("RAW_IMU", "inertial unit", ("p", "q", "r", "acc_x", "acc_y", "acc_z")),
    ],
)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_no_number_reaches_a_state(
    aircraft: Aircraft, compiled: Compiled, stream: str, what: str, channels: tuple, value: float
) -> None:
    def empty(sample: Sample) -> Sample:
        if sample.stream != stream:
            return sample
        told = {**sample.channels, **dict.fromkeys(channels, value)}
        return Sample(sample.stream, sample.time_us, sample.link_us, True, told)

    station, told = flown(aircraft, compiled, empty, BEGINS_S + SILENT_S + 1.0)
    assert ("invalid", what) in alarmed(told)
    assert station.newest is not None
    for state in (station.newest.flow, station.newest.rest, station.newest.attitude):
        assert np.isfinite(state).all()
    assert station.filter.restarts == 0


def test_a_sensor_that_disagrees_is_told_until_it_has_agreed_for_a_while() -> None:
    """Its noise is learned anew, so that its innovations soon look small: that is no agreement."""
    alarms, new = Alarms(), np.array([True, False, True, False])

    def flown(seconds: float, since: float, airspeed: float) -> list[tuple[str, str]]:
        for tick in range(int(seconds * 10)):
            # Three angles: a sum of three squares is no surprise.
            alarms.innovations(since + 0.1 * tick, new, np.array([airspeed, 0.0, 3.0, 0.0]))
        return [(one.kind, one.what) for one in alarms.told(flying=True)]

    assert flown(10.0, 0.0, 1.0) == []
    assert flown(0.1, 10.0, 400.0) == [], "one outlier is none"
    assert flown(2.0, 10.1, 30.0) == [("disagrees", "airspeed")]
    assert flown(AGREED_S, 12.1, 0.5) == [("disagrees", "airspeed")]
    assert flown(AGREED_S, 12.1 + AGREED_S, 0.5) == []


def test_a_clock_that_jumps_begins_anew_and_loses_nothing_else(
    aircraft: Aircraft, compiled: Compiled
) -> None:
    """The vehicle's stamps jump ahead: the filter begins anew with the wind that it knew."""
    jump_s = 1000.0

    def jump(sample: Sample) -> Sample:
        time_us = sample.time_us + round(jump_s * 1e6)
        return Sample(sample.stream, time_us, sample.link_us, True, sample.channels)

    station, told = flown(aircraft, compiled, jump)
    assert station.newest is not None
    assert station.filter.restarts == 1
    assert station.newest.row.time == pytest.approx(14.0 + jump_s, abs=0.1)
    assert np.isfinite(station.newest.rest).all()
    speed = np.hypot(*station.newest.rest[BLOCKS["velocity"]][:2])
    assert station.newest.flow[0] == pytest.approx(speed, abs=1.0)
    assert told["state_age_s"] < 0.1


def test_a_vehicle_whose_clock_jumps_back_is_a_reboot_and_time_goes_on() -> None:
    clock = LiveClock()

    def at(boot_ms: int, link_us: int) -> int:
        return clock.time_us("ATTITUDE", {"time_boot_ms": np.array([boot_ms])}, link_us)[0]

    before = [at(500_000 + 20 * k, 10**15 + 20_000 * k) for k in range(50)]
    after = [at(1_000 + 20 * k, 10**15 + 1_000_000 + 20_000 * k) for k in range(50)]
    assert clock.reboots == 1
    # The first few count as late messages, which have no time of the vehicle's own.
    assert all(later >= before[-1] for later in after)
    assert np.all(np.diff(after[5:]) == 20_000)


def test_a_ground_stations_clock_that_is_set_anew_moves_no_arrival(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first = now_us()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert 0 <= now_us() - first < 10_000_000


def test_servo_outputs_that_vanish_are_told_and_teach_nothing(
    aircraft: Aircraft, compiled: Compiled
) -> None:
    """The last command counted for ever: first model and processes learned with it."""
    taken: list[float] = []
    now, gone, back = [0], 5.0, 9.0

    def observed(item: object) -> None:
        if isinstance(item, Samples):
            taken.extend(item.time[KEPT])

    station = Station(
        aircraft, compiled, prior=None, vehicle=None, clock_us=lambda: now[0], observer=observed
    )
    told: dict[int, tuple[list, str, float]] = {}
    for sample in longer(aircraft, 13.0):
        now[0] = sample.link_us
        silent = sample.stream == "SERVO_OUTPUT_RAW" and gone <= 1e-6 * sample.time_us < back
        station.take([] if silent else [sample])
        station.work(2**62)
        if sample.time_us in (8_980_000, 12_980_000):
            station.decoder.vehicle = Vehicle(1, 1, NO_AUTOPILOT, "MAV_TYPE_FIXED_WING", 1)
            live = document.document(
                station, document.Outside(link="", phase="", now_us=sample.link_us)
            )
            age = live["coefficients"]["CZ"]["age_s"]
            told[sample.time_us] = (live["alarms"], station.phase(), age)
    alarms, phase, age = told[8_980_000]
    assert [one["words"] for one in alarms] == ["servo outputs are not heard for 4 s"]
    assert phase.startswith("flying, coefficients need SERVO_OUTPUT_RAW with channels")
    assert told[12_980_000][:2] == ([], "flying")
    times = np.array(taken)
    assert times.size > 0
    assert not np.any((times > gone + SILENT_COMMANDS_S) & (times < back))
    assert times.max() > back + 1.0
    assert station.model.state()["Cm.scalars"][1] == times.size
    # What was measured before grows old, and says so.
    assert age == pytest.approx(8.98 - times[times < back].max(), abs=0.1)
    assert age > 3.0
    assert told[12_980_000][2] < 1.5


def test_motor_speeds_are_watched_each_by_itself(aircraft: Aircraft) -> None:
    watched = {f"speed of motor {motor}": (("RPM",), (f"rpm_{motor}",)) for motor in (1, 2)}
    alarms = Alarms(watched)
    for tick in range(60):
        time_us = 100_000 * tick
        channels = {"rpm_1": 5000.0, "rpm_2": math.nan if tick > 10 else 5000.0}
        assert alarms.usable(
            Sample("RPM", time_us, time_us, True, channels), 0.1 * tick, flying=True
        )
    (told,) = alarms.told(flying=True)
    assert told.words == "speed of motor 2 holds no number for 5 s"


def test_what_is_many_is_said_as_many() -> None:
    alarms = Alarms()
    alarms.usable(Sample("AOA_SSA", 0, 0, True, {"alpha": 0.1, "beta": 0.0}), 0.0, flying=True)
    (told,) = alarms.told(flying=True, now=7.0)
    assert told.words == "vanes are not heard for 7 s"
