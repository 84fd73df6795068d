"""What listening shows: a table that renews itself on a terminal, else one line a second."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from typing import Any

import click

Document = Mapping[str, Any]

ANGLES = ("alpha", "beta", "roll", "pitch", "yaw")
LABELS = {
    "V": "airspeed",
    "wind_north": "wind north",
    "wind_east": "wind east",
    "wind_down": "wind down",
}
STALE_S = 3.0
"""Values older than this are called old, as on the page."""
BAND = 1.96
"""Standard deviations of the interval shown: 95 %."""


@contextmanager
def opened(*, to_stderr: bool) -> Generator[Callable[[Document], None], None, None]:
    """A place to show live documents; yields what shows one."""
    stream = sys.stderr if to_stderr else sys.stdout
    if not stream.isatty():
        yield lambda document: click.echo(line(document), file=stream)
        return
    from rich.console import Console
    from rich.live import Live

    console = Console(file=stream)
    with Live(console=console, auto_refresh=False, transient=False) as live:
        yield lambda document: live.update(table(document), refresh=True)


def say(text: str, *, to_stderr: bool) -> None:
    """One line beside the live documents."""
    click.echo(text, err=to_stderr)


def line(document: Document) -> str:
    """The newest state, coefficients and counts in one line, intervals of 95 %."""
    parts = [document["phase"], *_old(document)]
    state = document["state"]
    if state:
        parts += [_state(name, state[name]) for name in ("V", "alpha", "beta")]
        parts.append(f"wind {_wind(state)}")
        parts += [
            f"{name} {_number(item['value'], BAND * item['sd'])}{_aged(item)}"
            for name, item in document["coefficients"].items()
        ]
    if document["departures"]:
        parts.append(_departures(document))
    parts += [one["words"] for one in document.get("alarms", ())]
    parts += [f"likely: {_cause(one)}" for one in document.get("causes", ())[:1]]
    if document.get("maneuver"):
        parts.append(_maneuver(document["maneuver"]))
    if document["other_vehicles"]:
        parts.append(_vehicles(document))
    parts.append(_counts(document))
    return " | ".join(parts)


def _old(document: Document) -> list[str]:
    """That the values shown are old, if they are."""
    age = document.get("state_age_s")
    return [f"VALUES ARE {age:.0f} s OLD"] if age is not None and age > STALE_S else []


def _stale(item: Mapping[str, Any]) -> bool:
    return (item.get("age_s") or 0.0) > STALE_S


def _aged(item: Mapping[str, Any]) -> str:
    """How old a coefficient is, if it is old."""
    return f" ({item['age_s']:.0f} s OLD)" if _stale(item) else ""


def _state(name: str, item: Mapping[str, float]) -> str:
    label = LABELS.get(name, name)
    if name in ANGLES:
        value, band = math.degrees(item["value"]), math.degrees(BAND * item["sd"])
        return f"{label} {value:.1f} ± {band:.1f}°"
    return f"{label} {item['value']:.1f} ± {BAND * item['sd']:.1f} m/s"


def _wind(state: Mapping[str, Mapping[str, float]]) -> str:
    """Horizontal wind as a pilot says it: where it comes from, and how fast."""
    north, east = state["wind_north"]["value"], state["wind_east"]["value"]
    speed = math.hypot(north, east)
    along = math.hypot(north * state["wind_north"]["sd"], east * state["wind_east"]["sd"])
    band = BAND * along / max(speed, 1e-6)
    origin = math.degrees(math.atan2(-east, -north)) % 360.0
    return f"{speed:.1f} ± {band:.1f} m/s from {origin:03.0f}°"


def _number(value: float, band: float) -> str:
    """A value with as many digits as its interval leaves."""
    if not (math.isfinite(value) and math.isfinite(band)) or band <= 0.0:
        return f"{value:.4g}"
    digits = min(max(1 - math.floor(math.log10(band)), 0), 6)
    return f"{value:.{digits}f} ± {band:.{digits}f}"


def _vehicles(document: Document) -> str:
    """Which vehicle is followed where several are heard."""
    heard = ", ".join(map(str, document["other_vehicles"]))
    return f"vehicle {document['vehicle']} is followed; {heard} heard too (--vehicle N chooses)"


def _departures(document: Document) -> str:
    """In which coefficients the aircraft file is wrong now, and since when."""
    now = document["time_us"]
    return "the simulation departs: " + ", ".join(
        f"{name}{_by(item)} since {1e-6 * (now - item['since_us']):.0f} s "
        f"({item['deviations']:+.1f} sd)"
        for name, item in document["departures"].items()
    )


def _by(departure: Mapping[str, Any]) -> str:
    """The derivative that is farthest off, where one is named."""
    return f" by {departure['derivative']}" if departure.get("derivative") else ""


def _cause(one: Mapping[str, Any]) -> str:
    """A likely cause with its size, its interval and its probability."""
    from gcs_sysid.report.numbers import probability

    size, band, unit = one["size"], BAND * one["sd"], one["unit"]
    if unit == "rad":
        size, band, unit = math.degrees(size), math.degrees(band), "deg"
    words = f"{one['cause']} {one['about']}".strip()
    told = _number(size, band) + (f" {unit}" if unit != "1" else "")
    return f"{words} {told} ({probability(one['probability'])})"


def _maneuver(one: Mapping[str, Any]) -> str:
    """The maneuver in progress, what it has taught, and whether it may end."""
    words = f"maneuver {one['number']} on {', '.join(one['controls'])}, {one['seconds']:.0f} s, "
    words += f"{100.0 * one['learned']:.0f} % learned"
    return f"{words}, STOP: {one['stop']}" if one["stop"] else words


def _gauge(one: Mapping[str, Any]) -> Any:
    from rich.text import Text

    filled = round(20 * one["learned"])
    bar = f"[{'#' * filled}{'.' * (20 - filled)}] "
    return Text(bar + _maneuver(one), style="bold red" if one["stop"] else "bold green")


def _counts(document: Document) -> str:
    counts, latency = document["counts"], document["latency"]["packet_to_update"]
    lost = sum(counts["lost"].values())
    text = f"{counts['recorded']} frames, {counts['updates']} updates"
    text += f", {counts['decimated']} decimated, {counts['late']} late, {lost} lost"
    # Files of an earlier version do not have all of them.
    for name in ("frozen", "reboots", "restarts", "failures"):
        if counts.get(name):
            text += f", {counts[name]} {name}"
    if latency["p50_ms"] is not None:
        text += f", latency {latency['p50_ms']:.0f}/{latency['p99_ms']:.0f} ms"
    return text


def _measured(item: Mapping[str, Any]) -> Any:
    from rich.text import Text

    number = _number(item["value"], BAND * item["sd"])
    return Text.assemble((number, "strike" if _stale(item) else ""), (_aged(item), "bold red"))


def table(document: Document) -> Any:
    """The whole document as a rich table."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    head = Text(f"{document['aircraft']}  {document['link']}  {document['phase']}", style="bold")
    pieces: list[Any] = [head, *(Text(words, style="bold red") for words in _old(document))]
    if document["state"]:
        pieces.append(
            Text(
                "  ".join(
                    _state(name, document["state"][name])
                    for name in ("V", "alpha", "beta", "roll", "pitch", "yaw")
                )
            )
        )
        down = document["state"]["wind_down"]
        pieces.append(
            Text(
                f"wind {_wind(document['state'])}, up "
                f"{-down['value']:.1f} ± {BAND * down['sd']:.1f} m/s"
            )
        )
    if document["coefficients"]:
        grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
        grid.add_column("")
        grid.add_column("measured ± 95 %")
        grid.add_column("processes ± 95 %")
        # Files of an earlier version only know the first model.
        by = document.get("derivatives_by", "first model")
        grid.add_column(f"derivatives, {by} ± 95 %")
        for name, item in document["coefficients"].items():
            terms = document["derivatives"].get(name, {})
            words = "   ".join(
                f"{'const' if key == '1' else key} {_number(term['value'], BAND * term['sd'])}"
                for key, term in terms.items()
            )
            measured = _measured(item)
            believed = document["processes"]["coefficients"].get(name)
            learned = (
                document["processes"]["phase"]
                if believed is None
                else _number(believed["value"], BAND * believed["sd"])
            )
            style = "strike" if _stale(item) else ""
            grid.add_row(name, measured, Text(learned, style=style), words or "collecting")
        pieces.append(grid)
    if document.get("maneuver"):
        pieces.append(_gauge(document["maneuver"]))
    if document["departures"]:
        pieces.append(Text(_departures(document), style="bold yellow"))
    for one in document.get("causes", ()):
        pieces.append(Text(f"  likely: {_cause(one)}", style="yellow"))
    for one in document.get("alarms", ()):
        pieces.append(Text(one["words"], style="bold red"))
    for one in document.get("suggestions", ()):
        pieces.append(Text(f"fly next: {one['fly']} (for {', '.join(one['for'])})"))
    if document["other_vehicles"]:
        pieces.append(Text(_vehicles(document), style="yellow"))
    pieces.append(Text(_counts(document), style="dim"))
    return Group(*pieces)
