from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.diagnose import gain
from gcs_sysid.diagnose.unknowns import Columns
from gcs_sysid.diagnose.whitening import Blocks, Noise

NAMES = ("mass", "CZ.alpha")
COLUMNS = Columns(NAMES, np.array([0.02, 1.0]), np.zeros((0, 6, 2)))


def test_a_score_is_the_normal_density_by_hand() -> None:
    """One coefficient: noise of 0.3 and 0.4 from the file's own sigma make 0.5."""
    left = np.array([[0.5], [-0.5]])
    columns = np.zeros((2, 1, 2))
    columns[:, 0, 0] = [2.0, -2.0]
    columns[:, 0, 1] = 0.4
    measured = np.array([[1.0], [3.0]])
    blocks = Blocks(left, measured, columns, np.zeros(2, dtype=int), np.zeros(2, dtype=int))
    noise = Noise(np.zeros((4, 1)), np.eye(1), {}, 1.0, np.array([0.3]))
    before = gain.score(blocks, noise, COLUMNS, np.zeros(2))
    assert before.error == pytest.approx(50.0)
    assert before.nlpd == pytest.approx(0.5 + np.log(0.5) + 0.5 * np.log(2.0 * np.pi))
    after = gain.score(blocks, noise, COLUMNS, np.array([0.25, 0.0]))
    assert after.error == pytest.approx(0.0)
    assert after.nlpd == pytest.approx(np.log(0.5) + 0.5 * np.log(2.0 * np.pi))


def test_a_scaled_airspeed_is_predicted_from_other_samples() -> None:
    random = np.random.default_rng(8)
    true = 20.0 + 3.0 * random.standard_normal(2000)
    indicated = 0.9 * true + 0.2 * random.standard_normal(2000)
    indicated[::3] = np.nan
    fitted = np.arange(2000) < 1000
    before, after = gain.airspeed_scores(indicated, true, fitted, ~fitted)
    assert before.error == pytest.approx(100.0 * np.hypot(2.0, 0.3) / 2.7, rel=0.05)
    assert after.error == pytest.approx(100.0 * 0.2 / 2.7, rel=0.1)
    assert after.nlpd == pytest.approx(0.5 + np.log(0.2 * np.sqrt(2.0 * np.pi)), abs=0.05)
    assert after.nlpd < before.nlpd


def test_where_nothing_was_held_out_nothing_is_scored() -> None:
    blocks = Blocks(
        np.zeros((0, 1)), np.zeros((0, 1)), np.zeros((0, 1, 2)), np.zeros(0, int), np.zeros(0, int)
    )
    noise = Noise(np.zeros((4, 1)), np.eye(1), {}, 1.0, np.array([0.3]))
    assert np.isnan(gain.score(blocks, noise, COLUMNS, np.zeros(2)).nlpd)
    none = np.zeros(5, dtype=bool)
    for score in gain.airspeed_scores(np.ones(5), np.ones(5), ~none, none):
        assert np.isnan(score.error)
