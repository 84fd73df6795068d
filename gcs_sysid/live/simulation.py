"""The aircraft file's aerodynamics as a flight is held against them: those without tables."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft

Values = Mapping[str, Float[np.ndarray, " sample"]]


class Simulation:
    """Coefficients of an aircraft file.

    Args:
        aircraft: its file.

    Attributes:
        names: coefficients that it has terms of, and no tables.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._terms = {
            name: [
                (regressors.parse(key, controls=aircraft.control_names), term)
                for key, term in model.terms.items()
            ]
            for name, model in aircraft.aerodynamics.items()
            if model.terms and not model.tables
        }
        self.names = tuple(self._terms)

    def at(
        self, name: str, values: Values
    ) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
        """One of the coefficients, and its variance by the file's own sigmas."""
        value = variance = np.zeros_like(next(iter(values.values())))
        for parsed, term in self._terms[name]:
            column = np.asarray(regressors.evaluate(parsed, values))
            value = value + term.value * column
            variance = variance + (term.sigma * column) ** 2
        return value, variance

    def text(self) -> str:
        """Terms and values: two of the same text say the same."""
        return "; ".join(
            f"{name} {parsed.key} {term.value!r}"
            for name, terms in self._terms.items()
            for parsed, term in terms
        )
