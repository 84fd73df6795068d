"""States and measured coefficients of a flight as the aided filter knows them."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.estimate import coefficients
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.frames import Array
from gcs_sysid.model import aided
from gcs_sysid.model.aided import State
from gcs_sysid.offline import flight as flights
from gcs_sysid.offline.flight import Flight
from gcs_sysid.reconstruct.reconstruction import Reconstruction


def refined(
    one: Flight,
    unknowns: Unknowns,
    delay: Delay,
    states: State,
    covariance: Float[np.ndarray, "sample state state"],
) -> Flight:
    """The flight with the aided filter's states in place of the kinematic ones.

    Args:
        one: as reconstructed by kinematics.
        unknowns: sensor errors and intensities found.
        delay: of the surfaces, found with them.
        states: smoothed, one a sample.
        covariance: of their error states.
    """
    noise = jax.tree.map(np.exp, unknowns.log_noise)
    sensors = unknowns.means.sensors
    old = one.reconstruction
    flow, spread = (np.asarray(part) for part in _felt(states, jnp.asarray(covariance)))
    gust = np.asarray(noise.turbulence.gust)
    level = np.sqrt(np.mean(gust[:2] ** 2))
    known = replace(
        old,
        noise=old.noise._replace(
            accelerometer=np.asarray(noise.accelerometer),
            gyro=np.asarray(noise.gyro),
            gust=np.array([level, level, gust[2]]),
            # As a gust of first order with the same spectrum at low frequency.
            gust_time=0.5 * np.asarray(noise.turbulence.gust_length)[2] / np.median(flow[:, 0]),
        ),
        airspeed=flow[:, 0],
        alpha=flow[:, 1],
        beta=flow[:, 2],
        flow_covariance=spread[:, :3, :3],
        rate=old.data.gyro - np.asarray(sensors.gyro_bias),
        force=old.data.accelerometer - np.asarray(sensors.accelerometer_bias),
        euler=frames.euler_from_quaternion(np.asarray(states.attitude)),
        wind=np.asarray(states.air.wind) + np.asarray(states.air.gust),
        gust_rate=np.asarray(frames.unrotate(states.attitude, states.air.spin)),
    )
    return replace(
        one,
        reconstruction=known,
        delay=delay,
        samples=_measured(one, delay, known, flow, spread),
    )


TELLS = {"alpha": "CZ", "beta": "CY"}
"""Which force tells the filter a flow angle."""


def unsure_of(samples: Samples, model: AeroModel) -> Samples:
    """The samples with what the model's own uncertainty does to their flow angles.

    Without vanes the filter knows the angle of attack by the lift that it makes. The accelerometer
    measures the force to a part in a thousand, so that an error δC(x) of the modelled force, slow
    beside the filter, is an error of the angle that makes up for it,

        δα = −δCZ / (∂CZ/∂α),    δβ = −δCY / (∂CY/∂β),

    the same in all maneuvers where it comes from the constant. Slopes are their means over the
    flight: an angle that is wrong all along does not come and go where the lift curve is flat.
    Vanes, where there are any, know better: then this is the most that it can be. An angle that
    the modelled force does not depend on is not told by it.

    Args:
        samples: at states of a filter that holds `model`.
        model: the aerodynamics with their covariance.
    """
    lasting = {}
    for angle, force in TELLS.items():
        if force not in model.fits or angle not in model.depends_on(force):
            continue
        known = model.predict(samples.regressors, measured=False)[force].deviation ** 2
        # What the model does not describe comes and goes, and is in the filter's own noise.
        known = np.maximum(known - model.discrepancy(force) ** 2, 0.0)
        slope = float(np.mean(model.derivative(force, angle, samples.regressors).mean))
        lasting[angle] = known / slope**2
    return replace(samples, regressor_lasting=lasting)


def _measured(
    one: Flight,
    delay: Delay,
    states: Reconstruction,
    flow: Float[np.ndarray, "sample six"],
    spread: Float[np.ndarray, "sample six six"],
) -> Samples:
    """Coefficients from the inertial unit, at the air-relative motion that the filter knows."""
    aircraft, shape = one.aircraft, one.aircraft.geometry
    samples = coefficients.measure(
        states,
        aircraft,
        controls=flights.deflections(one.recording, aircraft, states.time, delay.value),
        thrust=flights.thrust(one.recording, aircraft, states),
        refused=one.samples.refused,
    )
    lengths = np.array([shape.wing_span, shape.mean_chord, shape.wing_span])
    unit = 0.5 * lengths / states.airspeed[:, None]
    names = ("phat", "qhat", "rhat")
    rates = dict(zip(names, (flow[:, 3:] * unit).T, strict=True))
    variance = np.einsum("sii->si", spread)
    return replace(
        samples,
        regressors={**samples.regressors, **rates},
        regressor_variance={
            "alpha": variance[:, 1],
            "beta": variance[:, 2],
            **dict(zip(names, (variance[:, 3:] * unit**2).T, strict=True)),
        },
    )


@jax.jit
def _felt(
    states: State, covariance: Float[Array, "sample state state"]
) -> tuple[Float[Array, "sample six"], Float[Array, "sample six six"]]:
    """Airspeed, flow angles and rates that the air feels, with their covariance."""

    def one(state: State, spread: Float[Array, "state state"]) -> tuple[Array, Array]:
        def felt(error: Float[Array, " state"]) -> Float[Array, " six"]:
            at = aided.compose(state, error)
            through = frames.unrotate(at.attitude, at.velocity - at.air.wind - at.air.gust)
            turning = at.rate - frames.unrotate(at.attitude, at.air.spin)
            return jnp.concatenate([jnp.stack(frames.flow_angles(through)), turning])

        zero = jnp.zeros(aided.SIZE)
        slope = jax.jacfwd(felt)(zero)
        return felt(zero), slope @ spread @ slope.T

    return jax.vmap(one)(states, covariance)
