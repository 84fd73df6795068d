"""The aerodynamic model that filter error found, in the form in which all methods are told.

What the flight alone says is the posterior with the prior taken off: Λ_flight = Λ − Λ_prior. Mass
and inertia are wrong by a factor common to the flight, of which every derivative of a force or of a
moment takes its share; no filter can see it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid import regressors
from gcs_sysid.aircraft import MOMENTS, Aircraft
from gcs_sysid.estimate import equation_error, plausible
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.equation_error import Problem
from gcs_sysid.estimate.result import AeroModel, CoefficientFit, Prior

CONSTANT_SIZE = 1.0
OTHER_SIZE = 10.0
"""What stands in for the plausible size of a constant, and of a term without a common size."""
UNSEEN = 1e-6
"""Directions that hold less information than this, in plausible sizes, are not seen."""
Terms = Mapping[str, Mapping[str, float]]


class Derivatives(NamedTuple):
    """All derivatives together.

    Attributes:
        keys: coefficient and regressor of each.
        value: of greatest posterior density.
        covariance: of the posterior.
        prior: their prior means.
        precision: of the prior.
        bound: one standard deviation that no estimate from these flights can beat.
    """

    keys: tuple[tuple[str, str], ...]
    value: Float[np.ndarray, " term"]
    covariance: Float[np.ndarray, "term term"]
    prior: Float[np.ndarray, " term"]
    precision: Float[np.ndarray, "term term"]
    bound: Float[np.ndarray, " term"]


def beliefs(
    structure: Mapping[str, Sequence[str]], prior: Mapping[str, Prior] | None, aircraft: Aircraft
) -> tuple[Terms, Terms]:
    """Prior mean and standard deviation of every term.

    Where nothing is stated: zero, give or take what is plausible on anything that flies.
    """
    mean: dict[str, dict[str, float]] = {}
    sigma: dict[str, dict[str, float]] = {}
    for name, keys in structure.items():
        stated = Prior({}, {}) if prior is None else prior.get(name, Prior({}, {}))
        wide = plausible.sizes(name, keys, aircraft.control_names)
        usual = [CONSTANT_SIZE if key == regressors.CONSTANT else OTHER_SIZE for key in keys]
        sizes = np.where(np.isfinite(wide), wide, usual)
        mean[name] = {key: stated.value.get(key, 0.0) for key in keys}
        sigma[name] = {
            key: stated.sigma.get(key, float(size)) for key, size in zip(keys, sizes, strict=True)
        }
    return mean, sigma


def model(
    found: Derivatives,
    flights: Sequence[Samples],
    aircraft: Aircraft,
    structure: Mapping[str, Sequence[str]],
    pieces: Sequence[Int[np.ndarray, " _sample"]],
) -> AeroModel:
    """What was found, beside how the flights excited it.

    Args:
        found: derivatives with priors.
        flights: coefficients measured with the smoothed states.
        aircraft: relative uncertainty of mass and inertia.
        structure: regressor keys by coefficient.
        pieces: for each flight and sample, the maneuver it belongs to; negative leaves it out.
    """
    alone, flight_value = _of_flight(found, structure, aircraft)
    fits = {}
    for name, keys in structure.items():
        problem = equation_error.problem(name, flights, aircraft, keys, pieces)
        rows = [found.keys.index((name, key)) for key in problem.keys]
        fits[name] = _described(problem, found, rows, alone, flight_value, aircraft, name)
    return AeroModel(fits=fits, controls=aircraft.control_names)


def _of_flight(
    found: Derivatives, structure: Mapping[str, Sequence[str]], aircraft: Aircraft
) -> tuple[Float[np.ndarray, "term term"], Float[np.ndarray, " term"]]:
    """Covariance and value by the flights alone, wide where they say nothing."""
    _, sizes = beliefs(structure, None, aircraft)
    scale = np.array([sizes[name][key] for name, key in found.keys])
    precision = np.linalg.inv(found.covariance)
    seen = (precision - found.precision) * np.outer(scale, scale)
    roots, vectors = np.linalg.eigh(0.5 * (seen + seen.T))
    directions = scale[:, None] * vectors
    covariance = (directions / np.maximum(roots, UNSEEN)) @ directions.T
    told = precision @ found.value - found.precision @ found.prior
    return covariance, covariance @ told


def _described(
    problem: Problem,
    found: Derivatives,
    rows: Sequence[int],
    alone: Float[np.ndarray, "term term"],
    flight_value: Float[np.ndarray, " term"],
    aircraft: Aircraft,
    name: str,
) -> CoefficientFit:
    chosen = np.ix_(rows, rows)
    baseline = equation_error.solve(problem, None)
    value = found.value[rows]
    factor = aircraft.mass.inertia_sigma if name in MOMENTS else aircraft.mass.mass_sigma
    scale = factor * value
    covariance = found.covariance[chosen] + np.outer(scale, scale)
    return replace(
        baseline,
        value=value,
        covariance=covariance,
        flight_value=flight_value[rows],
        deviations={
            "noise": np.sqrt(np.diagonal(alone)[rows]),
            "scale": np.abs(scale),
            "regressor": np.zeros(len(rows)),
        },
        white_deviation=found.bound[rows],
        repeated_covariance=covariance,
        **equation_error.scatter(problem, value)._asdict(),
    )
