"""The smoothing that angular rates ask for, found while they come in: constant cost and memory.

One filter for each candidate ratio runs on, and what the likelihood of the whole flight needs of
them are sums. After the same samples the answer is that of `rates.most_likely_ratio`.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.reconstruct import rates


class _Sums(NamedTuple):
    """Of one candidate: the filter's belief, Σ log variance, Σ innovation²/variance, samples."""

    mean: Float[Array, "two axis"]
    covariance: Float[Array, "two two"]
    logarithms: Float[Array, ""]
    squares: Float[Array, " axis"]
    count: Float[Array, ""]


@jax.jit
def _begun(first: Float[Array, " axis"]) -> _Sums:
    """Every candidate before the first sample."""

    def one(ratio: Float[Array, ""]) -> _Sums:
        zero = jnp.zeros(())
        return _Sums(*rates.start(first, ratio), zero, jnp.zeros_like(first), zero)

    return jax.vmap(one)(jnp.asarray(rates.RATIOS))


@jax.jit
def _taken(sums: _Sums, step: Float[Array, " sample"], rate: Float[Array, "sample axis"]) -> _Sums:
    """Every candidate after some samples more."""

    def one(ratio: Float[Array, ""], sums: _Sums) -> _Sums:
        def take(sums: _Sums, row: tuple[Array, Array]) -> tuple[_Sums, None]:
            belief, (_, _, innovation, variance) = rates.advance(sums[:2], *row, ratio)
            return _Sums(
                *belief,
                sums.logarithms + jnp.log(variance),
                sums.squares + innovation**2 / variance,
                sums.count + 1.0,
            ), None

        return jax.lax.scan(take, sums, (step, rate))[0]

    return jax.vmap(one)(jnp.asarray(rates.RATIOS), sums)


class RunningRates:
    """Most likely ratio and noise of the angular rates so far."""

    def __init__(self) -> None:
        self._sums: _Sums | None = None

    def take(
        self, step: Float[np.ndarray, " sample"], rate: Float[np.ndarray, "sample axis"]
    ) -> None:
        """Adds samples; always the same number of them, so that one compilation serves.

        Args:
            step: time since the sample before each [s].
            rate: angular rates, biases taken off [rad/s].
        """
        begun = _begun(jnp.asarray(rate[0])) if self._sums is None else self._sums
        self._sums = _taken(begun, jnp.asarray(step), jnp.asarray(rate))

    def found(self) -> tuple[float, Float[np.ndarray, " axis"]]:
        """Ratio q/r [1/s³] and noise of each rate [rad/s]; after some samples were taken."""
        if self._sums is None:
            raise ValueError("`found` needs samples: call `take` before")
        logarithms, squares, count = (np.asarray(value) for value in self._sums[2:])
        noise = squares / count[:, None]
        axes = noise.shape[1]
        score = -0.5 * (axes * logarithms + count * np.sum(np.log(noise), axis=1))
        ratio = rates.between_candidates(score)
        nearest = int(np.argmin(np.abs(np.log(rates.RATIOS / ratio))))
        return ratio, np.sqrt(noise[nearest])
