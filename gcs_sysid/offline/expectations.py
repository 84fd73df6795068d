"""What a document must say: a tree of the document's own keys, with an expectation at each end.

    [identify.derivatives.Cm]
    elevator = { value = -0.55, within = 0.03 }     # |found − value| ≤ within
    alpha = { value = -0.72, sds = 3 }              # and, or instead, ≤ 3 of the document's sd
    [identify.coefficients.Cm]
    relative_error = { most = 40 }                  # least ≤ found ≤ most
    [diagnose]
    verdict = "effect"                              # equal
    cause = { one_of = ["mass", "airspeed_scale"] }
    effects = { holds = ["mass"] }                  # a list with these in it
    [diagnose.ranking.0.parameters]                 # a number is a place in a list
    mass_ratio = { value = 1.1, within = 0.02 }

Where the document has an estimate `{value, sd, unit}` its value is what is compared. A value may be
a list of numbers; each of them is then compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gcs_sysid.aircraft_toml.section import Section, describe
from gcs_sysid.errors import InputError

KEYS = ("value", "within", "sds", "least", "most", "one_of", "holds")


@dataclass(frozen=True)
class Check:
    """One expectation and what became of it.

    Attributes:
        place: dotted path in the document.
        wanted: in words.
        found: in words.
        passed: whether that is what was wanted.
    """

    place: str
    wanted: str
    found: str
    passed: bool


def compare(expected: Section, document: Mapping[str, Any]) -> list[Check]:
    """Every expectation of a tree against a document.

    Raises:
        InputError: an expectation is malformed; the message names its key.
    """
    return list(_compared(expected, document, ""))


def _compared(expected: Section, found: Any, place: str) -> Iterable[Check]:
    for key, wanted in expected.data.items():
        there = f"{place}.{key}" if place else key
        part = _part(found, key)
        if not isinstance(wanted, Mapping):
            yield Check(there, _words(wanted), _words(part), part == wanted)
        elif _ends(wanted):
            yield _check(expected.table(key), there, part)
        else:
            yield from _compared(expected.table(key), part, there)


def _ends(wanted: Mapping[str, Any]) -> bool:
    """Whether an expectation stands here, rather than a branch of the tree."""
    return any(key in wanted and not isinstance(wanted[key], Mapping) for key in KEYS)


def _part(found: Any, key: str) -> Any:
    if isinstance(found, Mapping):
        return found.get(key)
    if isinstance(found, Sequence) and not isinstance(found, str) and key.isdecimal():
        return found[int(key)] if int(key) < len(found) else None
    return None


def _check(wanted: Section, place: str, found: Any) -> Check:
    wanted.allow_only(*KEYS)
    value, deviation = found, None
    if isinstance(found, Mapping):
        value, deviation = found.get("value"), found.get("sd")
    if wanted.has("value"):
        return _near(wanted, place, value, deviation)
    if wanted.has("one_of"):
        choice = wanted.data["one_of"]
        return Check(place, f"one of {_words(choice)}", _words(value), value in choice)
    if wanted.has("holds"):
        parts = wanted.data["holds"]
        there = isinstance(value, Sequence) and set(parts) <= set(value)
        return Check(place, f"holds {_words(parts)}", _words(value), there)
    return _between(wanted, place, value)


def _near(wanted: Section, place: str, value: Any, deviation: Any) -> Check:
    if not (wanted.has("within") or wanted.has("sds")):
        raise wanted.error(
            "within", found="nothing", allowed="a number", fix="say how near: `within` or `sds`"
        )
    aims = _numbers(wanted.data["value"])
    values = _numbers(value)
    spreads = _numbers(deviation) or [None] * len(values)
    within, sds = wanted.optional_number("within", "1"), wanted.optional_number("sds", "1")
    limits = [f"± {within:g}"] if within is not None else []
    limits += [f"± {sds:g} sd"] if sds is not None else []
    passed = len(aims) == len(values) == len(spreads) and all(
        (within is None or abs(x - aim) <= within)
        and (sds is None or (sd is not None and abs(x - aim) <= sds * sd))
        for x, aim, sd in zip(values, aims, spreads, strict=True)
    )
    known = [_words(value), *([] if deviation is None else [f"(sd {_words(deviation)})"])]
    return Check(place, f"{_words(wanted.data['value'])} {', '.join(limits)}", " ".join(known),
                 passed)  # fmt: skip


def _between(wanted: Section, place: str, value: Any) -> Check:
    least, most = wanted.optional_number("least", "1"), wanted.optional_number("most", "1")
    words = [f"≥ {least:g}"] if least is not None else []
    words += [f"≤ {most:g}"] if most is not None else []
    if not words:
        raise InputError(
            wanted.file, f"{wanted.path}: expects nothing", fix=f"give one of {', '.join(KEYS)}"
        )
    passed = (
        bool(_numbers(value))
        and (least is None or value >= least)
        and (most is None or value <= most)
    )
    return Check(place, " and ".join(words), _words(value), passed)


def _numbers(value: Any) -> list[float]:
    entries = value if isinstance(value, list) else [value]
    good = [float(x) for x in entries if isinstance(x, int | float) and not isinstance(x, bool)]
    return good if len(good) == len(entries) else []


def _words(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return ", ".join(_words(entry) for entry in value)
    return value if isinstance(value, str) else describe(value)
