"""What gusts may feign of a vane's scale: the arithmetic, and a flight on which they do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.model.kinematics import SIZE
from gcs_sysid.reconstruct.vane_scale import SCALE, ScaleBelief
from tests.reconstruct import truth
from tests.reconstruct.filtered_example import example, smoothed

DATA = Path(__file__).resolve().parents[2] / "data"


def belief(rows: int, feigned: float = 0.3) -> ScaleBelief:
    return ScaleBelief(
        prior=np.array([0.1, 0.1]),
        seen=np.array([0.02, 0.01]),
        rows=rows,
        feigned=np.array([feigned, 1e-6]),
    )


@pytest.mark.parametrize("longer", [1, 4])
def test_the_scale_moves_as_far_as_prior_and_feigned_part_allow(longer: int) -> None:
    """Closed form: data of deviation s under the prior given weigh p²/(p² + s²) of what they say,

    which is to be prior²/(prior² + feigned²) for any number of samples.
    """
    inputs = example().inputs
    count = inputs.step.shape[0]
    held = belief(count // longer).held(np.eye(SIZE), inputs)
    seen = 0.02 / np.sqrt(longer)
    narrow = held[SCALE, SCALE][0, 0]
    assert narrow / (narrow + seen**2) == pytest.approx(0.1**2 / (0.1**2 + 0.3**2))
    assert held[SCALE, SCALE][1, 1] == pytest.approx(0.1**2)  # nothing feigned: the prior itself
    others = np.delete(np.diagonal(held), np.arange(SCALE.start, SCALE.stop))
    np.testing.assert_array_equal(others, 1.0)


def test_the_deviation_told_holds_the_feigned_part() -> None:
    told = belief(100, feigned=0.5).told(smoothed())
    assert told.deviation[0, SCALE][0] == pytest.approx(0.1 * 0.5 / np.hypot(0.1, 0.5))
    assert told.deviation[0, SCALE][1] == smoothed().deviation[0, SCALE][1]
    np.testing.assert_array_equal(told.rest, smoothed().rest)


def test_a_vane_without_error_is_not_blamed_for_gusts() -> None:
    """The filter alone says -0.18 ± 0.03 of the alpha vane on this flight, where zero flew."""
    states = truth.reconstructed(
        DATA / "flights" / "demo_second.tlog", DATA / "aircraft" / "ultra_stick_25e.toml"
    )
    scale, deviation = states.block("vane_scale")[0], states.deviation("vane_scale")[0]
    assert (np.abs(scale) < 2.0 * deviation).all()
    assert (deviation <= 0.1).all()
