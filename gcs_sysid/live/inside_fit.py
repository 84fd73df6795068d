"""A minute of flight fitted inside the filter: where the filter beside the flight begins."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate import filter_error, first_guess, in_common, inside_filter
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.estimate.intensities import Prior as NoisePrior
from gcs_sysid.estimate.result import Prior
from gcs_sysid.estimate.scoring import LostError
from gcs_sysid.estimate.settling import Beliefs
from gcs_sysid.model.aided import Row, State
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import aided_flight
from gcs_sysid.offline.aided_flight import Kinematics
from gcs_sysid.reconstruct.aided_smoother import Beginning


class Task(NamedTuple):
    """What is to be fitted.

    Attributes:
        aircraft: its file.
        prior: derivatives believed before; None ignores the file's.
        rows: the flight.
        states: as kinematics have them.
        begun: likewise, of sensors and gusts.
        used: stream behind each kind of measurement.
    """

    aircraft: Aircraft
    prior: Mapping[str, Prior] | None
    rows: Row
    states: State
    begun: Kinematics
    used: Mapping[str, str]


class Found(NamedTuple):
    """What a minute of flight says.

    Attributes:
        unknowns: derivatives, sensor errors and intensities.
        covariance: of the first two, in the order of `ravel_pytree`.
        beginning: the state after the last row, and its covariance were these known.
        moved: how it moves with them.
        converged: whether the search ended.
        seconds: that it took.
    """

    unknowns: Unknowns
    covariance: Float[np.ndarray, "parameter parameter"]
    beginning: Beginning
    moved: Float[np.ndarray, "state parameter"]
    converged: bool
    seconds: float


def first_terms(
    aircraft: Aircraft, prior: Mapping[str, Prior] | None
) -> dict[str, dict[str, float]]:
    """Derivatives where a search begins, of every term of the usual structure."""
    structure = regressors.default_structure(aircraft)
    if prior is None:
        return first_guess.derivatives(aircraft, structure)
    mean, _ = inside_filter.beliefs(structure, prior, aircraft)
    return {name: dict(terms) for name, terms in mean.items()}


class _Beginning(NamedTuple):
    """Where a search begins; see `filter_error.fit`."""

    model: FlightModel
    flight: Flight
    first: Unknowns
    beliefs: Beliefs


def _beginning(task: Task) -> _Beginning:
    aircraft, rows, states = task.aircraft, task.rows, task.states
    structure = regressors.default_structure(aircraft)
    mean, sigma = inside_filter.beliefs(structure, task.prior, aircraft)
    start = first_terms(aircraft, task.prior)
    model = FlightModel(aided_flight.with_structure(aircraft, start))
    first_state = jax.tree.map(lambda part: part[0], states)
    spread = jnp.diag(jnp.asarray(aided_flight.START_DEVIATION) ** 2)
    flight = Flight(rows, states, Beginning(first_state, spread))
    first = aided_flight.first_unknowns(flight, aircraft, task.begun, start)
    vanes = bool(np.any(rows.measured.valid[:, 3]))
    prior, wide = aided_flight.beliefs(first, aircraft, used=task.used, vanes=vanes, known=sigma)
    keys = in_common.derivative_keys(first.means.aerodynamics)
    centre = in_common.with_values(prior.means, np.array([mean[name][key] for name, key in keys]))
    beliefs = Beliefs(
        np.asarray(ravel_pytree(centre)[0]),
        np.diag(np.asarray(ravel_pytree(wide.means)[0]) ** 2),
        NoisePrior(prior.log_noise, wide.log_noise),
    )
    return _Beginning(model, flight, first, beliefs)


def fitted(task: Task) -> Found | None:
    """Fits a flight; None where the filter loses the aircraft.

    Raises:
        QuickAirError: it cannot tell the aircraft from the air.
    """
    begun_at, count = clock.perf_counter(), task.rows.step.size
    every = np.ones(count, dtype=bool)
    try:
        fit = filter_error.fit(*_beginning(task), every, lambda _: None)
    except LostError:
        return None
    last = jax.tree.map(lambda part: np.asarray(part)[count - 1], fit.states)
    return Found(
        unknowns=jax.tree.map(np.asarray, fit.unknowns),
        covariance=fit.parameters,
        beginning=Beginning(last, np.asarray(fit.smoothed.covariance)[count - 1]),
        moved=np.asarray(fit.moved),
        converged=fit.converged,
        seconds=clock.perf_counter() - begun_at,
    )
