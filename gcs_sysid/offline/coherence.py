"""Where in frequency a simulated motion goes along with the measured one, and how.

Windows of equal length are averaged, each weighed by a raised cosine (Welch 1967). With x measured
and y simulated, the share of y that is a linear answer to x is the coherence |Sxy|²/(Sxx Syy), and
that answer is H = Sxy/Sxx: 1 for a simulation that moves as measured, smaller for one that moves
less, with a lag where it is late. Below a coherence of 0.6 such answers are not read (Tischler &
Remple, *Aircraft and Rotorcraft System Identification*, 2nd ed. 2012, section 7.5).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

COHERENT = 0.6
"""Coherence from which an answer is read."""
LEAST = 6
"""Fewer windows are not averaged: by chance alone one in twenty coherences of five is 0.53."""


def response(
    measured: Float[np.ndarray, "window sample"],
    simulated: Float[np.ndarray, "window sample"],
    step: float,
) -> dict[str, Any] | None:
    """The coherent band about the frequency of most motion, with gain and phase in it.

    Args:
        measured: windows of one channel; their last sample, which begins the next, is left out.
        simulated: likewise.
        step: between samples [s].

    Returns:
        `band_hz`; `gain` and `phase` [rad, a lag is negative] over the whole band, each frequency
        with its power; `hz`, `gains`, `phases`, `coherences` frequency by frequency. None where
        there are too few whole windows, no motion, or no coherence at its frequency.
    """
    whole = np.isfinite(measured).all(axis=1) & np.isfinite(simulated).all(axis=1)
    if whole.sum() < LEAST:
        return None
    one, other = (_spectra(values[whole, :-1]) for values in (measured, simulated))
    power, answer = np.mean(np.abs(one) ** 2, axis=0), np.mean(np.abs(other) ** 2, axis=0)
    cross = np.mean(np.conj(one) * other, axis=0)
    coherence = np.abs(cross) ** 2 / np.maximum(power * answer, 1e-300)
    most = int(np.argmax(power))
    if power[most] == 0.0 or coherence[most] < COHERENT:
        return None
    weak = np.flatnonzero(coherence < COHERENT)
    first = int(np.max(weak[weak < most], initial=-1)) + 1
    last = int(np.min(weak[weak > most], initial=power.size)) - 1
    band = slice(first, last + 1)
    hz = (np.arange(power.size) + 1)[band] / (step * (measured.shape[1] - 1))
    gain, total = cross[band] / power[band], cross[band].sum() / power[band].sum()
    return {
        "band_hz": [float(hz[0]), float(hz[-1])],
        "gain": float(np.abs(total)),
        "phase": float(np.angle(total)),
        "hz": hz.tolist(),
        "gains": np.abs(gain).tolist(),
        "phases": np.angle(gain).tolist(),
        "coherences": coherence[band].tolist(),
    }


def _spectra(values: Float[np.ndarray, "window sample"]) -> np.ndarray:
    """Transforms of windows up to a quarter of the sampling, without their mean."""
    count = values.shape[1]
    weight = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / count)
    mean = values @ weight / weight.sum()
    return np.fft.rfft((values - mean[:, None]) * weight, axis=1)[:, 1 : count // 4]
