"""A listener that is killed in flight, as its users run it, and goes on."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.live import snapshot
from gcs_sysid.sources import tlog
from tests.live import flown

ROOT = Path(__file__).resolve().parents[2]
AIRCRAFT = ROOT / "data/aircraft/ultra_stick_25e.toml"
SPEED = 4.0
KILLED_S, END_S = 48.0, 84.0
"""Of the flight: it is airborne from the beginning."""
RECORDING_LOST_S, MODEL_LOST_S = 1.0, 10.0


def learned(folder: Path) -> tuple[dict[str, float], int]:
    """Samples behind each coefficient of the model that is kept, and updates of the filter."""
    with np.load(folder / snapshot.NAME) as arrays:
        names = [name for name in arrays.files if name.endswith(".scalars")]
        return {name: float(arrays[name][1]) for name in names}, int(arrays["updates"])


@pytest.mark.slow
def test_what_a_kill_in_flight_costs(tmp_path: Path) -> None:
    """At most a second of recording and ten of model; the rest goes on where it was."""
    frames = tlog.frames((ROOT / "data/flights/demo.tlog").read_bytes())
    ends = [frames[0][0] + seconds * 1e6 for seconds in (KILLED_S, END_S)]
    before = [item for item in frames if item[0] < ends[0]]
    after = [item for item in frames if ends[0] <= item[0] < ends[1]]
    port, recording = flown.free_port(), tmp_path / "recording.tlog"

    with flown.listening(tmp_path, port, AIRCRAFT) as listener:
        listener.ready()
        sent = list(flown.play(before, port, speed=SPEED))
        listener.kill()
    killed = time.monotonic()
    kept = tlog.frames(recording.read_bytes())
    whole = sum(at < killed - RECORDING_LOST_S for at, _ in sent)
    assert whole <= len(kept)
    assert [frame for _, frame in kept] == [frame for _, frame in sent[: len(kept)]]
    samples, updates = learned(tmp_path)
    # Of what the filter took: on a busy computer it leaves out much, and so does what it learns.
    assert min(samples.values()) > 0.5 * updates > 100

    with flown.listening(tmp_path, port, AIRCRAFT, "--resume") as listener:
        listener.ready()
        for _ in flown.play(after, port, speed=SPEED):
            pass
        found = listener.until(lambda now: now["counts"]["recorded"] == len(after))
        said = listener.kill()
    told = re.search(r"recording\.tlog goes on.*; the model goes on from ([\d.]+) s before", said)
    assert told, said
    assert float(told[1]) <= MODEL_LOST_S
    again = tlog.read(recording.read_bytes())
    assert again.lost["garbage_bytes"] == again.lost["bad_crc"] == 0
    assert [frame for _, frame in tlog.frames(recording.read_bytes())] == [
        frame for _, frame in [*kept, *after]
    ]
    assert found["derivatives"].keys() == {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
    assert all(count > samples[name] for name, count in learned(tmp_path)[0].items())
