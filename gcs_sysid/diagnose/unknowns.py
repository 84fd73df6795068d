"""All that may have made what a file leaves of a flight: names, ordinary sigmas, signatures.

Beside the quantities of `motion.quantities` these are unknown: every aerodynamic value of the file,
with the sigma that the file gives it; what errors of the flow angles may have bent it by, since a
slope against a noisy angle comes out too small; and offsets of the flow angles, in each maneuver
others. They are part of every hypothesis, so that what they can explain accuses nobody.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS, FORCES, Aircraft
from gcs_sysid.diagnose import motion
from gcs_sysid.diagnose.motion import Motion, Wrong
from gcs_sysid.diagnose.observed import Observed
from gcs_sysid.estimate import basis, equation_error
from gcs_sysid.estimate.suspects import RIGGING
from gcs_sysid.frames import Array
from gcs_sysid.reconstruct import rates

CG_SIGMA = 0.01
"""Ordinary error of a weighed centre of gravity [mean chords]."""
AIRSPEED_SIGMA = 0.01
"""Ordinary scale error of an airspeed indicator; the aircraft file may say otherwise."""
LEAST_DELAY_SIGMA = 0.002
"""No delay is known better than this [s]."""


@dataclass(frozen=True)
class Columns:
    """Unknowns with what a unit of each adds to measured less predicted.

    Attributes:
        names: of the unknowns.
        sigma: ordinary standard deviation of each.
        values: their signatures, coefficients in the order of `COEFFICIENTS`.
    """

    names: tuple[str, ...]
    sigma: Float[np.ndarray, " unknown"]
    values: Float[np.ndarray, "sample six unknown"]


def smoothed(flight: Observed, values: np.ndarray) -> Float[np.ndarray, "sample six unknown"]:
    """Predictions as a measurement would show them: moments through the smoother of the rates."""
    force, moment = values[:, : len(FORCES)], values[:, len(FORCES) :]
    flat = np.ascontiguousarray(moment).reshape(moment.shape[0], -1)
    filtered = rates.smooth(flight.samples.time, flat, flight.samples.smoothing).value
    return np.concatenate([force, filtered.reshape(moment.shape)], axis=1)


def quantities(aircraft: Aircraft, flight: Observed, base: Wrong, number: int) -> Columns:
    """Signatures of everything that `motion` knows, each by one forward derivative."""
    names = tuple(motion.quantities(aircraft))
    directions = {key: jnp.asarray([float(key == name) for name in names]) for key in names}

    def along(direction: Wrong, flown: Motion) -> Array:
        def of(wrong: Wrong) -> Array:
            return motion.predicted(aircraft, wrong, flown)

        return jax.jvp(of, (dict(base),), (direction,))[1]

    # One direction after the other: all at once, a long flight would not fit into memory.
    found = jax.jit(
        lambda every, flown: jax.lax.map(lambda direction: along(direction, flown), every)
    )(directions, flight.motion)
    values = smoothed(flight, np.moveaxis(np.asarray(found), 0, 2))
    own = ("alpha", "beta", "delay", "accelerometer")
    named = tuple(f"{name} #{number}" if name.split(".")[0] in own else name for name in names)
    return Columns(named, _ordinary(aircraft, flight, names), values)


def _ordinary(
    aircraft: Aircraft, flight: Observed, names: tuple[str, ...]
) -> Float[np.ndarray, " unknown"]:
    """How wrong each quantity usually is."""
    stated = aircraft.pitot.error.scale_sigma
    usual = {
        "mass": aircraft.mass.mass_sigma,
        "inertia": aircraft.mass.inertia_sigma,
        "cg": CG_SIGMA,
        "thrust": max((engine.thrust_sigma for engine in aircraft.propulsion), default=0.0),
        "airspeed": AIRSPEED_SIGMA if stated is None else stated,
        "alpha": float(np.sqrt(np.mean(flight.alpha_sigma**2))),
        "beta": float(np.sqrt(np.mean(flight.beta_sigma**2))),
        "delay": max(flight.delay_sigma, LEAST_DELAY_SIGMA),
        "effectiveness": 0.0,
        "offset": RIGGING,
        **dict.fromkeys(COEFFICIENTS, 1.0),
    }
    usual |= {
        f"accelerometer.{axis}": float(value)
        for axis, value in zip(motion.AXES, flight.accelerometer_sigma, strict=True)
    }
    return np.array([usual.get(name, usual.get(name.split(".")[0], 0.0)) for name in names])


def bending(aircraft: Aircraft, flight: Observed, number: int) -> Columns:
    """What errors of the regressors may have taken off the slopes, see `equation_error.pull`."""
    names, columns = [], []
    for row, coefficient in enumerate(COEFFICIENTS):
        model = aircraft.aerodynamics.get(coefficient)
        if model is None or not model.terms or coefficient in flight.samples.refused:
            continue
        stacked = equation_error.problem(
            coefficient, [flight.samples], aircraft, tuple(model.terms), [flight.piece]
        )
        value = np.array([term.value for term in model.terms.values()])
        error = np.einsum(
            "vs,vsi,vsj->ij",
            stacked.slope_variance,
            stacked.slopes,
            stacked.slopes,
            optimize=True,
        )
        residual = stacked.measured - stacked.columns @ value
        lengths = (float(np.linalg.norm(each)) for each in (residual, stacked.noise))
        information = stacked.columns.T @ stacked.columns
        bent = equation_error.pull(error, information, value, *lengths)
        spread = equation_error.bounded(bent @ bent.T, stacked.plausible)
        size, direction = np.linalg.eigh(spread)
        every = basis.columns(tuple(model.terms), aircraft.control_names, flight.samples.regressors)
        for index in range(size.size):
            names.append(f"bent {coefficient} {index} #{number}")
            along = direction[:, index] * np.sqrt(max(float(size[index]), 0.0))
            columns.append((row, every @ along))
    return Columns(tuple(names), np.ones(len(names)), smoothed(flight, _placed(columns, flight)))


@dataclass(frozen=True)
class Offset:
    """An unknown that is another one (`of`) within one maneuver (`piece`)."""

    name: str
    sigma: float
    of: str
    piece: int


def maneuver_offsets(flight: Observed, number: int) -> tuple[Offset, ...]:
    """Offsets of the flow angles that differ from maneuver to maneuver."""
    return tuple(
        Offset(
            name=f"{angle} #{number} maneuver {piece}",
            sigma=float(np.sqrt(np.mean(spread[flight.piece == piece] ** 2))),
            of=f"{angle} #{number}",
            piece=int(piece),
        )
        for angle, spread in (("alpha", flight.alpha_sigma), ("beta", flight.beta_sigma))
        for piece in np.unique(flight.piece[flight.piece >= 0])
    )


def _placed(
    columns: list[tuple[int, Float[np.ndarray, " sample"]]], flight: Observed
) -> Float[np.ndarray, "sample six unknown"]:
    """Columns of one coefficient each, with zeros for the others."""
    values = np.zeros((flight.samples.time.size, len(COEFFICIENTS), len(columns)))
    for index, (row, column) in enumerate(columns):
        values[:, row, index] = column
    return values
