"""One flight as a diagnosis looks at it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.diagnose.motion import Motion
from gcs_sysid.estimate.coefficients import Samples


@dataclass(frozen=True)
class Observed:
    """What was flown, and how well it is known.

    Attributes:
        motion: what was measured.
        samples: the coefficients made of it, with their noise.
        piece: maneuver of each sample; negative outside of all.
        alpha_sigma: standard deviation of the angle of attack used [rad].
        beta_sigma: of the sideslip [rad].
        accelerometer_sigma: of the bias taken off the accelerometer [m/s²].
        delay_sigma: of the surfaces' delay [s].
        airspeed: what the kinematics alone say of the airspeed's scale error.
        airspeed_sigma: one standard deviation of that; infinite where they say nothing.
        indicated: true airspeed as indicated, at every sample [m/s]; not a number between messages.
        through_air: airspeed that velocity over ground and the steady wind make [m/s].
        gust: standard deviation of the gust over airspeed.
        vanes: whether flow vanes were recorded.
    """

    motion: Motion
    samples: Samples
    piece: Int[np.ndarray, " sample"]
    alpha_sigma: Float[np.ndarray, " sample"]
    beta_sigma: Float[np.ndarray, " sample"]
    accelerometer_sigma: Float[np.ndarray, " axis"]
    delay_sigma: float
    airspeed: float
    airspeed_sigma: float
    indicated: Float[np.ndarray, " sample"]
    through_air: Float[np.ndarray, " sample"]
    gust: float
    vanes: bool
