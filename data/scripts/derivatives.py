"""From a vortex lattice to the coefficients of an aircraft file, by central differences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from data.scripts.vortex_lattice import Flow, Lattice
from gcs_sysid.aircraft import COEFFICIENTS, CoefficientModel, Geometry, Value

STEP = 1e-3
"""Half of the difference, in rad or of a dimensionless rate: the lattice is smooth."""

# What moves in flight, roughly: below a ten-thousandth by that a term is left out.
_USUAL = {"alpha": 0.1, "beta": 0.1, "phat": 0.05, "qhat": 0.005, "rhat": 0.02}
_USUAL_CONTROL = 0.1
_NEGLIGIBLE = 1e-4

Coefficients = Float[np.ndarray, " coefficient"]


def coefficients(
    lattice: Lattice, geometry: Geometry, alpha: float, **regressors: float
) -> Coefficients:
    """CX CY CZ Cl Cm Cn about the lattice's reference point, friction left out.

    Args:
        lattice: the surfaces.
        geometry: what the coefficients refer to.
        alpha: angle of attack [rad].
        regressors: `beta`, `phat`, `qhat`, `rhat`, and controls [rad].
    """
    beta = regressors.pop("beta", 0.0)
    rates = (
        2.0 * regressors.pop("phat", 0.0) / geometry.wing_span,
        2.0 * regressors.pop("qhat", 0.0) / geometry.mean_chord,
        2.0 * regressors.pop("rhat", 0.0) / geometry.wing_span,
    )
    velocity = (
        math.cos(alpha) * math.cos(beta),
        math.sin(beta),
        math.sin(alpha) * math.cos(beta),
    )
    force, moment = lattice.loads(Flow(velocity, rates, regressors))
    span, chord = geometry.wing_span, geometry.mean_chord
    return 2.0 / geometry.wing_area * np.concatenate([force, moment / [span, chord, span]])


def slopes(
    lattice: Lattice, geometry: Geometry, alpha: float, controls: Sequence[str]
) -> dict[str, Coefficients]:
    """Derivatives of all coefficients at an angle of attack, by regressor; `"1"` is their value."""

    def at(angle: float, **regressors: float) -> Coefficients:
        return coefficients(lattice, geometry, angle, **regressors)

    found = {"1": at(alpha), "alpha": (at(alpha + STEP) - at(alpha - STEP)) / (2.0 * STEP)}
    for name in ("beta", "phat", "qhat", "rhat", *controls):
        found[name] = (at(alpha, **{name: STEP}) - at(alpha, **{name: -STEP})) / (2.0 * STEP)
    return found


def aerodynamics(
    lattice: Lattice,
    geometry: Geometry,
    *,
    alpha: float,
    controls: Sequence[str],
    friction: float,
    added: Mapping[str, Mapping[str, float]],
    sigma: float,
) -> dict[str, CoefficientModel]:
    """The lattice about one angle of attack as terms of an aircraft file.

    CX is quadratic in alpha, through three angles 6° apart; everything else is linear. Numbers
    have four digits, so that they come out the same on every machine.

    Args:
        lattice: the surfaces, about the airframe point.
        geometry: what the coefficients refer to.
        alpha: angle of attack of the linear terms [rad].
        controls: names of the deflections.
        friction: drag coefficient that potential flow does not have.
        added: further terms by coefficient.
        sigma: relative standard deviation of every value.
    """
    found = slopes(lattice, geometry, alpha, controls)
    terms = {name: _linear(found, i, alpha) for i, name in enumerate(COEFFICIENTS)}
    angles = alpha + np.radians([-6.0, 0.0, 6.0])
    axial = [coefficients(lattice, geometry, angle)[0] for angle in angles]
    square, slope, constant = np.polyfit(angles, axial, 2).tolist()
    terms["CX"] |= {"1": constant - friction, "alpha": slope, "alpha^2": square}
    for name, more in added.items():
        terms[name] |= more
    return {name: CoefficientModel(_values(each, sigma)) for name, each in terms.items()}


def _linear(found: Mapping[str, Coefficients], i: int, alpha: float) -> dict[str, float]:
    rows = {key: float(values[i]) for key, values in found.items()}
    rows["1"] -= rows["alpha"] * alpha
    usual = {"1": 1.0, **_USUAL}
    return {
        key: value
        for key, value in rows.items()
        if abs(value) * usual.get(key, _USUAL_CONTROL) > _NEGLIGIBLE
    }


def _values(terms: Mapping[str, float], sigma: float) -> dict[str, Value]:
    rounded = {key: float(f"{value:.4g}") for key, value in terms.items()}
    return {key: Value(value, sigma * abs(value)) for key, value in rounded.items()}
