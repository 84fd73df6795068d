"""What a flight says by itself, whatever was believed before: closed forms of linear problems."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import filter_error, in_common
from gcs_sysid.estimate.flight_rows import Unknowns
from tests.estimate import made_flight as made
from tests.estimate.made_scored import scored

SEEN = np.array([[40.0, 9.0], [9.0, 25.0]])
"""Information of a flight about two derivatives; of the others nothing is sought."""
BELIEVED = np.array([0.3, -0.2])
SAYS = np.array([0.5, 0.1])
"""What the flight would be taken for without the beliefs."""


def alone(
    slope: np.ndarray, scatter: np.ndarray, precision: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Information and values of the flight alone, and the covariance with the beliefs."""
    known = made.unknowns(1.0)
    flat, unravel = ravel_pytree(known.means)
    values = np.zeros(flat.size)
    values[:2] = np.linalg.solve(slope + precision, slope @ SAYS + precision @ BELIEVED)
    mean = np.zeros(flat.size)
    mean[:2] = BELIEVED
    done = scored(
        slope,
        unknowns=Unknowns(unravel(jnp.asarray(values)), known.log_noise),
        scatter=scatter,
        precision=precision,
        # Scores of two stretches that scatter as they should.
        blocks=np.sqrt(0.5 * np.diagonal(scatter)) * np.array([[1.0, 1.0], [-1.0, -1.0]]),
    )
    common = in_common.places(known.means)
    said = filter_error._said(done, mean, common)
    assert np.count_nonzero(said.information[2:]) == 0
    assert not said.late.any()
    first = said.information[:2, :2]
    return first, np.linalg.solve(first, said.told[:2]), done.covariance()


@pytest.mark.parametrize("strength", [0.01, 1.0, 100.0])
def test_what_a_flight_says_does_not_hang_on_what_was_believed(strength: float) -> None:
    """An ordinary likelihood: the posterior is the product of the prior and what is told here."""
    precision = strength * np.array([[50.0, -10.0], [-10.0, 30.0]])
    seen, says, covariance = alone(SEEN, SEEN, precision)
    np.testing.assert_allclose(seen, SEEN, rtol=1e-6, atol=1e-8 * strength * 50.0)
    np.testing.assert_allclose(says, SAYS, atol=1e-6)
    np.testing.assert_allclose(np.linalg.inv(covariance), SEEN + precision, rtol=1e-9)


def test_equations_that_weigh_a_flight_too_little_leave_it_what_it_says() -> None:
    """With most of the information gone by the gains the posterior is wider than the prior.

    The posterior less the prior was below nothing there: a direction without information was made
    of it, of which every derivative had its share, and no maneuver was worth anything.
    """
    precision = np.diag([100.0, 100.0])
    slope = 0.1 * SEEN
    seen, says, covariance = alone(slope, SEEN, precision)
    assert np.linalg.eigvalsh(np.linalg.inv(covariance) - precision).min() < 0.0
    np.testing.assert_allclose(seen, slope @ np.linalg.inv(SEEN) @ slope, rtol=0.02)
    np.testing.assert_allclose(says, SAYS, rtol=0.02)


def test_what_no_row_tells_is_not_bounded_and_stays_as_believed() -> None:
    """The bound of two derivatives, one without information; what was believed of them is left."""
    information = np.array([[4.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
    done = scored(information, precision=np.diag([10.0, 10.0, 1.0]))
    bound = filter_error._bound(done, 2)
    np.testing.assert_allclose(np.diagonal(bound), [2.0 / 7.0, np.inf])
    np.testing.assert_allclose(done.covariance()[1], [0.0, 0.1, 0.0], atol=1e-12)


def test_sums_that_move_less_are_known_less() -> None:
    """Godambe: A⁻¹ M A⁻ᵀ, here 2⁻¹ · 4 · 2⁻¹."""
    done = scored(np.array([[2.0]]), scatter=np.array([[4.0]]))
    np.testing.assert_allclose(done.covariance(), [[1.0]])
    stopped = replace(done, ended=False, moving=0.5)
    np.testing.assert_allclose(stopped.covariance(), [[1.25]])


def test_a_search_that_stopped_leaves_what_was_believed_as_it_was() -> None:
    """Of two derivatives the flight tells the sum; their difference is as it was believed."""
    told, believed = np.full((2, 2), 50.0), np.diag([4.0, 1.0])
    done = scored(told, precision=believed, ended=False, moving=3.0)
    left = np.linalg.inv(done.covariance()) - believed
    np.testing.assert_allclose(left, told / 10.0, rtol=1e-9)


@pytest.mark.parametrize(
    ("ended", "moving", "wanted"), [(True, 0.1, True), (False, 0.7, True), (False, 1.1, False)]
)
def test_a_search_that_stopped_tells_what_it_nearly_reached(ended, moving, wanted) -> None:
    assert scored(np.ones((1, 1)), ended=ended, moving=moving).settled is wanted
