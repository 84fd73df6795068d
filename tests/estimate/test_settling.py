"""Where a search goes that begins with gusts far too weak."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.estimate import settling
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.reconstruct.causal import Pass, Path, Told
from gcs_sysid.reconstruct.linear_filter import Belief
from tests.estimate import made_flight as made

pytestmark = pytest.mark.slow

KNOWN = made.unknowns(1.0)
FLAT = np.asarray(ravel_pytree(KNOWN.means)[0])
DERIVATIVES = np.arange(FLAT.size) < sum(len(terms) for terms in made.TERMS.values())
SIZES = np.where(DERIVATIVES, 0.3 * np.abs(FLAT), 0.0)


NOTHING = Pass(
    *[Told(np.zeros((1, 1)), np.zeros(1), 1.0)] * 2,
    Path([], Belief(jnp.zeros(1), jnp.zeros((1, 1)))),
    *(np.zeros((1, 1)), np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1))),
)


def beliefs() -> Beliefs:
    """Derivatives to a third; gusts and the noise of the inertial unit to a factor of e²."""
    held = jax.tree.map(jnp.zeros_like, KNOWN.log_noise)
    free, three = jnp.asarray(2.0), jnp.full(3, 2.0)
    turbulence = held.turbulence._replace(gust=three, gust_length=three)
    sigma = held._replace(turbulence=turbulence, gyro=free, accelerometer=free)
    return Beliefs(FLAT, np.diag(SIZES**2), Prior(KNOWN.log_noise, sigma))


@pytest.fixture(scope="module")
def settled() -> tuple[Settled, list[str]]:
    flight = made.made_flight(logs=made.sharp(KNOWN.log_noise))
    told: list[str] = []
    every = np.ones(made.COUNT, dtype=bool)
    return settling.settle(made.MODEL, flight, KNOWN, beliefs(), every, told.append), told


def test_gusts_that_shake_are_not_taken_for_derivatives(settled) -> None:
    """Begun in weak, long gusts, a flight in sharp ones settles near what made it."""
    done, _ = settled
    told = done.last.told.matrix[np.ix_(DERIVATIVES, DERIVATIVES)]
    known = np.linalg.inv(told + np.diag(SIZES[DERIVATIVES] ** -2.0))
    errors = (done.values - FLAT)[DERIVATIVES] / np.sqrt(np.diagonal(known))
    assert np.max(np.abs(errors)) < 4.0
    assert done.ended
    assert not done.restless
    np.testing.assert_allclose(np.exp(done.log_noise.turbulence.gust), 2.0, rtol=0.3)


def test_turns_begin_where_the_flight_is_likely(settled) -> None:
    """An approach that went astray is made again once gusts and noise were tried."""
    _, told = settled
    begun = {text.split(":")[0]: float(text.split()[-1]) for text in told if "likelihood" in text}
    assert any("astray" in text for text in told)
    assert begun["turn 1"] > -1e4


def test_a_search_without_rest_begins_anew_on_another_stretch(monkeypatch) -> None:
    """From where one rests, or else had the least to gain, turns go on over the whole flight."""
    flight, every = made.made_flight(), np.ones(made.COUNT, dtype=bool)
    begun_at: list[int] = []

    def settled_after(*lefts: float) -> float:
        begun_at.clear()

        def neared(model, part, first, *given) -> settling.Unknowns:
            begun_at.append(part.rows.step.size)
            return first

        def turns(model, part, first, beliefs, counts, turns, progress, **how) -> Settled:
            values = np.asarray(ravel_pytree(first.means)[0])
            if not how:
                return Settled(values, first.log_noise, NOTHING, counts, ~counts, (), ended=True)
            left = lefts[len(begun_at) - 1]
            values = np.full_like(values, len(begun_at))
            return Settled(
                values, first.log_noise, NOTHING, counts, ~counts, (), ended=False, left=left
            )

        monkeypatch.setattr(settling, "STRETCH", made.COUNT // 4)
        monkeypatch.setattr(settling, "_neared", neared)
        monkeypatch.setattr(settling, "_turns", turns)
        done = settling.settle(made.MODEL, flight, KNOWN, beliefs(), every, lambda _: None)
        assert set(begun_at) == {made.COUNT // 4}
        return float(done.values[0])

    assert settled_after(50.0) == 1
    assert settled_after(4e4, 0.5) == 2
    assert settled_after(np.nan, 4e4, 0.5) == 3
    assert settled_after(4e4, 7e3, np.nan) == 2
    assert settled_after(np.nan, 9e3, 7e3) == 3
