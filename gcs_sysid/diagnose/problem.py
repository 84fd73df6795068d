"""What a file leaves of one flight, and its signatures, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.diagnose import motion, unknowns
from gcs_sysid.diagnose.observed import Observed
from gcs_sysid.diagnose.unknowns import Columns, Offset


@dataclass(frozen=True)
class Problem:
    """One flight's residuals: left = Σ columns·unknown + noise.

    Attributes:
        time: [s].
        piece: maneuver of each sample; negative outside of all.
        measured: coefficients, in the order of `COEFFICIENTS`.
        left: measured less predicted by the file.
        usable: coefficients that the flight can give and the file has.
        columns: the unknowns.
        offsets: more unknowns, each one of the others within one maneuver.
        airspeed: what the kinematics alone say of the airspeed's scale error.
        airspeed_sigma: one standard deviation of that.
    """

    time: Float[np.ndarray, " sample"]
    piece: Int[np.ndarray, " sample"]
    measured: Float[np.ndarray, "sample six"]
    left: Float[np.ndarray, "sample six"]
    usable: tuple[int, ...]
    columns: Columns
    offsets: tuple[Offset, ...]
    airspeed: float
    airspeed_sigma: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of all unknowns, in the order of the columns of its blocks."""
        return (*self.columns.names, *(offset.name for offset in self.offsets))

    @property
    def sigma(self) -> Float[np.ndarray, " unknown"]:
        """Ordinary standard deviation of all unknowns."""
        return np.concatenate([self.columns.sigma, [offset.sigma for offset in self.offsets]])


def build(aircraft: Aircraft, flight: Observed, *, number: int = 0) -> Problem:
    """The residuals of one flight under a file, and what may have made them.

    Args:
        aircraft: the file.
        flight: what was flown.
        number: of the flight; unknowns that each flight has its own of are named with it.
    """
    base = motion.nothing(aircraft, flight.motion)
    direct = unknowns.quantities(aircraft, flight, base, number)
    parts = (
        direct,
        unknowns.bending(aircraft, flight, number),
    )
    columns = Columns(
        names=tuple(name for part in parts for name in part.names),
        sigma=np.concatenate([part.sigma for part in parts]),
        values=np.concatenate([part.values for part in parts], axis=2),
    )
    measured = np.asarray(jax.jit(lambda flown: motion.measured(aircraft, flown))(flight.motion))
    predicted = np.asarray(
        jax.jit(lambda wrong, flown: motion.predicted(aircraft, wrong, flown))(base, flight.motion)
    )
    left = measured - unknowns.smoothed(flight, predicted[:, :, None])[:, :, 0]
    # Linear about the airspeed that the kinematics prefer, but told from the file's own.
    scale = float(flight.motion.airspeed_scale)
    left = left + columns.values[:, :, columns.names.index("airspeed")] * scale
    return Problem(
        time=flight.samples.time,
        piece=flight.piece,
        measured=measured,
        left=left,
        usable=tuple(
            row
            for row, name in enumerate(COEFFICIENTS)
            if name in aircraft.aerodynamics and name not in flight.samples.refused
        ),
        columns=columns,
        offsets=unknowns.maneuver_offsets(flight, number),
        airspeed=flight.airspeed,
        airspeed_sigma=flight.airspeed_sigma,
    )
