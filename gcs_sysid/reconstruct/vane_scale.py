"""How far a flight in gusts may be believed about the scale of its flow vanes.

A vane's scale shows where the flow that the inertial motion foretells differs from what the vane
says; the gust between them is a state of the filter. But a gust moves the aircraft as well: what
the filter has not yet seen of it is in the motion already, which then runs against the vane, and
the vane seems to turn too little. The unseen part is the error with which a random walk (the gust,
q a second) is foretold from white noise (the vane, r times its interval), √(q r) in variance; over
the size of the foretold angle it bounds what it feigns of the scale. That error does not shrink
with more samples. The filter holds it as a prior so narrow that the scale moves only as far as it
should.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.model.kinematics import BLOCKS, MEASURED, Noise
from gcs_sysid.reconstruct.smoother import Inputs, Smoothed

SCALE = BLOCKS["vane_scale"]


@dataclass(frozen=True)
class ScaleBelief:
    """Standard deviations of the scales of both vanes.

    Attributes:
        prior: before the flight.
        seen: by `rows` samples of the flight, did gusts feign nothing.
        rows: samples behind `seen`.
        feigned: what gusts may feign.
    """

    prior: Float[np.ndarray, " two"]
    seen: Float[np.ndarray, " two"]
    rows: int
    feigned: Float[np.ndarray, " two"]

    def held(
        self, covariance: Float[np.ndarray, "state state"], inputs: Inputs
    ) -> Float[np.ndarray, "state state"]:
        """The prior covariance under which the samples of `inputs` move the scale far enough."""
        seen = self.seen * np.sqrt(self.rows / inputs.step.shape[0])
        result = covariance.copy()
        deviation = np.minimum(self.prior, seen * self.prior / self.feigned)
        result[SCALE, SCALE] = np.diag(deviation**2)
        return result

    def told(self, smoothed: Smoothed) -> Smoothed:
        """The smoothed flight with the scales' own deviation: prior and feigned part together."""
        deviation = smoothed.deviation.copy()
        both = self.prior * self.feigned / np.hypot(self.prior, self.feigned)
        deviation[:, SCALE] = np.maximum(deviation[:, SCALE], both)
        return smoothed._replace(deviation=deviation)


def scale_belief(
    noise: Noise,
    smoothed: Smoothed,
    inputs: Inputs,
    covariance: Float[np.ndarray, "state state"],
) -> ScaleBelief:
    """What part of a flight, smoothed with the prior `covariance`, says of its vanes."""
    prior = np.sqrt(np.diagonal(covariance)[SCALE])
    after = np.minimum(smoothed.deviation[0, SCALE], 0.999 * prior)
    steady = smoothed.rest[:, BLOCKS["velocity"]] - smoothed.rest[:, BLOCKS["wind"]]
    speed, *angles = frames.flow_angles(frames.unrotate(smoothed.attitude, steady))
    moved = np.std(np.stack(angles, axis=-1), axis=0)
    usual = float(np.mean(speed))
    seen = np.count_nonzero(inputs.measured.valid[:, list(MEASURED).index("vanes")])
    interval = float(np.sum(inputs.step)) / max(seen, 1)
    growth = 2.0 * np.asarray(noise.gust)[[2, 1]] ** 2 / float(noise.gust_time)
    white = (np.asarray(noise.measured)[MEASURED["vanes"]] * usual) ** 2 * interval
    unseen = (growth * white) ** 0.25
    return ScaleBelief(
        prior=prior,
        seen=1.0 / np.sqrt(1.0 / after**2 - 1.0 / prior**2),
        rows=inputs.step.shape[0],
        feigned=unseen / (usual * moved),
    )
