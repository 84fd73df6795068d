"""Equation error in the frequency domain, sample by sample: for use beside a flight.

Finite Fourier transforms at fixed frequencies are running sums, so that a sample costs the same
after an hour as after a minute:

    X(ω) = ∫₀ᵀ x e^(−jωt) dt        ∫₀ᵀ ẋ e^(−jωt) dt = [x e^(−jωt)]₀ᵀ + jω X(ω)

A model that holds sample by sample holds for transforms too: z = Σ θ x + c + d·t + v becomes
complex least squares, c and d being transforms of 1 and t, which take offset and drift away without
a filter. What lies outside the band (sensor noise above, slow wind below) does not enter, and a
measured rate is differentiated by its factor jω, not by differences.

The covariance takes v as stationary with a spectral density that is smooth over `SMOOTH`; it is
found from what is left. Transforms of one stretch at neighbouring frequencies are then correlated
by the stretch's own length, E[V(ω₁) V*(ω₂)] = S ∫₀ᵀ e^(−j(ω₁−ω₂)t) dt, so that a fine grid of
frequencies pretends to no more than there is. Errors of the regressors pull slopes toward zero here
as in `equation_error`; they are not counted.

References:
    Morelli, "Real-time parameter estimation in the frequency domain", J. Guidance 23(5), 2000.
    Morelli & Grauer, "Practical aspects of frequency-domain approaches for aircraft system
    identification", J. Aircraft 57(2), 2020.
    Klein & Morelli, *Aircraft System Identification*, 2006, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from gcs_sysid.errors import UsageError
from gcs_sysid.estimate.equation_error import inverse_where_seen

SPACING = 0.04
"""Usual spacing of frequencies [Hz] (Morelli 2000)."""
SMOOTH = 0.4
"""Width [Hz] over which the noise's spectral density hardly changes."""
TREND = 2
"""Columns that offset and drift take."""


@dataclass(frozen=True)
class Spectrum:
    """Running finite Fourier transforms of some channels, of 1 and of time.

    Attributes:
        frequencies: [Hz].
        sums: integrals so far by the trapezoidal rule; the last two columns are of 1 and of time.
        start: time of the first sample [s].
        time: of the newest sample [s].
        first: values at the first sample.
        newest: values at the newest.
    """

    frequencies: Float[np.ndarray, " frequency"]
    sums: Complex[np.ndarray, "frequency column"]
    start: float
    time: float
    first: Float[np.ndarray, " column"]
    newest: Float[np.ndarray, " column"]

    @property
    def duration(self) -> float:
        """Length of what was transformed [s]."""
        return self.time - self.start


@dataclass(frozen=True)
class Estimate:
    """Terms of one equation.

    Attributes:
        value: the terms, offset and drift left out.
        covariance: of them.
        residual: root mean square of what the transforms leave.
        density: spectral density of the noise at each frequency [unit²/Hz], two-sided.
    """

    value: Float[np.ndarray, " term"]
    covariance: Float[np.ndarray, "term term"]
    residual: float
    density: Float[np.ndarray, " frequency"]

    @property
    def deviation(self) -> Float[np.ndarray, " term"]:
        """One standard deviation of each term."""
        return np.sqrt(np.diagonal(self.covariance))


def band(low: float, high: float) -> Float[np.ndarray, " frequency"]:
    """Frequencies from `low` to `high` [Hz], `SPACING` apart.

    Raises:
        UsageError: they are not 0 < low < high.
    """
    if not 0.0 < low < high:
        raise UsageError(f"a band of frequencies needs 0 < low < high, got {low} to {high} Hz")
    return np.arange(low, high + 0.5 * SPACING, SPACING)


def begin(
    frequencies: Float[np.ndarray, " frequency"],
    time: float,
    values: Float[np.ndarray, " channel"],
) -> Spectrum:
    """Transforms that hold their first sample.

    Args:
        frequencies: [Hz].
        time: of the sample [s].
        values: one a channel.
    """
    every = np.concatenate([values, [1.0, 0.0]])
    sums = np.zeros((frequencies.size, every.size), dtype=np.complex128)
    return Spectrum(frequencies, sums, time, time, every, every)


def advance(spectrum: Spectrum, time: float, values: Float[np.ndarray, " channel"]) -> Spectrum:
    """The transforms with one more sample; the same cost and size for every one.

    A sample interval should be a tenth of the highest frequency's period at most.

    Args:
        spectrum: so far.
        time: of the sample, after the newest [s].
        values: one a channel.
    """
    every = np.concatenate([values, [1.0, time - spectrum.start]])
    turn = -2j * np.pi * spectrum.frequencies
    before = np.exp(turn * (spectrum.time - spectrum.start))[:, None] * spectrum.newest
    after = np.exp(turn * (time - spectrum.start))[:, None] * every
    sums = spectrum.sums + 0.5 * (time - spectrum.time) * (before + after)
    return Spectrum(spectrum.frequencies, sums, spectrum.start, time, spectrum.first, every)


def derivative(spectrum: Spectrum, channel: int) -> Complex[np.ndarray, " frequency"]:
    """Transform of a channel's derivative by time, its ends included."""
    turn = 2j * np.pi * spectrum.frequencies
    end = np.exp(-turn * spectrum.duration) * spectrum.newest[channel]
    return end - spectrum.first[channel] + turn * spectrum.sums[:, channel]


def regress(
    spectrum: Spectrum, terms: Sequence[int], measured: Complex[np.ndarray, " frequency"]
) -> Estimate:
    """Complex least squares of one equation, offset and drift beside its terms.

    Args:
        spectrum: holds the terms.
        terms: their channels.
        measured: transform of the left side: a channel's, or a derivative.
    """
    count = len(terms)
    place = [*terms, *range(spectrum.sums.shape[1] - TREND, spectrum.sums.shape[1])]
    columns = _stacked(spectrum.sums[:, place])
    wanted = _stacked(measured)
    inverse, unseen = inverse_where_seen(
        columns.T @ columns, float(np.linalg.norm(wanted)), wanted.size
    )
    gain = inverse @ columns.T
    value = gain @ wanted
    left = wanted - columns @ value
    alike = _correlation(spectrum.frequencies, spectrum.duration)
    rest = np.eye(wanted.size) - columns @ gain
    size = np.sqrt(_density(spectrum.frequencies, left, np.diagonal(rest @ alike @ rest.T)))
    noise = np.concatenate([size, size])
    covariance = gain @ (alike * np.outer(noise, noise)) @ gain.T + unseen @ unseen.T
    return Estimate(
        value=value[:count],
        covariance=covariance[:count, :count],
        residual=float(np.sqrt(np.mean(left**2))),
        density=size**2,
    )


def _stacked(values: Complex[np.ndarray, "*part"]) -> np.ndarray:
    """Real parts, then imaginary parts."""
    return np.concatenate([values.real, values.imag])


def _correlation(
    frequencies: Float[np.ndarray, " frequency"], duration: float
) -> Float[np.ndarray, "part part"]:
    """Covariance of real, then imaginary parts of transforms of white noise of density one."""

    def window(apart: np.ndarray) -> np.ndarray:
        return duration * np.sinc(apart * duration) * np.exp(-1j * np.pi * apart * duration)

    conjugate = window(frequencies[:, None] - frequencies[None, :])
    plain = window(frequencies[:, None] + frequencies[None, :])
    return 0.5 * np.block(
        [
            [(plain + conjugate).real, (plain - conjugate).imag],
            [(plain + conjugate).imag, (conjugate - plain).real],
        ]
    )


def _density(
    frequencies: Float[np.ndarray, " frequency"],
    left: Float[np.ndarray, " part"],
    expected: Float[np.ndarray, " part"],
) -> Float[np.ndarray, " frequency"]:
    """Spectral density of the noise: squared residuals over what density one would leave."""
    apart = (frequencies[:, None] - frequencies[None, :]) / SMOOTH
    weight = np.exp(-0.5 * apart**2)
    square = np.sum((left**2).reshape(2, -1), axis=0)
    return (weight @ square) / (weight @ np.sum(expected.reshape(2, -1), axis=0))
