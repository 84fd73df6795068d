"""A stall that the model does not have, hidden by the simulator in gusts: the filter asks for it.

The same flight with nothing hidden asks for nothing.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.offline import model_store
from tests.offline.conftest import ROOT, run

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

STALL = ROOT / "replay" / "stall" / "scenario.toml"
FILE = ROOT / "replay" / "ultra_stick_25e.toml"
HIDDEN = """[[effects]]
name = "stall"
alpha_break = 0.12     # rad: 7 deg
slope_loss = 0.6
"""


def flown(folder: Path, *, hidden: bool) -> Path:
    """The slow legs of the scenario, in stronger gusts."""
    text = STALL.read_text()
    assert HIDDEN in text
    head, *legs = text.split("[[legs]]")
    slow = [leg for leg in legs if "slow" in leg.splitlines()[1]]
    assert len(slow) == 2
    head = head.replace("../ultra_stick_25e.toml", str(FILE)).replace("gust = 0.10", "gust = 0.8")
    head = head[: head.rindex("[[flights]]")]
    scenario = folder / "scenario.toml"
    scenario.write_text("[[legs]]".join([head if hidden else head.replace(HIDDEN, ""), *slow]))
    command = [sys.executable, "-m", "gcs_sysid", "sitl", "--scenario", str(scenario)]
    subprocess.run([*command, "--out", str(folder)], check=True, capture_output=True)
    return folder / "first.tlog"


def test_a_stall_that_the_model_does_not_have_is_asked_for(tmp_path: Path) -> None:
    log = flown(tmp_path, hidden=True)
    told = run([log], tmp_path / "out", aircraft=FILE, method="filter-error").summary
    assert told["method"]["name"] == "filter_error"
    first = told["lacking"][0]
    assert first["coefficient"] == "CZ"
    assert "alpha" in first["regressor"]
    assert first["log_bayes_factor"] > 20.0
    assert 0.02 < first["share"] < 0.5


def test_a_flight_with_nothing_hidden_asks_for_nothing(tmp_path: Path) -> None:
    log = flown(tmp_path, hidden=False)
    told = run([log], tmp_path / "out", aircraft=FILE, method="filter-error").summary
    assert told["method"]["name"] == "filter_error"
    assert told["lacking"] == []
    # What the filter had to go by is kept for who plans the next flight.
    sensed = model_store.load(tmp_path / "out").sensing
    assert sensed is not None
    assert sensed.step == pytest.approx(0.02, rel=0.01)
    np.testing.assert_allclose(sensed.shares, [0.5, 0.2, 0.99, 0.5], atol=0.02)
    gust = np.exp(sensed.log_noise.turbulence.gust)
    assert np.all((gust > 0.3) & (gust < 1.6))  # 0.8 m/s flew, for a minute
    assert 0.0 < float(sensed.deviation.airspeed_scale) < 0.03
