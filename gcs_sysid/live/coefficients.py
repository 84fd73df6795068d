"""Measured coefficients beside the flight: those of the batch run, over a window that moves on.

A fixed-lag smoother: every `HOP` samples the newest `rates.WINDOW` ones go through the same
functions as a whole flight, and the `HOP` of them that lie `LAG` before the end are kept. Later
samples would hardly change these: the smoother's memory is shorter than `LAG`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gcs_sysid.aircraft import FORCES, Aircraft
from gcs_sysid.estimate import coefficients
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.live.commands import Commands
from gcs_sysid.live.filter import Estimate, flown
from gcs_sysid.live.ring import Ring
from gcs_sysid.model.kinematics import Noise
from gcs_sysid.reconstruct import rates
from gcs_sysid.reconstruct.reconstruction import States
from gcs_sysid.reconstruct.running_rates import RunningRates

HOP = 32
LAG = 16
KEPT = slice(rates.WINDOW - LAG - HOP, rates.WINDOW - LAG)
"""Rows of the window that are new each time, with smoothed neighbours on both sides."""

_COLUMNS = {
    "time": slice(0, 1),
    "flow": slice(1, 4),
    "covariance": slice(4, 13),
    "rate": slice(13, 16),
    "force": slice(16, 19),
    "density": slice(19, 20),
    "height": slice(20, 21),
}


class CoefficientWindow:
    """Turns estimates into measured coefficients.

    Args:
        aircraft: mass properties, geometry, servos, engines.
        commands: what the autopilot commands; filled by the caller.
    """

    def __init__(self, aircraft: Aircraft, commands: Commands) -> None:
        self._aircraft = aircraft
        self._commands = commands
        self._ring = Ring(rates.WINDOW, 21)
        self._rates = RunningRates()
        self._pending: list[Estimate] = []

    def clear(self) -> None:
        """Forgets the window: what comes next does not follow it."""
        self._ring.clear()
        self._pending = []

    def take(
        self, estimate: Estimate, noise: Noise, lever: np.ndarray, *, has_accelerometer: bool
    ) -> Samples | None:
        """Adds an estimate.

        Args:
            estimate: the next one.
            noise: intensities that the estimates rest on.
            lever: position of the inertial unit from the centre of gravity [m].
            has_accelerometer: whether specific force is measured.

        Returns:
            Every `HOP` estimates the coefficients of the whole window, else None.
        """
        self._pending.append(estimate)
        if len(self._pending) < HOP:
            return None
        for row in _packed(self._pending):
            self._ring.add(row)
        self._pending = []
        rows = self._ring.rows()
        self._learn(rows[-HOP:])
        if not self._ring.full or self._commands.missing is not None:
            return None
        if not self._commands.unbroken(rows[KEPT.start - LAG, 0]):
            return None
        return self._measured(rows, noise, lever, has_accelerometer=has_accelerometer)

    def _learn(self, rows: np.ndarray) -> None:
        """Lets the newest rows tell how lively the angular rates are."""
        time = rows[:, 0]
        self._rates.take(np.diff(time, prepend=time[0] - np.median(np.diff(time))), rows[:, 13:16])

    def _measured(
        self, rows: np.ndarray, noise: Noise, lever: np.ndarray, *, has_accelerometer: bool
    ) -> Samples:
        part = {name: rows[:, place] for name, place in _COLUMNS.items()}
        time, flow = part["time"][:, 0], part["flow"]
        states = States(
            time=time,
            noise=noise,
            airspeed=flow[:, 0],
            alpha=flow[:, 1],
            beta=flow[:, 2],
            flow_covariance=part["covariance"].reshape(-1, 3, 3),
            rate=part["rate"],
            force=part["force"],
            lever=lever,
            density=part["density"][:, 0],
            height=part["height"][:, 0],
        )
        ratio, rate_noise = self._rates.found()
        absent = {} if has_accelerometer else dict.fromkeys(FORCES, "no accelerometer is heard")
        return coefficients.measure(
            states,
            self._aircraft,
            controls=self._commands.controls(time),
            thrust=self._commands.thrust(time, states.airspeed, states.density),
            refused=absent,
            motion=rates.motion(time, states.rate, ratio, rate_noise),
        )


def _packed(estimates: Sequence[Estimate]) -> np.ndarray:
    """Rows of the window, in the order of `_COLUMNS`."""
    seen = flown(estimates)
    scalars = np.array([(one.row.time, one.row.density, one.row.height) for one in estimates])
    spread = seen.covariance.reshape(len(estimates), -1)
    return np.concatenate(
        [scalars[:, :1], seen.flow, spread, seen.rate, seen.force, scalars[:, 1:]], axis=1
    )
