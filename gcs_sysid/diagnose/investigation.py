"""From the residuals of flights to a ranking of causes: the whole inference in one place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS, MOMENTS, Aircraft
from gcs_sysid.diagnose import gain, joint, motion, unlisted, whitening
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.diagnose.gain import Score
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.diagnose.observed import Observed
from gcs_sysid.diagnose.problem import Problem
from gcs_sysid.diagnose.ranking import rank, sigma_under
from gcs_sysid.diagnose.unknowns import Columns
from gcs_sysid.diagnose.unlisted import Missing, Term
from gcs_sysid.diagnose.whitening import Blocks, Noise
from gcs_sysid.estimate import lacking
from gcs_sysid.reconstruct import rates

GUSTY = 0.03
"""Gust over airspeed beyond which coefficients accuse nobody. Without vanes, an angle of attack in
error by degrees looks like a shifted centre of gravity and a weaker elevator (measured: flights in
gusts of 4 to 5 % without any cause got Bayes factors of e⁸ to e¹⁹ against them), and only what the
kinematics say is used. With vanes even these are not: airspeed, gust and vanes partly explain each
other there (a flight in gusts of 5 % without any cause: airspeed 7 % off at seven standard
deviations)."""
INCREDIBLE = 0.3
"""A scale error of airspeed beyond this is a reconstruction that went astray."""


@dataclass(frozen=True)
class Investigation:
    """What flights say of all causes.

    Attributes:
        columns: names and ordinary sigmas of the unknowns.
        data: blocks that were used.
        noise: of them.
        information: of them, and of the kinematics.
        ranked: sets of causes, the most probable first.
        coefficients: whether coefficients were used, and not only the kinematics.
    """

    columns: Columns
    data: Blocks
    noise: Noise
    information: Information
    ranked: tuple[Ranked, ...]
    coefficients: bool


def trusted(flights: Sequence[Observed]) -> bool:
    """Whether the flow angles are known well enough for coefficients to speak."""
    return all(flight.gust <= GUSTY for flight in flights)


def credible(flights: Sequence[Observed]) -> bool:
    """Whether the reconstruction may accuse anybody at all."""
    return all(
        abs(float(flight.motion.airspeed_scale)) < INCREDIBLE
        and not (flight.vanes and flight.gust > GUSTY)
        for flight in flights
    )


def investigate(
    problems: Sequence[Problem],
    candidates: Sequence[Candidate],
    used: Sequence[int],
    *,
    coefficients: bool,
    noise: Noise | None = None,
) -> Investigation:
    """Ranks all sets of causes.

    Args:
        problems: one a flight.
        candidates: what may be named.
        used: maneuvers that take part.
        coefficients: whether to use them beside the kinematics.
        noise: of the residuals where it is known; None learns it from these maneuvers.
    """
    columns = joint.names(problems)
    data = joint.stacked(problems, columns, used)
    noise = noise or whitening.learn(data, sigma_under(candidates, columns))
    found = joint.kinematics(problems, columns)
    if coefficients:
        found = found.plus(whitening.gathered(data, noise))
    return Investigation(
        columns, data, noise, found, rank(found, columns, candidates), coefficients
    )


def scores(
    kept: Investigation, problems: Sequence[Problem], held_out: Sequence[int], best: Ranked
) -> tuple[Score, Score]:
    """How well held-out maneuvers are predicted before and after the causes `best`.

    Args:
        kept: of the maneuvers that took part.
        problems: flights with the maneuvers held out.
        held_out: their numbers.
        best: causes, with their posterior from the maneuvers that took part.
    """
    columns = joint.names(problems)
    data = joint.stacked(problems, columns, held_out)
    frees = [name for candidate in best.causes for name in candidate.frees]
    wrong = np.zeros(len(columns.names))
    for name in frees:
        wrong[columns.names.index(name)] = best.posterior.mean[kept.columns.names.index(name)]
    nothing = np.zeros_like(wrong)
    return (
        gain.score(data, kept.noise, columns, nothing),
        gain.score(data, kept.noise, columns, wrong),
    )


def missing_term(
    aircraft: Aircraft,
    flights: Sequence[Observed],
    problems: Sequence[Problem],
    used: Sequence[int],
    known: Investigation,
) -> Missing:
    """The term that the residuals ask for most, beyond the best set of causes.

    Args:
        aircraft: the file.
        flights: what was flown.
        problems: the same flights' residuals.
        used: maneuvers that take part.
        known: what the causes explain.
    """
    products = unlisted.terms(aircraft.control_names)
    columns, left, _ = whitening.whitened(known.data, known.noise)
    best = known.ranked[0].posterior
    found: list[Missing] = []
    for place, row in enumerate(problems[0].usable):
        values = [_products(aircraft, flight, products, row) for flight in flights]
        names = tuple(str(index) for index in range(len(products)))
        extra = [
            replace(problem, columns=Columns(names, np.ones(len(names)), value), offsets=())
            for problem, value in zip(problems, values, strict=True)
        ]
        stacked = joint.stacked(extra, joint.names(extra), used)
        size = np.maximum(stacked.columns[:, place].std(axis=0), 1e-12)
        sigma = lacking.SIZE * stacked.measured[:, place].std() / size
        white, _, _ = whitening.whitened(stacked, known.noise)
        terms = [Term(COEFFICIENTS[row], product) for product in products]
        found.append(unlisted.strongest(best, columns, left, white, sigma, terms))
    return max(found, key=lambda item: item.log_bayes_factor)


def _products(
    aircraft: Aircraft, flight: Observed, products: Sequence[tuple[str, ...]], row: int
) -> Float[np.ndarray, "sample six term"]:
    """Columns of missing terms in one coefficient."""
    base = motion.nothing(aircraft, flight.motion)
    flow = {
        name: np.asarray(value)
        for name, value in motion.flow(aircraft, base, flight.motion).items()
    }
    found = np.stack([unlisted.values(flow, product) for product in products], axis=1)
    if COEFFICIENTS[row] in MOMENTS:
        found = rates.smooth(flight.samples.time, found, flight.samples.smoothing).value
    values = np.zeros((found.shape[0], len(COEFFICIENTS), len(products)))
    values[:, row] = found
    return values
