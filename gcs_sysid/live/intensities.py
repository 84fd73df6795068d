"""Noise of the measurements and intensity of the gusts, learned while the filter runs.

The batch run finds them by expectation–maximisation over the smoothed flight; here each update
gives its expected square and a slow average holds them (Shumway & Stoffer 1982 with the filtered in
the place of the smoothed moments). With e the innovation, S its covariance and R the noise:

    E[noise²] = (R S⁻¹ e)² + diag(R − R S⁻¹ R)        E[gust²] = ĝ² + P_gg
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid import frames
from gcs_sysid.model.kinematics import BLOCKS, MEASURED, Noise
from gcs_sysid.reconstruct.kinematic_ekf import KinematicFilter
from gcs_sysid.reconstruct.reconstruction import (
    MEASURED_FLOOR,
    UNSEEN_VERTICAL_GUST,
    gust_intensities,
)

MEMORY_S = 20.0
"""Time constant of the average [s]; shorter at first, so that the first guess is soon forgotten."""
FIRST_MEMORY_S = 3.0
_WIDTHS = np.array([rows.stop - rows.start for rows in MEASURED.values()])
_VANES = list(MEASURED).index("vanes")


class Intensities:
    """What the newest minute of flight says of the noise.

    Args:
        first: intensities to begin with.
        seen: groups of measurements that the flight has, in the order of `MEASURED`.
        repeated: samples that share one error, of each row; see `reconstruction.repeated`.
    """

    def __init__(
        self,
        first: Noise,
        seen: Bool[np.ndarray, " group"],
        repeated: Float[np.ndarray, " row"],
    ) -> None:
        self._first = first
        self._repeated = repeated
        self._age = 0.0
        self._vanes = bool(seen[_VANES])
        self._square = np.asarray(first.measured) ** 2 / repeated
        gust = np.asarray(first.gust) ** 2
        self._level, self._vertical = float(gust[0]), float(gust[2])

    @property
    def noise(self) -> Noise:
        """Intensities as they are believed now."""
        level = np.sqrt(self._level)
        vertical = np.sqrt(self._vertical) if self._vanes else UNSEEN_VERTICAL_GUST * level
        return self._first._replace(
            measured=np.maximum(np.sqrt(self._square), MEASURED_FLOOR) * np.sqrt(self._repeated),
            gust=gust_intensities(float(level), float(vertical)),
        )

    def take(
        self,
        running: KinematicFilter,
        valid: Bool[np.ndarray, " group"],
        step: float,
        *,
        again: bool = False,
    ) -> None:
        """Learns from the update just made.

        Args:
            running: the filter after it.
            valid: groups of measurements that were in it.
            step: time since the one before [s].
            again: whether this is a further update at the same time: no time has gone by, and the
                gust has told what it has to tell.
        """
        self._age += 0.0 if again else step
        share = 1.0 - np.exp(-step / np.clip(self._age, FIRST_MEMORY_S, MEMORY_S))
        present = np.repeat(valid, _WIDTHS)
        known = running.R @ running.SI
        noise = (known @ running.y) ** 2 + np.diagonal(running.R - known @ running.R)
        noise = np.minimum(noise, 25.0 * self._square)
        self._square = self._square + np.where(present, share, 0.0) * (noise - self._square)
        if again:
            return
        gust = running.x[BLOCKS["gust"]]
        second = gust**2 + np.diagonal(running.P)[BLOCKS["gust"]]
        if self._vanes:
            self._level += share * (0.5 * (second[0] + second[1]) - self._level)
            self._vertical += share * (second[2] - self._vertical)
            return
        ahead = frames.rotate(running.attitude, np.array([1.0, 0.0, 0.0]))[:2]
        along = float(second[:2] @ ahead**2 / max(float(ahead @ ahead), 1e-6))
        self._level += share * (along - self._level)
