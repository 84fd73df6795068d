"""What the servo stream tells: messages that were lost, and silences in which commands changed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.model import actuators
from gcs_sysid.offline import servo_outputs
from gcs_sysid.recording import Recording, Stream, Vehicle
from tests.offline.made_aircraft import small

TIME = np.arange(500) / 50.0
LAG = 0.14
SILENCE = slice(200, 215)
"""Messages that never came: a third of a second."""


def test_messages_that_a_radio_lost_are_made_up_for() -> None:
    """One and three in a row lie on the line between their neighbours; a hole stays one."""
    sent = 1500.0 + 100.0 * np.sin(3.0 * TIME)
    kept = np.ones(TIME.size, dtype=bool)
    kept[[100, 200, 201, 202]] = False
    kept[300:310] = False
    stream = Stream("SERVO_OUTPUT_RAW", TIME[kept], TIME[kept], {"pwm_1": sent[kept]})
    time, found = servo_outputs.pulses(stream, (1,))
    hole = (TIME > TIME[299]) & (TIME < TIME[310])
    np.testing.assert_allclose(time, TIME[~hole], atol=1e-12)
    np.testing.assert_allclose(found[1], sent[~hole], atol=1.0)
    assert np.max(np.abs(found[1][100] - sent[100])) < 0.1


def test_what_is_sent_when_it_changes_has_lost_nothing() -> None:
    time = np.cumsum(np.random.default_rng(3).exponential(0.05, size=200))
    stream = Stream("SERVO_OUTPUT_RAW", time, time, {"pwm_1": 1500.0 + time})
    np.testing.assert_array_equal(servo_outputs.pulses(stream, (1,))[0], time)


def slow() -> Aircraft:
    """With servos that lag."""
    return replace(small(), servos=tuple(replace(one, time_constant=LAG) for one in small().servos))


def silent(*, moved: float, lost: slice = SILENCE, steady: bool = True) -> Recording:
    """Commands of which some were lost, the elevator's another afterwards by so many µs."""
    kept = np.ones(TIME.size, dtype=bool)
    kept[lost] = False
    time = TIME[kept]
    if not steady:
        time = np.cumsum(np.random.default_rng(3).exponential(0.05, size=time.size))
    still = np.full(time.size, 1500.0)
    elevator = still + np.where(np.arange(time.size) >= lost.start, moved, 0.0)
    channels = {"pwm_1": still, "pwm_2": elevator, "pwm_3": still, "pwm_4": still}
    stream = Stream("SERVO_OUTPUT_RAW", time, time, channels)
    vehicle = Vehicle(1, 1, "MAV_AUTOPILOT_GENERIC", "MAV_TYPE_FIXED_WING", 1)
    return Recording("made.tlog", "", vehicle, 0, {"SERVO_OUTPUT_RAW": stream})


def unknown(recording: Recording, aircraft: Aircraft) -> np.ndarray:
    """Times of the steps through which it is not known where surfaces stood."""
    steps = servo_outputs.known(recording, aircraft, TIME[:-1], TIME[1:])
    return TIME[1:][~steps]


def test_a_command_that_changed_unseen_is_forgotten_as_the_servo_forgets() -> None:
    """At the end of what is not believed, a servo told at either end stands alike."""
    aircraft = slow()
    found = unknown(silent(moved=150.0), aircraft)
    begin, end = TIME[SILENCE.start - 1], TIME[SILENCE.stop]
    assert found[0] == pytest.approx(begin + 0.02)
    assert np.all(np.diff(found) < 0.021), "one piece"
    early, late = (
        actuators.surface(
            aircraft.servos[1],
            np.where(TIME > at, 1650.0, 1500.0),
            TIME,
            at=found[-1:],
        )
        for at in (begin + 1e-3, end - 1e-3)
    )
    travel = 0.5
    apart = abs(float(early[0] - late[0])) / travel
    assert 0.2 * servo_outputs.TOLD < apart < 1.2 * servo_outputs.TOLD


def test_a_command_that_is_the_same_after_a_short_silence_never_changed() -> None:
    assert unknown(silent(moved=0.0), slow()).size == 0
    assert unknown(silent(moved=1.0), slow()).size == 0


def test_in_a_long_silence_a_command_may_have_come_and_gone() -> None:
    lost = slice(200, 240)
    found = unknown(silent(moved=0.0, lost=lost), slow())
    assert found[0] == pytest.approx(TIME[200])
    assert found[-1] > TIME[240] + 2.0 * LAG


def test_what_was_made_up_for_is_known() -> None:
    lost = slice(200, 200 + servo_outputs.MOST_LOST)
    assert unknown(silent(moved=150.0, lost=lost), slow()).size == 0


def test_a_servo_without_lag_is_known_with_the_next_message() -> None:
    found = unknown(silent(moved=150.0), small())
    assert found[-1] == pytest.approx(TIME[SILENCE.stop])


def test_a_stream_that_comes_when_it_changes_is_never_silent() -> None:
    assert unknown(silent(moved=150.0, steady=False), slow()).size == 0


def test_the_throttle_counts_and_a_channel_of_nobody_does_not() -> None:
    quiet = silent(moved=0.0)
    stream = quiet.streams["SERVO_OUTPUT_RAW"]
    step = np.where(np.arange(stream.time.size) >= SILENCE.start, 150.0, 0.0)
    for channel, counts in (("pwm_3", True), ("pwm_7", False)):
        channels = {**stream.channels, channel: 1500.0 + step}
        other = replace(stream, channels=channels)
        found = unknown(replace(quiet, streams={stream.name: other}), slow())
        assert (found.size > 0) == counts
