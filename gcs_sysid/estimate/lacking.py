"""Terms that a model lacks, by the innovations of the filter that holds it.

A filter whose aerodynamics lack a term bends the flow angles until its polynomial fits, so that the
coefficients measured at its states no longer show it. Its innovations do. With sensitivities J to
all that was fitted and j to a term, gains held (`causal`),

    s = Σ jᵀ S⁻¹ ν − H_jF Σ_F Σ J_Fᵀ S⁻¹ ν        v = H_jj − H_jF Σ_F H_Fj        H = Σ Jᵀ S⁻¹ J

are the term's score and information once everything fitted has had its share, Σ_F from H_FF and
what was believed (Rao's score test, Proc. Cambridge Phil. Soc. 44, 1948, p. 50). Of a model that
lacks nothing s scatters by v. Where one thing is wrong everything is a little, and what scores of
stretches of flight scatter by beyond v, on the median of all terms, counts as noise. θ = s/v is
what the term is to first order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.estimate import basis, in_common, scoring, settling, stepwise
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.estimate.settling import Beliefs
from gcs_sysid.estimate.stepwise import ENTER
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import causal

LEAST_SHARE = 0.02
"""Least share of its coefficient's spread that a term moves. What is less no simulation is good
to."""
BENDS = (0.04, 0.08, 0.12, 0.16, 0.2, 0.24)
"""Angles of attack from which a coefficient may go another way [rad]."""
SIZE = 0.5
"""One sigma of what a term that is there moves, as a share of its coefficient's spread."""


class Scores(NamedTuple):
    """What flights say of terms that the model does not have, coefficient by coefficient.

    Attributes:
        score: s of the module's equations.
        information: v.
        scatter: variance of s.
    """

    score: Float[np.ndarray, " term"]
    information: Float[np.ndarray, " term"]
    scatter: Float[np.ndarray, " term"]

    def plus(self, other: Scores) -> Scores:
        """Of another flight too."""
        return Scores(*(one + more for one, more in zip(self, other, strict=True)))


@dataclass(frozen=True)
class Lacking:
    """A term that flights ask for.

    Attributes:
        coefficient: that it belongs to.
        key: the regressor.
        evidence: logarithm of the Bayes factor for it, among as many as were tried [nat].
        value: of the term, to first order, with the others as they are.
        deviation: one sigma of it.
        share: of the coefficient's spread that it moves.
    """

    coefficient: str
    key: str
    evidence: float
    value: float
    deviation: float
    share: float


def candidates(aircraft: Aircraft) -> tuple[str, ...]:
    """Terms that are asked about in every coefficient: usual ones, and a curve over α that bends.

    Where it bends is asked at the same angles on every flight, for one compiled program.
    """
    bends = (f"max(0, alpha - {knot:g})" for knot in BENDS)
    return (*stepwise.candidates(aircraft), "alpha^3", *bends)


def scores(
    model: FlightModel,
    flight: Flight,
    found: Unknowns,
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    keys: Sequence[str],
) -> Scores:
    """What one flight says of every term in every coefficient.

    Args:
        model: the aircraft.
        flight: measurements and first states.
        found: where the search ended.
        beliefs: before the flight.
        counts: rows that take part.
        keys: regressors of the terms.
    """
    every = in_common.derivative_keys(found.means.aerodynamics)
    # A term moves what its coefficient's constant moves, and is asked about where there is one.
    having = [name for name in COEFFICIENTS if (name, regressors.CONSTANT) in every]
    constants = tuple(every.index((name, regressors.CONSTANT)) for name in having)
    controls = model.aircraft.control_names
    terms = tuple(regressors.parse(key, controls=controls) for key in keys)
    more = causal.More(terms, constants)
    path = settling.along(model, flight, found)
    done = causal.passed(model, *found, path, counts, more=more)
    behind = ravel_pytree(found.means)[0].size
    free = np.flatnonzero(np.diagonal(beliefs.covariance) > 0.0)
    matrix, score, _ = done.told
    inner = matrix[np.ix_(free, free)] + scoring.inverse(beliefs.covariance[np.ix_(free, free)])
    across = matrix[free, behind:]
    shared = scoring.inverse(inner) @ across
    information = np.diagonal(matrix)[behind:] - np.sum(across * shared, axis=0)
    information = np.where(information > 1e-9 * np.diagonal(matrix)[behind:], information, 0.0)
    parts = done.blocks[:, behind:] - done.blocks[:, free] @ shared
    told = Scores(
        score=score[behind:] - shared.T @ score[free],
        information=information,
        scatter=settling.overdispersion(parts, information) * information,
    )
    places = np.repeat([name in having for name in COEFFICIENTS], len(keys))
    return Scores(*(_placed(part, places) for part in told))


def strongest(
    told: Scores,
    aircraft: Aircraft,
    structure: Mapping[str, Sequence[str]],
    keys: Sequence[str],
    flow: Mapping[str, Float[np.ndarray, " sample"]],
    measured: Mapping[str, Float[np.ndarray, " sample"]],
) -> list[Lacking]:
    """The one term of each coefficient that flights ask for most, the surest first.

    Args:
        told: what they say.
        aircraft: names of its controls.
        structure: terms that the coefficients have.
        keys: terms that were asked about.
        flow: variables and controls in the flights.
        measured: coefficients there.
    """
    found = []
    for row, name in enumerate(COEFFICIENTS):
        score, information, scatter = (
            part[row * len(keys) : (row + 1) * len(keys)] for part in told
        )
        moved = _moved(aircraft, structure[name], keys, flow)
        spread = float(np.std(measured[name]))
        seen = (information > 0.0) & (moved > 0.0)
        if not seen.any():
            continue
        value, variance = np.zeros(len(keys)), np.ones(len(keys))
        value[seen] = score[seen] / information[seen]
        variance[seen] = scatter[seen] / information[seen] ** 2
        sigma = SIZE * spread / np.where(seen, moved, 1.0)
        gain = log_bayes_factor(value / variance, 1.0 / variance, sigma)
        best = int(np.argmax(np.where(seen, gain, -np.inf)))
        evidence = float(gain[best] - np.log(told.score.size))
        size = float(np.abs(value[best]) * moved[best] / spread)
        if evidence >= ENTER and size >= LEAST_SHARE:
            deviation = float(np.sqrt(variance[best]))
            found.append(Lacking(name, keys[best], evidence, float(value[best]), deviation, size))
    return sorted(found, key=lambda one: -one.evidence)


def log_bayes_factor(
    score: Float[np.ndarray, " term"],
    information: Float[np.ndarray, " term"],
    sigma: Float[np.ndarray, " term"],
) -> Float[np.ndarray, " term"]:
    """For each term of deviation σ against none, ½ σ²s²/(1 + σ²v) − ½ log(1 + σ²v) [nat].

    Args:
        score: s, of variance v where there is no term.
        information: v.
        sigma: σ.
    """
    share = 1.0 + information * sigma**2
    return 0.5 * (sigma * score) ** 2 / share - 0.5 * np.log(share)


def _placed(
    values: Float[np.ndarray, " some"], places: Bool[np.ndarray, " every"]
) -> Float[np.ndarray, " every"]:
    out = np.zeros(places.size)
    out[places] = values
    return out


def _moved(
    aircraft: Aircraft,
    has: Sequence[str],
    keys: Sequence[str],
    flow: Mapping[str, Float[np.ndarray, " sample"]],
) -> Float[np.ndarray, " term"]:
    """Standard deviation of each term that others do not make up for; 0 where the term is there."""
    controls = aircraft.control_names
    own = basis.columns(tuple(has), controls, flow)
    more = basis.columns(tuple(keys), controls, flow)
    left = more - own @ np.linalg.lstsq(own, more, rcond=None)[0]
    return np.where([key in has for key in keys], 0.0, np.std(left, axis=0))
