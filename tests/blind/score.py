"""What a diagnosis is worth, knowing what was hidden. Reads the documents' own keys only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tests.blind.draw import Draw
from tests.blind.sizes import depends_on

Z95 = 1.959964
"""Half of the 95 % interval of a normal variable, in standard deviations."""

GROUP = 3
"""Causes that a group which cannot be told apart may hold at most."""

_NAMES = ("control", "stream", "derivative")
"""What an effect is about, beside its numbers."""


@dataclass(frozen=True)
class Sized:
    """A size found: error over the stated standard deviation, and over the true deviation."""

    parameter: str
    deviations: float
    relative: float

    @property
    def inside(self) -> bool:
        """Whether the 95 % interval holds the truth."""
        return abs(self.deviations) <= Z95


@dataclass(frozen=True)
class Score:
    """What one diagnosis is worth.

    Attributes:
        said: what it named, in short, for the confusion matrix.
        alone: the truth was named, and nothing else.
        grouped: or it was in a group of at most three that cannot be told apart.
        false_alarm: somebody was accused of what did not happen, on a flight with nothing hidden.
        first: the ranking's first entry is the truth.
        probability: that the ranking states for its first entry; None without a ranking.
        sizes: of the parameters hidden, where the truth was named.
        shown: size hidden over the one from which half of such flights would name it, as the
            diagnosis itself says; None where it does not.
    """

    said: str
    alone: bool
    grouped: bool
    false_alarm: bool
    first: bool
    probability: float | None
    sizes: tuple[Sized, ...]
    shown: float | None = None


def score(draw: Draw, diagnosis: Mapping[str, Any]) -> Score:
    """Compare a diagnosis with what was hidden."""
    verdict = diagnosis.get("verdict")
    named = accused(diagnosis)
    group = _group(diagnosis)
    truth = draw.causes
    right = named == truth and _about_the_same(draw, diagnosis)
    if draw.cause == "none":
        right = verdict == "no_effect"
    if draw.cause == "unlisted":
        right = verdict == "unlisted_effect" and _names_the_term(draw, diagnosis)
    # A pair is found when each of the two is somewhere among those that explain as much.
    held = bool(truth) and truth <= group and len(group) <= GROUP * len(truth)
    ranking = diagnosis.get("ranking") or [None]
    return Score(
        said=said(diagnosis),
        alone=right,
        grouped=right or (verdict == "ambiguous" and held),
        false_alarm=draw.cause == "none" and (bool(named) or bool(group)),
        first=ranking[0] is not None and _set(ranking[0]) == truth and _speaks_of(draw, ranking[0]),
        probability=None if ranking[0] is None else float(ranking[0]["probability"]),
        sizes=_sizes(draw, diagnosis) if right or held else (),
        shown=_shown(draw, diagnosis),
    )


def accused(diagnosis: Mapping[str, Any]) -> frozenset[str]:
    """What a diagnosis names without doubt."""
    if diagnosis.get("verdict") == "unlisted_effect":
        return frozenset(("unlisted",))
    if diagnosis.get("verdict") == "effect":
        return frozenset(diagnosis["effects"])
    return frozenset()


def said(diagnosis: Mapping[str, Any]) -> str:
    """The answer in short: `mass`, `mass + cg_shift`, `mass or cg_shift`, `none`, a verdict."""
    verdict = str(diagnosis.get("verdict"))
    match verdict:
        case "effect" | "unlisted_effect":
            return " + ".join(sorted(accused(diagnosis)))
        case "ambiguous":
            return " or ".join(sorted(_group(diagnosis)))
        case "no_effect":
            return "none"
    return verdict


def _group(diagnosis: Mapping[str, Any]) -> frozenset[str]:
    """Causes that cannot be told apart; with `none` among them nobody is accused."""
    if diagnosis.get("verdict") != "ambiguous":
        return frozenset()
    group = frozenset(diagnosis.get("indistinguishable") or ())
    return frozenset() if "none" in group else group


def _set(entry: Mapping[str, Any]) -> frozenset[str]:
    return frozenset(entry["causes"]) - {"none"}


def _entry(draw: Draw, diagnosis: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The ranking's entry for what was hidden."""
    for entry in diagnosis.get("ranking") or ():
        if _set(entry) == draw.causes and _speaks_of(draw, entry):
            return entry
    return None


def _about_the_same(draw: Draw, diagnosis: Mapping[str, Any]) -> bool:
    """Whether the control, stream or derivative is the one that it was."""
    ranking = diagnosis.get("ranking") or ()
    of_these = [entry for entry in ranking if _set(entry) == draw.causes]
    return not of_these or _speaks_of(draw, of_these[0])


def _speaks_of(draw: Draw, entry: Mapping[str, Any]) -> bool:
    """Whether an entry is about what the effects are about, as far as it says so."""
    for effect in draw.effects:
        for key in _NAMES:
            every = [_stated(one, key) for one in _found(effect, entry) if key in one]
            if key in effect and every and str(effect[key]) not in set().union(*every):
                return False
    return True


def _stated(one: Mapping[str, Any], key: str) -> set[str]:
    """What a parameter is about: of a servo that two controls share, it is said of one of them."""
    return {str(one[key]), *one.get("same_servos", ())}


def _found(effect: Mapping[str, Any], entry: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """An entry's parameters that an effect frees; a second of that name has words after it."""
    return [
        one
        for name, one in entry.get("parameters", {}).items()
        if name.split(" ")[0] in _numbers(effect)
    ]


def _sizes(draw: Draw, diagnosis: Mapping[str, Any]) -> tuple[Sized, ...]:
    entry = _entry(draw, diagnosis)
    if entry is None:
        return ()
    found = []
    for effect in draw.effects:
        for name, true in _numbers(effect).items():
            one = _estimate(effect, name, entry)
            if one is None or not one["sd"] > 0.0:
                continue
            error = float(one["value"]) - true
            far = abs(true - _nominal(name)) or 1.0
            found.append(Sized(name, error / float(one["sd"]), error / far))
    return tuple(found)


def _shown(draw: Draw, diagnosis: Mapping[str, Any]) -> float | None:
    """Of one effect alone: of its parameters, the one that shows most."""
    if len(draw.effects) != 1:
        return None
    (effect,) = draw.effects
    about = [str(effect[key]) for key in _NAMES if key in effect]
    listed = (diagnosis.get("detectable") or {}).get(" ".join((effect["name"], *about)), {})
    ratios = [
        abs(true - _nominal(name)) / listed[name]["named_from"]
        if listed[name]["named_from"]
        else 0.0
        for name, true in _numbers(effect).items()
        if "named_from" in listed.get(name, {})
    ]
    return max(ratios, default=None)


def _estimate(
    effect: Mapping[str, Any], name: str, entry: Mapping[str, Any]
) -> Mapping[str, Any] | None:
    for key, one in entry.get("parameters", {}).items():
        about = all(key not in one or str(effect.get(key)) in _stated(one, key) for key in _NAMES)
        if key.split(" ")[0] == name and about:
            return one
    return None


def _numbers(effect: Mapping[str, Any]) -> dict[str, float]:
    return {
        key: float(value)
        for key, value in effect.items()
        if isinstance(value, int | float) and key != "name"
    }


def _nominal(parameter: str) -> float:
    return 1.0 if parameter == "ratio" or parameter.endswith("_ratio") else 0.0


def _names_the_term(draw: Draw, diagnosis: Mapping[str, Any]) -> bool:
    """The right coefficient, the right variables, and at most one more."""
    stated = diagnosis.get("unlisted") or {}
    coefficient, variables = depends_on(draw.effects[0])
    named: Sequence[str] = stated.get("depends_on") or ()
    return (
        stated.get("coefficient") == coefficient
        and set(variables) <= set(named)
        and len(set(named)) <= len(variables) + 1
    )
