"""Filter error on whole flights: models, and the flights with the states that the filter knows.

Flights follow each other: what one has told of the derivatives is the prior of the next, while
sensors and gusts are each flight's own. The model that is scored is found first, and learns nothing
from held-out maneuvers; the model that is kept starts from it and takes in all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool

from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.estimate import filter_error, first_guess, flight_rows, inside_filter
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.inside_filter import Derivatives, Terms
from gcs_sysid.estimate.intensities import Prior as NoisePrior
from gcs_sysid.estimate.result import AeroModel, Prior
from gcs_sysid.estimate.scoring import LostError
from gcs_sysid.estimate.settling import Beliefs
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.offline import aided_flight, aided_states
from gcs_sysid.offline.flight import SERVO_STREAM, Flight, Progress
from gcs_sysid.reconstruct import aided_smoother
from gcs_sysid.reconstruct.aided_smoother import FlightModel

LONGEST = 20000
"""Rows of a flight that are fitted at most, those with the most control; states are found for all
of them."""
STILL_GROWING, STILL_MOVING = 2.0, 1.5
"""A search that has not ended has found nothing where its log-likelihood changed by more than this
with its last step [nat], and a derivative was to move by more than this [its deviations]. Biases
that are told to a hundredth of a thousandth may still be on their way."""


class UnsettledError(Exception):
    """The search found no end; the message says what to do."""


@dataclass(frozen=True)
class AidedFlights:
    """What filter error made of the flights.

    Attributes:
        flights: with the filter's states and the coefficients measured at them.
        scored: the model without the held-out maneuvers.
        final: the model of all.
        fits: of the final model, one a flight.
        notes: what the engineer should know.
    """

    flights: list[Flight]
    scored: AeroModel
    final: AeroModel
    fits: tuple[Fit, ...]
    notes: tuple[str, ...]


class _Prepared(NamedTuple):
    one: Flight
    rows: flight_rows.Flight
    held: Bool[np.ndarray, " row"]
    first: Unknowns


def identify(
    flights: Sequence[Flight],
    aircraft: Aircraft,
    structure: Mapping[str, Sequence[str]],
    prior: Mapping[str, Prior] | None,
    held_out: Sequence[int],
    progress: Progress,
) -> AidedFlights:
    """Fits the flights, one after the other.

    Args:
        flights: as reconstructed by kinematics.
        aircraft: its description.
        structure: regressor keys by coefficient.
        prior: values believed before; None leaves the file's values out, as a start too.
        held_out: ids of maneuvers that the scored model may not learn from.
        progress: told what is being done.

    Raises:
        UnsettledError: the search did not end, on which flight and what to do.
    """
    mean, sigma = inside_filter.beliefs(structure, prior, aircraft)
    start = mean if prior is not None else first_guess.derivatives(aircraft, structure)
    model = FlightModel(aided_flight.with_structure(aircraft, start))
    prepared = [_prepared(one, start, held_out) for one in flights]
    steps = 2 * len(prepared)

    def told(number: int) -> Callable[[str], None]:
        return lambda text: progress(f"fitting the model: {text}", number / steps)

    scored_fits, final_fits = [], []
    found = _believed(mean, sigma)
    for number, item in enumerate(prepared):
        first = item.first if number == 0 else _with(item.first, found)
        fit = _fit(model, item, first, found, ~item.held, None, told(number))
        scored_fits.append(fit)
        found = _after(found, fit)
    scored = found
    if any(item.held.any() for item in prepared):
        found = _believed(mean, sigma)
        for number, item in enumerate(prepared):
            first = _with(scored_fits[number].unknowns, scored)
            every = np.ones_like(item.held)
            tell = told(len(prepared) + number)
            fit = _fit(model, item, first, found, every, scored_fits[number], tell)
            final_fits.append(fit)
            found = _after(found, fit)
    else:
        # Nothing was held out: both models are one.
        final_fits = scored_fits
    progress("smoothing with the model", 1.0)
    seen = [
        _smoothed(model, item, _with(fit.unknowns, scored))
        for item, fit in zip(prepared, scored_fits, strict=True)
    ]
    samples = [one.samples for one in seen]
    kept = [one.pieces() for one in seen]
    learned = [np.where(np.isin(piece, list(held_out)), -1, piece) for piece in kept]
    return AidedFlights(
        flights=seen,
        scored=inside_filter.model(scored, samples, aircraft, structure, learned),
        final=inside_filter.model(found, samples, aircraft, structure, kept),
        fits=tuple(final_fits),
        notes=(
            *(_cut_short(item) for item in prepared if item.rows.rows.step.size > LONGEST),
            *(
                _unended(item, fit)
                for item, fit in zip(prepared, final_fits, strict=True)
                if not fit.converged
            ),
        ),
    )


def _prepared(one: Flight, start: Terms, held_out: Sequence[int]) -> _Prepared:
    states = one.reconstruction
    rows = aided_flight.prepare(one.recording, one.aircraft, states)
    time = states.time[0] + np.cumsum(rows.rows.step)
    held = np.zeros(time.size, dtype=bool)
    for segment in one.segments:
        if segment.id in held_out:
            held |= (time >= segment.start) & (time < segment.end)
    return _Prepared(
        one, rows, held, aided_flight.first_unknowns(rows, one.aircraft, states, start)
    )


def _believed(mean: Terms, sigma: Terms) -> Derivatives:
    """The prior as what is known so far."""
    keys = tuple((name, key) for name in sorted(mean) for key in sorted(mean[name]))
    value = np.array([mean[name][key] for name, key in keys])
    spread = np.array([sigma[name][key] for name, key in keys])
    precision = np.diag(1.0 / spread**2)
    return Derivatives(keys, value, np.diag(spread**2), value, precision, spread)


def _after(before: Derivatives, fit: Fit) -> Derivatives:
    """What is known with one flight more; each flight's information adds to the bound's."""
    if fit.keys != before.keys:
        raise ValueError("derivatives in another order")
    values = fit.unknowns.means.aerodynamics
    value = np.array([float(values[name][key]) for name, key in fit.keys])
    first = np.array_equal(np.linalg.inv(before.covariance), before.precision)
    least = np.sqrt(np.diagonal(fit.bound))
    bound = least if first else 1.0 / np.hypot(1.0 / before.bound, 1.0 / least)
    return before._replace(value=value, covariance=fit.covariance, bound=bound)


def _with(unknowns: Unknowns, found: Derivatives) -> Unknowns:
    """These unknowns with other derivatives."""
    values: dict[str, dict[str, jax.Array]] = {}
    for (name, key), value in zip(found.keys, found.value, strict=True):
        values.setdefault(name, {})[key] = jnp.asarray(value)
    return unknowns._replace(means=unknowns.means._replace(aerodynamics=values))


def _fit(
    model: FlightModel,
    item: _Prepared,
    first: Unknowns,
    found: Derivatives,
    counts: Bool[np.ndarray, " row"],
    earlier: Fit | None,
    progress: Callable[[str], None],
) -> Fit:
    rows = item.rows
    if rows.rows.step.shape[0] > LONGEST:
        begin = flight_rows.busiest(rows, LONGEST)
        rows, counts = flight_rows.cut(rows, begin), counts[begin]
    off = "mass, inertia, signs of the controls or the thrust of the aircraft file may be far off"
    source, before = item.one.recording.source, _beliefs(item, found)
    try:
        stretch = None if earlier is None else earlier.stretch
        fit = filter_error.fit(model, rows, first, before, counts, progress, stretch=stretch)
    except LostError as error:
        raise UnsettledError(f"{source}: the filter lost the aircraft: {off}") from error
    growing = abs(_grown(fit)) > STILL_GROWING
    if not fit.converged and growing and fit.moving > STILL_MOVING:
        raise UnsettledError(
            f"{source}: the likelihood of the model inside the filter still changed by "
            f"{_grown(fit):.0f} a step, and a derivative by {fit.moving:.1f} deviations: {off}"
        )
    return fit


def _grown(fit: Fit) -> float:
    """Change of the log-likelihood by the last step [nat]."""
    return fit.log_likelihood[-1] - fit.log_likelihood[-2:][0]


def _beliefs(item: _Prepared, found: Derivatives) -> Beliefs:
    """What is believed before a flight: its own sensors and gusts, and derivatives as found."""
    spread: dict[str, dict[str, float]] = {}
    for (name, key), value in zip(found.keys, np.diagonal(found.covariance), strict=True):
        spread.setdefault(name, {})[key] = float(np.sqrt(value))
    vanes = bool(np.asarray(item.rows.rows.measured.valid)[:, 3].any())
    prior, sigma = aided_flight.beliefs(item.first, item.one.aircraft, vanes=vanes, known=spread)
    covariance = np.diag(np.asarray(ravel_pytree(sigma.means)[0]) ** 2)
    count = len(found.keys)
    covariance[:count, :count] = found.covariance
    mean = np.asarray(ravel_pytree(_with(prior, found).means)[0])
    return Beliefs(mean, covariance, NoisePrior(prior.log_noise, sigma.log_noise))


def _smoothed(model: FlightModel, item: _Prepared, unknowns: Unknowns) -> Flight:
    """The whole flight under a model, its maneuvers held out or not."""
    states, done = aided_smoother.iterated(
        model, *unknowns, item.rows.rows, item.rows.nominal, item.rows.beginning, rounds=4
    )
    kept = aided_flight.kept_rows(item.one.reconstruction)
    late = unknowns.means.sensors.surface_delay
    stated = item.one.aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
    return aided_states.refined(
        item.one,
        unknowns,
        Delay(stated + float(late), item.one.delay.deviation, found=True),
        jax.tree.map(lambda part: jnp.asarray(np.asarray(part)[kept]), states),
        np.asarray(done.covariance)[kept],
    )


def _unended(item: _Prepared, fit: Fit) -> str:
    return (
        f"{item.one.recording.source}: the search inside the filter stopped before it had settled "
        f"(the log-likelihood still changed by {_grown(fit):+.0f} a step): take its intervals as "
        "too narrow, and check mass, inertia and the terms of the aircraft file"
    )


def _cut_short(item: _Prepared) -> str:
    step = float(np.median(item.rows.rows.step))
    return (
        f"{item.one.recording.source}: of {item.rows.rows.step.size * step / 60.0:.0f} minutes the "
        f"{LONGEST * step / 60.0:.0f} with the most control were fitted; states are of all"
    )
