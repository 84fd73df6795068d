"""The aided filter, row by row: filterpy's extended Kalman filter over the whole flight model.

The live form of `causal`: each row is linearised about what the filter expects, so that both are
the same filter, one row at a time with filterpy's arithmetic (Joseph form) or a flight at once in
`jax.lax.scan`; a test holds them together. filterpy's state is the error state: nought but for the
moment of an update, after which it is folded into the aircraft's.

Live nobody looks back, so that the filter itself says whether it still follows the aircraft:
innovations squared over their covariance are one a measurement as long as it does (Bar-Shalom, Li &
Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4.2).
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

MEMORY = 100
"""Rows after which what innovations were has faded to a third: some seconds, as a gust that the
intensities do not expect may last."""
LOST = 10.0
"""Innovations whose squares are so many times as large as they should be, for seconds, are those of
a filter that follows another aircraft. Intensities that are all wrong by a factor of two make
four."""


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

    Attributes:
        excess: squares of the last innovations over what they should be; near 1 where all is well.
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
        self._faded = np.zeros(2)
        self.excess = 1.0

    @property
    def lost(self) -> bool:
        """Whether the filter lost the aircraft: what it says then is no number."""
        # What is not a number is not less either.
        return not self.excess < LOST

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
        # Absent rows have no innovation.
        row = np.array([self.y @ self.SI @ self.y, np.count_nonzero(seen.present)])
        self._faded = (1.0 - 1.0 / MEMORY) * self._faded + row
        squares, count = self._faded
        self.excess = float(squares / count) if count > 0.0 else 1.0
        self.state, self.x = _folded(self.state, self.x), np.zeros(SIZE)
