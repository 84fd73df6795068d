"""What becomes of a flight that goes wrong."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.blind import fly
from tests.blind.draw import Fixed, draw
from tests.blind.fly import Recorded


def test_a_command_that_refuses_counts_as_failed_with_its_reason(tmp_path):
    recorded = Recorded(tmp_path / "no.tlog", tmp_path / "no.toml", departed=False)
    diagnosis, seconds = fly.diagnose(recorded, tmp_path / "out")
    assert diagnosis["verdict"] == "failed"
    assert "no such file" in diagnosis["message"]
    assert seconds > 0.0


def test_a_command_without_an_end_counts_as_failed(tmp_path, monkeypatch: pytest.MonkeyPatch):
    def hangs(*arguments: object, timeout: float, **others: object) -> None:
        raise subprocess.TimeoutExpired("gcs-sysid", timeout)

    monkeypatch.setattr(subprocess, "run", hangs)
    recorded = Recorded(Path("a.tlog"), Path("a.toml"), departed=False)
    diagnosis, seconds = fly.diagnose(recorded, tmp_path)
    assert (diagnosis["verdict"], seconds) == ("failed", fly.PATIENCE)


def test_a_flight_out_of_control_is_told(tmp_path):
    """Without ailerons nobody keeps it upright."""
    effect = {"name": "surface_effectiveness", "control": "aileron", "ratio": 0.0}
    fixed = Fixed("surface_effectiveness", "aerosonde", "exact", short=True, effects=(effect,))
    assert fly.fly(draw(0, fixed=fixed), tmp_path / "upset").departed
    recorded = fly.fly(draw(0, fixed=Fixed("none", "aerosonde", short=True)), tmp_path / "calm")
    assert not recorded.departed
    assert recorded.log.stat().st_size > 100_000
    assert recorded.informed is not None


def test_nothing_here_knows_the_part_that_finds_causes():
    """Only files and the command line stand between the two."""
    allowed = ("aircraft", "aircraft_file", "sitl", "errors")
    for path in Path(fly.__file__).parent.glob("*.py"):
        for line in path.read_text(encoding="utf-8").splitlines():
            module = re.match(r"(?:from|import) gcs_sysid(?:\.(\w+))?(?: import (\w+))?", line)
            assert module is None or (module[1] or module[2]) in allowed, f"{path.name}: {line}"
