"""The simulation to be tested: the tables `[aerodynamics.CX]` to `[aerodynamics.Cn]`, in radians.

A term is `regressor = value`, or `{ value = ..., sigma = ... }` with a relative standard deviation,
or `{ value = ..., sd = ... }` with an absolute one. A table is any other key with `regressors`,
`breakpoints`, `values` and perhaps a relative `sigma` of a scale common to all its values.
"""

from __future__ import annotations

import math

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, CoefficientModel, TableTerm, Value
from gcs_sysid.aircraft_toml.section import Section, describe, increasing
from gcs_sysid.errors import RegressorError

DEFAULT_SIGMA = 0.1
"""Relative standard deviation of a value about which the file says nothing."""
ZERO_VALUE_SCALE = 0.01
"""What a relative sigma refers to where the value is 0.

A relative sigma of 0 would make the term exactly 0 for ever, however the aircraft flies. With this
scale it is held near 0, 0.001 at the default sigma, but data can move it; whoever believes less
in the 0 says so with an absolute `sd`.
"""
LARGEST_SIGMA = 10.0

_FLOW_ANGLES = ("alpha", "beta")
_LARGEST_ANGLE = math.pi
_OTHER_AXES = {
    "CL": "lift is in wind axes; in body axes CZ = -CL·cos(alpha) - CD·sin(alpha)",
    "CD": "drag is in wind axes; in body axes CX = CL·sin(alpha) - CD·cos(alpha)",
    "CN": "the normal force is -CZ; the yawing moment is `Cn`",
    "CA": "the axial force is -CX",
}


def read_aerodynamics(
    section: Section | None, controls: tuple[str, ...]
) -> dict[str, CoefficientModel]:
    """The table `[aerodynamics]`, by coefficient; empty without it.

    Args:
        section: the table.
        controls: names of the aircraft's controls, in rad.

    Raises:
        AircraftFileError: a key or a value is wrong.
    """
    if section is None:
        return {}
    _check_coefficients(section)
    sigma = _sigma(section, DEFAULT_SIGMA)
    return {
        name: _read_coefficient(section.table(name), controls, sigma)
        for name in COEFFICIENTS
        if section.has(name)
    }


def _check_coefficients(section: Section) -> None:
    allowed = ("sigma", *COEFFICIENTS)
    for key in section.data:
        if key in allowed:
            continue
        axes = _OTHER_AXES.get(key)
        if axes is None:
            section.allow_only(*allowed)
        raise section.error(
            key, found="an unknown key", allowed=", ".join(allowed), fix=axes or f"remove `{key}`"
        )


def _read_coefficient(
    section: Section, controls: tuple[str, ...], sigma: float
) -> CoefficientModel:
    terms: dict[str, Value] = {}
    tables: list[TableTerm] = []
    for key, entry in section.data.items():
        if isinstance(entry, dict) and "regressors" in entry:
            tables.append(_read_table(section.table(key), key, controls, sigma))
            continue
        name = _regressor(section, key, key, controls)
        if name in terms:
            raise section.error(
                key,
                found=f"the regressor `{name}` again",
                allowed="each product of regressors once, in whatever order",
                fix="keep one of the two",
            )
        terms[name] = _read_value(section, key, sigma)
    return CoefficientModel(terms=terms, tables=tuple(tables))


def _regressor(section: Section, key: str, text: str, controls: tuple[str, ...]) -> str:
    """Canonical text of a regressor, its knots checked to be in radians."""
    try:
        regressor = regressors.parse(text, controls=controls)
    except RegressorError as error:
        raise section.error(key, found=error.found, allowed=error.allowed, fix=error.fix) from error
    for factor in regressor.factors:
        angle = factor.variable in (*_FLOW_ANGLES, *controls)
        if angle and abs(factor.knot) > _LARGEST_ANGLE:
            raise section.error(
                key,
                found=f"a knot at {factor.knot:g} rad",
                allowed="knots in rad",
                fix=f"for {factor.knot:g} deg write {math.radians(factor.knot):.4g}",
            )
    return regressor.key


def _read_value(section: Section, key: str, sigma: float) -> Value:
    entry = section.data[key]
    if not isinstance(entry, dict):
        value = section.number(key, "1")
        return Value(value, relative_to_absolute(value, sigma))
    table = section.table(key)
    table.allow_only("value", "sigma", "sd")
    value = table.number("value", "1")
    if not table.has("sd"):
        return Value(value, relative_to_absolute(value, _sigma(table, sigma)))
    if table.has("sigma"):
        raise table.error(
            "sd",
            found="`sd` beside `sigma`",
            allowed="`sigma`, relative to the value, or `sd`, in the value's unit",
            fix="keep one of the two",
        )
    return Value(value, table.number("sd", "1", above=0.0))


def relative_to_absolute(value: float, sigma: float) -> float:
    """Absolute standard deviation of a value with relative standard deviation `sigma`.

    See `ZERO_VALUE_SCALE` for a value of 0.
    """
    return sigma * (abs(value) or ZERO_VALUE_SCALE)


def _sigma(section: Section, default: float) -> float:
    sigma = section.number("sigma", "1", default=default, above=0.0)
    if sigma >= LARGEST_SIGMA:
        raise section.error(
            "sigma",
            found=f"{sigma:g}",
            allowed=f"a relative standard deviation above 0, below {LARGEST_SIGMA:g}",
            fix=f"for {sigma:g} % write sigma = {sigma / 100.0:g}",
        )
    return sigma


def _read_table(section: Section, name: str, controls: tuple[str, ...], sigma: float) -> TableTerm:
    section.allow_only("regressors", "breakpoints", "values", "sigma")
    names = section.data["regressors"]
    if (
        not isinstance(names, list)
        or len(names) not in (1, 2)
        or not all(isinstance(text, str) for text in names)
    ):
        raise section.error(
            "regressors",
            found=describe(names),
            allowed="a list of one or two regressors in quotes",
            fix='for instance regressors = ["alpha", "elevator"]',
        )
    keys = tuple(_regressor(section, "regressors", text, controls) for text in names)
    breakpoints = _breakpoints(section, keys, controls)
    if len(keys) == 1:
        values = section.numbers("values", "1", count=len(breakpoints[0]))
    else:
        values = section.rows("values", "1", shape=(len(breakpoints[0]), len(breakpoints[1])))
    return TableTerm(name, keys, breakpoints, values, _sigma(section, sigma))


def _breakpoints(
    section: Section, keys: tuple[str, ...], controls: tuple[str, ...]
) -> tuple[tuple[float, ...], ...]:
    """One increasing list a regressor; over one regressor a plain list will do."""
    entry = section.data.get("breakpoints")
    plain = isinstance(entry, list) and not any(isinstance(e, list) for e in entry)
    lists = [entry] if plain and len(keys) == 1 else entry
    if not isinstance(lists, list) or len(lists) != len(keys):
        raise section.error(
            "breakpoints",
            found="nothing" if entry is None else describe(entry),
            allowed=f"one list of numbers for each of {', '.join(keys)}",
            fix="for instance breakpoints = [[-0.1, 0.0, 0.1], [-0.3, 0.3]]",
        )
    breakpoints = []
    for key, numbers in zip(keys, lists, strict=True):
        single = Section(section.file, section.path, {"breakpoints": numbers})
        points = single.numbers("breakpoints", "1", at_least=2)
        angle = key in (*_FLOW_ANGLES, *controls)
        if not increasing(points) or (angle and max(map(abs, points)) > _LARGEST_ANGLE):
            raise section.error(
                "breakpoints",
                found=f"{describe(numbers)} for {key}",
                allowed="numbers that increase without repeats, angles in rad",
                fix="sort them, with the table, and write 7 deg as 0.1222",
            )
        breakpoints.append(points)
    return tuple(breakpoints)
