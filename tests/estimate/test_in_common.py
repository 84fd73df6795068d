"""What flights have in common, found and put back in the flat vector."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.aircraft import Aircraft, Geometry, Mass
from gcs_sysid.estimate import in_common
from gcs_sysid.model import departures
from gcs_sysid.model.aided import Means
from tests.estimate import made_flight as made

PLAIN = made.unknowns(1.0).means
BARE = Aircraft(name="made", mass=Mass(10.0, 1.0, 1.0, 1.0), geometry=Geometry(1.0, 2.0, 0.5))


def embodied() -> Means:
    by = departures.none(BARE, 0)._replace(
        mass=jnp.asarray(0.1), inertia=jnp.array([0.2, 0.3, 0.4]), thrust=jnp.asarray(0.5)
    )
    return PLAIN._replace(departures=jax.tree.map(lambda part: jnp.asarray(part, float), by))


@pytest.mark.parametrize("means", [PLAIN, embodied()])
def test_values_stand_beside_their_keys(means: Means) -> None:
    found = dict(zip(in_common.keys(means), in_common.values(means), strict=True))
    for name, terms in means.aerodynamics.items():
        for key, value in terms.items():
            assert found.pop((name, key)) == pytest.approx(float(value))
    body = (
        {}
        if means.departures is None
        else dict(zip(in_common.PARTS, np.arange(1, 6) / 10, strict=True))
    )
    assert found == {(in_common.BODY, part): pytest.approx(value) for part, value in body.items()}


def test_other_values_leave_the_rest_alone() -> None:
    means = embodied()
    old = in_common.values(means)
    changed = in_common.with_values(means, old + 1.0)
    np.testing.assert_allclose(in_common.values(changed), old + 1.0)
    moved = np.asarray(ravel_pytree(changed)[0] - ravel_pytree(means)[0])
    assert np.count_nonzero(moved) == old.size
