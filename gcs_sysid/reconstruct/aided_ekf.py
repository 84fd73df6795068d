"""The aided filter, row by row: filterpy's extended Kalman filter over the whole flight model.

The live form of `causal`: each row is linearised about what the filter expects, so that both are
the same filter, one row at a time with filterpy's arithmetic (Joseph form) or a flight at once in
`jax.lax.scan`; a test holds them together. filterpy's state is the error state: nought but for the
moment of an update, after which it is folded into the aircraft's.

Behind the error state stand derivatives and sensor errors that are not known exactly: constants,
which the filter goes on finding as it flies (Jategaonkar, *Flight Vehicle System Identification*,
2nd ed. 2015, chapter 7). An angle of attack that was found with a derivative goes with it, and
their covariance knows that. So the beginning has to be near, and the intensities right: a filter
that expects other gusts than blow takes them for derivatives. `filter_error` finds both, of so much
flight that a part of that error is left; what is known of derivatives therefore grows old.

Live nobody looks back, so that the filter itself says whether it still follows the aircraft:
innovations squared over their covariance are one a measurement as long as it does (Bar-Shalom, Li &
Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4.2).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from jax.flatten_util import ravel_pytree
from jaxtyping import Float, Int

from gcs_sysid.frames import Array
from gcs_sysid.model import aided, aided_linear, departures
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


# Four programs: for all in one the compiler takes 100 MB more while it compiles (of 400).
_advance = jax.jit(lambda model, *rest: aided.advance(model.aircraft, *rest))
_linearise = jax.jit(lambda model, *rest: aided_linear.linearise(model.aircraft, *rest))
_mechanics = jax.jit(lambda model, *rest: aided_linear.mechanics(model.aircraft, *rest))


@jax.jit
def _felt(
    model: FlightModel,
    means: Means,
    sought: Int[Array, " sought"],
    noise: Noise,
    state: State,
    after: State,
    row: Row,
) -> tuple[Float[Array, "state sought"], Float[Array, "row sought"]]:
    """How the state after a row's step, and what is measured there, move with what is sought."""
    flat, unravel = ravel_pytree(means)

    def felt(values: Float[Array, " sought"]) -> tuple[Array, Array]:
        other = unravel(flat.at[sought].set(values))
        there = aided.advance(model.aircraft, other, noise, state, row)
        left = aided.innovation(model.aircraft, other, after, row)
        return aided.difference(there, after), left

    moved, left = jax.jacfwd(felt)(flat[sought])
    present = aided_linear.present_rows(row)
    return moved, jnp.where(present[:, None], -left, 0.0)


@jax.jit
def _folded(
    state: State, means: Means, sought: Int[Array, " sought"], error: Float[Array, " error"]
) -> tuple[State, Means]:
    flat, unravel = ravel_pytree(means)
    return aided.compose(state, error[:SIZE]), unravel(flat.at[sought].add(error[SIZE:]))


@jax.jit
def _flowing(
    model: FlightModel, means: Means, state: State, row: Row
) -> tuple[Float[Array, " three"], Float[Array, "three state"]]:
    """Flow at the centre of gravity, and how it changes with an error state."""

    def flow(error: Float[Array, " state"]) -> tuple[Array, Array]:
        at = aided.compose(state, error)
        centre = departures.centre(model.aircraft, means.departures)
        found = jnp.stack(aided.through_air(model.aircraft, means, at, row, at.rate, centre))
        return found, found

    slope, value = jax.jacfwd(flow, has_aux=True)(jnp.zeros(SIZE))
    return value, slope


class AidedFilter(ExtendedKalmanFilter):  # filterpy ships no type information
    """Live reconstruction with the aerodynamics inside: `predict_x` is the flight model.

    Args:
        model: the aircraft.
        means: derivatives and sensor errors.
        covariance: of these, in the order of `ravel_pytree`; what has no variance is held.
        noise: intensities.
        beginning: belief about the state before the first row, were all means known.
        moved: how that state moves with them; zeros where it was found without.
        drift: by how much more the covariance of the means is believed wrong each second.

    Attributes:
        state: of the aircraft.
        means: derivatives and sensor errors as they are known now.
        sought: which of them the filter goes on finding, in the order of `ravel_pytree`.
        excess: squares of the last innovations over what they should be; near 1 where all is well.
    """

    def __init__(
        self,
        model: FlightModel,
        means: Means,
        covariance: Float[np.ndarray, "parameter parameter"],
        noise: Noise,
        beginning: Beginning,
        moved: Float[np.ndarray, "state parameter"],
        drift: Float[np.ndarray, "parameter parameter"],
    ) -> None:
        self.sought = np.flatnonzero(np.diagonal(covariance) > 0.0)
        super().__init__(dim_x=SIZE + self.sought.size, dim_z=ROW_COUNT)
        self.x = np.zeros(self.dim_x)
        known, with_them = covariance[np.ix_(self.sought, self.sought)], moved[:, self.sought]
        self.P[:SIZE, :SIZE] = beginning.covariance + with_them @ known @ with_them.T
        self.P[:SIZE, SIZE:] = with_them @ known
        self.P[SIZE:, :SIZE] = self.P[:SIZE, SIZE:].T
        self.P[SIZE:, SIZE:] = known
        self.state = beginning.state
        self.means = means
        self._model, self._noise = model, noise
        self._drift = drift[np.ix_(self.sought, self.sought)]
        self._seen: tuple[Linearised, Float[np.ndarray, "row sought"]] | None = None
        # As if all had been well: one row tells nothing of seconds.
        self._faded = np.full(2, float(MEMORY))
        self.excess = 1.0

    @property
    def lost(self) -> bool:
        """Whether the filter lost the aircraft: what it says then is no number."""
        # What is not a number is not less either.
        return not self.excess < LOST

    @property
    def covariance(self) -> Float[np.ndarray, "parameter parameter"]:
        """Of derivatives and sensor errors as known now, in the order of `ravel_pytree`."""
        size = ravel_pytree(self.means)[0].size
        known = np.zeros((size, size))
        known[np.ix_(self.sought, self.sought)] = self.P[SIZE:, SIZE:]
        return known

    def flow(self, row: Row) -> tuple[Float[np.ndarray, " three"], Float[np.ndarray, " three"]]:
        """True airspeed [m/s], angle of attack and sideslip [rad] at the centre of gravity.

        Args:
            row: that was taken in last.

        Returns:
            Values, and one standard deviation of each, all told.
        """
        value, slope = _flowing(self._model, self.means, self.state, row)
        spread = np.asarray(slope) @ self.P[:SIZE, :SIZE] @ np.asarray(slope).T
        return np.asarray(value), np.sqrt(np.maximum(np.diagonal(spread), 0.0))

    def predict_x(self, u: Row | int = 0) -> None:
        """Moves the state to the end of the step that leads to a row."""
        if not isinstance(u, Row):
            raise TypeError("`u` must be a row")
        model, means, noise, state = self._model, self.means, self._noise, self.state
        after = _advance(model, means, noise, state, u)
        inner = _mechanics(model, means, state, after, u)
        seen = _linearise(model, means, noise, state, after, u, inner)
        moved, shown = _felt(model, means, self.sought, noise, state, after, u)
        self._seen, self.state = (seen, np.asarray(shown)), after
        self.F, self.Q = np.eye(self.dim_x), np.zeros((self.dim_x, self.dim_x))
        self.F[:SIZE, :SIZE], self.F[:SIZE, SIZE:] = seen.transition, moved
        self.Q[:SIZE, :SIZE] = seen.process
        self.Q[SIZE:, SIZE:] = float(u.step) * self._drift

    def observe(self) -> None:
        """Takes in what the row predicted last has measured."""
        if self._seen is None:
            raise ValueError("no row was predicted")
        seen: Any = jax.tree.map(np.asarray, self._seen[0])
        view = np.concatenate([seen.sensitivity, self._seen[1]], axis=1)
        self.R = np.diag(seen.variance)
        self.update(seen.residual, HJacobian=lambda _: view, Hx=lambda _: np.zeros(ROW_COUNT))
        # Absent rows have no innovation.
        row = np.array([self.y @ self.SI @ self.y, np.count_nonzero(seen.present)])
        self._faded = (1.0 - 1.0 / MEMORY) * self._faded + row
        squares, count = self._faded
        self.excess = float(squares / count)
        self.state, self.means = _folded(self.state, self.means, self.sought, self.x)
        self.x = np.zeros(self.dim_x)
