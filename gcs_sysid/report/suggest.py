"""The page that `suggest` leaves: what to fly next, what it teaches, how far it goes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_sysid.figures.data import Figure
from gcs_sysid.figures.maneuver import THROTTLE, confidence, maneuver
from gcs_sysid.report import labels, page
from gcs_sysid.report.findings import Finding
from gcs_sysid.report.numbers import number
from gcs_sysid.report.sheet import Table

FINDINGS = 4
"""Maneuvers among the findings at most; the table has them all."""


@dataclass(frozen=True)
class Pair:
    """A line of a card."""

    name: str
    value: str


@dataclass(frozen=True)
class Card:
    """One maneuver for the cockpit or the ground station: a page when printed."""

    name: str
    title: str
    how: str
    entry: tuple[Pair, ...]
    expected: tuple[Pair, ...]
    stop: tuple[Pair, ...]
    recovery: str
    figure: Figure


@dataclass(frozen=True)
class Page:
    """Everything that the template places."""

    findings: tuple[Finding, ...]
    flown: Table | None
    maps: tuple[Figure, ...]
    derivatives: tuple[Table, ...]
    maneuvers: Table
    sortie_lead: str
    sortie: Table
    cards: tuple[Card, ...]
    refused: Table


def render(summary: Mapping, table: Mapping[str, np.ndarray]) -> str:
    """The report of a suggestion as one self-contained HTML file.

    Args:
        summary: the document of `suggest`.
        table: `maneuvers.parquet`, one array a column.
    """
    made = Page(
        findings=findings(summary),
        flown=_flown(summary["flown"]),
        maps=tuple(
            confidence(name, item, summary["confidence"])
            for name, item in summary["confidence_map"].items()
        ),
        derivatives=tuple(
            _derivatives(name, terms)
            for name, terms in summary["sortie"]["derivatives"].items()
            if name in summary["sortie"]["asked"]
        ),
        maneuvers=_maneuvers(summary),
        sortie_lead=_sortie_lead(summary),
        sortie=_sortie(summary["sortie"]["steps"]),
        cards=tuple(
            _card(item, maneuver(table, place, item), summary)
            for place, item in enumerate(summary["maneuvers"])
        ),
        refused=Table(
            ("maneuver", "why"),
            tuple((_words(item["name"]), item["reason"]) for item in summary["refused"]),
        ),
    )
    figures = [*made.maps, *(card.figure for card in made.cards)]
    return page.render("suggest.html.j2", figures, {"page": made, "summary": summary})


def findings(summary: Mapping) -> tuple[Finding, ...]:
    """The headline findings, most important first."""
    listed = summary["maneuvers"]
    flown = summary["flown"]
    found = []
    if flown is not None:
        found.append(
            Finding(
                "Flown",
                f"deviations came out {number(flown['achieved_over_predicted'], 2)} times those "
                "foretold (median).",
            )
        )
    if summary["fly"] is not None:
        done = summary["fly"]
        found.append(
            Finding(
                "On the vehicle",
                f"{_words(done['maneuver'])} at {100.0 * done['share']:.0f} %: {done['outcome']} "
                f"({done['flown_s']:.1f} s).",
            )
        )
    if not listed:
        text = (
            f"every coefficient asked about is known to {100.0 * summary['confidence']:.0f} % of "
            "its variation in the maneuver that varies it most, and wherever the aircraft may go, "
            "there without what no flight changes (mass, inertia, thrust); ask for more with a "
            "smaller --confidence."
        )
        return (*found, Finding("Nothing to fly", text))
    found.append(Finding("Least sure", f"{_unsure(summary)}."))
    if summary.get("separate"):
        told = summary["separate"]
        unit = "" if told["unit"] == "1" else f" {told['unit']}"
        before, after = (f"{number(told[f'sd_{when}'], 2)}{unit}" for when in ("before", "after"))
        found.append(
            Finding(
                "Separates",
                f"{told['causes']}: the size of the first, were the second at work as well, is "
                f"known to {before} now and to {after} after the sortie (sd by noise and by "
                "what the file may have wrong within its sigmas).",
            )
        )
    if stays := _stays(summary["sortie"]):
        text = (
            f"{stays}, whatever is flown: mass, inertia, thrust and the moments' lag are known no "
            "better, and scale all derivatives. Weigh the aircraft and swing it; what runs tell "
            "is listed beside that."
        )
        found.append(Finding("Stays", text))
    taken = [item for item in listed if item["times_in_sortie"]] or listed
    for item in taken[:FINDINGS]:
        found.append(Finding("Fly", f"{_described(item)}: {_teaches(item, summary)}."))
    found.append(Finding("Sortie", _sortie_lead(summary)))
    risk = max(item["envelope"]["violation_probability"] for item in listed)
    found.append(
        Finding(
            "Safe",
            f"each leaves the envelope with probability {number(risk, 2)} at most, in gusts of "
            f"{number(summary['gust']['value'], 2)} m/s ({summary['gust']['source']}); "
            f"{_held(summary['hold'])}.",
        )
    )
    return tuple(found)


def _held(hold: Mapping) -> str:
    """How the autopilot is taken to hold the aircraft."""
    flown = [
        f"{name} ({100.0 * one['explained']:.0f} % of what it did)"
        for name, one in hold.items()
        if one["source"] == "flown"
    ]
    assumed = [name for name, one in hold.items() if one["source"] != "flown"]
    parts = []
    if flown:
        parts.append(f"{_listing(flown)} held as the autopilot did in the flights")
    if assumed:
        parts.append(f"{_listing(assumed)} held as fast as servos allow (assumed)")
    return ", ".join(parts)


def _listing(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _unsure(summary: Mapping) -> str:
    """Coefficients and how well each is known."""
    words = []
    for name, item in summary["unsure"].items():
        share = 100.0 * item["sd"] / item["spread"] if item["spread"] else math.inf
        words.append(f"{name} to {number(share, 2)} % of its variation")
        if item["sd_reachable"] > summary["confidence"] * item["spread"] >= item["sd"]:
            farthest = 100.0 * item["sd_reachable"] / item["spread"]
            words[-1] += f", to {number(farthest, 2)} % at the edge of what it may fly"
    return "; ".join(words)


def _described(item: Mapping) -> str:
    return (
        f"{item['kind']} of {item['duration_s']:.1f} s on {_amplitudes(item)} at "
        f"{item['entry']['airspeed']:.0f} m/s"
    )


def _amplitudes(item: Mapping) -> str:
    return ", ".join(_amplitude(name, value) for name, value in item["amplitude"].items())


def _amplitude(name: str, value: float) -> str:
    if name == THROTTLE:
        return f"{name} ±{100.0 * value:.0f} %"
    return f"{name} ±{math.degrees(value):.1f}°"


def _teaches(item: Mapping, summary: Mapping) -> str:
    """The derivatives that one run tells most of, one for each coefficient that it is for.

    Not the coefficients, and beside what mass and inertia leave unknown: no run takes that away.
    """
    values = summary["sortie"]["derivatives"]
    parts = []
    for name in item["target"]["coefficients"]:
        terms = item["expected"].get(name, {"derivatives": {}})["derivatives"]
        # What is asked about beside the model's own terms is 0 as far as anybody knows.
        told = {
            key: tuple(
                _beside(one[when], values[name][key]["sd_stays"])
                for when in ("sd_before", "sd_after")
            )
            for key, one in terms.items()
            if key != "1" and values[name][key]["value"] != 0.0
        }
        told = {key: pair for key, pair in told.items() if pair[0] > 0.0}
        if not told:
            continue
        key, pair = min(told.items(), key=lambda item: item[1][1] / item[1][0])
        size = abs(values[name][key]["value"]) / 100.0
        before, after = (number(one / size, 2) for one in pair)
        parts.append(f"{labels.derivative(name, key)} from {before} to {after} %")
    return ", ".join(parts) + " (sd)"


def _beside(whole: float, stays: float) -> float:
    """What flying can change of a deviation."""
    return math.sqrt(max(whole**2 - stays**2, 0.0))


def _stays(sortie: Mapping) -> str:
    """Coefficients of whose deviation most is left by what no flight tells; often none."""
    parts = []
    for name in sortie["asked"]:
        terms = [
            one
            for key, one in sortie["derivatives"][name].items()
            if key != "1" and one["value"] != 0.0
        ]
        most = [one for one in terms if one["sd_stays"] ** 2 > 0.5 * one["sd_before"] ** 2]
        if 2 * len(most) > len(terms):
            share = np.median([one["sd_stays"] / abs(one["value"]) for one in most])
            parts.append(f"{number(100.0 * share, 2)} % of {name}")
    return ", ".join(parts)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _maneuvers(summary: Mapping) -> Table:
    return Table(
        (
            "maneuver",
            "amplitude",
            "length, s",
            "worth a minute",
            "beyond the envelope",
            "in sortie",
        ),
        tuple(
            (
                _words(item["name"]),
                _amplitudes(item),
                f"{item['duration_s']:.1f}",
                number(60.0 * item["worth"], 2),
                f"{number(item['envelope']['violation_probability'], 2)} "
                f"({item['envelope']['left']} of {item['envelope']['flights']})",
                f"{item['times_in_sortie']} ×" if item["times_in_sortie"] else "–",
            )
            for item in summary["maneuvers"]
        ),
    )


def _derivatives(name: str, terms: Mapping[str, Mapping[str, float]]) -> Table:
    return Table(
        (f"{name}", "value", "sd now", "sd after the sortie", "sd that stays beside"),
        tuple(
            (
                labels.derivative(name, key),
                number(one["value"], 3),
                number(_beside(one["sd_before"], one["sd_stays"]), 2),
                number(_beside(one["sd_after"], one["sd_stays"]), 2),
                number(one["sd_stays"], 2),
            )
            for key, one in terms.items()
        ),
    )


def _sortie_lead(summary: Mapping) -> str:
    plan = summary["sortie"]
    if not plan["steps"]:
        return (
            "no sortie: with what stays, no maneuver would make a deviation noticeably smaller; "
            "listed are those that come nearest."
        )
    careful = " Small amplitudes first, since the model is poor." if summary["poor_model"] else ""
    legs = plan["steps"][-1]["leg"]
    return (
        f"{len(plan['steps'])} runs on {legs} legs in {plan['minutes']:.1f} minutes, legs in turn "
        f"out and back so that wind does not look like the aircraft.{careful}"
    )


def _sortie(steps: Sequence[Mapping]) -> Table:
    return Table(
        ("run", "amplitude", "leg", "begins", "airspeed, m/s", "height, m", "length, s"),
        tuple(
            (
                f"{place}. {_words(step['maneuver'])}",
                f"{100.0 * step['share']:.0f} %",
                f"{step['leg']} {step['direction']}",
                f"{int(step['begins_s'] // 60)}:{int(step['begins_s'] % 60):02d}",
                f"{step['airspeed']:.0f}",
                f"{step['height']:.0f}",
                f"{step['duration_s']:.0f}",
            )
            for place, step in enumerate(steps, 1)
        ),
    )


def _card(item: Mapping, figure: Figure, summary: Mapping) -> Card:
    entry = item["entry"]
    return Card(
        name=item["name"],
        title=f"{_words(item['name']).rpartition(' ')[0].capitalize()} at "
        f"{entry['airspeed']:.1f} m/s",
        how=f"{item['how'].capitalize()}. Amplitude {_amplitudes(item)}.",
        entry=(
            Pair("airspeed", f"{entry['airspeed']:.1f} m/s"),
            Pair("height", f"{entry['height']:.0f} m above ground or more"),
            Pair("attitude", "wings level, trimmed for 5 s, into the wind first, then with it"),
            Pair("autopilot", f"holds {entry['holds']}"),
            Pair("gusts", f"no more than {number(summary['gust']['value'], 2)} m/s"),
            Pair("length", f"{item['duration_s']:.1f} s, and 3 s hands off"),
        ),
        expected=tuple(
            Pair(
                labels.derivative(name, key),
                _before_after(one, summary["sortie"]["derivatives"][name][key]["sd_stays"]),
            )
            for name in item["target"]["coefficients"]
            for key, one in item["expected"].get(name, {"derivatives": {}})["derivatives"].items()
        ),
        stop=_stop(item["abort"]),
        recovery=f"Recovery: {item['recovery']}.",
        figure=figure,
    )


def _before_after(one: Mapping[str, float], stays: float) -> str:
    before, after = (number(_beside(one[f"sd_{when}"], stays), 2) for when in ("before", "after"))
    return f"{before} → {after}"


def _stop(abort: Mapping[str, Sequence[float]]) -> tuple[Pair, ...]:
    degrees = math.degrees(1.0)
    units = {
        "airspeed": ("airspeed", "m/s", 1.0),
        "alpha": ("angle of attack", "°", degrees),
        "beta": ("sideslip", "°", degrees),
        "load_factor": ("load factor", "g", 1.0),
        "bank": ("bank", "°", degrees),
    }
    found = [
        Pair(label, f"outside {number(scale * low, 3)} to {number(scale * high, 3)}\u00a0{unit}")
        for name, (label, unit, scale) in units.items()
        for low, high in [abort[name]]
    ]
    return (*found, Pair("height", f"below {abort['height_min'][0]:.0f} m"), Pair("link", "lost"))


def _flown(flown: Mapping | None) -> Table | None:
    if flown is None:
        return None
    return Table(
        ("derivative", "sd before", "foretold", "achieved", "achieved / foretold", "moved, sd"),
        tuple(
            (
                labels.derivative(row["coefficient"], row["regressor"]),
                number(row["sd_before"], 2),
                number(row["sd_predicted"], 2),
                number(row["sd_achieved"], 2),
                number(row["achieved_over_predicted"], 2),
                number(row["moved_by_sd"], 2),
            )
            for row in flown["derivatives"]
        ),
    )
