"""Filter error on whole flights: models, and the flights with the states that the filter knows.

Flights follow each other: each is fitted where those before it have led, while sensors and gusts
are each flight's own, and what all of them say is added to what was believed. The model that is
scored is found first, and learns nothing from held-out maneuvers; the model that is kept starts
from it and takes in all, each flight with what the others have said (the cavity of expectation
propagation; Minka, *UAI* 2001). By itself a weak flight would have to find its way from there to
where the file alone would have it: its search stood still 13 deviations away, for 13 steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.diagnose import extended
from gcs_sysid.estimate import (
    filter_error,
    first_guess,
    flight_rows,
    in_common,
    inside_filter,
    lacking,
    quick_air,
    scoring,
    settling,
)
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.in_common import Said
from gcs_sysid.estimate.inside_filter import Derivatives, Terms
from gcs_sysid.estimate.intensities import Prior as NoisePrior
from gcs_sysid.estimate.lacking import Lacking, Scores
from gcs_sysid.estimate.quick_air import QuickAirError
from gcs_sysid.estimate.result import AeroModel, Prior
from gcs_sysid.estimate.scoring import LostError
from gcs_sysid.estimate.settling import Beliefs
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.gp.aerodynamics import beyond
from gcs_sysid.model import departures
from gcs_sysid.model.aided import Means, State
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import aided_compatibility, aided_flight, aided_states
from gcs_sysid.offline.flight import SERVO_STREAM, Flight, Progress
from gcs_sysid.reconstruct import aided_smoother

COARSE_MASS, COARSE_INERTIA = 0.03, 0.1
"""A file that is less sure than this of mass or inertia [one sigma, relative] may be wrong enough
for what goes with them, thrust above all, to bend the airspeed's scale."""
ROUNDS, ROUNDS_NEAR = 4, 2
"""Of the smoother: from the kinematics, and from a flight smoothed with nearly the same model."""
EXACT = 1e-4
"""Least relative deviation of what a file says of mass, inertia and thrust: nothing is exact."""
OFF = (
    "mass, inertia, signs of the controls or the thrust of the aircraft file may be far off: check "
    "them, or fly longer maneuvers of every axis"
)
"""Why a filter loses an aircraft, or a search does not end."""


class UnsettledError(Exception):
    """The filter lost the aircraft, or the search found no end; the message says what to do.

    Args:
        message: on which flight, what and why.
        lacking: terms that the flights ask for where the search stopped; one of them may be why.
    """

    def __init__(self, message: str, lacking: Sequence[Lacking] = ()) -> None:
        super().__init__(message)
        self.lacking = tuple(lacking)


@dataclass(frozen=True)
class AidedFlights:
    """What filter error made of the flights.

    Attributes:
        flights: with the filter's states, the coefficients measured at them, and its verdict on the
            sensors.
        scored: the model without the held-out maneuvers.
        final: the model of all.
        aircraft: with the mass, inertia and thrust that go with the final model.
        derivatives: of the final model, all together.
        fits: of the final model, one a flight.
        lacking: terms that the final model does not have, and the flights ask for.
        unsettled: on which flight a search did not end, and what to do: then nothing here but
            `lacking` is a number. Empty where all did.
        notes: what the engineer should know.
    """

    flights: list[Flight]
    scored: AeroModel
    final: AeroModel
    aircraft: Aircraft
    derivatives: Derivatives
    fits: tuple[Fit, ...]
    lacking: tuple[Lacking, ...]
    unsettled: str
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
    *,
    body: bool = False,
) -> AidedFlights:
    """Fits the flights, one after the other.

    Args:
        flights: as reconstructed by kinematics.
        aircraft: its description.
        structure: regressor keys by coefficient.
        prior: values believed before; None leaves the file's values out, as a start too.
        held_out: ids of maneuvers that the scored model may not learn from.
        progress: told what is being done.
        body: whether mass, inertia and thrust are found too, starting from what the file says of
            them and how sure it is, or taken as the file has them. No flight tells a heavy
            aircraft with much thrust and lift from a light one, but what the rates do to each
            other tells the inertias' ratios, and thrust that acts off the centre their size.

    Raises:
        UnsettledError: the filter lost the aircraft, on which flight and what to do.
    """
    mean, sigma = inside_filter.beliefs(structure, prior, aircraft)
    start = mean if prior is not None else first_guess.derivatives(aircraft, structure)
    model = FlightModel(aided_flight.with_structure(aircraft, start))
    prepared = [_prepared(one, start, held_out, body=body) for one in flights]
    steps = 2 * len(prepared)

    def told(number: int) -> Callable[[str], None]:
        return lambda text: progress(f"fitting the model: {text}", number / steps)

    scored_fits = []
    before = _believed(mean, sigma, aircraft, body=body)
    found = before
    for number, item in enumerate(prepared):
        first = item.first if number == 0 else _with(item.first, found)
        fit = _fit(model, item, first, found, ~item.held, None, told(number))
        scored_fits.append(fit)
        found = _after(found, fit)
    scored = found
    if any(item.held.any() for item in prepared):
        tell = [told(len(prepared) + number) for number in range(len(prepared))]
        final_fits = _of_all(model, prepared, scored_fits, before, tell)
        found = reduce(_after, final_fits, before)
    else:
        # Nothing was held out: both models are one.
        final_fits = scored_fits
    progress("smoothing with the model", 1.0)
    seen = [
        _smoothed(model, item, _agreeing(fit, scored), _embodied(aircraft, scored), fit.states)
        for item, fit in zip(prepared, scored_fits, strict=True)
    ]
    samples = [one.samples for one in seen]
    kept = [one.pieces() for one in seen]
    learned = [np.where(np.isin(piece, list(held_out)), -1, piece) for piece in kept]
    fits = tuple(final_fits)
    scored_model = inside_filter.model(scored, samples, aircraft, structure, learned)
    return AidedFlights(
        flights=[
            replace(
                one,
                samples=aided_states.unsure_of(one.samples, scored_model),
                compatibility=aided_compatibility.check(fit, one),
            )
            for one, fit in zip(seen, fits, strict=True)
        ],
        scored=scored_model,
        final=inside_filter.model(found, samples, aircraft, structure, kept),
        aircraft=_embodied(aircraft, found),
        derivatives=found,
        fits=fits,
        lacking=_lacking(model, prepared, fits, before, seen, structure),
        unsettled=_unsettled(prepared, fits) or _unsettled(prepared, scored_fits),
        notes=(
            *(() if body else _held(aircraft)),
            *(
                _cut_short(item)
                for item in prepared
                if item.rows.rows.step.size > flight_rows.LONGEST
            ),
        ),
    )


def _lacking(
    model: FlightModel,
    prepared: Sequence[_Prepared],
    fits: Sequence[Fit],
    before: Derivatives,
    seen: Sequence[Flight],
    structure: Mapping[str, Sequence[str]],
) -> tuple[Lacking, ...]:
    """Terms that the flights together ask for."""
    aircraft = prepared[0].one.aircraft
    keys, each = lacking.candidates(aircraft), []
    for item, fit in zip(prepared, fits, strict=True):
        rows, counts = flight_rows.busiest(item.rows, np.ones_like(item.held))
        beliefs = _beliefs(item, _with(item.first, before), before.covariance)
        each.append(lacking.scores(model, rows, fit.unknowns, beliefs, counts, keys))
    used = [one.pieces() >= 0 for one in seen]
    flow, measured = (
        {
            name: np.concatenate(
                [of(one)[name][part] for one, part in zip(seen, used, strict=True)]
            )
            for name in of(seen[0])
        }
        for of in (lambda one: one.samples.regressors, lambda one: one.samples.measured)
    )
    told = reduce(Scores.plus, each)
    return tuple(lacking.strongest(told, aircraft, structure, keys, flow, measured))


class Seen(NamedTuple):
    """A flight with the states that a filter knows, and that filter's log-likelihood [nat]."""

    flight: Flight
    log_likelihood: float


def seen_by(one: Flight, model: AeroModel, progress: Progress) -> Seen:
    """A flight that a model has not seen, with the states that the filter knows by that model.

    The model learns nothing: it is held, with the global part of the processes beside it, and only
    what is the flight's own, sensor errors, delays and gusts, is found.

    These states know the forces and moments that were measured at the very sample. What the model
    then says at them agrees with what was measured better than any forecast could.

    Args:
        one: as reconstructed by kinematics.
        model: the aerodynamics.
        progress: told what is being done.

    Raises:
        UnsettledError: the filter lost the aircraft.
    """
    terms = {
        name: dict(zip(fit.keys, fit.value.tolist(), strict=True))
        for name, fit in model.fits.items()
    }
    described = aided_flight.with_structure(one.aircraft, terms)
    flown = FlightModel(replace(described, beyond=beyond(model)))
    item = _prepared(one, terms, (), body=False)
    count = len(in_common.keys(item.first.means))
    before = _beliefs(item, item.first, np.zeros((count, count)))
    rows, counts = flight_rows.busiest(item.rows, np.ones_like(item.held))
    done = settling.settle(
        flown, rows, item.first, before, counts, lambda text: progress(f"smoothing: {text}", 0.9)
    )
    likelihood = float(done.last.log_likelihood.sum())
    if not np.isfinite(likelihood):
        raise UnsettledError(_lost(one))
    late = _deviation(done, before, item.first.means).sensors.surface_delay
    item = item._replace(one=replace(one, delay=replace(one.delay, deviation=float(late))))
    smoothed = _smoothed(flown, item, settling.at(done, item.first.means), one.aircraft)
    samples = aided_states.unsure_of(smoothed.samples, model)
    return Seen(replace(smoothed, samples=samples), likelihood)


def _deviation(done: settling.Settled, before: Beliefs, like: Means) -> Means:
    """One standard deviation of what was sought, by information at held gains; else 0."""
    free = np.flatnonzero(np.diagonal(before.covariance) > 0.0)
    chosen = np.ix_(free, free)
    known = done.last.told.matrix[chosen] + scoring.inverse(before.covariance[chosen])
    found = np.zeros(before.mean.size)
    found[free] = np.sqrt(np.diagonal(scoring.inverse(known)))
    return ravel_pytree(like)[1](jnp.asarray(found))


def _prepared(one: Flight, start: Terms, held_out: Sequence[int], *, body: bool) -> _Prepared:
    states = one.reconstruction
    rows = aided_flight.prepare(one.recording, one.aircraft, states)
    time = states.time[0] + np.cumsum(rows.rows.step)
    held = np.zeros(time.size, dtype=bool)
    for segment in one.segments:
        if segment.id in held_out:
            held |= (time >= segment.start) & (time < segment.end)
    first = aided_flight.first_unknowns(rows, one.aircraft, aided_flight.kinematics(states), start)
    if body:
        none = jax.tree.map(
            lambda part: jnp.asarray(part, jnp.float64), departures.none(one.aircraft, 0)
        )
        first = first._replace(means=first.means._replace(departures=none))
    return _Prepared(one, rows, held, first)


def _believed(mean: Terms, sigma: Terms, aircraft: Aircraft, *, body: bool) -> Derivatives:
    """The prior as what is known so far."""
    keys = tuple((name, key) for name in sorted(mean) for key in sorted(mean[name]))
    value = np.array([mean[name][key] for name, key in keys])
    spread = np.array([sigma[name][key] for name, key in keys])
    bound = spread
    if body:
        keys = (*keys, *((in_common.BODY, part) for part in in_common.PARTS))
        value = np.concatenate([value, np.zeros(len(in_common.PARTS))])
        spread = np.concatenate([spread, _stated(aircraft)])
    precision = np.diag(1.0 / spread**2)
    return Derivatives(keys, value, precision, Said.nothing(value.size), bound)


def _stated(aircraft: Aircraft) -> Float[np.ndarray, " part"]:
    """How sure the file is of mass, inertia and thrust, relative."""
    mass, inertia = aircraft.mass.mass_sigma, aircraft.mass.inertia_sigma
    thrust = max((engine.thrust_sigma for engine in aircraft.propulsion), default=0.0)
    return np.maximum([mass, inertia, inertia, inertia, thrust], EXACT)


def _embodied(aircraft: Aircraft, found: Derivatives) -> Aircraft:
    """The aircraft with the mass, inertia and thrust that were found, if they were sought."""
    rows = [row for row, (name, _) in enumerate(found.keys) if name == in_common.BODY]
    if not rows:
        return aircraft
    mass, *inertia, thrust = found.value[rows]
    sure = np.sqrt(np.diagonal(found.covariance)[rows])
    wrong = {
        "mass": (mass, sure[0]),
        "thrust": (thrust, sure[-1]),
        **{f"inertia.{axis}": (inertia[axis], sure[1 + axis]) for axis in range(3)},
    }
    known = extended.corrected(aircraft, wrong)
    # One number for all axes in the file: that of the one known least.
    return replace(known, mass=replace(known.mass, inertia_sigma=float(np.max(sure[1:4]))))


def _after(before: Derivatives, fit: Fit) -> Derivatives:
    """What is known with one flight more; each flight's information adds to the bound's."""
    if fit.keys != before.keys:
        raise ValueError("derivatives in another order")
    least = np.sqrt(np.diagonal(fit.bound))
    with np.errstate(divide="ignore"):  # nothing from either is nothing from both
        both = 1.0 / np.hypot(1.0 / before.bound, 1.0 / least)
    first = not before.said.information.any()
    return before._replace(said=before.said.plus(fit.said), bound=least if first else both)


def _of_all(
    model: FlightModel,
    prepared: Sequence[_Prepared],
    scored: Sequence[Fit],
    before: Derivatives,
    told: Sequence[Callable[[str], None]],
) -> list[Fit]:
    """Fits of all maneuvers, each flight beside what the others have said without those held out.

    Args:
        model: the aircraft.
        prepared: the flights.
        scored: their fits without what is held out.
        before: what was believed before any flight.
        told: told of each flight's steps.
    """
    together, fits = reduce(_after, scored, before), []
    for number, item in enumerate(prepared):
        others = reduce(_after, [*scored[:number], *scored[number + 1 :]], before)
        first = _with(scored[number].unknowns, together)
        every = np.ones_like(item.held)
        fits.append(_fit(model, item, first, others, every, scored[number], told[number]))
    return fits


def _with(unknowns: Unknowns, found: Derivatives) -> Unknowns:
    """These unknowns with other derivatives, and with another body where that is sought."""
    return unknowns._replace(means=in_common.with_values(unknowns.means, found.value))


def _agreeing(fit: Fit, found: Derivatives) -> Unknowns:
    """A flight's unknowns with what all flights have found, and what of its own goes with that."""
    means = fit.unknowns.means
    flat, unravel = ravel_pytree(means)
    common = in_common.places(means)
    sought = np.diagonal(fit.parameters)[common] > 0.0
    places = common[sought]
    off = (found.value - in_common.values(means))[sought]
    known = fit.parameters[:, places] @ scoring.inverse(fit.parameters[np.ix_(places, places)])
    return fit.unknowns._replace(means=unravel(flat + known @ off))


def _fit(
    model: FlightModel,
    item: _Prepared,
    first: Unknowns,
    found: Derivatives,
    counts: Bool[np.ndarray, " row"],
    earlier: Fit | None,
    progress: Callable[[str], None],
) -> Fit:
    rows, counts = flight_rows.busiest(item.rows, counts)
    before = _beliefs(item, _with(item.first, found), found.covariance)
    try:
        stretch = None if earlier is None else earlier.stretch
        return filter_error.fit(model, rows, first, before, counts, progress, stretch=stretch)
    except LostError as error:
        raise UnsettledError(_lost(item.one)) from error
    except QuickAirError as error:
        source = item.one.recording.source
        raise UnsettledError(f"{source}: {error}: {quick_air.FIX}") from error


def _unsettled(prepared: Sequence[_Prepared], fits: Sequence[Fit]) -> str:
    """On which flight first a search did not end; empty where all did."""
    for item, fit in zip(prepared, fits, strict=True):
        if not fit.converged:
            grown = fit.log_likelihood[-1] - fit.log_likelihood[-2:][0]
            return (
                f"{item.one.recording.source}: the search inside the filter did not end (the "
                f"log-likelihood still changed by {grown:+.0f} a step, and a derivative was to "
                f"move by {fit.moving:.1f} of its deviations): {OFF}"
            )
    return ""


def _lost(one: Flight) -> str:
    return f"{one.recording.source}: the filter lost the aircraft: {OFF}"


def _beliefs(item: _Prepared, centre: Unknowns, known: Float[np.ndarray, "key key"]) -> Beliefs:
    """What is believed before a flight: its own sensors and gusts, and the aircraft as found.

    Args:
        item: the flight.
        centre: unknowns of which those that flights have in common are believed.
        known: covariance of these.
    """
    means = item.first.means
    count = len(in_common.derivative_keys(means.aerodynamics))
    spread: dict[str, dict[str, float]] = {}
    for (name, key), value in zip(
        in_common.keys(means)[:count], np.diagonal(known)[:count], strict=True
    ):
        spread.setdefault(name, {})[key] = float(np.sqrt(value))
    vanes = bool(np.asarray(item.rows.rows.measured.valid)[:, 3].any())
    used = item.one.reconstruction.data.used
    prior, sigma = aided_flight.beliefs(
        item.first, item.one.aircraft, used=used, vanes=vanes, known=spread
    )
    covariance = np.diag(np.asarray(ravel_pytree(sigma.means)[0]) ** 2)
    common = in_common.places(means)
    covariance[np.ix_(common, common)] = known
    mean = in_common.with_values(prior.means, in_common.values(centre.means))
    return Beliefs(
        np.asarray(ravel_pytree(mean)[0]), covariance, NoisePrior(prior.log_noise, sigma.log_noise)
    )


def _smoothed(
    model: FlightModel,
    item: _Prepared,
    unknowns: Unknowns,
    aircraft: Aircraft,
    near: State | None = None,
) -> Flight:
    """The whole flight under a model, its maneuvers held out or not, as of this aircraft.

    From the smoothed flight that is `near`, where that is all of it and not its liveliest part.
    """
    nominal, rounds = item.rows.nominal, ROUNDS
    if near is not None and len(near.velocity) == item.rows.rows.step.size:
        nominal, rounds = near, ROUNDS_NEAR
    states, done = aided_smoother.iterated(
        model, *unknowns, item.rows.rows, nominal, item.rows.beginning, rounds=rounds
    )
    kept = aided_flight.kept_rows(item.rows.rows)
    late = unknowns.means.sensors.surface_delay
    stated = item.one.aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
    return aided_states.refined(
        replace(
            item.one,
            aircraft=replace(item.one.aircraft, mass=aircraft.mass, propulsion=aircraft.propulsion),
        ),
        unknowns,
        Delay(stated + float(late), item.one.delay.deviation, found=True),
        jax.tree.map(lambda part: jnp.asarray(np.asarray(part)[kept]), states),
        np.asarray(done.covariance)[kept],
    )


def _held(aircraft: Aircraft) -> tuple[str, ...]:
    """What holding a coarse mass or inertia does; nothing where the file is sure of both.

    Thrust and weight no longer go together, and a wrong airspeed makes up for a part of it.
    """
    mass, inertia = aircraft.mass.mass_sigma, aircraft.mass.inertia_sigma
    if mass <= COARSE_MASS and inertia <= COARSE_INERTIA:
        return ()
    return (
        f"the aircraft file knows the mass to {100.0 * mass:.0f} % and the inertia to "
        f"{100.0 * inertia:.0f} %: held where they are wrong, they bend the airspeed's scale and "
        "with it every derivative; --mass-properties flight finds them with the rest",
    )


def _cut_short(item: _Prepared) -> str:
    minutes = float(np.median(item.rows.rows.step)) / 60.0
    return (
        f"{item.one.recording.source}: of {item.rows.rows.step.size * minutes:.1f} minutes the "
        f"{flight_rows.LONGEST * minutes:.1f} with the most control were fitted; states are of all"
    )
