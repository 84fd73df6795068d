"""Tables of scores: what is found of what, how often, and whether stated numbers hold.

References:
    Clopper and Pearson, Biometrika 26 (1934) 404: exact intervals of a share.
    Naeini, Cooper and Hauskrecht, AAAI (2015) 2901: expected calibration error.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.stats import beta

from tests.benchmarks import table
from tests.blind.draw import FILES, SIZES, Draw
from tests.blind.score import Score

NEAR = 1.1
"""Error over that of the file that knows everything, up to which an extension is as good."""

EDGES = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0)
"""Bins of stated probabilities: finer where decisions are taken."""


SHOWN = (0.0, 0.7, 1.0, 1.4, 2.0, np.inf)
"""Bins of a hidden size over the one that a flight would show half of the time."""

SURE = 0.95
"""How many intervals are wanted to hold what they are about."""


class Flights(NamedTuple):
    """Which flights tables are about, so that none takes the place of another's.

    Attributes:
        suffix: of the tables' names.
        words: behind their titles.
    """

    suffix: str
    words: str


DOZEN = Flights("", "")
"""Those of `make blind`, which the README shows."""


@dataclass(frozen=True)
class Result:
    """One draw, flown and diagnosed.

    Attributes:
        draw: what was hidden.
        score: what the diagnosis is worth.
        seconds: that it took.
        cores: on how many.
        departed: whether the aircraft was lost control of.
        error: on what took no part, of the extended file.
        least_error: the same of a file that knows everything.
    """

    draw: Draw
    score: Score
    seconds: float
    cores: int
    departed: bool
    error: float | None = None
    least_error: float | None = None


def clopper_pearson(hits: int, count: int, *, level: float = 0.95) -> tuple[float, float]:
    """Exact interval of a share of which `hits` of `count` were seen."""
    outside = 0.5 * (1.0 - level)
    low = 0.0 if hits == 0 else float(beta.ppf(outside, hits, count - hits + 1))
    high = 1.0 if hits == count else float(beta.ppf(1.0 - outside, hits + 1, count - hits))
    return low, high


def calibration_error(stated: Sequence[float], true: Sequence[bool]) -> float:
    """Expected calibration error: stated probability less share that was true, over all bins."""
    rows = reliability(stated, true)
    return sum(count * abs(mean - share) for count, mean, share in rows) / max(len(stated), 1)


def reliability(
    stated: Sequence[float], true: Sequence[bool]
) -> tuple[tuple[int, float, float], ...]:
    """For each bin of `EDGES` with anything in it: count, mean stated probability, share true."""
    probability, came = np.asarray(stated, dtype=float), np.asarray(true, dtype=float)
    bins = np.clip(np.searchsorted(EDGES, probability, side="right") - 1, 0, len(EDGES) - 2)
    return tuple(
        (int(inside.sum()), float(probability[inside].mean()), float(came[inside].mean()))
        for inside in (bins == i for i in range(len(EDGES) - 1))
        if inside.any()
    )


def one_by_one(results: Sequence[Result], flights: Flights = DOZEN) -> None:
    """Print a line for each flight."""
    rows = [
        (
            result.draw.index,
            " + ".join(sorted(result.draw.causes)) or "none",
            result.draw.size if result.draw.effects else "",
            result.draw.aircraft,
            result.draw.file,
            result.score.said,
            _verdict(result),
            "" if result.score.probability is None else f"{result.score.probability:.2f}",
            ", ".join(f"{one.deviations:+.1f}" for one in result.score.sizes),
            f"{result.seconds:.0f}",
        )
        for result in results
    ]
    columns = ("draw", "hidden", "size", "aircraft", "file", "said", "verdict", "stated")
    _show(
        flights,
        "blind",
        "Blind flights: what was hidden and what was said",
        (*columns, "size off [sd]", "s"),
        rows,
    )


def right(results: Sequence[Result], flights: Flights = DOZEN) -> None:
    """Print how many were answered right."""
    flown = [result for result in results if not result.departed]
    hidden = [result.score for result in flown if result.draw.cause != "none"]
    clean = [result.score for result in flown if result.draw.cause == "none"]
    sizes = [one for score in hidden for one in score.sizes]
    rows = {
        "something hidden, named alone": [score.alone for score in hidden],
        "so, or in a group of three at most": [score.grouped for score in hidden],
        "nothing hidden, nobody accused": [not score.false_alarm for score in clean],
        "sizes that their 95 % intervals hold": [one.inside for one in sizes],
    }
    cores = ", ".join(sorted({str(one.cores) for one in flown}))
    seconds = f"{np.median([result.seconds for result in flown]):.0f}" if flown else ""
    _show(
        flights,
        "blind_right",
        "Blind flights: how many of them were answered right",
        ("flights", "right"),
        [
            *((words, f"{sum(each)} of {len(each)}") for words, each in rows.items() if each),
            (f"seconds, median, cores: {cores}", seconds),
        ],
    )


def missed(results: Sequence[Result]) -> tuple[str, ...]:
    """What these flights miss of what is wanted of a dozen; nothing where all is well.

    Of so few every one must be answered right: one wrong is less than 97 and 98 %. Of the sizes so
    many must be inside their 95 % intervals that chance may have left the others out.
    """
    wrong = [result for result in results if result.departed or not result.score.alone]
    sizes = [one for result in results if not result.departed for one in result.score.sizes]
    inside = sum(one.inside for one in sizes)
    said = [f"draw {result.draw.index}: {_verdict(result)}" for result in wrong]
    if sizes and clopper_pearson(inside, len(sizes))[1] < SURE:
        said.append(f"{inside} of {len(sizes)} sizes are inside their 95 % intervals")
    return tuple(said)


def summary(results: Sequence[Result], flights: Flights = DOZEN) -> None:
    """Print everything that a campaign tells."""
    flown = [result for result in results if not result.departed]
    _confusion(flights, flown, departed=len(results) - len(flown))
    _power(flights, flown)
    _shown(flights, flown)
    _false_alarms(flights, flown)
    _calibration(flights, flown)
    _coverage(flights, flown)
    _extension(flights, flown)


def _verdict(result: Result) -> str:
    if result.departed:
        return "lost control, not counted"
    if result.score.alone:
        return "right"
    if result.score.grouped:
        return "in a group"
    return "FALSE ALARM" if result.score.false_alarm else "wrong"


def _confusion(flights: Flights, results: Sequence[Result], *, departed: int) -> None:
    rows = []
    for cause in sorted({result.draw.cause for result in results}):
        of_it = [result for result in results if result.draw.cause == cause]
        instead = Counter(result.score.said for result in of_it if not result.score.alone)
        rows.append(
            (
                cause,
                len(of_it),
                _share(of_it, lambda score: score.alone),
                _share(of_it, lambda score: score.grouped),
                ", ".join(f"{said} {count}" for said, count in instead.most_common(4)),
            )
        )
    _show(
        flights,
        "blind_confusion",
        f"What was hidden and what was said ({departed} flights lost control and are not counted)",
        ("hidden", "flights", "right and alone", "or in a group", "said instead"),
        rows,
    )


def _power(flights: Flights, results: Sequence[Result]) -> None:
    hidden = [result for result in results if result.draw.cause not in ("none",)]
    kinds: tuple[tuple[str, Callable[[Draw], bool]], ...] = (
        ("one cause", lambda draw: draw.cause not in ("unlisted", "two")),
        ("unlisted", lambda draw: draw.cause == "unlisted"),
        ("two", lambda draw: draw.cause == "two"),
    )
    rows = []
    for words, belongs in kinds:
        for size in SIZES:
            for file in FILES:
                of_it = [
                    result
                    for result in hidden
                    if belongs(result.draw) and (result.draw.size, result.draw.file) == (size, file)
                ]
                if of_it:
                    alone = _share(of_it, lambda score: score.alone)
                    grouped = _share(of_it, lambda score: score.grouped)
                    rows.append((words, size, file, len(of_it), alone, grouped))
    columns = ("hidden", "size", "file", "flights", "right and alone", "or in a group")
    _show(flights, "blind_power", "Power against size", columns, rows)


def _shown(flights: Flights, results: Sequence[Result]) -> None:
    """Whether a flight shows what `diagnose` says that it would."""
    told = [(result, result.score.shown) for result in results if result.score.shown is not None]
    rows = []
    for low, high in itertools.pairwise(SHOWN):
        of_it = [result for result, shown in told if low <= shown < high]
        if of_it:
            alone = _share(of_it, lambda score: score.alone)
            grouped = _share(of_it, lambda score: score.grouped)
            rows.append((f"{low:g} to {high:g}", len(of_it), alone, grouped))
    columns = ("hidden / shown half of the time", "flights", "right and alone", "or in a group")
    _show(flights, "blind_shown", "Power against what diagnose says of it", columns, rows)


def _false_alarms(flights: Flights, results: Sequence[Result]) -> None:
    rows = []
    for file in FILES:
        clean = [
            result for result in results if result.draw.cause == "none" and result.draw.file == file
        ]
        if clean:
            false = _share(clean, lambda score: score.false_alarm)
            quiet = _share(clean, lambda score: score.alone)
            rows.append((file, len(clean), false, quiet))
    columns = ("file", "flights", "false alarms", "said that nothing is wrong")
    _show(flights, "blind_false_alarms", "Flights with nothing hidden", columns, rows)


def _calibration(flights: Flights, results: Sequence[Result]) -> None:
    stated = [
        (result.score.probability, result.score.first)
        for result in results
        if result.score.probability is not None
    ]
    if not stated:
        return
    probability, came = zip(*stated, strict=True)
    rows = [
        (f"{mean:.3f}", count, f"{share:.3f}")
        for count, mean, share in reliability(probability, came)
    ]
    error = calibration_error(probability, came)
    _show(
        flights,
        "blind_calibration",
        f"Stated probability of the first in the ranking: expected calibration error {error:.3f}",
        ("stated, mean of the bin", "flights", "true"),
        rows,
    )


def _coverage(flights: Flights, results: Sequence[Result]) -> None:
    rows = []
    for cause in sorted({result.draw.cause for result in results}):
        sizes = [
            one for result in results if result.draw.cause == cause for one in result.score.sizes
        ]
        if sizes:
            inside = _interval(sum(one.inside for one in sizes), len(sizes))
            error = float(np.median([abs(one.relative) for one in sizes]))
            rows.append((cause, len(sizes), inside, f"{100.0 * error:.1f} %"))
    columns = ("hidden", "sizes", "in the 95 % interval", "median error over size")
    _show(flights, "blind_coverage", "Sizes where the cause was found", columns, rows)


def _extension(flights: Flights, results: Sequence[Result]) -> None:
    """Only where the cause was found: another file says nothing of how well it is extended."""
    rows = []
    for cause in sorted({result.draw.cause for result in results}):
        ratios = [
            result.error / result.least_error
            for result in results
            if result.draw.cause == cause
            and result.score.alone
            and result.error is not None
            and result.least_error
        ]
        if ratios:
            near = _interval(sum(ratio <= NEAR for ratio in ratios), len(ratios))
            rows.append((cause, len(ratios), f"{float(np.median(ratios)):.2f}", near))
    _show(
        flights,
        "blind_extension",
        "Error of the extended file on what took no part, over that of the file that knows all",
        ("hidden", "flights", "median", f"at most {NEAR:g}"),
        rows,
    )


def _show(
    flights: Flights,
    name: str,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[object]],
) -> None:
    """A table, unless there is nothing in it."""
    if rows:
        of_them = f" ({flights.words})" if flights.words else ""
        table.show(f"{name}{flights.suffix}", f"{title}{of_them}", columns, rows)


def _share(results: Iterable[Result], of: Callable[[Score], bool]) -> str:
    found = [of(result.score) for result in results]
    return _interval(sum(found), len(found))


def _interval(hits: int, count: int) -> str:
    """A share with its 95 % interval, in percent."""
    low, high = clopper_pearson(hits, count)
    return f"{100.0 * hits / count:.0f} % ({100.0 * low:.0f}-{100.0 * high:.0f})"
