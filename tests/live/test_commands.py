"""Commands as they are heard: where a silence leaves surfaces in doubt, as after landing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.live.commands import CommandMaps, Commands
from gcs_sysid.offline import servo_outputs
from gcs_sysid.recording import Recording
from gcs_sysid.sources.samples import Sample
from tests.offline.test_servo_outputs import SILENCE, TIME, silent, slow

STREAM = "SERVO_OUTPUT_RAW"


def heard(recording: Recording, until: float = np.inf) -> Commands:
    """What has been heard of a recording up to a time [s]; another message comes at that time."""
    aircraft = slow()
    commands = Commands(aircraft, CommandMaps(aircraft))
    stream = recording.streams[STREAM]
    for index in np.flatnonzero(stream.time <= until):
        values = {name: float(value[index]) for name, value in stream.channels.items()}
        at = float(stream.time[index])
        commands.take(Sample(STREAM, round(1e6 * at), 0, True, values), at)
    if np.isfinite(until):
        commands.take(Sample("ATTITUDE", round(1e6 * until), 0, True, {"roll": 0.0}), until)
    return commands


@pytest.mark.parametrize(
    ("moved", "lost"),
    [
        (150.0, SILENCE),
        (0.0, SILENCE),
        (-40.0, slice(300, 306)),
        (0.0, slice(200, 240)),
        (150.0, slice(200, 200 + servo_outputs.MOST_LOST)),
    ],
)
def test_what_a_silence_leaves_in_doubt_is_what_it_does_after_landing(
    moved: float, lost: slice
) -> None:
    recording = silent(moved=moved, lost=lost)
    steps = TIME[100:-1], TIME[101:]
    expected = servo_outputs.known(recording, slow(), *steps)
    np.testing.assert_array_equal(heard(recording).known(*steps), expected)


def test_while_a_silence_lasts_nobody_knows_whether_a_command_changed() -> None:
    recording = silent(moved=0.0)
    newest = float(TIME[SILENCE.start - 1])
    steps = TIME[150 : SILENCE.start + 8], TIME[151 : SILENCE.start + 9]
    usual = heard(recording, until=newest + 0.06).known(*steps)
    assert usual.all(), "some messages of a radio are always late"
    found = heard(recording, until=newest + 0.2).known(*steps)
    np.testing.assert_array_equal(found, steps[1] <= newest + 1e-9)
    assert heard(recording).known(*steps).all(), "the same command came again"


def test_doubt_comes_as_late_as_the_stream_does() -> None:
    """Servos that are told of 0.1 s late are in doubt 0.1 s later."""
    aircraft, recording = slow(), silent(moved=150.0)
    late = replace(aircraft, streams={STREAM: servo_outputs.StreamTiming(delay=0.1)})
    first = [
        TIME[:-1][~servo_outputs.known(recording, one, TIME[:-1], TIME[1:])][0]
        for one in (aircraft, late)
    ]
    assert first[1] - first[0] == pytest.approx(0.1, abs=0.011)
