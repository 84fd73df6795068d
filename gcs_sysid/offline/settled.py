"""Flights of a diagnosis, settled under beliefs about their aircraft.

Each flight is settled by itself under the simulation's own beliefs, and tells what it tells as a
quadratic form in the departures from them; flights add. Where a cause is then put to the test, the
flights are settled again with it, from where they were.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.diagnose.aided import beliefs, quantities
from gcs_sysid.diagnose.aided.quantities import Flown, Quantities
from gcs_sysid.diagnose.aided.ranking import RIGHT
from gcs_sysid.diagnose.aided.unknowns import Unknowns, of_flight
from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate import flight_rows, godambe, quick_air, settling, weighed
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.likelihood import Instruments
from gcs_sysid.estimate.quick_air import QuickAirError
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.estimate.weighed import Relation, Weighed
from gcs_sysid.model import departures
from gcs_sysid.model.aided import State
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import aided_flight
from gcs_sysid.offline.flight import Flight
from gcs_sysid.reconstruct import aided_smoother, causal

RELATED = 2000
"""Rows of the stretch on which it is worked out how errors move scores."""
STRAIGHT = 2.0 * aided_flight.SLOPE_STEP
"""Surfaces are taken to move on as they do over so much of a delay [s]."""
ASTRAY, LEFT = 8.0, 0.1
"""A value of the file that is off by so many of its sigmas, and of which so small a share is left,
has gone astray: no file that is known to a tenth has an aileron without effect."""
SHARES = ("mass", "inertia", "thrust")
"""What the file says of the airframe, as shares of it."""
ALL_BUT = 0.99
"""Quantile of a control's motion that counts as its fastest."""


@dataclass(frozen=True)
class Subject:
    """One flight ready to be settled.

    Attributes:
        one: as it was read.
        rows: as the filter reads it.
        first: where a search begins.
        fitted: rows that take part.
        late: delay of the surfaces beyond the file's [s] about which they are looked up.
    """

    one: Flight
    rows: flight_rows.Flight
    first: flight_rows.Unknowns
    fitted: Bool[np.ndarray, " row"]
    late: float = 0.0


def flown(flights: Sequence[Flight], aircraft: Aircraft) -> Flown:
    """What of the flights decides which quantities there are."""
    steps = [float(np.median(np.diff(one.samples.time))) for one in flights]
    rates = {
        name: max(
            float(np.quantile(np.abs(np.diff(one.samples.regressors[name])), ALL_BUT) / step)
            for one, step in zip(flights, steps, strict=True)
        )
        for name in aircraft.control_names
    }
    data = [one.reconstruction.data for one in flights]
    # A log that began in the air does not tell the height unless the autopilot does.
    height = min(
        float(np.min(each.height))
        if each.above_home or float(np.median(each.height)) > aided_flight.LOWEST
        else np.inf
        for each in data
    )
    blown = (np.mean(one.reconstruction.wind[:, :2], axis=0) for one in flights)
    return Flown(
        qbar=np.concatenate([one.samples.qbar for one in flights]),
        lowest=height / aircraft.geometry.wing_span,
        rates=rates,
        streams=flights[0].reconstruction.data.used,
        wind=max(float(np.linalg.norm(each)) for each in blown),
    )


def prepare(one: Flight, found: Quantities, held_out: Sequence[int], *, apart: bool) -> Subject:
    """A flight as the filter reads it.

    Args:
        one: as it was read.
        found: quantities, whose servos are tried.
        held_out: maneuvers that take no part.
        apart: whether the whole flight takes none.
    """
    states = one.reconstruction
    rows = aided_flight.prepare(one.recording, found.aircraft, states, found.servos)
    time = states.time[0] + np.cumsum(rows.rows.step)
    fitted = np.full(time.size, not apart)
    for segment in one.segments:
        if segment.id in held_out:
            fitted &= ~((time >= segment.start) & (time < segment.end))
    terms = {
        name: {key: item.value for key, item in model.terms.items()}
        for name, model in found.aircraft.aerodynamics.items()
    }
    first = aided_flight.first_unknowns(
        rows, found.aircraft, aided_flight.kinematics(states), terms
    )
    none = departures.none(found.aircraft, len(found.servos))
    means = first.means._replace(departures=none)
    return Subject(one, rows, first._replace(means=means), fitted)


def with_servos(subject: Subject, found: Quantities) -> Subject:
    """The flight with what other sizes of lag and play do to its controls."""
    return _looked_up(subject, found, subject.late)


def departed(subject: Subject, by: Float[np.ndarray, " parameter"]) -> Subject:
    """The flight with its search begun elsewhere."""
    values, unravel = ravel_pytree(subject.first.means)
    return replace(subject, first=subject.first._replace(means=unravel(values + by)))


def undelayed(subject: Subject, found: Quantities) -> Subject:
    """The flight with its surfaces looked up where its file has them: a cause delays them."""
    return subject if subject.late == 0.0 else _looked_up(subject, found, 0.0)


def with_delay(subject: Subject, found: Quantities, done: Settled) -> Subject:
    """The flight with its surfaces looked up about the delay that it was settled with.

    Where telemetry samples commands that change five times between two messages, what is told holds
    half an interval too long.
    """
    late = float(settling.at(done, subject.first.means).means.sensors.surface_delay)
    if abs(late - subject.late) < STRAIGHT:
        return subject
    return _looked_up(subject, found, late)


def _looked_up(subject: Subject, found: Quantities, late: float) -> Subject:
    one = subject.one
    rows = aided_flight.prepare(
        one.recording,
        found.aircraft,
        one.reconstruction,
        found.servos,
        moving=found.moving if found.acting else None,
        late=late,
    )
    return replace(subject, rows=rows, late=late)


def model_of(found: Quantities) -> FlightModel:
    """The aircraft with all terms, as the filter looks it up."""
    return FlightModel(found.aircraft)


def believed(subject: Subject, found: Quantities, *, vanes: bool) -> Beliefs:
    """What is believed of one flight before any cause."""
    means = subject.first.means
    names = quantities.names(means)
    sigma = beliefs.ordinary(names, found.aircraft, vanes=vanes)
    values = np.asarray(ravel_pytree(means)[0])
    mean = np.array(
        [
            value if name.startswith("aerodynamics.") else 0.0
            for name, value in zip(names, values, strict=True)
        ]
    )
    bare = subject.first._replace(means=means._replace(departures=None))
    known = {name: dict.fromkeys(terms, 1.0) for name, terms in means.aerodynamics.items()}
    used = subject.one.reconstruction.data.used
    _, spread = aided_flight.beliefs(bare, found.aircraft, used=used, vanes=vanes, known=known)
    return Beliefs(mean, np.diag(sigma**2), Prior(subject.first.log_noise, spread.log_noise))


def begin(
    model: FlightModel, subject: Subject, before: Beliefs, progress: Callable[[str], None]
) -> Settled:
    """A flight settled on a stretch of it.

    What is wrong with delays, vanes and trims may be so much that derivatives and inertia go
    anywhere to make up for it. Then the search begins with what the file says of these, and linear
    evidence tells from there what is wrong.

    Args:
        model: the aircraft.
        subject: the flight.
        before: beliefs about it.
        progress: told what is being done.

    Raises:
        RefusedError: the filter lost the aircraft, or cannot tell it from the air.
    """
    rows, fitted = flight_rows.busiest(subject.rows, subject.fitted)
    done, _ = settling.begun(model, rows, subject.first, before, fitted, progress, rough=True)
    names = quantities.names(subject.first.means)
    if (astray := _astray(names, before, done.values)) is not None:
        progress(f"{astray} went astray: begun anew with the file's own values")
        held = _as_the_file_has_it(names, before)
        again, _ = settling.begun(model, rows, subject.first, held, fitted, progress, rough=True)
        done = done if again.restless else again
    if not np.isfinite(done.last.log_likelihood.sum()):
        raise RefusedError(
            subject.one.recording.source,
            "the simulation's own model lost the aircraft inside the filter",
            fix="check mass, inertia, signs of the controls and the thrust of the aircraft file",
        )
    try:
        quick_air.check(done.log_noise, before.noise.mean, rows.rows.passing)
    except QuickAirError as error:
        raise RefusedError(subject.one.recording.source, str(error), fix=quick_air.FIX) from error
    return done


def _astray(
    names: Sequence[str], before: Beliefs, values: Float[np.ndarray, " parameter"]
) -> str | None:
    """A value of the file that a search has lost; None where there is none."""
    sigma = np.sqrt(np.diagonal(before.covariance))
    for name, usual, own, value in zip(names, before.mean, sigma, values, strict=True):
        if name.startswith("aerodynamics.") and usual != 0.0:
            left = value / usual
        elif name.startswith("departures.") and name.split(".")[1] in SHARES:
            left = 1.0 + value
        else:
            continue
        if own > 0.0 and abs(value - usual) > ASTRAY * own and left < LEFT:
            return name
    return None


def _as_the_file_has_it(names: Sequence[str], before: Beliefs) -> Beliefs:
    """Beliefs in a file that is right; what sensors, streams and trims are off by stays."""
    kinds = [name.split(".") for name in names]
    airframe = [kind[:2] in [["departures", each] for each in (*SHARES, "cg")] for kind in kinds]
    share = np.where([kind[0] == "aerodynamics" for kind in kinds], RIGHT, 1.0)
    share[airframe] = 0.0
    return replace(before, covariance=before.covariance * np.outer(share, share))


def relation(model: FlightModel, subject: Subject, before: Beliefs, done: Settled) -> Relation:
    """How errors of the unknowns move the scores of a flight, by its busiest stretch."""
    stretch, _ = flight_rows.busiest(subject.rows, subject.fitted, RELATED)
    return weighed.relation(model, stretch, settling.at(done, subject.first.means), before)


def weigh(
    model: FlightModel,
    subject: Subject,
    before: Beliefs,
    start: Settled,
    by: Relation,
    progress: Callable[[str], None],
    *,
    first: Sequence[Float[np.ndarray, " parameter"]],
    asked: Instruments | None = None,
    sets: int = weighed.SETS,
) -> Weighed:
    """A flight searched and weighed.

    Args:
        model: the aircraft.
        subject: the flight.
        before: beliefs about it.
        start: where it was settled before, of which the intensities are taken.
        by: how errors of the unknowns move its scores.
        progress: told what is being done.
        first: parameters to begin with; the likeliest are taken.
        asked: instruments of the flight at another point nearby, where they are known.
        sets: times that instruments are used at most.
    """
    rows, fitted = flight_rows.busiest(subject.rows, subject.fitted)
    begun = [settling.at(replace(start, values=values), subject.first.means) for values in first]
    return weighed.climbed(
        *(model, rows, begun, before, fitted, by, progress, asked),
        sets=sets,
        near=start.last.path,
    )


def told(
    unknowns: Unknowns, number: int, before: Beliefs, found: Weighed
) -> tuple[Information, Information]:
    """What a flight says of all unknowns by what was fitted, and by what was not.

    Scores are told relative to the beliefs' mean. Rows count for less where scores of blocks
    scatter more than independent innovations would, or do not vanish.
    """
    done, both = found.settled, []
    share = 1.0 / max(settling.scatter(done, before), found.doubt)
    moved, rows = done.values - before.mean, done.last.log_likelihood[: done.fitted.size]
    for part, counts in ((found.told, done.fitted), (found.apart, done.apart)):
        score = part.score + part.matrix @ moved
        shared = float(rows[counts].sum() - moved @ (part.score + 0.5 * part.matrix @ moved))
        one = of_flight(unknowns, number, part.matrix, score, part.count, shared)
        both.append(one.weighed(share))
    return both[0], both[1]


def states(
    model: FlightModel, subject: Subject, done: Settled
) -> tuple[flight_rows.Unknowns, State, Float[np.ndarray, "row state state"]]:
    """Parameters, smoothed states and their covariance at every sample of the whole flight."""
    found = settling.at(done, subject.first.means)
    nominal, smoothed = aided_smoother.iterated(
        model,
        *found,
        subject.rows.rows,
        subject.rows.nominal,
        subject.rows.beginning,
        rounds=3,
    )
    kept = aided_flight.kept_rows(subject.rows.rows)
    at = jax.tree.map(lambda part: jnp.asarray(np.asarray(part)[kept]), nominal)
    return found, at, np.asarray(smoothed.covariance)[kept]


def with_terms(
    model: FlightModel,
    subject: Subject,
    found: Weighed,
    names: Sequence[str],
    terms: Sequence[tuple[str, ...]],
) -> Weighed:
    """A flight that also tells of terms that the model does not have, all of them 0."""
    done = found.settled
    unknowns = settling.at(done, subject.first.means)
    constants = [names.index(f"aerodynamics.{name}.1") for name in COEFFICIENTS]
    controls = model.aircraft.control_names
    products = [regressors.parse("*".join(term), controls=controls) for term in terms]
    last = causal.passed(
        model,
        unknowns.means,
        unknowns.log_noise,
        done.last.path,
        done.fitted,
        more=causal.More(tuple(products), tuple(constants)),
        apart=done.apart,
    )
    values = np.concatenate([done.values, np.zeros(len(COEFFICIENTS) * len(terms))])
    return Weighed(
        replace(done, values=values, last=last),
        godambe.widened(found.told, last.told),
        godambe.widened(found.apart, last.apart),
        found.asked,
        found.by,
        found.doubt,
    )


def stretched(before: Beliefs, count: int) -> Beliefs:
    """Beliefs with so many parameters more, that are held at 0."""
    size = before.mean.size
    covariance = np.zeros((size + count, size + count))
    covariance[:size, :size] = before.covariance
    return replace(
        before, mean=np.concatenate([before.mean, np.zeros(count)]), covariance=covariance
    )
