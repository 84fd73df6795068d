"""The kinematic filter beside the flight: started from the first seconds in the air, then stepped.

Noise intensities and the first state come from the rows of these seconds in the way in which a
whole flight's do; then one row is one predict and one update of constant cost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.frames import Array
from gcs_sysid.live.intensities import Intensities
from gcs_sysid.live.rows import NEEDED, Row
from gcs_sysid.model.kinematic_jacobians import flow_sensitivity
from gcs_sysid.model.kinematics import (
    BLOCKS,
    MEASURED,
    SIZE,
    Imu,
    Measurements,
    Noise,
    State,
    corrected,
    flow,
)
from gcs_sysid.reconstruct.kinematic_ekf import KinematicFilter
from gcs_sysid.reconstruct.measurements import GAP, FlightData
from gcs_sysid.reconstruct.reconstruction import (
    first_noise,
    first_state,
    repeated,
    sensor_levers,
)

START_S = 3.0
"""Flight that is looked at before the filter starts [s]."""
AGAIN_S = 0.5
"""The same after a hole in the inertial data: only attitude and velocity are begun anew."""
START_ROWS = 1024
"""Rows kept while something needed is missing."""
_LEAST_ROWS = 8
_KEPT = slice(BLOCKS["wind"].start, SIZE)
"""What a hole in the data does not change: wind and sensor errors."""


@jax.jit
def _described(
    state: State,
    covariance: Float[Array, "state state"],
    imu: Imu,
    reference: Float[Array, " axis"],
) -> tuple[Array, Array, Imu]:
    """Flow at the centre of gravity, its covariance, and the inertial sample without errors."""
    sensitivity = flow_sensitivity(state, imu, reference)
    spread = sensitivity @ covariance @ sensitivity.T
    return flow(state, imu, reference), spread, corrected(imu, state.rest)


_all_described = jax.jit(jax.vmap(_described, in_axes=(0, 0, 0, None)))


class Flown(NamedTuple):
    """What several estimates say of flow and motion.

    Attributes:
        flow: true airspeed [m/s], angle of attack, sideslip [rad] at the centre of gravity.
        covariance: of the three.
        rate: angular rate, sensor errors off [rad/s].
        force: specific force at the inertial unit, sensor errors off [m/s²].
    """

    flow: Float[np.ndarray, "sample three"]
    covariance: Float[np.ndarray, "sample three three"]
    rate: Float[np.ndarray, "sample axis"]
    force: Float[np.ndarray, "sample axis"]


@dataclass(frozen=True)
class Estimate:
    """State at one inertial sample, from everything up to it.

    Attributes:
        row: what it was updated with.
        attitude: quaternion, body to NED.
        rest: additive state.
        covariance: of the error state.
        reference: centre of gravity from the inertial unit [m].
        nis: normalised innovation squared of each group of measurements that is new in the row.
    """

    row: Row
    attitude: Float[np.ndarray, " four"]
    rest: Float[np.ndarray, " state"]
    covariance: Float[np.ndarray, "state state"]
    reference: Float[np.ndarray, " axis"]
    nis: Float[np.ndarray, " group"]

    @property
    def deviation(self) -> Float[np.ndarray, " state"]:
        """One standard deviation of the error state."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))

    @property
    def flow(self) -> Float[np.ndarray, " three"]:
        """True airspeed [m/s], angle of attack, sideslip [rad] at the centre of gravity."""
        return np.asarray(self._described[0])

    @property
    def flow_covariance(self) -> Float[np.ndarray, "three three"]:
        """Of the three."""
        return np.asarray(self._described[1])

    @cached_property
    def _described(self) -> tuple[Array, Array, Imu]:
        # Not for every update: half of them are followed by one of the same moment.
        state = State(self.attitude, self.rest)
        return _described(state, self.covariance, self.row.after, self.reference)


def flown(estimates: Sequence[Estimate]) -> Flown:
    """Flow and motion of several estimates, at hardly more cost than those of one."""
    given = [(State(one.attitude, one.rest), one.covariance, one.row.after) for one in estimates]
    stacked = jax.tree.map(lambda *each: np.stack(each), *given)
    flow_, covariance, imu = _all_described(*stacked, estimates[0].reference)
    parts = (flow_, covariance, imu.gyro, imu.accelerometer)
    return Flown(*(np.asarray(part) for part in parts))


class LiveFilter:
    """Reconstruction of a flight while it goes on.

    Args:
        aircraft: sensor positions and what is known of their errors.

    Attributes:
        restarts: how often the filter had to begin again, by holes in the data or by losing its
            footing.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._levers, self._reference = sensor_levers(aircraft)
        self._waiting: deque[Row] = deque(maxlen=START_ROWS)
        self._filter: KinematicFilter | None = None
        self._intensities: Intensities | None = None
        self._before: KinematicFilter | None = None
        self.restarts = 0

    @property
    def started(self) -> bool:
        """Whether estimates come out."""
        return self._filter is not None

    @property
    def noise(self) -> Noise:
        """Intensities in use; only once `started`."""
        if self._filter is None:
            raise ValueError("`noise` is known once the filter is `started`")
        return self._filter.noise

    @property
    def lever(self) -> Float[np.ndarray, " axis"]:
        """Position of the inertial unit from the centre of gravity [m]."""
        return -self._reference

    @property
    def missing(self) -> tuple[str, ...]:
        """What the start still waits for."""
        seen = self._seen()
        return tuple(group for group in NEEDED if group not in seen)

    def stop(self) -> None:
        """Ends the flight; the next row begins another one."""
        self._waiting.clear()
        self._filter = self._before = None

    def restart(self) -> None:
        """Forgets states and begins anew, from what comes."""
        self._waiting.clear()
        self._lost()

    def take(self, row: Row, used: dict[str, str]) -> list[Estimate]:
        """Moves on by a row.

        Args:
            row: the next one, or the newest once more with what came after it.
            used: stream behind each group of measurements.

        Returns:
            Estimates: one a row; none while the start is prepared, and then those of all its rows.
        """
        if row.again and self._filter is None:
            if self._waiting and self._waiting[-1].time == row.time:
                self._waiting[-1] = replace(row, new=row.measured.valid, again=False)
            return []
        if row.again:
            return self._stepped(row)
        if self._filter is not None and row.step > GAP:
            self.restarts += 1
            self._before, self._filter = self._filter, None
        if self._filter is not None:
            return self._stepped(row)
        self._waiting.append(row)
        enough = AGAIN_S if self._before is not None else START_S
        long_enough = row.time - self._waiting[0].time >= enough
        if self.missing or not long_enough or len(self._waiting) < _LEAST_ROWS:
            return []
        rows = list(self._waiting)
        self._waiting.clear()
        self._begin(rows, used)
        return [item for later in rows[1:] for item in self._stepped(later)]

    def _seen(self) -> set[str]:
        return {
            group
            for index, group in enumerate(MEASURED)
            if any(row.measured.valid[index] for row in self._waiting)
        }

    def _begin(self, rows: list[Row], used: dict[str, str]) -> None:
        data = _flight_data(rows, used)
        state, covariance = first_state(data, self._aircraft, 0)
        noise = first_noise(data)
        if self._before is not None:
            rest, covariance = np.array(state.rest), np.array(covariance)
            rest[_KEPT] = self._before.x[_KEPT]
            covariance[_KEPT, _KEPT] = self._before.P[_KEPT, _KEPT]
            state, noise = State(state.attitude, jnp.asarray(rest)), self._before.noise
            self._before = None
        self._filter = KinematicFilter(state, covariance, self._levers, noise)
        self._intensities = Intensities(
            noise, data.measured.valid.any(axis=0), repeated(data.time, data.measured)
        )
        self._filter.observe(rows[0].after, rows[0].measured)

    def _stepped(self, row: Row) -> list[Estimate]:
        running, intensities = self._filter, self._intensities
        if running is None or intensities is None:
            return []
        try:
            if not row.again:
                running.predict((row.before, row.after, row.step))
            if row.new.any():
                running.observe(row.after, row.measured._replace(valid=row.new))
        except ValueError:  # filterpy's inverse refuses a covariance that is not finite
            return self._lost()
        if not (np.isfinite(running.x).all() and np.isfinite(running.P).all()):
            return self._lost()
        intensities.take(running, row.new, row.step, again=row.again)
        running.noise = intensities.noise
        return [
            Estimate(
                row=row,
                attitude=running.attitude,
                rest=running.x,
                covariance=running.P,
                reference=self._reference,
                nis=np.where(row.new, running.nis, 0.0),
            )
        ]

    def _lost(self) -> list[Estimate]:
        """Begins anew where the numbers have come to nothing."""
        self.restarts += 1
        self._filter = self._before = None
        return []


def _flight_data(rows: list[Row], used: dict[str, str]) -> FlightData:
    """Some rows as one short flight."""

    def stacked(name: str) -> np.ndarray:
        return np.stack([getattr(row.measured, name) for row in rows])

    time = np.array([row.time for row in rows])
    spread = Measurements(*(stacked(name) for name in Measurements._fields))
    seen = [group for index, group in enumerate(MEASURED) if spread.valid[:, index].any()]
    rate = float(1.0 / np.median(np.diff(time)))
    return FlightData(
        time=time,
        gyro=np.stack([np.asarray(row.after.gyro) for row in rows]),
        accelerometer=np.stack([np.asarray(row.after.accelerometer) for row in rows]),
        has_accelerometer="accelerometer" in used,
        measured=spread,
        density=np.array([row.density for row in rows]),
        height=np.array([row.height for row in rows]),
        above_home=False,
        used={
            name: stream for name, stream in used.items() if name in seen or name not in MEASURED
        },
        rates={"gyro": rate},
    )
