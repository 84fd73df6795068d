"""Output error: parameters of a deterministic simulation by the likelihood of its outputs.

    ẋ = f(θ, x, u),  x(0) = x₀        y_k = g(θ, x(t_k), u_k) + b + v_k

v is measurement noise of unknown variance, one for each output; θ is shared by all maneuvers,
initial state x₀ and bias b belong to each. Steps are Gauss–Newton's with damping, by exact
derivatives of the simulation; the variances are put to the mean square of the residuals after each.
What belongs to one maneuver is eliminated from its own rows, so that cost grows linearly with
maneuvers.

The information at the end is that of white noise. Residuals are coloured, most of all where
something drives the aircraft that the simulation does not know (gusts). The covariance given counts
their own auto- and cross-correlation, summed over lags with Bartlett's taper:

    M⁻¹ [Σ_i Σ_j S_iᵀ R⁻¹ R_vv(i−j) R⁻¹ S_j] M⁻¹

That makes the intervals hold; it does not make the estimate better, which in gusts a filter would.

References:
    Maine & Iliff, NASA RP-1168, 1986, chapters 4 and 5.
    Morelli & Klein, "Accuracy of aerodynamic model parameters estimated from flight test data",
    J. Guidance 20(1), 1997, eq. 21.
    Jategaonkar, *Flight Vehicle System Identification*, 2nd ed. 2015, chapter 4.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gcs_sysid.estimate.equation_error import inverse_where_seen
from gcs_sysid.frames import Array
from gcs_sysid.model import runge_kutta

LONGEST_LAG = 5.0
"""Residuals further apart than this [s] are taken as independent."""
SMALL = 1e-4
"""A step below this share of each parameter's standard deviation ends the search."""
MOST_STEPS = 50
WORSE = 1e-6
"""Of the log likelihood: by as much a step may lose to rounding."""
MOST_DAMPING = 1e8
LARGEST = 1e100
SPARE = 0.2
"""Least share of the independent samples that is left once every parameter has taken one."""

Status = Literal["converged", "too many steps", "no step helps", "start not finite"]
REMEDY: dict[Status, str] = {
    "converged": "",
    "too many steps": "start nearer, from equation error, or free fewer parameters",
    "no step helps": "start nearer, from equation error, or split the maneuvers where they diverge",
    "start not finite": "the simulation diverges with the start values: shorten the maneuvers or "
    "start from a stable model",
}
"""What to do about each way to end."""


@dataclass(frozen=True)
class Model:
    """What is simulated; both functions are pure, of JAX arrays.

    Attributes:
        rate: of change of the state: f(parameters, state, inputs).
        output: what is measured: g(parameters, state, inputs).
    """

    rate: Callable[[Array, Array, Array], Array]
    output: Callable[[Array, Array, Array], Array]


@dataclass(frozen=True)
class Records:
    """Maneuvers of one sample interval, padded to one length.

    Attributes:
        inputs: linear between samples.
        measured: NaN where there is no measurement, and beyond the end.
        start: first guess of each initial state.
        step: sample interval [s].
    """

    inputs: Float[np.ndarray, "maneuver sample input"]
    measured: Float[np.ndarray, "maneuver sample output"]
    start: Float[np.ndarray, "maneuver state"]
    step: float


@dataclass(frozen=True)
class Fit:
    """What the maneuvers say.

    Attributes:
        value: the shared parameters.
        covariance: of them, coloured residuals counted.
        white_covariance: as if residuals were white (the Cramér–Rao bound at the residual's size).
        start: initial state of each maneuver.
        bias: of each output in each maneuver; zero where it is not free.
        noise: standard deviation of each output's residual.
        residual: measured less simulated; NaN where nothing was measured.
        effective_samples: independent ones among the measurements.
        status: how the search ended.
        steps: taken.
    """

    value: Float[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    white_covariance: Float[np.ndarray, "parameter parameter"]
    start: Float[np.ndarray, "maneuver state"]
    bias: Float[np.ndarray, "maneuver output"]
    noise: Float[np.ndarray, " output"]
    residual: Float[np.ndarray, "maneuver sample output"]
    effective_samples: float
    status: Status
    steps: int

    @property
    def deviation(self) -> Float[np.ndarray, " parameter"]:
        """One standard deviation of each parameter."""
        return np.sqrt(np.diagonal(self.covariance))


def padded(
    inputs: Sequence[Float[np.ndarray, "_sample input"]],
    measured: Sequence[Float[np.ndarray, "_sample output"]],
    start: Sequence[Float[np.ndarray, " state"]],
    step: float,
) -> Records:
    """Maneuvers of different length as one block; the last input is held beyond the end."""
    longest = max(len(item) for item in measured)

    def extended(rows: np.ndarray, fill: np.ndarray) -> np.ndarray:
        return np.vstack([rows, np.tile(fill, (longest - len(rows), 1))])

    return Records(
        inputs=np.stack([extended(item, item[-1]) for item in inputs]),
        measured=np.stack([extended(item, np.full(item.shape[1], np.nan)) for item in measured]),
        start=np.stack(start),
        step=step,
    )


class OutputError:
    """An estimator for one model, compiled once for records of one shape.

    Args:
        model: what is simulated.
        free_start: states whose initial value belongs to each maneuver; the others keep the guess.
        free_bias: outputs with a bias in each maneuver.
        substeps: of the integration in a sample interval; a step should be a third of the fastest
            time constant at most.
    """

    def __init__(
        self,
        model: Model,
        *,
        free_start: Sequence[int],
        free_bias: Sequence[int] = (),
        substeps: int = 1,
    ) -> None:
        self._model = model
        self._free_start = tuple(free_start)
        self._free_bias = tuple(free_bias)
        self._substeps = substeps
        self._simulate = jax.jit(jax.vmap(self._one, in_axes=(None, 0, 0, 0, None)))
        self._slopes = jax.jit(jax.vmap(self._derived, in_axes=(None, 0, 0, 0, None)))
        self._gather = jax.jit(_gather)

    def simulate(
        self,
        value: Float[np.ndarray, " parameter"],
        own: Float[np.ndarray, "maneuver own"],
        records: Records,
    ) -> Float[np.ndarray, "maneuver sample output"]:
        """Outputs of every maneuver; `own` are changes of its initial state, then its biases."""
        return np.asarray(self._simulate(value, own, records.start, records.inputs, records.step))

    def fit(self, records: Records, start: Float[np.ndarray, " parameter"]) -> Fit:
        """Maximises the likelihood of all maneuvers together.

        Args:
            records: the maneuvers.
            start: first guess of the shared parameters.
        """
        seen = np.isfinite(records.measured)
        measured = np.where(seen, records.measured, 0.0)
        count = seen.sum(axis=(0, 1))
        value = np.array(start, dtype=np.float64)
        own = np.zeros((seen.shape[0], len(self._free_start) + len(self._free_bias)))

        def errors(value: np.ndarray, own: np.ndarray) -> np.ndarray:
            return np.where(seen, measured - self.simulate(value, own, records), 0.0)

        residual = errors(value, own)
        status: Status = "too many steps"
        damping, steps = 0.0, 0
        if not _bounded(residual):
            nothing = np.full_like(residual, np.nan)
            return self._ended(records, value, own, nothing, seen, "start not finite", 0)
        while steps < MOST_STEPS:
            steps += 1
            # Where nothing but rounding is left it is not taken for noise.
            floor = 1e-16 * np.mean(measured**2, axis=(0, 1))
            weight = seen / np.sqrt(np.sum(residual**2, axis=(0, 1)) / count + floor)
            slopes = self._slopes(value, own, records.start, records.inputs, records.step)
            normal, gradient = (np.asarray(item) for item in self._gather(slopes, residual, weight))
            cost = _cost(residual, count, floor)
            while True:
                move, own_move, information = _solved(normal, gradient, value.size, damping)
                tried = errors(value + move, own + own_move)
                if _bounded(tried) and _cost(tried, count, floor) <= cost + WORSE:
                    break
                damping = max(10.0 * damping, 1e-4)
                if damping > MOST_DAMPING:
                    break
            if damping > MOST_DAMPING:
                status = "no step helps"
                break
            value, own, residual = value + move, own + own_move, tried
            damping = 0.0 if damping <= 1e-4 else 0.1 * damping
            if damping == 0.0 and move @ information @ move <= SMALL**2 * value.size:
                status = "converged"
                break
        return self._ended(records, value, own, residual, seen, status, steps)

    def _one(
        self,
        value: Float[Array, " parameter"],
        own: Float[Array, " own"],
        start: Float[Array, " state"],
        inputs: Float[Array, "sample input"],
        step: Float[Array, ""],
    ) -> Float[Array, "sample output"]:
        """Simulated outputs of one maneuver."""
        model, share = self._model, step / self._substeps
        moved = len(self._free_start)

        def between(
            state: Array, row: tuple[Array, Array]
        ) -> tuple[Float[Array, " state"], Float[Array, " state"]]:
            before, after = row
            ends = np.linspace(0.0, 1.0, 2 * self._substeps + 1)[:, None]
            given = before[None] + ends * (after - before)[None]

            def part(at: Array, index: Int[Array, ""]) -> tuple[Array, None]:
                def slope(inside: Array, when: Int[Array, ""]) -> Array:
                    return model.rate(value, inside, given[2 * index + when])

                return runge_kutta.advance(slope, at, share), None

            ahead, _ = jax.lax.scan(part, state, jnp.arange(self._substeps))
            return ahead, ahead

        first = start.at[jnp.array(self._free_start, dtype=int)].add(own[:moved])
        _, later = jax.lax.scan(between, first, (inputs[:-1], inputs[1:]))
        states = jnp.concatenate([first[None], later])
        outputs = jax.vmap(model.output, in_axes=(None, 0, 0))(value, states, inputs)
        bias = (
            jnp.zeros(outputs.shape[1]).at[jnp.array(self._free_bias, dtype=int)].set(own[moved:])
        )
        return outputs + bias[None, :]

    def _derived(
        self, value: Array, own: Array, start: Array, inputs: Array, step: Array
    ) -> Float[Array, "sample output free"]:
        """Derivatives of one maneuver's outputs by the shared, then its own parameters."""

        def both(free: Array) -> Array:
            return self._one(free[: value.size], free[value.size :], start, inputs, step)

        return jax.jacfwd(both)(jnp.concatenate([value, own]))

    def _ended(
        self,
        records: Records,
        value: Float[np.ndarray, " parameter"],
        own: Float[np.ndarray, "maneuver own"],
        residual: Float[np.ndarray, "maneuver sample output"],
        seen: Bool[np.ndarray, "maneuver sample output"],
        status: Status,
        steps: int,
    ) -> Fit:
        moved = len(self._free_start)
        start, bias = records.start.copy(), np.zeros((seen.shape[0], seen.shape[2]))
        start[:, list(self._free_start)] += own[:, :moved]
        bias[:, list(self._free_bias)] = own[:, moved:]
        noise = np.sqrt(np.sum(residual**2, axis=(0, 1)) / seen.sum(axis=(0, 1)))
        unknown = np.full((value.size, value.size), np.nan)
        white = coloured = unknown
        effective = float("nan")
        if status == "converged":
            slopes = np.asarray(
                self._slopes(value, own, records.start, records.inputs, records.step)
            )
            white, coloured, effective = _covariances(
                slopes, residual / noise, seen / noise, value.size, records.step
            )
        return Fit(
            value=value,
            covariance=coloured,
            white_covariance=white,
            start=start,
            bias=bias,
            noise=noise,
            residual=np.where(seen, residual, np.nan),
            effective_samples=effective,
            status=status,
            steps=steps,
        )


def _bounded(residual: Float[np.ndarray, "maneuver sample output"]) -> bool:
    """Whether a simulation has not diverged beyond what can be squared; NaN has."""
    return bool(np.max(np.abs(residual)) < LARGEST)


def _cost(
    residual: Float[np.ndarray, "maneuver sample output"],
    count: Int[np.ndarray, " output"],
    floor: Float[np.ndarray, " output"],
) -> float:
    """Negative log likelihood with the variances at their best, constants left out."""
    variance = np.sum(residual**2, axis=(0, 1)) / count + floor
    return 0.5 * float(np.sum(count * np.log(variance)))


def _gather(
    slopes: Float[Array, "maneuver sample output free"],
    residual: Float[Array, "maneuver sample output"],
    weight: Float[Array, "maneuver sample output"],
) -> tuple[Float[Array, "maneuver free free"], Float[Array, "maneuver free"]]:
    """SᵀR⁻¹S and SᵀR⁻¹e of each maneuver."""
    whitened = slopes * weight[..., None]
    flat = whitened.reshape(whitened.shape[0], -1, whitened.shape[-1])
    error = (residual * weight).reshape(residual.shape[0], -1)
    return jnp.einsum("mni,mnj->mij", flat, flat), jnp.einsum("mni,mn->mi", flat, error)


def _solved(
    normal: Float[np.ndarray, "maneuver free free"],
    gradient: Float[np.ndarray, "maneuver free"],
    shared: int,
    damping: float,
) -> tuple[
    Float[np.ndarray, " parameter"],
    Float[np.ndarray, "maneuver own"],
    Float[np.ndarray, "parameter parameter"],
]:
    """Step of the shared and of each maneuver's own parameters, and the information on the shared.

    The own parameters are eliminated maneuver by maneuver (Schur complement).
    """
    diagonal = np.einsum("mii->mi", normal)
    damped = normal + damping * np.eye(normal.shape[1]) * diagonal[:, None, :]
    across, inner = damped[:, :shared, shared:], damped[:, shared:, shared:]
    gain = _times_inverse(across, inner)
    information = np.sum(damped[:, :shared, :shared] - gain @ np.swapaxes(across, 1, 2), axis=0)
    own_part = gradient[:, shared:, None]
    along = np.sum(gradient[:, :shared] - (gain @ own_part)[..., 0], axis=0)
    move, *_ = np.linalg.lstsq(*_scaled(information, along), rcond=1e-12)
    move = move / np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    left = gradient[:, shared:] - np.einsum("mso,s->mo", across, move)
    own = _times_inverse(left[:, None, :], inner)[:, 0, :]
    return move, own, information


def _scaled(
    information: Float[np.ndarray, "parameter parameter"], along: Float[np.ndarray, " parameter"]
) -> tuple[Float[np.ndarray, "parameter parameter"], Float[np.ndarray, " parameter"]]:
    """The same equations in units in which the diagonal is one."""
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    return information * np.outer(scale, scale), along * scale


def _times_inverse(
    rows: Float[np.ndarray, "maneuver row own"], inner: Float[np.ndarray, "maneuver own own"]
) -> Float[np.ndarray, "maneuver row own"]:
    """Rows times inner⁻¹ of each maneuver; what a maneuver does not show of its own stays."""
    return rows @ np.linalg.pinv(inner, rcond=1e-12, hermitian=True)


def _covariances(
    slopes: Float[np.ndarray, "maneuver sample output free"],
    residual: Float[np.ndarray, "maneuver sample output"],
    weight: Float[np.ndarray, "maneuver sample output"],
    shared: int,
    step: float,
) -> tuple[
    Float[np.ndarray, "parameter parameter"], Float[np.ndarray, "parameter parameter"], float
]:
    """Covariance by white and by coloured residuals, and the number of independent ones.

    Args:
        slopes: derivatives of the outputs.
        residual: over its standard deviation; zero where nothing was measured.
        weight: one over that deviation; zero where nothing was measured.
        shared: number of shared parameters.
        step: sample interval [s].
    """
    whitened = slopes * weight[..., None]
    flat = whitened.reshape(whitened.shape[0], -1, whitened.shape[-1])
    own = flat[..., shared:]
    across = np.swapaxes(flat[..., :shared], 1, 2) @ own
    gain = _times_inverse(across, np.swapaxes(own, 1, 2) @ own)
    # What the own parameters could have explained as well says nothing about the shared.
    pure = flat[..., :shared] - own @ np.swapaxes(gain, 1, 2)
    information = np.einsum("mni,mnj->ij", pure, pure)
    seen = weight > 0.0
    count = int(seen.sum())
    inverse, unseen = inverse_where_seen(information, float(np.sqrt(count)), count)
    score = _score_covariance(pure.reshape((*weight.shape, shared)), residual, seen, step)
    coloured = inverse @ score @ inverse
    ratio = np.diagonal(coloured) / np.maximum(np.diagonal(inverse), 1e-300)
    effective = count / max(float(np.median(ratio)), 1.0)
    taken = flat.shape[-1] - shared
    left = max(effective - shared - weight.shape[0] * taken, SPARE * effective)
    hidden = unseen @ unseen.T
    freedom = count / max(count - shared - weight.shape[0] * taken, 1)
    return inverse * freedom + hidden, coloured * effective / left + hidden, effective


def _score_covariance(
    slopes: Float[np.ndarray, "maneuver sample output parameter"],
    residual: Float[np.ndarray, "maneuver sample output"],
    seen: Bool[np.ndarray, "maneuver sample output"],
    step: float,
) -> Float[np.ndarray, "parameter parameter"]:
    """Σ_i Σ_j S_iᵀ Γ(i−j) S_j with Γ the residuals' tapered auto- and cross-correlation.

    Correlations are pooled over the maneuvers; sums over both times are convolutions, by FFT.
    """
    length = residual.shape[1]
    lags = min(max(int(LONGEST_LAG / step), 1), length - 1)
    size = 2 ** int(np.ceil(np.log2(2 * length)))
    spectrum = np.fft.rfft(residual, size, axis=1)
    pairs = np.fft.rfft(seen.astype(np.float64), size, axis=1)
    products = np.fft.irfft(np.einsum("mfc,mfd->fcd", spectrum.conj(), spectrum), size, axis=0)
    number = np.fft.irfft(np.einsum("mfc,mfd->fcd", pairs.conj(), pairs), size, axis=0)
    delay = np.minimum(np.arange(size), size - np.arange(size))
    taper = np.maximum(1.0 - delay / (lags + 1.0), 0.0)[:, None, None]
    density = np.fft.rfft(taper * products / np.maximum(number, 1.0), axis=0)
    total = np.zeros((slopes.shape[-1],) * 2)
    for one in slopes:
        turned = np.fft.rfft(one, size, axis=0)
        # Both lie on the same grid of frequencies, so that convolution and sum are one product.
        weight = np.full(turned.shape[0], 2.0)
        weight[0] = weight[-1] = 1.0
        total += np.einsum(
            "f,fci,fdc,fdj->ij", weight, turned.conj(), density, turned, optimize=True
        ).real
    values, vectors = np.linalg.eigh(0.5 * (total + total.T) / size)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T
