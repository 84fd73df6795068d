"""Hyper-parameters of greatest marginal likelihood, from several starting points.

Length-scales have a wide log-normal prior and noise is kept off zero, so that an output without
signal, or an input that it does not depend on, has an answer too. The gradient is exact; the search
is L-BFGS on logarithms (amplitudes of shared processes, which are signed, as they are).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float
from scipy import optimize

from gcs_sysid.errors import UsageError
from gcs_sysid.frames import Array
from gcs_sysid.gp import exact, inducing
from gcs_sysid.gp.dependent import Kernel, Points
from gcs_sysid.gp.samples import Rows

SCALE_MEDIAN = 3.0
"""Median of the prior of the length-scales, in standard deviations of the input: coefficients are
nearly linear over a flight, and a process much longer than the data is a straight line."""
SCALE_SPREAD = 1.0
"""Standard deviation of its logarithm."""
AMPLITUDE = 1.0
"""Standard deviation of the prior of the amplitudes, in standard deviations of the output."""
LEAST_NOISE = 1e-6
"""Variance of the noise cannot fall below this share of the output's."""


_NO_ANSWER = 1e12
"""Cost of hyper-parameters whose covariance cannot be factorised: the search steps back."""


class Unknowns(NamedTuple):
    """Hyper-parameters as the search moves them."""

    amplitude: Float[Array, "latent output"]
    log_scale: Float[Array, "latent row input"]
    log_own_amplitude: Float[Array, " output"]
    log_own_scale: Float[Array, "output input"]
    log_noise: Float[Array, " output"]


@dataclass(frozen=True)
class Structure:
    """Size of the covariance.

    Attributes:
        latents: shared processes; 0 makes the outputs independent.
        tied: whether all outputs share the length-scales of a latent process.
    """

    latents: int = 2
    tied: bool = True


@dataclass(frozen=True)
class Learned:
    """The best start's outcome.

    Attributes:
        kernel: learned covariance.
        noise: variance of each output that the samples' own errors do not explain.
        log_posterior: of the hyper-parameters, up to a constant [nat].
        starts: the same of every start: where they differ the likelihood has several peaks.
    """

    kernel: Kernel
    noise: Float[Array, " output"]
    log_posterior: float
    starts: tuple[float, ...]


def kernel_of(unknowns: Unknowns) -> Kernel:
    """The covariance that the search's values stand for."""
    return Kernel(
        amplitude=unknowns.amplitude,
        scale=jnp.exp(unknowns.log_scale),
        own_amplitude=jnp.exp(unknowns.log_own_amplitude),
        own_scale=jnp.exp(unknowns.log_own_scale),
    )


def noise_of(unknowns: Unknowns) -> Float[Array, " output"]:
    """Variance of the noise."""
    return LEAST_NOISE + jnp.exp(unknowns.log_noise)


def fit_exact(
    rows: Rows, structure: Structure, *, starts: int, seed: int, steps: int = 100
) -> Learned:
    """By the exact marginal likelihood: n³ a step for n values."""
    points, values, own = exact.observed(rows)

    def likelihood(unknowns: Unknowns) -> Float[Array, ""]:
        noise = own + noise_of(unknowns)[points.output]
        return exact.log_marginal(kernel_of(unknowns), points, values, noise)

    shape = (rows.values.shape[1], rows.inputs.shape[1])
    return _search(
        jax.jit(jax.value_and_grad(_cost(likelihood))), shape, structure, starts, seed, steps
    )


def fit_inducing(
    rows: Rows,
    points: Points,
    repeats: Float[Array, " output"],
    structure: Structure,
    *,
    starts: int,
    seed: int,
    steps: int = 60,
) -> Learned:
    """By the marginal likelihood of the approximation through `points`: linear in the samples.

    Args:
        rows: samples.
        points: inducing points that carry the likelihood; they are not kept.
        repeats: samples of each output that say the same, see `inducing.Basis`.
        structure: of the covariance.
        starts: of the search.
        seed: of their draw.
        steps: of each, at most.
    """

    def evaluate(unknowns: Unknowns) -> tuple[Array, Unknowns]:
        return _inducing_cost(unknowns, rows, points, repeats)

    shape = (rows.values.shape[1], rows.inputs.shape[1])
    return _search(evaluate, shape, structure, starts, seed, steps)


@jax.jit
def _inducing_cost(
    unknowns: Unknowns, rows: Rows, points: Points, repeats: Float[Array, " output"]
) -> tuple[Array, Unknowns]:
    def likelihood(at: Unknowns) -> Float[Array, ""]:
        base = inducing.basis(kernel_of(at), noise_of(at), repeats, points)
        return inducing.log_marginal(base, rows)

    return jax.value_and_grad(_cost(likelihood))(unknowns)


def _cost(
    likelihood: Callable[[Unknowns], Float[Array, ""]],
) -> Callable[[Unknowns], Float[Array, ""]]:
    return lambda unknowns: -(likelihood(unknowns) + _log_prior(unknowns))


def _log_prior(unknowns: Unknowns) -> Float[Array, ""]:
    middle = jnp.log(SCALE_MEDIAN)
    scales = [unknowns.log_scale, unknowns.log_own_scale]
    total = sum(-0.5 * jnp.sum(((each - middle) / SCALE_SPREAD) ** 2) for each in scales)
    sizes = [unknowns.amplitude, jnp.exp(unknowns.log_own_amplitude)]
    total = total + sum(-0.5 * jnp.sum((each / AMPLITUDE) ** 2) for each in sizes)
    # Flat in the variance rather than in its logarithm, which may run off to minus infinity.
    return total + 0.1 * jnp.sum(unknowns.log_own_amplitude) + 0.1 * jnp.sum(unknowns.log_noise)


def _search(
    evaluate: Callable[[Unknowns], tuple[Array, Unknowns]],
    shape: tuple[int, int],
    structure: Structure,
    starts: int,
    seed: int,
    steps: int,
) -> Learned:
    random = np.random.default_rng(seed)
    begins = [_begin(random, shape, structure) for _ in range(starts)]
    outcomes = []
    for begin in begins:
        first, restore = ravel_pytree(begin)

        def cost(vector: np.ndarray, restore: Callable = restore) -> tuple[float, np.ndarray]:
            value, slope = evaluate(restore(jnp.asarray(vector)))
            flat = np.asarray(ravel_pytree(slope)[0])
            if not (np.isfinite(float(value)) and np.all(np.isfinite(flat))):
                return _NO_ANSWER, np.zeros_like(flat)
            return float(value), flat

        found = optimize.minimize(
            cost, np.asarray(first), jac=True, method="L-BFGS-B", options={"maxiter": steps}
        )
        outcomes.append((-float(found.fun), restore(jnp.asarray(found.x))))
    best, unknowns = max(outcomes, key=lambda outcome: outcome[0])
    if best <= -_NO_ANSWER:
        raise UsageError(
            "the likelihood of the samples is not finite; give finite values, each with its noise"
        )
    return Learned(
        kernel=kernel_of(unknowns),
        noise=noise_of(unknowns),
        log_posterior=best,
        starts=tuple(value for value, _ in outcomes),
    )


def _begin(random: np.random.Generator, shape: tuple[int, int], structure: Structure) -> Unknowns:
    outputs, inputs = shape
    rows = 1 if structure.tied else outputs

    def near(middle: float, *size: int) -> Array:
        return jnp.asarray(middle + 0.3 * random.standard_normal(size))

    return Unknowns(
        # Of the size of the outputs: near zero the search stays there.
        amplitude=jnp.asarray(random.choice([-0.7, 0.7], (structure.latents, outputs))),
        log_scale=near(float(np.log(SCALE_MEDIAN)), structure.latents, rows, inputs),
        log_own_amplitude=near(-1.0, outputs),
        log_own_scale=near(float(np.log(SCALE_MEDIAN)), outputs, inputs),
        log_noise=near(-2.0, outputs),
    )
