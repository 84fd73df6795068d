"""The page that `diagnose` leaves: the cause in words, how sure, what it gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.verdict import NAMED, SHOWN
from gcs_sysid.figures import diagnosis
from gcs_sysid.figures.data import Span
from gcs_sysid.report import sheet
from gcs_sysid.report.findings import Finding
from gcs_sysid.report.numbers import for_people, number, plus_minus, power_of_ten, probability
from gcs_sysid.report.sheet import Section, Sheet, Table

_BINS = 700
_BARS = 6
_WORTH_A_WORD = 1e-3
"""Probability below which a rival of what is named has no place on the first page."""
_WANTED = 2
"""Causes that are to be flown for next."""
_SIGMAS = 1.959964
_HELD_OUT = ("held out, before", "after", "gained")


def render(summary: Mapping, table: Mapping[str, np.ndarray]) -> str:
    """The report of a diagnosis as one self-contained HTML file.

    Args:
        summary: the document of `diagnose`.
        table: `residuals.parquet`, one array a column.
    """
    changed = summary["verdict"] in ("effect", "ambiguous")
    flights = summary["flights"]
    figures = tuple(
        diagnosis.residuals(
            table,
            flight=index,
            spans=_spans(summary, index),
            changed=changed,
            bins=_BINS // max(len(flights), 1),
            source=str(flight["source"]) if len(flights) > 1 else "",
        )
        for index, flight in enumerate(flights)
    )
    return sheet.render(
        Sheet(
            kind="Diagnosis report",
            question="What the simulation gets wrong",
            summary=summary,
            findings=findings(summary),
            sections=(
                *_explanations(summary),
                *_alternatives(summary),
                *_gains(summary),
                *_changes(summary),
                *_could(summary),
                Section(
                    "residuals",
                    "Residuals",
                    "Shaded maneuvers took no part in what is scored.",
                    figures=figures,
                ),
            ),
            files="diagnosis.json and residuals.parquet; the file put right is "
            "aircraft-extended.toml, its changes aircraft-extended.patch",
        )
    )


def findings(summary: Mapping) -> tuple[Finding, ...]:
    """The headline findings, most important first."""
    found = [Finding("Verdict", _said(summary))]
    found += [Finding("Cause", _sentence(text)) for text in summary["explanation"]]
    best = summary["ranking"][0]
    named = summary["explanation"] or summary["verdict"] == "unlisted_effect"
    if best["parameters"] and named:
        found.append(Finding("Size", _parameters(best) + " (± 95 %)."))
    wanted = _fly_next(summary)
    if wanted:
        found.append(Finding("Fly next", _sentence(wanted)))
    gain = summary["gain"]
    if named:
        found.append(Finding("Gain", _gained(gain)))
    if summary.get("perhaps"):
        found.append(Finding("Perhaps", _perhaps(summary)))
    if summary.get("followed", True):
        found.append(Finding("Rivals", _rivals(summary["ranking"])))
    elif summary["stands_out"]:
        words = ", ".join(f"{one['label']} {_off(one)[0]}" for one in summary["stands_out"])
        found.append(
            Finding("Look at", f"{words}: farther off than is ordinary, but nobody is accused.")
        )
    if "file_accuracy" in summary:
        found.append(Finding("File", _accuracy(summary["file_accuracy"])))
    return tuple(found)


def _fly_next(summary: Mapping) -> str:
    """What to fly to tell causes apart, or to see those that this flight says too little of."""
    if summary["separating_maneuver"]:
        asked = summary.get("separate")
        planned = f"; `suggest --separate {asked}` plans it" if asked else ""
        return summary["separating_maneuver"] + planned
    told = summary["verdict"] in ("effect", "insufficient_data")
    if not told or not summary.get("followed", True):
        return ""
    doubted = list(summary.get("perhaps") or ())
    best = summary["ranking"][0]
    if summary["verdict"] == "insufficient_data" and best["log_bayes_factor"] >= NAMED:
        doubted = list(best["causes"])
    unseen = [] if doubted else _unseen(summary["detectable"])
    causes = [one for one in doubted or unseen if one != "none"][:_WANTED]
    shown = "; ".join(f"for {one}: {CAUSES[one.split()[0]].shown_by}" for one in causes)
    return f"{shown} (this flight would not have shown it)" if unseen else shown


def _unseen(detectable: Mapping) -> list[str]:
    """Causes of a size that matters that another flight would show, what is nearest to it first.

    Not those that hide behind what the file states of them: no flight betters that.
    """
    short = {
        name: min(SHOWN * one["sd"] / one["matters"] for one in entries.values())
        for name, entries in detectable.items()
    }
    return sorted((name for name, ratio in short.items() if ratio > 1.0), key=short.__getitem__)


def _shown_from(entry: Mapping) -> float:
    """Size from which flights show a parameter; infinite where none is enough."""
    named = entry.get("named_from", SHOWN * entry["sd"])
    return np.inf if named is None else named


def _perhaps(summary: Mapping) -> str:
    """What may be at work beside what is sure, and how large it would be."""
    sizes = {name: _sizes(each) for name, each in summary.get("perhaps_parameters", {}).items()}
    words = ", ".join(
        f"{name} {probability(share)}" + (f" ({sizes[name]})" if sizes.get(name) else "")
        for name, share in summary["perhaps"].items()
    )
    interval = " (sizes ± 95 %)" if any(sizes.values()) else ""
    return f"beside what is sure, by its probability: {words}{interval}."


def _rivals(ranking: Sequence[Mapping]) -> str:
    """What would explain the flight in place of the first of the ranking.

    A cause that is perhaps at work beside the first is a rival where it stands without it only,
    and far less probable there.
    """
    others = [item for item in ranking[1:4] if item["probability"] >= _WORTH_A_WORD]
    if not others:
        return f"no other explanation is above {100.0 * _WORTH_A_WORD:g} %."
    words = (f"{item['label']} {probability(item['probability'])}" for item in others)
    return f"{'; '.join(words)}."


def _accuracy(share: float) -> str:
    """How good the file's aerodynamics are, cause aside, as a sentence."""
    if share < 1.0:
        return f"in all else its aerodynamics are right to about {share:.2g} of their sigmas."
    if share > 1.0:
        return f"its aerodynamics are off by about {share:.2g} times what their sigmas say."
    return "its aerodynamics are about as far off as their sigmas say."


def _gained(gain: Mapping) -> str:
    """What took no part, before and after: its error, or where a sensor was wrong its density."""
    before, after = gain["holdout_error_before"], gain["holdout_error_after"]
    if before != after:
        words = f"error on what took no part {number(before)} % before, {number(after)} % after"
        if "holdout_error_gained_sd" in gain:
            sure = _SIGMAS * gain["holdout_error_gained_sd"]
            words += f", a gain of {plus_minus(before - after, sure)} % (± 95 %)"
        return f"{words}{_gained_in_flight(gain)}."
    return (
        f"what took no part is foretold better by {_nats(gain)} nat a measurement; its "
        "coefficients are as they were, since it is not the aircraft that was wrong."
    )


def _nats(gain: Mapping) -> str:
    """Gained per measurement, with its 95 % interval where that is known."""
    gained = gain["holdout_nlpd_before"] - gain["holdout_nlpd_after"]
    sure = gain.get("holdout_nlpd_gained_sd")
    return number(gained) if sure is None else plus_minus(gained, _SIGMAS * sure)


def _gained_in_flight(gain: Mapping) -> str:
    """The channel that free flight is put right in most, if surely any is."""
    channels = (gain.get("free_run") or {}).get("channels") or {}
    sure = {
        name: item
        for name, item in channels.items()
        if item["gained"] > _SIGMAS * item["gained_sd"] > 0.0
    }
    if not sure:
        return ""
    name, item = max(sure.items(), key=lambda pair: pair[1]["before"] / pair[1]["after"])
    before, after = (for_people(item[key], 0.0, item["unit"]) for key in ("before", "after"))
    length = gain["free_run"]["length_s"]
    return (
        f"; flown freely for {length:.0f} s it is off by {number(after[0])} {after[2]} in {name}, "
        f"by {number(before[0])} before"
    )


def _said(summary: Mapping) -> str:
    """The verdict as a sentence."""
    probable = probability(summary["probability"])
    match summary["verdict"]:
        case "effect":
            return f"{summary['ranking'][0]['label']}, probability {probable}."
        case "ambiguous":
            every, sure = summary["indistinguishable"], summary["sure"]
            rest = " or ".join(one for one in every if one not in sure)
            # Of two controls with the same cause the names are one.
            if sure and rest:
                return (
                    f"{' and '.join(sure)}, and beside it {rest}: which, this flight cannot tell."
                )
            return f"{' or '.join(every)}: this flight cannot tell them apart."
        case "no_effect":
            return (
                "nothing in the catalogue is wrong with this simulation beyond what its sigmas "
                "allow."
            )
        case "unlisted_effect":
            found = summary["unlisted"]
            return (
                f"nothing in the catalogue explains it: {found['coefficient']} is off with "
                f"{' and '.join(found['depends_on'])}."
            )
        case _:
            return f"this flight cannot tell: {_why_not(summary)}."


def _why_not(summary: Mapping) -> str:
    """Why nothing is said to be wrong and nothing right."""
    best = summary["ranking"][0]
    if not summary.get("followed", True):
        return "the filter cannot follow this simulation through it, so that no cause has a measure"
    if best["causes"] != ["none"] and best["log_bayes_factor"] >= NAMED:
        return (
            f"{best['label']} fits best, but what took no part in the fit is foretold no better "
            "for it, so that something else is wrong"
        )
    if summary["strained"]:
        return (
            "nothing in the catalogue stands out, but values of the file had to go farther than "
            "its sigmas allow"
        )
    return (
        "no cause is sure enough to be named, and those of a size that matters would not have shown"
    )


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _parameters(item: Mapping) -> str:
    return _sizes(item["parameters"])


def _sizes(parameters: Mapping) -> str:
    return ", ".join(
        f"{name} {plus_minus(entry['value'], _SIGMAS * entry['sd'])}"
        + ("" if entry["unit"] == "1" else f" {entry['unit']}")
        for name, entry in parameters.items()
    )


def _explanations(summary: Mapping) -> tuple[Section, ...]:
    """Sets of causes; where the filter did not follow, what stood out instead, if anything did.

    What coefficients alone would accuse there accuses nobody, and would be read as if it did.
    """
    if not summary.get("followed", True):
        if not summary["stands_out"]:
            return ()
        text = (
            "With no set of causes did the filter follow this simulation, so that none has a "
            "probability. Where its search began, near the aircraft file and on the busiest "
            "stretch of the flight, these had to be off by more than they ordinarily are. That is "
            "where to look first, and no finding: nothing that took no part speaks for it."
        )
        return (Section("stands-out", "Where to look first", text, tables=(_leads(summary),)),)
    shown = summary["ranking"][:_BARS]
    return (
        Section(
            "ranking",
            "Explanations",
            "Sets of causes by probability. The log Bayes factor is the evidence against nothing "
            "being wrong: 3 is 20 to 1. What errors of the file's aerodynamics (its sigmas), of "
            "mass, thrust and inertia, of the flow angles and of the surfaces' rigging can explain "
            "is explained by them first.",
            tables=(_ranking(summary),),
            figures=(diagnosis.probabilities(shown, [item["label"] for item in shown]),),
        ),
    )


def _gains(summary: Mapping) -> tuple[Section, ...]:
    """What putting right gains, where there was something to be put right."""
    if not summary.get("followed", True):
        return ()
    apart = "on what took no part, with what putting right gains there, ± 95 %, and "
    text = (
        "On maneuvers, or a flight, that took no part: the error in percent of the measured "
        "spread, and the negative log predictive density, lower is better. Below, coefficient by "
        "coefficient: rms of measured less predicted in percent of the measured spread, "
        f"{apart if summary['gain'].get('channels') else ''}on all that was flown."
        f"{_flown_words(summary)}"
    )
    tables = (_gain(summary), _coefficients(summary), *_flown(summary))
    return (Section("gain", "Gain", text, tables=tables),)


def _could(summary: Mapping) -> tuple[Section, ...]:
    """How well each cause would be known, where it was weighed at all."""
    if not summary.get("followed", True):
        return ()
    text = (
        "How well each cause would be known, were it the only one, against the size from which it "
        "matters, and the size from which half of such flights would show it: less than that may "
        "be there unseen. Up to the size in the last column something else explains as much."
    )
    if unasked := summary.get("not_asked"):
        named = "; ".join(f"{name} ({shown_by})" for name, shown_by in unasked.items())
        text += f" Not asked about, since this flight could not show it; what would: {named}."
    return (Section("could", "What this flight could show", text, tables=(_detectable(summary),)),)


def _leads(summary: Mapping) -> Table:
    return Table(
        ("what", "off by", "ordinarily within (one deviation)"),
        tuple((one["label"], *_off(one)) for one in summary["stands_out"]),
    )


def _off(lead: Mapping) -> tuple[str, str]:
    """By how much something is off, and ordinarily is, in units for people."""
    off, ordinary, unit = for_people(lead["off"], lead["ordinary"], lead["unit"])
    return f"{off:+.3g} {unit}".strip(), f"{ordinary:.2g} {unit}".strip()


def _ranking(summary: Mapping) -> Table:
    return Table(
        ("explanation", "probability", "log Bayes factor", "parameters, ± 95 %"),
        tuple(
            (
                item["label"],
                probability(item["probability"]),
                number(item["log_bayes_factor"]),
                _parameters(item) or "–",
            )
            for item in summary["ranking"]
        ),
    )


def _alternatives(summary: Mapping) -> tuple[Section, ...]:
    """Why it is not something else, where a cause is named."""
    if not summary["explanation"] or not summary.get("alternatives"):
        return ()
    rows = tuple(
        (
            item["label"],
            number(item["log_bayes_factor"]),
            f"{number(item['behind'])} nat",
            _times(item["behind"]),
            _parameters(item) or "–",
        )
        for item in summary["alternatives"][:_BARS]
    )
    return (
        Section(
            "alternatives",
            "Why not something else",
            "What explains most without the cause above: the evidence it has against nothing being "
            "wrong, by how much that is less, and the size it would have to have, ± 95 %.",
            tables=(
                Table(
                    ("instead", "log Bayes factor", "behind", "the flight is then", "it would be"),
                    rows,
                ),
            ),
        ),
    )


def _changes(summary: Mapping) -> tuple[Section, ...]:
    """What the file put right says otherwise."""
    if not summary.get("changes"):
        return ()
    return (
        Section(
            "changes",
            "The file put right",
            "What aircraft-extended.toml says otherwise than the file under test, both as this "
            "program writes them.",
            text=tuple(summary["changes"]),
        ),
    )


def _times(nats: float) -> str:
    """How much less probable a flight is, in words that need no logarithm."""
    power = nats / np.log(10.0)
    if power >= 4.0:
        return f"{power_of_ten(round(power))} times less probable"
    return f"{number(float(10.0**power), 2)} times less probable"


def _gain(summary: Mapping) -> Table:
    gain = summary["gain"]
    before, after = gain["holdout_error_before"], gain["holdout_error_after"]
    density = [gain[f"holdout_nlpd_{when}"] for when in ("before", "after")]
    sure = gain.get("holdout_error_gained_sd")
    gained = number(before - after) if sure is None else plus_minus(before - after, _SIGMAS * sure)
    return Table(
        ("held out", "before", "after", "gained"),
        (
            ("error, %", number(before), number(after), gained),
            ("nlpd, nat a measurement", *map(number, density), _nats(gain)),
        ),
    )


def _coefficients(summary: Mapping) -> Table:
    """Coefficient by coefficient; what took no part where that was judged by coefficient."""
    judged = summary["gain"].get("channels", {})
    rows = []
    for name, item in summary["discrepancy"].items():
        apart: tuple[str, ...] = ("–",) * len(_HELD_OUT) if judged else ()
        if (one := judged.get(name)) is not None:
            gained = plus_minus(one["gained"], _SIGMAS * one["gained_sd"])
            apart = (number(one["before"]), number(one["after"]), gained)
        rows.append((name, *apart, *(number(100.0 * item[key]) for key in ("before", "after"))))
    head = ("", *(_HELD_OUT if judged else ()), "all, before", "after")
    return Table(head, tuple(rows))


def _flown_words(summary: Mapping) -> str:
    free = summary["gain"].get("free_run")
    if not free or not free["channels"]:
        return ""
    lost = free["lost"]
    words = (
        f" Last, {free['windows']} windows of {free['length_s']:.0f} s of what took no part, flown "
        "freely by both, through the wind and the gusts that the filter found: rms of simulated "
        "less measured."
    )
    if any(lost.values()):
        words += f" Not flown to the end: {lost['before']} before, {lost['after']} after."
    return words


def _flown(summary: Mapping) -> tuple[Table, ...]:
    free = summary["gain"].get("free_run")
    if not free or not free["channels"]:
        return ()
    rows = []
    for name, item in free["channels"].items():
        both = [for_people(item[key], 0.0, item["unit"])[0] for key in ("before", "after")]
        half = _SIGMAS * item["gained_sd"]
        gained, half, unit = for_people(item["gained"], half, item["unit"])
        rows.append((f"{name}, {unit}", *map(number, both), plus_minus(gained, half)))
    return (Table(("flown freely", "before", "after", "gained"), tuple(rows)),)


def _detectable(summary: Mapping) -> Table:
    """From what size these flights show each cause: half of such flights at just that size."""
    return Table(
        ("cause", "parameter", "one sd", "matters from", "shown from", "seen", "like others up to"),
        tuple(
            (
                name,
                parameter,
                number(item["sd"], 2),
                number(item["matters"], 2),
                number(_shown_from(item), 2) if np.isfinite(_shown_from(item)) else "no size",
                "yes" if _shown_from(item) <= item["matters"] else "no",
                _like(item),
            )
            for name, entries in summary["detectable"].items()
            for parameter, item in entries.items()
        ),
    )


def _like(entry: Mapping) -> str:
    """Up to what size something else explains as much, and what."""
    if not entry.get("rival"):
        return ""
    alone = entry["alone_from"]
    return f"{'any size' if alone is None else number(alone, 2)} ({entry['rival']})"


def _spans(summary: Mapping, flight: int) -> tuple[Span, ...]:
    return tuple(
        Span(
            f"{'+'.join(item['controls'])} {item['kind']} {item['id']}".strip(),
            item["start_s"],
            item["start_s"] + item["duration_s"],
            "held_out" if item["held_out"] else "fitted",
        )
        for item in summary["maneuvers"]
        if item["flight"] == flight
    )
