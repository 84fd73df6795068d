"""From estimates of the kinematic filter to rows of the aided one, some moments later.

What `aided_flight.prepare` does with a whole flight: commands and measurements that belong to a
row may arrive after it, so that rows are made in batches of one shape, each `LAG_S` behind the
newest estimate. Estimates that come faster than the equations ask for are left out; what was
measured beside them goes to the nearest row that stays.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.live.commands import Commands
from gcs_sysid.live.filter import Estimate, flown
from gcs_sysid.model import aided, runge_kutta
from gcs_sysid.model.aided import State
from gcs_sysid.model.kinematics import BLOCKS, MEASURED, Measurements
from gcs_sysid.offline import aided_flight

BATCH = 32
"""Rows that are made at once."""
LAG_S = 0.3
"""What belongs to a row has arrived by then [s]: commands of the next tenth of a second, and
positions that a satellite receiver was late with."""
HOLE_S = 0.5
"""Over a longer step [s] nothing is known of the air any more: rows begin anew."""
SETTLED_S = 2.0
"""Estimates of a kinematic filter that has just begun are left out for so long [s]. After a hole of
five seconds in a flight an aided filter that began at the first one had innovations five times as
large as they should be, and moved Cm_alpha by 2.5 of its deviations; so it moved by a tenth."""
APART = 0.55
"""Of the longest step that the equations allow: rows are no closer than this."""


class Batch(NamedTuple):
    """Rows that follow each other.

    Attributes:
        rows: what the aided filter reads; a first row of step 0 begins anew.
        states: of the kinematic filter, at the rows.
        time: of the rows [s after the epoch].
    """

    rows: aided.Row
    states: State
    time: Float[np.ndarray, " row"]


class _Kept(NamedTuple):
    """A row to be: its time, the step to it, and the estimate there; none in a hole."""

    time: float
    step: float
    estimate: Estimate
    there: bool


class InsideRows:
    """Makes rows of the aided filter.

    Args:
        aircraft: how long its steps may be, and its sensors.
        commands: what the autopilot commands; filled by the caller.
    """

    def __init__(self, aircraft: Aircraft, commands: Commands) -> None:
        self._aircraft = aircraft
        self._commands = commands
        self._kept: list[_Kept] = []
        self._last: Estimate | None = None
        self._begun: float | None = None
        self._longest = aided_flight.LONGEST_STEP
        self._measured: dict[str, deque[tuple[float, Float[np.ndarray, " value"]]]] = {
            group: deque(maxlen=4 * BATCH) for group in MEASURED
        }

    def clear(self) -> None:
        """What comes next does not follow what came."""
        self._kept, self._last, self._begun = [], None, None
        for waiting in self._measured.values():
            waiting.clear()

    def take(self, estimate: Estimate, lever: Float[np.ndarray, " axis"]) -> Batch | None:
        """Adds a finished estimate; returns a batch of rows when one can be made.

        Args:
            estimate: the next one.
            lever: from the centre of gravity to the inertial unit [m].
        """
        self._keep(estimate)
        whole = len(self._kept) > BATCH
        if not whole or estimate.row.time - self._kept[BATCH].time < LAG_S:
            return None
        batch, self._kept = self._kept[:BATCH], self._kept[BATCH:]
        return self._made(batch, lever)

    def _keep(self, estimate: Estimate) -> None:
        time, last = estimate.row.time, self._last
        if last is not None and time - last.row.time > HOLE_S:
            self.clear()
            last = None
        self._begun = time if self._begun is None else self._begun
        if time - self._begun < SETTLED_S:
            return
        self._wait(estimate)
        if last is None:
            speed = np.array([estimate.flow[0]])
            density = np.array([estimate.row.density])
            self._longest = aided_flight.longest_step(self._aircraft, speed, density)
            self._kept.append(_Kept(time, 0.0, estimate, there=True))
            self._last = estimate
            return
        step = time - last.row.time
        if step < APART * self._longest:
            return
        parts = max(int(np.ceil(step / self._longest - 0.1)), 1)
        for part in range(1, parts):
            between = last.row.time + part * step / parts
            self._kept.append(_Kept(between, step / parts, last, there=False))
        self._kept.append(_Kept(time, step / parts, estimate, there=True))
        self._last = estimate

    def _wait(self, estimate: Estimate) -> None:
        """Puts what was measured beside an estimate among what waits for its row."""
        row = estimate.row
        for index, group in enumerate(MEASURED):
            if row.measured.valid[index]:
                # The aided filter has a pitot tube's lag itself: see `measurements.as_shown`.
                shown = self._aircraft.pitot.error.lag if group == "airspeed" else 0.0
                when = row.time + float(row.measured.age[index]) + shown
                self._measured[group].append((when, np.asarray(getattr(row.measured, group))))

    def _made(self, kept: list[_Kept], lever: Float[np.ndarray, " axis"]) -> Batch:
        time = np.array([one.time for one in kept])
        step = np.array([one.step for one in kept])
        there = np.array([one.there for one in kept])
        states = np.stack([one.estimate.rest for one in kept])
        rows = [one.estimate.row for one in kept]
        height = np.array([row.height for row in rows])
        gyro, force = (
            np.stack([np.asarray(getattr(row.after, name)) for row in rows])
            for name in ("gyro", "accelerometer")
        )
        velocity, wind, gust = (states[:, BLOCKS[name]] for name in ("velocity", "wind", "gust"))
        bias = states[:, BLOCKS["gyro_bias"]]
        moments = aided_flight.within(time - step, time)
        controls = self._controls(moments)
        earlier = self._controls(moments - aided_flight.SLOPE_STEP)
        settings = self._settings(moments)
        made = aided.Row(
            step=step,
            controls=controls,
            control_slopes=(earlier - controls) / aided_flight.SLOPE_STEP,
            control_changes=np.zeros((*controls.shape, 0)),
            settings=settings,
            setting_changes=np.zeros((*settings.shape, 0)),
            density=np.array([row.density for row in rows]),
            height=height,
            climbed=height,
            passing=np.linalg.norm(velocity - wind, axis=1),
            gyro=np.where(there[:, None], gyro, 0.0),
            accelerometer=np.where(there[:, None], force, 0.0),
            inertial=there,
            modelled=self._commands.known(time - step, time),
            measured=self._nearest(time, there, 0.5 * (time[-1] + self._kept[0].time)),
        )
        attitude = np.stack([one.estimate.attitude for one in kept])
        turns = np.sum(np.diff(attitude, axis=0) ** 2, axis=1) > 2.0
        signs = np.cumprod(np.concatenate([[1.0], np.where(turns, -1.0, 1.0)]))
        speed = flown([one.estimate for one in kept]).flow[:, :1]
        first = aided_flight.first_states(
            *(attitude * signs[:, None], velocity, wind, gust, gyro - bias, speed, lever)
        )
        return Batch(made, first, time)

    def _controls(
        self, moments: Float[np.ndarray, "row moment"]
    ) -> Float[np.ndarray, "row three control"]:
        names = self._aircraft.control_names
        if not self._commands.heard:
            return np.zeros((moments.shape[0], 3, len(names)))
        found = self._commands.controls(moments.ravel())
        each = [found[name].reshape(moments.shape) for name in names]
        return runge_kutta.inputs(np.stack(each, axis=-1))

    def _settings(
        self, moments: Float[np.ndarray, "row moment"]
    ) -> Float[np.ndarray, "row three engine"]:
        if not self._commands.heard:
            return np.zeros((moments.shape[0], 3, len(self._aircraft.propulsion)))
        found = self._commands.settings(moments.ravel())
        return runge_kutta.inputs(found.reshape(*moments.shape, -1))

    def _nearest(
        self, time: Float[np.ndarray, " row"], there: Bool[np.ndarray, " row"], end: float
    ) -> Measurements:
        """What was measured nearest to each row, before `end`; of two of a kind the nearer one."""
        count, places = time.size, np.flatnonzero(there)
        valid, age = np.zeros((count, len(MEASURED)), dtype=bool), np.zeros((count, len(MEASURED)))
        level = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1))
        values = {
            "airspeed": np.zeros((count, 1)),
            "velocity": np.zeros((count, 3)),
            "attitude": level,
            "vanes": np.zeros((count, 2)),
        }
        for index, group in enumerate(MEASURED):
            waiting = self._measured[group]
            while waiting and waiting[0][0] < end:
                when, value = waiting.popleft()
                row = places[np.argmin(np.abs(time[places] - when))]
                off = when - float(time[row])
                nearer = not valid[row, index] or abs(off) < abs(age[row, index])
                if nearer and abs(off) <= self._longest:
                    valid[row, index], age[row, index] = True, off
                    values[group][row] = value
        return Measurements(**values, valid=valid, age=age)
