"""A flight as a diagnosis looks at it."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.motion import Motion
from gcs_sysid.diagnose.observed import Observed
from gcs_sysid.model.kinematics import MEASURED
from gcs_sysid.offline import flight as flights
from gcs_sysid.offline.flight import Flight
from gcs_sysid.reconstruct import rates
from gcs_sysid.reconstruct.reconstruction import PRIOR


def observed(flight: Flight, aircraft: Aircraft) -> Observed:
    """What a flight measured, before it was turned into coefficients, and how well it is known.

    Args:
        flight: read and reconstructed with this aircraft file.
        aircraft: the file, less controls that the log lacks.
    """
    states, samples = flight.reconstruction, flight.samples
    data = states.data
    smooth = rates.smooth(samples.time, states.rate, samples.smoothing)
    angle = rates.smooth(samples.time, states.alpha[:, None], samples.smoothing)
    thrust = flights.thrust(flight.recording, aircraft, states)
    cg = np.broadcast_to(np.array(aircraft.mass.cg), thrust.force.shape)
    controls = {name: samples.regressors[name] for name in aircraft.control_names}
    value, deviation = (
        float(states.block("airspeed_scale")[-1, 0]),
        float(states.deviation("airspeed_scale")[-1, 0]),
    )
    stated = aircraft.pitot.error.scale_sigma
    airspeed, sigma = _without_prior(
        value, deviation, PRIOR["airspeed_scale"] if stated is None else stated
    )
    flow = np.sqrt(np.einsum("sii->si", states.flow_covariance))
    gust = float(states.noise.gust[0]) / float(np.mean(states.airspeed))
    return Observed(
        motion=Motion(
            airspeed=jnp.asarray(states.airspeed),
            alpha=jnp.asarray(states.alpha),
            beta=jnp.asarray(states.beta),
            alpha_rate=jnp.asarray(angle.derivative[:, 0]),
            rate=jnp.asarray(smooth.value),
            acceleration=jnp.asarray(smooth.derivative),
            force=jnp.asarray(states.force),
            lever=jnp.asarray(states.lever),
            thrust=jnp.asarray(thrust.force),
            thrust_moment=jnp.asarray(thrust.moment + np.cross(cg, thrust.force)),
            density=jnp.asarray(states.density),
            height=jnp.asarray(states.height),
            controls={name: jnp.asarray(column) for name, column in controls.items()},
            control_rates={
                name: jnp.asarray(np.gradient(column, samples.time))
                for name, column in controls.items()
            },
            airspeed_scale=jnp.asarray(value),
        ),
        samples=samples,
        piece=flight.pieces(),
        alpha_sigma=flow[:, 1],
        beta_sigma=flow[:, 2],
        accelerometer_sigma=states.deviation("accelerometer_bias").mean(axis=0),
        delay_sigma=flight.delay.deviation,
        airspeed=airspeed,
        airspeed_sigma=sigma,
        indicated=np.where(
            np.asarray(data.measured.valid)[:, list(MEASURED).index("airspeed")],
            np.asarray(data.measured.airspeed)[:, 0],
            np.nan,
        ),
        through_air=np.linalg.norm(states.block("velocity") - states.block("wind"), axis=1),
        gust=gust,
        vanes="vanes" in data.used,
    )


def _without_prior(value: float, deviation: float, prior: float) -> tuple[float, float]:
    """What the data alone say of a number estimated under a prior of mean zero."""
    left = 1.0 / deviation**2 - 1.0 / prior**2
    if left <= 1e-6 / prior**2:
        return 0.0, float("inf")
    return value / deviation**2 / left, float(1.0 / np.sqrt(left))
