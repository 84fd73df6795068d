"""How much better a file predicts with a cause in it, on maneuvers that took no part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.diagnose.unknowns import Columns
from gcs_sysid.diagnose.whitening import Blocks, Noise


@dataclass(frozen=True)
class Score:
    """Prediction of coefficients.

    Attributes:
        nlpd: negative log predictive density [nat a block and coefficient]; not a number where
            nothing was held out.
        errors: 100·RMS(measured − predicted)/std(measured) of each coefficient.
    """

    nlpd: float
    errors: Float[np.ndarray, " coefficient"]

    @property
    def error(self) -> float:
        """Mean over the coefficients."""
        return float(np.mean(self.errors))


def score(
    data: Blocks, noise: Noise, columns: Columns, wrong: Float[np.ndarray, " unknown"]
) -> Score:
    """How well the file predicts when it is corrected by `wrong`.

    The predictive deviation is that of the noise and of the file's own aerodynamic sigmas, the same
    whatever the correction.
    """
    if data.left.shape[0] == 0:
        return Score(float("nan"), np.array([np.nan]))
    left = data.left - data.columns @ wrong
    own = np.array([_aerodynamic(name) for name in columns.names])
    file = np.sum((data.columns[:, :, own] * columns.sigma[own]) ** 2, axis=2)
    deviation = np.sqrt(noise.deviation**2 + file)
    density = 0.5 * (left / deviation) ** 2 + np.log(deviation) + 0.5 * np.log(2.0 * np.pi)
    spread = np.maximum(data.measured.std(axis=0), 1e-12)
    return Score(float(np.mean(density)), 100.0 * np.sqrt(np.mean(left**2, axis=0)) / spread)


def airspeed_scores(
    indicated: Float[np.ndarray, " sample"],
    through_air: Float[np.ndarray, " sample"],
    fitted: Bool[np.ndarray, " sample"],
    held_out: Bool[np.ndarray, " sample"],
) -> tuple[Score, Score]:
    """How well held-out airspeeds are predicted from the kinematics without and with a scale.

    The scale, and the deviation that is claimed, come from other samples of the flight; the steady
    wind comes from the whole of it.

    Args:
        indicated: airspeed [m/s], not a number where there was none.
        through_air: the same from velocity over ground and wind [m/s].
        fitted: samples that give the scale.
        held_out: samples that are predicted.
    """
    seen = np.isfinite(indicated)
    ours, theirs = fitted & seen, held_out & seen
    if not ours.any() or not theirs.any():
        nothing = Score(float("nan"), np.array([np.nan]))
        return nothing, nothing
    ratio = float(indicated[ours] @ through_air[ours] / (through_air[ours] @ through_air[ours]))
    spread = float(np.std(indicated[theirs]))

    def of(scale: float) -> Score:
        deviation = float(np.sqrt(np.mean((indicated - scale * through_air)[ours] ** 2)))
        error = (indicated - scale * through_air)[theirs]
        density = 0.5 * (error / deviation) ** 2 + np.log(deviation) + 0.5 * np.log(2.0 * np.pi)
        relative = 100.0 * float(np.sqrt(np.mean(error**2))) / spread
        return Score(float(np.mean(density)), np.array([relative]))

    return of(1.0), of(ratio)


def _aerodynamic(name: str) -> bool:
    return name.split(".")[0] in ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
