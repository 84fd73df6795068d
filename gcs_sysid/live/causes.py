"""Likely causes of a departure, from what the first model and the aircraft file differ by.

A cause moves the derivatives along one direction d: a weak elevator takes the same share off all
that hold the elevator, a shift of the centre of gravity adds lift times an arm to the pitching
moment. With δ the difference of the derivatives, Σ its covariance (of the flight's estimate and of
the file's values) and τ the size that such a cause has, the evidence for it against none is that
of one regression coefficient (Kass & Raftery 1995, section 3),

    log B = m² / 2(k + τ⁻²) − log(1 + k τ²) / 2,   m = dᵀ Σ⁻¹ δ,   k = dᵀ Σ⁻¹ d.

A first look while flying: noise of the flow, lags and delays are not in it. `diagnose` decides.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import FORCES, MOMENTS, Aircraft
from gcs_sysid.live.regression import Solution

TOLD = 3.0
"""Log Bayes factor from which a cause is told: twenty to one."""
MOST = 3
LEAST = 0.02
"""And from which probability, among all that were looked for."""
MATTERS = 0.2
"""And from which share of its usual size: a small one may be sure, and is no cause."""
FARTHEST = 3.0
"""And up to how many times its usual size: what needs more is something else in its disguise, such
as slopes that noise of the flow pulls toward zero."""
LEFT = 2.0
"""And where no more than this many times the expected square of the differences is left: what a
cause does not explain is not its doing."""
RATES = frozenset({"phat", "qhat", "rhat", "alphadot_hat"})

Direction = Mapping[tuple[str, str], float]
"""What one unit of a cause adds to the derivatives, by coefficient and regressor."""


@dataclass(frozen=True)
class Suspect:
    """One thing that may be wrong.

    Attributes:
        cause: its identifier, as `diagnose` has it.
        about: the control, axis or derivative; empty where there is none.
        moves: what one unit of it adds to the derivatives.
        sigma: how large it usually is.
        unit: of its size.
    """

    cause: str
    about: str
    moves: Direction
    sigma: float
    unit: str


@dataclass(frozen=True)
class Likely:
    """A suspect with what the flight says of it.

    Attributes:
        suspect: which.
        probability: among all suspects and none.
        log_bayes_factor: against none.
        size: of it.
        deviation: one standard deviation of the size.
    """

    suspect: Suspect
    probability: float
    log_bayes_factor: float
    size: float
    deviation: float


def likely(aircraft: Aircraft, found: Mapping[str, Solution]) -> list[Likely]:
    """Causes that explain the difference between flight and file, the likeliest first.

    Args:
        aircraft: its file, with aerodynamics.
        found: derivatives of the flight alone, without the file as prior.
    """
    parts = _differences(aircraft, found)
    if not parts:
        return []
    judged = [_judged(suspect, parts) for suspect in suspects(aircraft)]
    judged = [one for one in judged if one is not None]
    evidence = np.array([0.0, *(one[1] for one in judged)])
    share = np.exp(evidence - evidence.max())
    share /= share.sum()
    told = [
        Likely(suspect, float(share[index + 1]), log_bayes, size, deviation)
        for index, (suspect, log_bayes, size, deviation) in enumerate(judged)
        if log_bayes > TOLD
        and share[index + 1] >= LEAST
        and MATTERS * suspect.sigma < abs(size) <= FARTHEST * suspect.sigma
        and explained(parts, suspect, size)
    ]
    return sorted(told, key=lambda one: -one.log_bayes_factor)[:MOST]


def explained(parts: Mapping[str, _Part], suspect: Suspect, size: float) -> bool:
    """Whether the coefficients that a cause moves are as the file has them, but for that cause."""
    square, count = 0.0, 0
    for name, part in parts.items():
        moved = np.array([suspect.moves.get((name, key), 0.0) for key in part.keys])
        if not moved.any():
            continue
        left = part.apart - size * moved
        square += float(left @ part.information @ left)
        count += len(part.keys)
    return square <= LEFT * count


def suspects(aircraft: Aircraft) -> Iterator[Suspect]:
    """Everything that is looked for, for an aircraft file's aerodynamics."""
    file = _values(aircraft)
    parsed = {at: regressors.parse(at[1], controls=aircraft.control_names).variables for at in file}
    for control in aircraft.control_names:
        own = {at: value for at, value in file.items() if control in parsed[at]}
        yield Suspect("surface_effectiveness", control, own, 0.3, "1")
        moved = {(at[0], regressors.CONSTANT): value for at, value in own.items()
                 if at[1] == control}  # fmt: skip
        yield Suspect("surface_offset", control, moved, 0.05, "rad")
    yield Suspect("mass", "", _scaled(file, FORCES, -1.0), 0.1, "1")
    for axis, name in zip("xyz", MOMENTS, strict=True):
        yield Suspect("inertia", f"I{axis}{axis}", _scaled(file, (name,), -1.0), 0.25, "1")
    arm = aircraft.geometry.mean_chord / aircraft.geometry.wing_span
    lift = {("Cm", key): value for (name, key), value in file.items() if name == "CZ"}
    side = {("Cn", key): -arm * value for (name, key), value in file.items() if name == "CY"}
    yield Suspect("cg_shift", "", {**lift, **side}, 0.08, "mean chords forward")
    speed = {at: (-1.0 if RATES & set(parsed[at]) else -2.0) * value for at, value in file.items()}
    yield Suspect("airspeed_scale", "", speed, 0.05, "1")
    for name, cause, sigma in (
        ("CX", "drag_increase", 0.03), ("Cl", "asymmetry", 0.01), ("Cn", "asymmetry", 0.01),
    ):  # fmt: skip
        yield Suspect(cause, f"{name}0", {(name, regressors.CONSTANT): 1.0}, sigma, "1")
    for at, value in file.items():
        if at[1] != regressors.CONSTANT:
            yield Suspect("aero_derivative", f"{at[0]}_{at[1]}", {at: abs(value)}, 0.3, "1")


def _scaled(
    file: Mapping[tuple[str, str], float], names: tuple[str, ...], by: float
) -> dict[tuple[str, str], float]:
    """What is measured of these coefficients, divided by too small a mass or inertia."""
    return {at: by * value for at, value in file.items() if at[0] in names}


def _values(aircraft: Aircraft) -> dict[tuple[str, str], float]:
    """The file's derivatives by coefficient and canonical key; none of those with tables."""
    return {
        (name, regressors.parse(key, controls=aircraft.control_names).key): term.value
        for name, model in aircraft.aerodynamics.items()
        if not model.tables
        for key, term in model.terms.items()
    }


@dataclass(frozen=True)
class _Part:
    """Difference of one coefficient's derivatives and its information."""

    keys: tuple[str, ...]
    apart: Float[np.ndarray, " term"]
    information: Float[np.ndarray, "term term"]


def _differences(aircraft: Aircraft, found: Mapping[str, Solution]) -> dict[str, _Part]:
    parts = {}
    for name, solution in found.items():
        model = aircraft.aerodynamics.get(name)
        if model is None or not model.terms or model.tables:
            continue
        terms = {
            regressors.parse(key, controls=aircraft.control_names).key: term
            for key, term in model.terms.items()
        }
        believed = np.array([terms[key].value if key in terms else 0.0 for key in solution.keys])
        sigma = np.array([terms[key].sigma if key in terms else 0.0 for key in solution.keys])
        covariance = solution.covariance + np.diag(sigma**2)
        information = np.linalg.pinv(covariance, hermitian=True)
        parts[name] = _Part(solution.keys, solution.value - believed, information)
    return parts


def _judged(
    suspect: Suspect, parts: Mapping[str, _Part]
) -> tuple[Suspect, float, float, float] | None:
    along = known = 0.0
    for name, part in parts.items():
        moved = np.array([suspect.moves.get((name, key), 0.0) for key in part.keys])
        along += float(moved @ part.information @ part.apart)
        known += float(moved @ part.information @ moved)
    if not known > 0.0:
        return None
    total = known + suspect.sigma**-2
    log_bayes = 0.5 * along**2 / total - 0.5 * np.log1p(known * suspect.sigma**2)
    return suspect, float(log_bayes), along / total, total**-0.5
