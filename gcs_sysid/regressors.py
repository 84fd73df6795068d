"""What the aerodynamic coefficients are a function of, as text and as arrays.

A regressor is a product of factors joined by `*`: a variable of `VARIABLES` or a control of the
aircraft, raised to a power with `^`, or one side of it beyond a knot, `max(0, alpha - 0.12)`. Its
canonical text, `Regressor.key`, is the same however the product was written, so that it can serve
as the name of a derivative.

Evaluation uses operators only and therefore answers NumPy and JAX arrays alike.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, CoefficientModel
from gcs_sysid.errors import RegressorError, UsageError

CONSTANT = "1"
MAX_EXPONENT = 9


@dataclass(frozen=True)
class Variable:
    """One quantity a coefficient may depend on: its unit and its meaning."""

    unit: str
    meaning: str


VARIABLES: Mapping[str, Variable] = {
    CONSTANT: Variable("1", "constant term"),
    "alpha": Variable("rad", "angle of attack of the air-relative velocity"),
    "beta": Variable("rad", "sideslip of the air-relative velocity"),
    "phat": Variable("1", "roll rate p·b/2V, the gust's own rotation taken off"),
    "qhat": Variable("1", "pitch rate q·c̄/2V, the gust's own rotation taken off"),
    "rhat": Variable("1", "yaw rate r·b/2V, the gust's own rotation taken off"),
    "alphadot_hat": Variable("1", "rate of change of alpha, dα/dt·c̄/2V"),
    "Tc": Variable("1", "thrust coefficient T/(q̄·S)"),
    "qbar": Variable("Pa", "dynamic pressure ½ρV²"),
    "V": Variable("m/s", "true airspeed"),
    "h_over_b": Variable("1", "height above ground over wing span"),
}
"""Names that every aircraft has; its controls, in rad, come in addition."""

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_POWER = r"\s*(?:\^\s*(?P<exponent>\d{1,3})\s*)?"
_PLAIN = re.compile(rf"\s*(?P<name>{_NAME}|1){_POWER}")
_ABOVE = re.compile(
    rf"\s*max\(\s*0(?:\.0*)?\s*,\s*(?P<name>{_NAME})\s*"
    rf"(?:(?P<sign>[+-])\s*(?P<knot>{_NUMBER})\s*)?\){_POWER}"
)
_BELOW = re.compile(
    rf"\s*max\(\s*0(?:\.0*)?\s*,\s*(?:(?P<sign>[+-])?\s*(?P<knot>{_NUMBER})\s*)?-\s*"
    rf"(?P<name>{_NAME})\s*\){_POWER}"
)


@dataclass(frozen=True)
class Factor:
    """`variable`, or the part of it beyond `knot`, to the power `exponent`.

    `side` is +1 for max(0, variable - knot), -1 for max(0, knot - variable), and 0 for the variable
    itself (`knot` is then 0).
    """

    variable: str
    exponent: int = 1
    side: Literal[-1, 0, 1] = 0
    knot: float = 0.0

    @property
    def key(self) -> str:
        """Canonical text of the factor."""
        power = f"^{self.exponent}" if self.exponent > 1 else ""
        if self.side == 0:
            return self.variable + power
        if self.side > 0:
            inside = self.variable if self.knot == 0.0 else _shifted(self.variable, self.knot)
        else:
            inside = f"{'' if self.knot == 0.0 else f'{self.knot!r} '}- {self.variable}"
        return f"max(0, {inside}){power}"


@dataclass(frozen=True)
class Regressor:
    """A product of factors; without any it is the constant 1."""

    factors: tuple[Factor, ...] = ()

    @property
    def key(self) -> str:
        """Canonical text: equal for equal products, and readable by `parse`."""
        return "*".join(factor.key for factor in self.factors) or CONSTANT

    @property
    def variables(self) -> tuple[str, ...]:
        """Variables and controls it uses, each once."""
        return tuple(dict.fromkeys(factor.variable for factor in self.factors))


def parse(text: str, *, controls: Iterable[str] = ()) -> Regressor:
    """Read a regressor.

    Args:
        text: for instance `alpha^2`, `elevator*Tc` or `max(0, alpha - 0.12)`.
        controls: names of the aircraft's controls, known beside `VARIABLES`.

    Returns:
        The product, factors merged and in canonical order.

    Raises:
        RegressorError: the text is no product of known factors.
    """
    known = (*VARIABLES, *controls)
    factors: list[Factor] = []
    start = 0
    for piece in text.split("*"):
        factors.append(_factor(text, piece, start, known))
        start += len(piece) + 1
    merged = _merge(factors, known)
    excessive = [factor for factor in merged if not 1 <= factor.exponent <= MAX_EXPONENT]
    if excessive:
        raise RegressorError(
            f"exponent {excessive[0].exponent} of `{excessive[0].variable}` in `{text}`",
            allowed=f"whole exponents from 1 to {MAX_EXPONENT}",
            fix="lower the exponent, or leave the factor out",
        )
    return Regressor(merged)


def evaluate(
    regressor: Regressor, values: Mapping[str, Float[Any, "*sample"]]
) -> Float[Any, "*sample"]:
    """The regressor's value at every sample.

    Args:
        regressor: what to evaluate.
        values: arrays of one shape by name of variable or control, NumPy or JAX.

    Returns:
        An array of that shape and kind.

    Raises:
        UsageError: a variable that the regressor uses is not in `values`.
    """
    missing = [name for name in regressor.variables if name not in values]
    if missing or not values:
        raise UsageError(
            f"regressor `{regressor.key}` needs {', '.join(missing) or 'at least one array'}, "
            f"given: {', '.join(values) or 'nothing'}; add it to `values`"
        )
    if not regressor.factors:
        sample = next(iter(values.values()))
        return sample.__array_namespace__().ones_like(sample)
    product = _factor_value(regressor.factors[0], values)
    for factor in regressor.factors[1:]:
        product = product * _factor_value(factor, values)
    return product


# Lateral first: `flap_differential` rolls. Words are compared without a plural s.
_MARKS: Mapping[Literal["lateral", "longitudinal"], frozenset[str]] = {
    "lateral": frozenset({"differential", "asymmetric", "antisymmetric", "aileron", "rudder"}),
    "longitudinal": frozenset(
        "symmetric collective elevator stabilator stabilizer stabiliser canard flap slat spoiler "
        "airbrake speedbrake".split()
    ),
}


def control_kind(name: str) -> Literal["longitudinal", "lateral", "unknown"]:
    """Which motion a control is for, by the usual meaning of its name.

    One half of a pair (`elevator_left`) and an elevon that is neither `_symmetric` nor
    `_differential` act in all axes: unknown.
    """
    words = [word.rstrip("s") for word in name.lower().split("_")]
    if {"left", "right"} & set(words):
        return "unknown"
    for kind, marks in _MARKS.items():
        if set(words) & marks:
            return kind
    return "unknown"


_LONGITUDINAL = ("CX", "CZ", "Cm")
_LATERAL_TERMS = (CONSTANT, "beta", "phat", "rhat")
_LONGITUDINAL_TERMS: Mapping[str, tuple[str, ...]] = {
    "CX": (CONSTANT, "alpha", "alpha^2"),
    "CZ": (CONSTANT, "alpha", "qhat"),
    "Cm": (CONSTANT, "alpha", "qhat"),
}


def default_structure(aircraft: Aircraft) -> dict[str, tuple[str, ...]]:
    """Terms of a first linear model, by coefficient.

    Where the file has a coefficient in `[aerodynamics]`, its keys are the structure (with the
    constant, and with the regressors of its tables); otherwise the usual small-disturbance terms
    and the controls that act on that motion by `control_kind`. A control of unknown kind enters
    all.

    Args:
        aircraft: whose controls and aerodynamics to use.

    Returns:
        Canonical regressor keys by coefficient, in the order of `COEFFICIENTS`.
    """
    return {
        name: _from_model(aircraft.aerodynamics[name], aircraft.control_names)
        if name in aircraft.aerodynamics
        else _usual_terms(name, aircraft.control_names)
        for name in COEFFICIENTS
    }


def _usual_terms(coefficient: str, controls: Sequence[str]) -> tuple[str, ...]:
    longitudinal = coefficient in _LONGITUDINAL
    own = "longitudinal" if longitudinal else "lateral"
    terms = _LONGITUDINAL_TERMS[coefficient] if longitudinal else _LATERAL_TERMS
    return (*terms, *(name for name in controls if control_kind(name) in (own, "unknown")))


def _from_model(model: CoefficientModel, controls: Sequence[str]) -> tuple[str, ...]:
    keys = [CONSTANT, *model.terms, *(key for table in model.tables for key in table.regressors)]
    return tuple(dict.fromkeys(parse(key, controls=controls).key for key in keys))


def _shifted(variable: str, knot: float) -> str:
    return f"{variable} {'-' if knot > 0.0 else '+'} {abs(knot)!r}"


def _factor(text: str, piece: str, start: int, known: Sequence[str]) -> Factor:
    if match := _PLAIN.fullmatch(piece):
        side, knot = 0, 0.0
    elif match := _ABOVE.fullmatch(piece):
        side, knot = 1, -_signed(match["sign"], match["knot"])
    elif match := _BELOW.fullmatch(piece):
        side, knot = -1, _signed(match["sign"], match["knot"])
    else:
        raise _unreadable(text, piece, start)
    name = match["name"]
    if name not in known:
        raise _unknown_variable(text, name, start + match.start("name"), known)
    # Adding zero turns -0.0 into 0.0, so that equal knots have one text.
    return Factor(name, int(match["exponent"] or 1), side, knot + 0.0)


def _signed(sign: str | None, number: str | None) -> float:
    magnitude = float(number or 0.0)
    return -magnitude if sign == "-" else magnitude


def _merge(factors: Sequence[Factor], known: Sequence[str]) -> tuple[Factor, ...]:
    exponents: dict[tuple[str, Literal[-1, 0, 1], float], int] = {}
    for factor in factors:
        base = (factor.variable, factor.side, factor.knot)
        exponents[base] = exponents.get(base, 0) + factor.exponent
    merged = [
        Factor(variable, exponent, side, knot)
        for (variable, side, knot), exponent in exponents.items()
        if (variable, side) != (CONSTANT, 0)
    ]
    return tuple(sorted(merged, key=lambda f: (known.index(f.variable), f.side, f.knot)))


def _factor_value(
    factor: Factor, values: Mapping[str, Float[Any, "*sample"]]
) -> Float[Any, "*sample"]:
    value = values[factor.variable]
    if factor.side:
        beyond = (value - factor.knot) * float(factor.side)
        # max(0, x) by operators alone; exact, because halving is.
        value = 0.5 * (beyond + abs(beyond))
    return value**factor.exponent if factor.exponent > 1 else value


def _unreadable(text: str, piece: str, start: int) -> RegressorError:
    if not piece.strip():
        found = f"nothing at character {start + 1} of `{text}`"
        fix = "write a power as `alpha^2`, a product as `alpha*elevator`"
    else:
        skipped = len(piece) - len(piece.lstrip())
        found = f"`{piece.strip()}` at character {start + skipped + 1} of `{text}`"
        fix = "a sum is two terms with two values; beyond a knot is `max(0, alpha - 0.12)`"
    return RegressorError(
        found,
        allowed="variables and controls, `x^2`, `max(0, x - 0.12)`, `max(0, 0.12 - x)`, "
        "joined by `*`",
        fix=fix,
    )


def _unknown_variable(text: str, name: str, at: int, known: Sequence[str]) -> RegressorError:
    by_lower = {each.lower(): each for each in known}
    close = [by_lower[key] for key in difflib.get_close_matches(name.lower(), by_lower, n=1)]
    return RegressorError(
        f"unknown variable `{name}` at character {at + 1} of `{text}`",
        allowed=", ".join(known),
        fix=f"did you mean `{close[0]}`?" if close else "use one of these, or add the control",
    )
