"""Entries of `diagnosis.json` that are the same however causes were weighed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.diagnose.aided.power import Power
from gcs_sysid.diagnose.aided.unlisted import MissingTerm
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.explanation import explained
from gcs_sysid.diagnose.hypothesis import Estimate, Ranked
from gcs_sysid.diagnose.unlisted import Missing
from gcs_sysid.diagnose.verdict import INCREDIBLE, Verdict
from gcs_sysid.estimate.suspects import named, suspects
from gcs_sysid.estimate.traces import traces
from gcs_sysid.offline.leads import Lead

LISTED = 12
"""Sets of causes that the document lists."""


def verdict(
    answer: Verdict,
    aircraft: Aircraft,
    missing: Missing | MissingTerm | None,
    unlisted: float | None = None,
) -> dict[str, Any]:
    """The answer and what belongs to it, in the keys of the interface.

    Args:
        answer: of the ranking.
        aircraft: the simulation.
        missing: a term that nothing listed stands for, where one is asked for.
        unlisted: probability that one is missing, where that is known.
    """
    best = answer.best
    rivals = [name for item in answer.indistinguishable for name in item.names]
    named = answer.answer in ("effect", "ambiguous")
    probability = best.probability
    if missing is not None:
        probability = best.probability if unlisted is None else unlisted
    elif not named:
        # Of what is said, that is nothing, and not of a favourite that is not believed.
        probability = next((one.probability for one in answer.ranked if not one.causes), 0.0)
    return {
        "verdict": answer.answer,
        "cause": best.names[0] if named else "unlisted" if missing else "none",
        "probability": probability,
        "explanation": [explained(one, own) for one, own in pairs(best)] if named else [],
        "indistinguishable": list(dict.fromkeys(rivals)),
        "sure": [one.cause.name for one in answer.sure] if named else [],
        "separating_maneuver": _separating(answer),
        "separate": separate(answer, aircraft),
        "effects": list(best.names) if named else ["unlisted"] if missing else [],
        "perhaps": {one.label: share for one, share in answer.perhaps.items()} if named else {},
        "perhaps_parameters": {
            one.label: _parameters([(one, sizes)]) for one, sizes in answer.sizes.items() if named
        },
        "unlisted": None
        if missing is None
        else {
            "coefficient": missing.coefficient,
            "depends_on": list(dict.fromkeys(missing.variables)),
            "log_bayes_factor": missing.log_bayes_factor,
        },
    }


def pairs(item: Ranked) -> list[tuple[Candidate, tuple[Estimate, ...]]]:
    """Every cause of a set with the estimates of its parameters."""
    return list(zip(item.causes, item.estimates, strict=True))


def _separating(answer: Verdict) -> str | None:
    """What to fly where causes cannot be told apart."""
    if answer.answer != "ambiguous":
        return None
    causes = {
        one.cause.name: one.cause
        for item in answer.indistinguishable
        for one in item.causes
        if one not in answer.sure
    }
    return "; ".join(cause.shown_by for cause in causes.values())


def separate(answer: Verdict, aircraft: Aircraft) -> str | None:
    """What `suggest --separate` is to be asked: the first two causes of which it may be either.

    None where there are no two that it knows of.
    """
    if answer.answer != "ambiguous":
        return None
    every = [*suspects(aircraft), *traces(aircraft)]
    words = [
        _asked(one, own)
        for item in answer.indistinguishable
        for one, own in pairs(item)
        if one not in answer.sure
    ]
    known = [text for text in dict.fromkeys(words) if len(named(every, text)) == 1]
    return ",".join(known[:2]) if len(known) > 1 else None


def _asked(candidate: Candidate, estimates: Sequence[Estimate]) -> str:
    """A cause and what it is about; of several parameters the one that is farthest off."""
    about = candidate.about.replace(".", "_")
    if len(estimates) > 1 and not about:
        farthest = max(estimates, key=lambda one: abs(one.value - one.nominal) / one.deviation)
        about = farthest.name.removesuffix("_ratio").removeprefix("bias_")
    return f"{candidate.cause.name}:{about}" if about else candidate.cause.name


def ranking(
    ranked: Sequence[Ranked], missing: MissingTerm | None = None, unlisted: float = 0.0
) -> list[dict[str, Any]]:
    """The most probable sets of causes, and something unlisted among them."""
    listed = [_ranked(item) for item in ranked[:LISTED]]
    if missing is not None:
        term = {"value": missing.value, "sd": missing.deviation, "unit": "1"}
        listed.append(
            {
                "causes": ["unlisted"],
                "label": "unlisted",
                "probability": unlisted,
                "log_bayes_factor": missing.log_bayes_factor,
                "parameters": {f"{missing.coefficient}.{missing.key}": term},
            }
        )
    return sorted(listed, key=lambda item: -item["probability"])


def _parameters(of: Sequence[tuple[Candidate, tuple[Estimate, ...]]]) -> dict[str, Any]:
    """Of causes, by name; where two have one of the same name, with what the second is about."""
    parameters: dict[str, Any] = {}
    for candidate, estimates in of:
        for estimate in estimates:
            entry: dict[str, Any] = {
                "value": estimate.value,
                "sd": estimate.deviation,
                "unit": estimate.unit,
            }
            if candidate.about:
                entry[candidate.cause.about] = candidate.about
            if candidate.also:
                entry["same_servos"] = list(candidate.also)
            name = estimate.name
            parameters[name if name not in parameters else f"{name} {candidate.label}"] = entry
    return parameters


def _ranked(item: Ranked) -> dict[str, Any]:
    return {
        "causes": list(item.names) or ["none"],
        "label": " and ".join(one.label for one in item.causes) or "nothing",
        "probability": item.probability,
        "log_bayes_factor": item.log_bayes_factor,
        "parameters": _parameters(pairs(item)),
    }


def alternatives(ranked: Sequence[Ranked]) -> list[dict[str, Any]]:
    """The best explanations that have no cause of the most probable one, nothing among them.

    `behind` is by how much their evidence is less [nat].
    """
    best = ranked[0]
    listed = []
    for item in ranked:
        if set(item.causes) & set(best.causes) or item is best or len(item.causes) > 1:
            continue
        behind = best.log_bayes_factor - item.log_bayes_factor
        listed.append({**_ranked(item), "behind": behind})
    return sorted(listed, key=lambda item: item["behind"])[:LISTED]


def not_asked(candidates: Sequence[Candidate]) -> dict[str, str]:
    """Causes that the flights give no sense to, and what would show them."""
    asked = {each.cause.name for each in candidates}
    return {name: cause.shown_by for name, cause in CAUSES.items() if name not in asked}


def detectable(
    candidates: Sequence[Candidate],
    deviations: Sequence[Sequence[float]],
    sizes: Mapping[str, float],
    powers: Sequence[Sequence[Power]] | None = None,
) -> dict[str, dict[str, Any]]:
    """What the flights would know of each cause's parameters, were it the only one.

    Args:
        candidates: the causes. Of one with places, that is told where it is named first.
        deviations: how well the flights would know the parameters of each.
        sizes: what `Parameter.matters` is a share of.
        powers: from what sizes the flights would name each, where that is known.
    """
    listed: dict[str, dict[str, Any]] = {}
    for index, (candidate, spread) in enumerate(zip(candidates, deviations, strict=True)):
        if candidate.cause.about == "derivative":
            continue
        entry = listed.setdefault(candidate.label, {})
        for place, parameter in enumerate(candidate.cause.parameters):
            if parameter.expected:
                continue
            told = {
                "sd": spread[place],
                "matters": parameter.matters * sizes[parameter.per],
                "unit": parameter.unit,
            }
            if powers is not None:
                told |= _power(powers[index][place])
            known = entry.get(parameter.name)
            if known is None or told.get("named_from", 0.0) < known.get("named_from", 0.0):
                entry[parameter.name] = told
    return {name: entry for name, entry in listed.items() if entry}


def _power(one: Power) -> dict[str, Any]:
    """Sizes that no flight of this kind reaches are null."""
    rival = None if one.rival is None else one.rival.label
    return {"named_from": one.named, "alone_from": one.alone, "rival": rival}


def dropped(best: Ranked) -> list[str]:
    """What would explain the flights and is not named."""
    labels = " and ".join(one.label for one in best.causes)
    return [
        f"{labels} would explain what was fitted ({best.log_bayes_factor:.1f} nat), but what took "
        "no part is foretold no better with it, and so it is not named"
    ]


def incredible(farthest: float) -> list[str]:
    """A warning where the likeliest cause has a size that nobody would believe.

    Args:
        farthest: by how many of its own sigmas it is off.
    """
    if farthest < INCREDIBLE:
        return []
    return [
        f"the likeliest cause would have to be off by {farthest:.1f} of the sigmas it is given, "
        "which nobody would believe: something that no cause here stands for is at work"
    ]


def strained(bent: Mapping[str, float], controls: Sequence[str]) -> list[str]:
    """One warning for each value of the file that was bent too far.

    Args:
        bent: by how many of its sigmas, by parameter of the model.
        controls: names of the aircraft's.
    """
    return [
        f"{_in_words(name, controls)} had to go {abs(size):.1f} of its sigmas from the file: it is "
        "wrong, or something that no cause here stands for is"
        for name, size in bent.items()
    ]


def stands_out(leads: Sequence[Lead], controls: Sequence[str]) -> list[dict[str, Any]]:
    """What was off by more than it ordinarily is, where no set of causes found rest.

    Args:
        leads: parameters of the model, the farthest first.
        controls: names of the aircraft's.
    """
    return [
        {
            "parameter": one.name,
            "label": _in_words(one.name, controls),
            "off": one.off,
            "ordinary": one.ordinary,
            "unit": one.unit,
        }
        for one in leads
    ]


def _in_words(name: str, controls: Sequence[str]) -> str:
    """What a parameter of the model is called; derivatives keep their names."""
    kind, _, rest = name.partition(".")
    if kind not in ("sensors", "departures"):
        return name.removeprefix("aerodynamics.")
    what, _, index = rest.partition(".")
    words = "the " + what.replace("_", " ")
    if not index:
        return words
    if what == "offset":
        return f"{words} of the {controls[int(index)]}"
    if what == "attitude_tilt":
        return f"{words} ({('roll', 'pitch')[int(index)]})"
    return f"{words} ({(('alpha', 'beta') if what.startswith('vane') else 'xyz')[int(index)]})"
