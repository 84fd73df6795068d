"""What putting right gains, by leaving out one part after the other."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.offline import departed


def test_the_gain_is_known_to_what_leaving_out_a_part_changes() -> None:
    """Written out part by part: rms of what is left, and its scatter (Efron & Stein, 1981)."""
    rng = np.random.default_rng(3)
    parts = {label: [rng.normal(0.0, size, 40) for _ in range(9)]
             for label, size in (("before", 2.0), ("after", 1.5))}  # fmt: skip
    squares = {label: np.array([np.sum(one**2) for one in each]) for label, each in parts.items()}
    found = departed.left_out(squares, np.full(9, 40.0), 10.0)

    def rms(label: str, without: int | None) -> float:
        kept = [one for index, one in enumerate(parts[label]) if index != without]
        return 10.0 * float(np.sqrt(np.mean(np.concatenate(kept) ** 2)))

    gains = np.array([rms("before", one) - rms("after", one) for one in range(9)])
    assert found["before"] == pytest.approx(rms("before", None))
    assert found["after"] == pytest.approx(rms("after", None))
    assert found["gained"] == pytest.approx(rms("before", None) - rms("after", None))
    assert found["gained_sd"] == pytest.approx(np.sqrt(8 / 9 * np.sum((gains - gains.mean()) ** 2)))


def test_what_changes_nothing_gains_nothing() -> None:
    squares = dict.fromkeys(("before", "after"), np.array([3.0, 5.0, 1.0]))
    found = departed.left_out(squares, np.full(3, 10.0), 1.0)
    assert found["gained"] == 0.0
    assert found["gained_sd"] == 0.0


@pytest.mark.parametrize(
    ("gained", "sd", "told"), [(-5.0, 1.0, True), (-5.0, 4.0, False), (-0.5, 0.1, False)]
)
def test_a_gain_that_is_paid_on_another_axis_is_said(gained: float, sd: float, told: bool) -> None:
    """Where it is surely worse, and by enough that somebody would mind."""
    other = {"before": 30.0, "after": 10.0, "gained": 20.0, "gained_sd": 2.0}
    one = {"before": 10.0, "after": 10.0 - gained, "gained": gained, "gained_sd": sd}
    warnings = departed.paid({"Cm": other, "Cn": one})
    assert len(warnings) == told
    assert all("makes Cn worse by 5.0 %" in text for text in warnings)


@pytest.mark.parametrize(("alike", "share"), [(True, 1.0), (False, 6.0**-0.5)])
def test_the_mean_gain_of_six_coefficients_has_their_common_scatter(
    alike: bool, share: float
) -> None:
    """Errors that come together do not average out; independent ones do, by √6."""
    rng, count = np.random.default_rng(8), 40000
    stretches = np.arange(count) // 20
    rows = {
        "t": np.arange(count) * departed.STRETCH / 20.0,
        "flight": np.zeros(count),
        "maneuver": np.ones(count),
    }
    for index, name in enumerate(COEFFICIENTS):
        draws = np.random.default_rng(0 if alike else index)
        loud = draws.uniform(0.5, 2.0, stretches[-1] + 1)[stretches]
        rows[f"{name}_measured"] = rng.normal(0.0, 1.0, count)
        rows[f"{name}_before"], rows[f"{name}_after"] = loud, 0.5 * loud
    found = departed.gain(rows, [1], before=0.0, gained=0.1, gained_sd=None)
    each = float(np.mean([one["gained_sd"] for one in found["channels"].values()]))
    assert each > 0.0
    assert found["holdout_error_gained_sd"] == pytest.approx(share * each, rel=0.1)
