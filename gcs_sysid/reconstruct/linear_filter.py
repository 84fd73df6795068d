"""Kalman filter, smoother and likelihood of a system that is linear about a nominal flight.

The deviation e from the nominal obeys `Linearised`. Filter and smoother are the textbook ones
(Särkkä, *Bayesian Filtering and Smoothing*, 2013, algorithms 4.2 and 8.2); the innovations' density
is the likelihood of everything that the matrices depend on,

    log L = Σ −½ (νᵀ S⁻¹ ν + log |S| + n log 2π)

with the log-determinant: without it whatever makes the filter expect more gust explains every
flight. Its gradient with respect to all matrices comes from one backward sweep.

Everything works on chunks of one fixed length, so that one compilation serves flights of any
length and every aircraft.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.model.aided_linear import Linearised

Single = TypeVar("Single")

JITTER = 1e-14
"""Added to predicted variances before they are inverted: attitude gains none in its own right."""


class Belief(NamedTuple):
    """Mean and covariance of the deviation; of the steps of `innovations` the mean only."""

    mean: Float[Array, "*sample state"]
    covariance: Float[Array, "*sample state state"]


class Filtered(NamedTuple):
    """One step of the filter.

    Attributes:
        predicted: before the row's measurements.
        updated: after them.
        log_likelihood: of the row's innovation.
        whitened: innovation over the root of its covariance, row by row.
        root: inverse of the Cholesky factor of the innovation's covariance.
        gain: by which a whitened innovation corrects the mean, transposed.
    """

    predicted: Belief
    updated: Belief
    log_likelihood: Float[Array, "*sample"]
    whitened: Float[Array, "*sample row"]
    root: Float[Array, "*sample row row"]
    gain: Float[Array, "*sample row state"]


def step(belief: Belief, row: Linearised) -> Filtered:
    """One prediction and update."""
    mean = row.transition @ belief.mean + row.offset
    covariance = row.transition @ belief.covariance @ row.transition.T + row.process
    seen = row.sensitivity @ covariance
    factor = jnp.linalg.cholesky(seen @ row.sensitivity.T + jnp.diag(row.variance))
    # Kept for everything that comes later: solved for many rows at once, two systems side by side
    # can wait for each other for ever (jaxlib 0.10, as many threads as systems).
    root = jax.scipy.linalg.solve_triangular(factor, jnp.eye(factor.shape[0]), lower=True)
    gain = root @ seen
    whitened = root @ (row.residual - row.sensitivity @ mean)
    left = covariance - gain.T @ gain
    density = -0.5 * (
        whitened @ whitened
        + 2.0 * jnp.sum(jnp.log(jnp.diagonal(factor)))
        + jnp.sum(row.present).astype(mean.dtype) * jnp.log(2.0 * jnp.pi)
    )
    return Filtered(
        Belief(mean, covariance),
        Belief(mean + gain.T @ whitened, 0.5 * (left + left.T)),
        density,
        whitened,
        root,
        gain,
    )


@jax.jit
def run(start: Belief, rows: Linearised) -> tuple[Belief, Filtered]:
    """The filter over a chunk: its end, and every step."""

    def ahead(belief: Belief, row: Linearised) -> tuple[Belief, Filtered]:
        done = step(belief, row)
        return done.updated, done

    return jax.lax.scan(ahead, start, rows)


@jax.jit
def innovations(start: Belief, rows: Linearised) -> tuple[Belief, Filtered]:
    """`run` without the covariances, which are two thirds of what is written."""

    def ahead(belief: Belief, row: Linearised) -> tuple[Belief, Filtered]:
        done = step(belief, row)
        means = (part._replace(covariance=None) for part in (done.predicted, done.updated))
        return done.updated, Filtered(*means, *done[2:])

    return jax.lax.scan(ahead, start, rows)


@jax.jit
def likelihood(start: Belief, rows: Linearised) -> tuple[Belief, Float[Array, ""]]:
    """The filter's end and the chunk's log-likelihood."""

    def ahead(belief: Belief, row: Linearised) -> tuple[Belief, Float[Array, ""]]:
        done = step(belief, row)
        return done.updated, done.log_likelihood

    end, each = jax.lax.scan(ahead, start, rows)
    return end, jnp.sum(each)


@jax.jit
def adjoint(
    start: Belief, rows: Linearised, done: Filtered, later: Belief
) -> tuple[Belief, Linearised]:
    """Gradient of the log-likelihood from this chunk on, by one backward sweep.

    With S = L Lᵀ, U = L⁻¹H, G = L⁻¹HP⁻, w = L⁻¹ν and J = I − GᵀU, the gradients λ⁺, Λ⁺ with respect
    to an updated mean and covariance become those with respect to the predicted ones,

        λ⁻ = Jᵀλ⁺ + Uᵀw        Λ⁻ = JᵀΛ⁺J + ½ (Jᵀλ⁺ wᵀU + Uᵀw λ⁺ᵀJ + Uᵀ(wwᵀ − I)U)

    and Φᵀλ⁻, ΦᵀΛ⁻Φ those of the step before. Every matrix's gradient follows from them.

    Args:
        start: belief at the chunk's beginning.
        rows: the chunk.
        done: the filter's steps over it.
        later: gradient of what follows with respect to the belief at the chunk's end.

    Returns:
        Gradient with respect to `start`, and to every matrix of the chunk.
    """
    unit = done.root @ rows.sensitivity

    def back(after: Belief, item: tuple[Array, ...]) -> tuple[Belief, tuple[Belief, Belief]]:
        transition, seen, gain, white = item
        pull = after.mean - seen.T @ (gain @ after.mean)
        told = seen.T @ white
        left = after.covariance - seen.T @ (gain @ after.covariance)
        left = left - (left @ gain.T) @ seen
        mixed = pull[:, None] * told[None, :]
        spread = left + 0.5 * (mixed + mixed.T + told[:, None] * told[None, :] - seen.T @ seen)
        mean = pull + told
        earlier = Belief(transition.T @ mean, transition.T @ spread @ transition)
        return earlier, (after, Belief(mean, spread))

    earlier, (updated, predicted) = jax.lax.scan(
        back, later, (rows.transition, unit, done.gain, done.whitened), reverse=True
    )
    before = _before(start, done)

    def of_matrices(
        row: Linearised, step_: Filtered, begun: Belief, plus: Belief, minus: Belief
    ) -> Linearised:
        gain, white = step_.gain, step_.whitened
        answer = gain @ plus.mean
        both = answer[:, None] * white[None, :]
        of_spread = 0.5 * (
            white[:, None] * white[None, :] - jnp.eye(white.size) - both - both.T
        ) + (gain @ plus.covariance @ gain.T)
        of_seen = (
            (white - answer)[:, None] * step_.predicted.mean[None, :]
            + 2.0 * of_spread @ gain
            + white[:, None] * (step_.predicted.covariance @ plus.mean)[None, :]
            - 2.0 * gain @ plus.covariance @ step_.predicted.covariance
        )
        inverse = step_.root
        return Linearised(
            transition=minus.mean[:, None] * begun.mean[None, :]
            + 2.0 * minus.covariance @ row.transition @ begun.covariance,
            offset=minus.mean,
            process=minus.covariance,
            sensitivity=inverse.T @ of_seen,
            residual=inverse.T @ (answer - white),
            variance=jnp.sum((of_spread @ inverse) * inverse, axis=0),
            present=jnp.zeros_like(row.residual),
        )

    return earlier, jax.vmap(of_matrices)(rows, done, before, updated, predicted)


def _before(start: Belief, done: Filtered) -> Belief:
    """Belief at the beginning of every step of a chunk."""
    return Belief(
        jnp.concatenate([start.mean[None], done.updated.mean[:-1]]),
        jnp.concatenate([start.covariance[None], done.updated.covariance[:-1]]),
    )


@jax.jit
def smooth(later: Belief, start: Belief, rows: Linearised, done: Filtered) -> tuple[Belief, Belief]:
    """Rauch–Tung–Striebel over a chunk.

    Args:
        later: smoothed belief at the chunk's end.
        start: filtered belief at its beginning.
        rows: the chunk.
        done: the filter's steps.

    Returns:
        Smoothed belief at the chunk's beginning, and at each of its rows.
    """
    before = _before(start, done)

    def back(
        ahead: Belief, item: tuple[Belief, Belief, Float[Array, "state state"]]
    ) -> tuple[Belief, Belief]:
        earlier, predicted, transition = item
        spread = predicted.covariance + JITTER * jnp.eye(predicted.mean.size)
        gain = jax.scipy.linalg.cho_solve(
            jax.scipy.linalg.cho_factor(spread), transition @ earlier.covariance
        ).T
        mean = earlier.mean + gain @ (ahead.mean - predicted.mean)
        covariance = earlier.covariance + gain @ (ahead.covariance - predicted.covariance) @ gain.T
        return Belief(mean, 0.5 * (covariance + covariance.T)), ahead

    return jax.lax.scan(back, later, (before, done.predicted, rows.transition), reverse=True)


class Changed(NamedTuple):
    """First-order change of what the filter expects, whitened by its own root, S = L Lᵀ.

    Attributes:
        innovation: L⁻¹ dν.
        spread: L⁻¹ dS L⁻ᵀ.
    """

    innovation: Float[Array, "sample other row"]
    spread: Float[Array, "sample other row row"]


@jax.jit
def changes(
    start: Belief, rows: Linearised, done: Filtered, others: Sequence[Linearised], earlier: Belief
) -> tuple[Belief, Changed]:
    """What small changes of the matrices change, gains included, for several of them side by side.

    With A = d(HP⁻), dS = d(HP⁻Hᵀ + R) and K = P⁻HᵀS⁻¹,

        dP⁺ = dP⁻ − KA − AᵀKᵀ + K dS Kᵀ        dm⁺ = dm⁻ + K dν + (Aᵀ − K dS) S⁻¹ν

    All that a row needs is worked out as its turn comes, so that nothing leaves the core's cache:
    of eight at once each takes half the time that it takes with the differences made before. What
    the matrices differ by is taken in double precision, what follows of it is worked out in single:
    it forgets as the filter does, so that errors do not grow, and takes a third less of the time.

    Args:
        start: belief at the chunk's beginning, the same for all.
        rows: the chunk.
        done: the filter's steps over it.
        others: the chunk with matrices that differ a little.
        earlier: change of the belief at the chunk's beginning by each of them.

    Returns:
        Change of the belief at the chunk's end, and of every innovation.
    """
    before = _before(start, done)

    def ahead(
        changed: Belief, item: tuple[Linearised, Sequence[Linearised], Filtered, Belief]
    ) -> tuple[Belief, Changed]:
        row, others, step_, begun = item
        transition, seen = _single((row.transition, row.sensitivity))
        earlier, expected = _single((begun, step_.predicted))
        gain, root, whitened = _single((step_.gain, step_.root, step_.whitened))
        by, weight = gain.T @ root, root.T @ whitened

        def one(change: Belief, other: Linearised) -> tuple[Belief, Changed]:
            differs = _single(jax.tree.map(jnp.subtract, other, row._replace(present=None)))
            turned, looked = differs.transition, differs.sensitivity
            mean = transition @ change.mean + turned @ earlier.mean + differs.offset
            half = 0.5 * transition @ change.covariance + turned @ earlier.covariance
            half = half @ transition.T
            predicted = half + half.T + differs.process
            crossed = looked @ expected.covariance
            both = crossed @ seen.T
            crossed = seen @ predicted + crossed
            spread = crossed @ seen.T + both.T + jnp.diag(differs.variance)
            innovation = differs.residual - looked @ expected.mean - seen @ mean
            fed = by @ (crossed - 0.5 * spread @ by.T)
            mean = mean + by @ (innovation - spread @ weight) + crossed.T @ weight
            return (
                Belief(mean, predicted - fed - fed.T),
                Changed(root @ innovation, root @ spread @ root.T),
            )

        return jax.vmap(one)(changed, jax.tree.map(lambda *parts: jnp.stack(parts), *others))

    bare = tuple(other._replace(present=None) for other in others)
    return jax.lax.scan(ahead, _single(earlier), (rows, bare, done, before))


def _single(values: Single) -> Single:
    """The same in single precision."""
    return jax.tree.map(lambda part: part.astype(jnp.float32), values)
