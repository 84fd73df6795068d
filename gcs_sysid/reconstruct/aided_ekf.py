"""The aided filter, row by row: filterpy's extended Kalman filter over the whole flight model.

The live form of `causal`: each row is linearised about what the filter expects, so that both are
the same filter, one row at a time with filterpy's arithmetic (Joseph form) or a flight at once in
`jax.lax.scan`; a test holds them together. filterpy's state is the error state: nought but for the
moment of an update, after which it is folded into the aircraft's.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter

from gcs_sysid.model import aided, aided_linear
from gcs_sysid.model.aided import ROW_COUNT, SIZE, Means, Noise, Row, State
from gcs_sysid.model.aided_linear import Linearised
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct.aided_smoother import Beginning


@jax.jit
def _ahead(
    model: FlightModel, means: Means, noise: Noise, state: State, row: Row
) -> tuple[State, Linearised]:
    """State at the end of a row's step, and the row about the step."""
    after = aided.advance(model.aircraft, means, noise, state, row)
    inner = aided_linear.mechanics(model.aircraft, means, state, after, row)
    return after, aided_linear.linearise(model.aircraft, means, noise, state, after, row, inner)


_folded = jax.jit(aided.compose)


class AidedFilter(ExtendedKalmanFilter):  # filterpy ships no type information
    """Live reconstruction with the aerodynamics inside: `predict_x` is the flight model.

    Args:
        model: the aircraft.
        means: derivatives and sensor errors.
        noise: intensities.
        beginning: belief about the state before the first row.
    """

    def __init__(
        self, model: FlightModel, means: Means, noise: Noise, beginning: Beginning
    ) -> None:
        super().__init__(dim_x=SIZE, dim_z=ROW_COUNT)
        self.x = np.zeros(SIZE)
        self.P = np.asarray(beginning.covariance)
        self.state = beginning.state
        self._known = (model, means, noise)
        self._seen: Linearised | None = None

    def predict_x(self, u: Row | int = 0) -> None:
        """Moves the state to the end of the step that leads to a row."""
        if not isinstance(u, Row):
            raise TypeError("`u` must be a row")
        self.state, self._seen = _ahead(*self._known, self.state, u)
        self.F, self.Q = np.asarray(self._seen.transition), np.asarray(self._seen.process)

    def observe(self) -> None:
        """Takes in what the row predicted last has measured."""
        if self._seen is None:
            raise ValueError("no row was predicted")
        seen: Any = jax.tree.map(np.asarray, self._seen)
        self.R = np.diag(seen.variance)
        self.update(
            seen.residual, HJacobian=lambda _: seen.sensitivity, Hx=lambda _: np.zeros(ROW_COUNT)
        )
        self.state, self.x = _folded(self.state, self.x), np.zeros(SIZE)
