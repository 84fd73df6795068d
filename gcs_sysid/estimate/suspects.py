"""Along which direction of the derivatives each cause moves them.

A weak elevator takes the same share off all that hold the elevator, a shift of the centre of
gravity adds lift times an arm to the pitching moment. What shows along the flight in other ways,
such as lags and delays, is in `traces`; noise of the flow is in neither.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from gcs_sysid import regressors
from gcs_sysid.aircraft import FORCES, MOMENTS, Aircraft, Value

RIGGING = math.radians(0.5)
"""What a surface ordinarily stands off by [rad]."""
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

    @property
    def label(self) -> str:
        """The cause, and what it is about."""
        return f"{self.cause} {self.about}".rstrip()


def suspects(aircraft: Aircraft) -> Iterator[Suspect]:
    """Everything that is looked for, for an aircraft file's aerodynamics."""
    file = file_values(aircraft)
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
            yield Suspect("aero_derivative", f"{at[0]}_{at[1]}", {at: value}, 0.3, "1")


def _scaled(
    file: Mapping[tuple[str, str], float], names: tuple[str, ...], by: float
) -> dict[tuple[str, str], float]:
    """What is measured of these coefficients, divided by too small a mass or inertia."""
    return {at: by * value for at, value in file.items() if at[0] in names}


def named(every: Iterable[Suspect], text: str) -> list[Suspect]:
    """Those of some suspects that a text means: a cause, and after a colon what it is about."""
    cause, _, about = text.partition(":")
    return [one for one in every if one.cause == cause and about in ("", one.about)]


def file_values(aircraft: Aircraft) -> dict[tuple[str, str], float]:
    """The file's derivatives by coefficient and canonical key; none of those with tables."""
    return {at: term.value for at, term in _terms(aircraft)}


def file_sigmas(aircraft: Aircraft) -> dict[tuple[str, str], float]:
    """One standard deviation of each."""
    return {at: term.sigma for at, term in _terms(aircraft)}


def _terms(aircraft: Aircraft) -> Iterator[tuple[tuple[str, str], Value]]:
    for name, model in aircraft.aerodynamics.items():
        if model.tables:
            continue
        for key, term in model.terms.items():
            yield (name, regressors.parse(key, controls=aircraft.control_names).key), term
