"""Names as a reader knows them: symbols for coefficients, regressors and sensor errors."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

from gcs_sysid.aircraft import COEFFICIENTS

_SYMBOLS = {
    "alpha": "α",
    "beta": "β",
    "phat": "p̂",
    "qhat": "q̂",
    "rhat": "r̂",
    "alphadot_hat": "α̇",
    "qbar": "q̄",
    "h_over_b": "h/b",
    "Tc": "Tc",
}
_DERIVATIVE = re.compile(r"\bC([XYZlmn])(?:_([\w^*]+))?(?![\w(])")
_MEANING = {
    "CX": "force along body x",
    "CY": "side force",
    "CZ": "force along body z",
    "Cl": "rolling moment",
    "Cm": "pitching moment",
    "Cn": "yawing moment",
}
GOOD = 0.90
USABLE = 0.70
_GRADES = (
    (0.99, "excellent"),
    (GOOD, "good"),
    (USABLE, "usable"),
    (0.0, "weak"),
)
"""Grades by the share of variance explained on held-out maneuvers, 0.99 being an error of 10 %.
Manned and subscale research flights with flow vanes reach 0.95 to 0.99 for forces and pitching
moment, 0.90 to 0.98 for rolling and yawing moment (Klein and Morelli 2006, "Aircraft System
Identification")."""


def coefficient(name: str) -> Markup:
    """`CX` as C with a subscript; any other name escaped."""
    if name in COEFFICIENTS:
        return Markup("C<sub>{}</sub>").format(name[1:])
    return escape(name)


def meaning(name: str) -> str:
    """What a coefficient is of, in words."""
    return _MEANING.get(name, "")


def regressor(key: str) -> str:
    """A regressor's key in symbols: `alpha^2` as α², `1` as "constant"."""
    if key == "1":
        return "constant"
    words = re.sub(r"[A-Za-z_]\w*", lambda match: _SYMBOLS.get(match[0], match[0]), key)
    words = words.replace("^2", "²").replace("^3", "³").replace(" - ", " \u2212 ")
    return words.replace("*", "·")


def derivative(name: str, key: str) -> str:
    """A derivative in one word of plain text, for instance `Cm_alpha`; `Cm_0` for a constant."""
    return f"{name}_{'0' if key == '1' else key}"


def typeset(text: str) -> Markup:
    """A sentence with names like `Cm_alpha` set as symbols, all else escaped.

    Numbers keep their interval and unit on the same line.
    """
    bound = text.replace(" ± ", "\u00a0±\u00a0").replace(" %", "\u00a0%")
    pieces: list[str] = []
    end = 0
    for match in _DERIVATIVE.finditer(bound):
        pieces += [escape(bound[end : match.start()]), _symbol(match[1], match[2])]
        end = match.end()
    return Markup("").join([*pieces, escape(bound[end:])])


def _symbol(axis: str, key: str | None) -> Markup:
    if key is None:
        return Markup("C<sub>{}</sub>").format(axis)
    return Markup('<span class="symbol">C<sub>{} {}</sub></span>').format(axis, regressor(key))


def sensor(name: str) -> str:
    """`accelerometer_bias_x` as words."""
    return name.replace("_", " ")


def grade(r2: float | None) -> str:
    """A word for the share of variance explained on held-out maneuvers; empty when not known."""
    if r2 is None or r2 != r2:
        return ""
    return next((word for bound, word in _GRADES if r2 >= bound), "worse than a constant")
