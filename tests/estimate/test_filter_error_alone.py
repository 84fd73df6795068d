"""What a flight says by itself, whatever was believed before: closed forms of linear problems."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import filter_error, in_common
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.likelihood import Curvature
from gcs_sysid.estimate.scoring import Scored
from tests.estimate import made_flight as made

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
    free = np.zeros(flat.size, dtype=bool)
    free[:2] = True
    values = np.zeros(flat.size)
    values[:2] = np.linalg.solve(slope + precision, slope @ SAYS + precision @ BELIEVED)
    mean = np.zeros(flat.size)
    mean[:2] = BELIEVED
    quiet = np.zeros(ravel_pytree(known.log_noise)[0].size, dtype=bool)
    done = Scored(
        unknowns=Unknowns(unravel(jnp.asarray(values)), known.log_noise),
        free=(free, quiet),
        curvature=Curvature(slope, scatter, scatter),
        # Scores of two stretches that scatter as they should.
        blocks=np.sqrt(0.5 * np.diagonal(scatter)) * np.array([[1.0, 1.0], [-1.0, -1.0]]),
        precision=precision,
        whitened=np.zeros((1, 1)),
        log_likelihood=(0.0,),
        ended=True,
        moving=0.0,
        moved=np.zeros((1, flat.size)),
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
