"""What counts as leaving the envelope, and how sure a count makes one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from gcs_sysid.aircraft import Envelope
from gcs_sysid.maneuvers import envelope
from gcs_sysid.maneuvers.flown import Flown
from tests.offline.made_aircraft import small

ALLOWED = Envelope((10.0, 30.0), (-0.1, 0.2), (-0.2, 0.2), (-1.0, 3.0), 1.0, 50.0)


def level(draws: int = 4, samples: int = 5) -> Flown:
    one = np.ones((draws, samples))
    return Flown(
        airspeed=20.0 * one,
        alpha=0.05 * one,
        beta=0.0 * one,
        rate=np.zeros((draws, samples, 3)),
        bank=0.0 * one,
        load_factor=one,
        height=100.0 * one,
        controls=np.zeros((draws, samples, 3)),
        commanded=np.zeros((draws, samples, 3)),
        settings=np.zeros((draws, samples, 1)),
        thrust=0.0 * one,
    )


def changed(path: Flown, name: str, value: float, *, draw: int = 2) -> Flown:
    values = getattr(path, name).copy()
    values[draw, 3] = value
    return path._replace(**{name: values})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("alpha", 0.19), ("alpha", -0.09), ("beta", 0.19), ("airspeed", 29.5), ("bank", -0.96),
        ("load_factor", 2.9), ("height", 49.0),
    ],
)  # fmt: skip
def test_a_limit_less_its_margin_is_broken_by_the_one_that_breaks_it(name, value) -> None:
    found = envelope.broken(changed(level(), name, value), ALLOWED, small())
    assert [key for key, which in found.items() if which.any()] == [name]
    assert found[name].tolist() == [False, False, True, False]
    assert envelope.most_broken(found) == name
    assert envelope.most_broken(envelope.broken(level(), ALLOWED, small())) is None


def test_surfaces_have_travel_and_rate() -> None:
    asked = level().commanded.copy()
    asked[1, 3:, 1] = 0.51
    found = envelope.broken(level()._replace(commanded=asked), ALLOWED, small())
    assert found["travel of elevator"].tolist() == [False, True, False, False]
    slow = tuple(replace(servo, rate_limit=1.0) for servo in small().servos)
    asked[1, 3:, 1] = 0.03
    found = envelope.broken(
        level()._replace(commanded=asked), ALLOWED, replace(small(), servos=slow)
    )
    assert found["rate of elevator"].tolist() == [False, True, False, False]
    asked[1, 3:, 1] = 0.02
    found = envelope.broken(
        level()._replace(commanded=asked), ALLOWED, replace(small(), servos=slow)
    )
    assert not found["rate of elevator"].any()


@pytest.mark.parametrize("left", [0, 1, 5])
def test_the_bound_leaves_five_percent_for_luck(left: int) -> None:
    """Were the probability the bound itself, so few would leave with 5 % only."""
    bound = envelope.upper_bound(left, 512)
    assert stats.binom.cdf(left, 512, bound) == pytest.approx(0.05, rel=1e-6)


def test_no_flight_of_few_proves_nothing() -> None:
    """0 of n proves 1 % from n = ln 0.05/ln 0.99 = 298.07 on."""
    assert envelope.allowed_to_leave(298) == -1
    assert envelope.allowed_to_leave(299) == 0
    assert envelope.allowed_to_leave(512) == 1
    assert envelope.upper_bound(3, 3) == 1.0


def test_the_largest_share_inside_is_interpolated() -> None:
    still, moved = level(), changed(level(), "alpha", 0.05 + 0.3)
    shares = np.linspace(0.01, 1.0, 100)
    found = envelope.largest_inside(still, moved, ALLOWED, small(), shares)
    # 0.05 + 0.3 share = 0.2 less a margin of 0.05·0.3.
    assert found == pytest.approx((0.185 - 0.05) / 0.3, abs=0.011)
    assert envelope.largest_inside(still, still, ALLOWED, small(), shares) == 1.0
    beyond = changed(level(), "alpha", 0.3)
    assert envelope.largest_inside(beyond, beyond, ALLOWED, small(), shares) == 0.0
    each = envelope.each_inside(still, moved, ALLOWED, small(), shares)
    assert each.pop("alpha") == pytest.approx(found)
    assert set(each.values()) == {1.0}
    assert (
        envelope.each_inside(beyond, beyond, ALLOWED, small(), shares[50:])["alpha"] == shares[50]
    )
