"""The aerodynamic model that filter error found, in the form in which all methods are told.

What flights say adds up, Λ = Σ Λ_flight and Λ θ = Σ Λ_flight θ_flight, and so does the prior. Mass
and inertia are wrong by a factor, of which every derivative of a force or of a moment takes its
share. Where they are taken as the file has them that share is stated beside the rest; where they
were found with the derivatives (`in_common.BODY`) it is what the derivatives' deviations would be
less without them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid import regressors
from gcs_sysid.aircraft import MOMENTS, Aircraft
from gcs_sysid.estimate import equation_error, in_common, plausible
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.equation_error import Problem
from gcs_sysid.estimate.in_common import Said
from gcs_sysid.estimate.result import AeroModel, CoefficientFit, Prior
from gcs_sysid.estimate.scoring import inverse

CONSTANT_SIZE = 1.0
OTHER_SIZE = 10.0
"""What stands in for the plausible size of a constant, and of a term without a common size."""
UNSEEN = 1e-6
"""Directions that hold less information than this, in plausible sizes, are not seen."""
Terms = Mapping[str, Mapping[str, float]]


class Derivatives(NamedTuple):
    """All derivatives together, and behind them the body where that is sought.

    Attributes:
        keys: coefficient and regressor of each, see `in_common`.
        believed: values before any flight.
        precision: of these.
        said: what flights say of them.
        bound: of the derivatives, one standard deviation that no estimate from these flights can
            beat.
    """

    keys: tuple[tuple[str, str], ...]
    believed: Float[np.ndarray, " key"]
    precision: Float[np.ndarray, "key key"]
    said: Said
    bound: Float[np.ndarray, " term"]

    @property
    def value(self) -> Float[np.ndarray, " key"]:
        """Of greatest posterior density, by Bayes' rule: in whatever order the flights came."""
        return self._told(self.precision @ self.believed + self.said.told)

    @property
    def late(self) -> Float[np.ndarray, " key"]:
        """What the values go by where the lag of the moments is off by what is allowed for."""
        return self._told(self.said.late)

    @property
    def covariance(self) -> Float[np.ndarray, "key key"]:
        """Of the posterior."""
        late = self.late
        return inverse(self.precision + self.said.information) + np.outer(late, late)

    def _told(self, vector: Float[np.ndarray, " key"]) -> Float[np.ndarray, " key"]:
        return inverse(self.precision + self.said.information) @ vector


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
    alone = _of_flight(found, structure, aircraft)
    fits = {}
    for name, keys in structure.items():
        problem = equation_error.problem(name, flights, aircraft, keys, pieces)
        rows = [found.keys.index((name, key)) for key in problem.keys]
        fits[name] = _described(problem, found, rows, alone, aircraft, name)
    return AeroModel(fits=fits, controls=aircraft.control_names)


class _Alone(NamedTuple):
    """What flights say without a prior of the derivatives, wide where they say nothing.

    Attributes:
        value: of each.
        noise: variance of each, with body and lag known.
        body: variance that the body's adds; None where the body was not sought.
    """

    value: Float[np.ndarray, " key"]
    noise: Float[np.ndarray, " key"]
    body: Float[np.ndarray, " key"] | None


def _of_flight(
    found: Derivatives, structure: Mapping[str, Sequence[str]], aircraft: Aircraft
) -> _Alone:
    _, sizes = beliefs(structure, None, aircraft)
    of_body = np.array([name == in_common.BODY for name, _ in found.keys])
    scale = np.array(
        [1.0 if name == in_common.BODY else sizes[name][key] for name, key in found.keys]
    )
    # What is believed of the body stays: no flight tells mass from thrust.
    seen = found.said.information + found.precision * np.outer(of_body, of_body)
    covariance = _inverse(seen, scale)
    value, total = covariance @ found.said.told, np.diagonal(covariance)
    if not of_body.any():
        return _Alone(value, total, None)
    kept = np.flatnonzero(~of_body)
    noise = np.zeros(scale.size)
    noise[kept] = np.diagonal(_inverse(seen[np.ix_(kept, kept)], scale[kept]))
    return _Alone(value, noise, np.maximum(total - noise, 0.0))


def _inverse(
    seen: Float[np.ndarray, "key key"], scale: Float[np.ndarray, " key"]
) -> Float[np.ndarray, "key key"]:
    """Covariance of what has this information, in units of `scale`."""
    unit = seen * np.outer(scale, scale)
    roots, vectors = np.linalg.eigh(0.5 * (unit + unit.T))
    directions = scale[:, None] * vectors
    return (directions / np.maximum(roots, UNSEEN)) @ directions.T


def _described(
    problem: Problem,
    found: Derivatives,
    rows: Sequence[int],
    alone: _Alone,
    aircraft: Aircraft,
    name: str,
) -> CoefficientFit:
    baseline = equation_error.solve(problem, None)
    value = found.value[rows]
    covariance = found.covariance[np.ix_(rows, rows)]
    if alone.body is None:
        factor = aircraft.mass.inertia_sigma if name in MOMENTS else aircraft.mass.mass_sigma
        scale = np.abs(factor * value)
        covariance = covariance + np.outer(factor * value, factor * value)
    else:
        scale = np.sqrt(alone.body[rows])
    return replace(
        baseline,
        value=value,
        covariance=covariance,
        flight_value=alone.value[rows],
        deviations={
            "noise": np.sqrt(alone.noise[rows]),
            "scale": scale,
            # With the prior: alone, it is as wide as noise where a flight sees next to nothing.
            "lag": np.abs(found.late[rows]),
            "regressor": np.zeros(len(rows)),
        },
        late=found.late[rows],
        white_deviation=found.bound[rows],
        repeated_covariance=covariance,
        **equation_error.scatter(problem, value)._asdict(),
    )
