from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.offline.measured_surfaces import in_place_of_commands
from gcs_sysid.recording import Stream
from tests.offline.made_aircraft import small
from tests.reconstruct.made_flights import flight

FLIGHT = flight(duration=60.0)


def with_positions(positions: dict[int, np.ndarray], time: np.ndarray):
    channels = {f"position_{n}": values for n, values in positions.items()}
    stream = Stream("ACTUATOR_STATUS", time, time, channels)
    return replace(FLIGHT, streams={**FLIGHT.streams, "ACTUATOR_STATUS": stream})


def test_measured_positions_become_the_pulses_that_stand_for_them() -> None:
    aircraft = small()
    servo = aircraft.servos[0]
    time = np.arange(5.0, 50.0, 0.01)
    moved = 0.1 * np.sin(time)
    recording, known, names = in_place_of_commands(
        with_positions({servo.channel: moved}, time), aircraft
    )
    assert names == (servo.surface,)
    pulses = recording.streams["SERVO_OUTPUT_RAW"]
    np.testing.assert_allclose(pulses.time, time)
    order = np.argsort(servo.pwm)
    back = np.interp(
        pulses.channels[f"pwm_{servo.channel}"],
        np.array(servo.pwm)[order],
        np.array(servo.deflection)[order],
    )
    np.testing.assert_allclose(back, moved, atol=1e-12)
    assert known.servos[0].time_constant == 0.0
    assert known.servos[1:] == aircraft.servos[1:]


def test_surfaces_that_were_not_measured_keep_their_commands() -> None:
    aircraft = small()
    first, other = aircraft.servos[0], aircraft.servos[1]
    time = np.arange(5.0, 50.0, 0.01)
    recording, _, _ = in_place_of_commands(
        with_positions({first.channel: 0.0 * time}, time), aircraft
    )
    commands = FLIGHT.streams["SERVO_OUTPUT_RAW"]
    held = recording.streams["SERVO_OUTPUT_RAW"].channels[f"pwm_{other.channel}"]
    at = np.searchsorted(commands.time, 20.0, side="right") - 1
    assert held[np.searchsorted(time, 20.0)] == commands.channels[f"pwm_{other.channel}"][at]
    assert recording.streams["SERVO_OUTPUT_RAW[commanded]"].count == commands.count


def test_without_measurements_nothing_changes() -> None:
    aircraft = small()
    assert in_place_of_commands(FLIGHT, aircraft) == (FLIGHT, aircraft, ())
    unknown = with_positions({99: np.zeros(3)}, np.arange(3.0))
    assert in_place_of_commands(unknown, aircraft) == (unknown, aircraft, ())


@pytest.mark.parametrize("lag", [0.05, 0.2])
def test_a_measured_surface_knows_its_servo_s_lag(lag: float) -> None:
    """Whatever lag the file gives the servo, the position measured behind it stays as it is."""
    aircraft = small()
    slow = replace(aircraft, servos=tuple(replace(s, time_constant=lag) for s in aircraft.servos))
    time = np.arange(5.0, 50.0, 0.01)
    positions = {servo.channel: 0.05 * np.sin(time) for servo in aircraft.servos}
    recording, known, _ = in_place_of_commands(with_positions(positions, time), slow)
    assert all(servo.time_constant == 0.0 for servo in known.servos)
    assert known.streams["SERVO_OUTPUT_RAW"].delay == 0.0
    assert recording.streams["SERVO_OUTPUT_RAW"].count == time.size
