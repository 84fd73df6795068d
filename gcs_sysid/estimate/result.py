"""An identified aerodynamic model: coefficients, derivatives and how far each can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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
        deviations: one standard deviation of `flight_value` by origin: `noise` (coloured residuals),
            `scale` (mass, inertia, thrust), `regressor` (errors of the flow angles).
        white_deviation: what textbook least squares would claim.
        discrepancy: standard deviation of what neither noise nor uncertain flow angles explain.
        residual: standard deviation of measured minus model.
        correlation: of the regressors.
        excitation: standard deviation of each term's contribution over that of the coefficient.
        lowest: smallest value of each regressor in the data.
        highest: largest value.
        samples: rows fitted.
        effective_samples: independent rows that would give the same standard errors.
    """

    keys: tuple[str, ...]
    value: Float[np.ndarray, " term"]
    covariance: Float[np.ndarray, "term term"]
    flight_value: Float[np.ndarray, " term"]
    deviations: Mapping[str, Float[np.ndarray, " term"]]
    white_deviation: Float[np.ndarray, " term"]
    discrepancy: float
    residual: float
    correlation: Float[np.ndarray, "term term"]
    excitation: Float[np.ndarray, " term"]
    lowest: Float[np.ndarray, " term"]
    highest: Float[np.ndarray, " term"]
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
        seen: dict[str, None] = {}
        for fit in self.fits.values():
            for key in fit.keys:
                for name in regressors.parse(key, controls=self.controls).variables:
                    seen.setdefault(name)
        return tuple(seen)

    def predict(
        self,
        values: Mapping[str, Float[np.ndarray, " sample"]],
        *,
        variance: Mapping[str, Float[np.ndarray, " sample"]] | None = None,
    ) -> dict[str, Prediction]:
        """Every coefficient at given conditions.

        Args:
            values: one array a variable, see `variables`.
            variance: of those variables that are themselves estimates; its effect is added.
        """
        out = {}
        for name, fit in self.fits.items():
            rows = basis.columns(fit.keys, self.controls, values)
            spread = np.einsum("si,ij,sj->s", rows, fit.covariance, rows, optimize=True)
            spread = spread + fit.discrepancy**2
            for variable, amount in (variance or {}).items():
                slope = basis.slopes(fit.keys, self.controls, values, variable) @ fit.value
                spread = spread + slope**2 * amount
            out[name] = Prediction(rows @ fit.value, np.sqrt(np.maximum(spread, 0.0)))
        return out

    def derivative(
        self, name: str, variable: str, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Prediction:
        """∂C/∂variable at given conditions, with one standard deviation."""
        fit = self.fits[name]
        slope = basis.slopes(fit.keys, self.controls, values, variable)
        spread = np.einsum("si,ij,sj->s", slope, fit.covariance, slope, optimize=True)
        return Prediction(slope @ fit.value, np.sqrt(np.maximum(spread, 0.0)))
