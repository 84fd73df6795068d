"""An identified aerodynamic model: coefficients, derivatives and how far each can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid import regressors
from gcs_sysid.estimate import basis


@dataclass(frozen=True)
class Prior:
    """Values believed before the flight and one standard deviation of each, by regressor key."""

    value: Mapping[str, float]
    sigma: Mapping[str, float]


@dataclass(frozen=True)
class CoefficientFit:
    """One coefficient as a linear combination of regressors.

    Attributes:
        keys: regressors.
        value: their coefficients (derivatives, per rad or dimensionless), prior included.
        covariance: of `value`: coloured residuals, scale errors, regressor errors, prior.
        flight_value: what the flight alone says.
        deviations: one standard deviation of `flight_value` by origin: `noise` (coloured
            residuals), `scale` (mass, inertia, thrust), `regressor` (errors of the flow angles);
            inside the filter also `lag` (of the moments behind the surfaces).
        late: by how much each value goes with one deviation of that lag, all in the same direction;
            0 where none was reckoned with.
        white_deviation: what textbook least squares would claim.
        repeated_covariance: of `value` for use at regressors measured in the same way as those it
            was fitted on: without the part of regressor errors, which then repeat themselves.
        discrepancy: standard deviation of what the noise of the measurement does not explain.
        calibration: factor, at most 1, to the variance of that noise where residuals are smaller.
        residual: standard deviation of measured minus model.
        correlation: of the regressors.
        excitation: standard deviation of each term's contribution over that of the coefficient.
        lowest: smallest value of each regressor in the data.
        highest: largest value.
        spread: standard deviation of each.
        samples: rows fitted.
        effective_samples: independent rows that would give the same standard errors.
    """

    keys: tuple[str, ...]
    value: Float[np.ndarray, " term"]
    covariance: Float[np.ndarray, "term term"]
    flight_value: Float[np.ndarray, " term"]
    deviations: Mapping[str, Float[np.ndarray, " term"]]
    late: Float[np.ndarray, " term"]
    white_deviation: Float[np.ndarray, " term"]
    repeated_covariance: Float[np.ndarray, "term term"]
    discrepancy: float
    calibration: float
    residual: float
    correlation: Float[np.ndarray, "term term"]
    excitation: Float[np.ndarray, " term"]
    lowest: Float[np.ndarray, " term"]
    highest: Float[np.ndarray, " term"]
    spread: Float[np.ndarray, " term"]
    samples: int
    effective_samples: float

    @property
    def deviation(self) -> Float[np.ndarray, " term"]:
        """One standard deviation of each value."""
        return np.sqrt(np.diagonal(self.covariance))


@dataclass(frozen=True)
class Prediction:
    """A coefficient at given conditions and one standard deviation of the coefficient itself."""

    mean: Float[np.ndarray, " sample"]
    deviation: Float[np.ndarray, " sample"]


@dataclass(frozen=True)
class AeroModel:
    """Identified coefficients by name, and the controls they are functions of."""

    fits: Mapping[str, CoefficientFit]
    controls: tuple[str, ...]

    @property
    def variables(self) -> tuple[str, ...]:
        """Variables and controls that any coefficient uses, in order of first use."""
        return tuple(dict.fromkeys(one for name in self.fits for one in self.depends_on(name)))

    def depends_on(self, name: str) -> tuple[str, ...]:
        """Variables and controls that one coefficient uses, in order of first use."""
        parsed = (regressors.parse(key, controls=self.controls) for key in self.fits[name].keys)
        return tuple(dict.fromkeys(one for item in parsed for one in item.variables))

    def region(
        self, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Int[np.ndarray, " sample"]:
        """Id of the local model that answers at each condition; 0 where there is none."""
        return np.zeros(next(iter(values.values())).shape, dtype=int)

    def discrepancy(self, name: str) -> float:
        """What of a predicted deviation is scatter about the model, no uncertainty of it."""
        return self.fits[name].discrepancy

    def predict(
        self, values: Mapping[str, Float[np.ndarray, " sample"]], *, measured: bool
    ) -> dict[str, Prediction]:
        """Every coefficient at given conditions.

        Args:
            values: one array a variable, see `variables`.
            measured: whether the conditions were measured in a flight like those of the fit. Then
                what their errors do is part of the scatter seen in the fit; exact conditions
                instead ask for the true slopes, whose uncertainty holds how far these errors may
                have bent them.
        """
        out = {}
        for name, fit in self.fits.items():
            rows = basis.columns(fit.keys, self.controls, values)
            covariance = fit.repeated_covariance if measured else fit.covariance
            spread = np.einsum("si,ij,sj->s", rows, covariance, rows, optimize=True)
            deviation = np.sqrt(np.maximum(spread, 0.0) + fit.discrepancy**2)
            out[name] = Prediction(rows @ fit.value, deviation)
        return out

    def derivative(
        self, name: str, variable: str, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Prediction:
        """∂C/∂variable at given conditions, with one standard deviation."""
        fit = self.fits[name]
        slope = basis.slopes(fit.keys, self.controls, values, variable)
        spread = np.einsum("si,ij,sj->s", slope, fit.covariance, slope, optimize=True)
        return Prediction(slope @ fit.value, np.sqrt(np.maximum(spread, 0.0)))
