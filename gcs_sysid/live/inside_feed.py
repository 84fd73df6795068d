"""Feeds the filter with the aerodynamics inside with what the kinematic filter has finished."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live import inside_known
from gcs_sysid.live.commands import Commands
from gcs_sysid.live.filter import Estimate
from gcs_sysid.live.inside_known import Fed, Filtering, Known
from gcs_sysid.live.inside_rows import InsideRows
from gcs_sysid.model.kinematics import BLOCKS
from gcs_sysid.model.kinematics import Noise as KinematicNoise
from gcs_sysid.offline.aided_flight import Kinematics

_OFF = Known(phase="off")


class InsideFeed:
    """Makes rows of estimates, and hands them on.

    Args:
        aircraft: its file.
        commands: what the autopilot commands; filled by the caller.
        prior: derivatives believed before; None ignores the file's.
        to: what is fed; None leaves the aerodynamics out of the filter.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        commands: Commands,
        prior: Mapping[str, Prior] | None,
        to: Filtering | None,
    ) -> None:
        # A file without aerodynamics believes in nothing.
        self._aircraft, self._prior, self._to = aircraft, prior or None, to
        self._maker = InsideRows(aircraft, commands)
        self._count = 0

    @property
    def known(self) -> Known:
        """The newest of everything."""
        return _OFF if self._to is None else self._to.known

    def clear(self) -> None:
        """What comes next does not follow what came."""
        self._maker.clear()

    def take(
        self,
        estimate: Estimate,
        noise: KinematicNoise,
        lever: Float[np.ndarray, " axis"],
        used: Mapping[str, str],
    ) -> None:
        """Adds a finished estimate.

        Args:
            estimate: of the kinematic filter.
            noise: intensities that it rests on.
            lever: from the centre of gravity to the inertial unit [m].
            used: stream behind each kind of measurement.
        """
        if self._to is None or "accelerometer" not in used:
            return
        batch = self._maker.take(estimate, lever)
        if batch is not None:
            begun = Kinematics(
                *(estimate.rest[BLOCKS[name]] for name in ("gyro_bias", "accelerometer_bias")),
                np.asarray(noise.gust),
            )
            self._to.take(Fed(self._count, batch, begun, dict(used)))
            self._count += 1

    def state(self) -> Mapping[str, np.ndarray]:
        """Everything learned so far, as arrays by name; nothing before there is anything."""
        return self.known.state

    def restore(self, state: Mapping[str, np.ndarray]) -> bool:
        """Goes on from the `state` of one for the same aircraft.

        Returns:
            Whether it does; without a state it begins anew.

        Raises:
            KeyError: something is missing.
            ValueError: something has another shape, or is not finite.
        """
        found = inside_known.learned(state, self._aircraft, self._prior)
        if found is None or self._to is None:
            return False
        self._to.restore(inside_known.state(found))
        return True
