"""Shows measured results: `python docs/results.py` renews measured.md and the README's block."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

README = Path(__file__).parents[1] / "README.md"
PAGE = Path(__file__).with_name("measured.md")
KEPT = Path(__file__).with_name("results")
BEGIN = "<!-- results: written by `make results` -->"
END = "<!-- end of results -->"

HEAD = """\
# Measured results

What the benchmarks found when they were last run with `make results`. Those of flights that are not
part of the repository are left out where these flights are absent.
"""


class Cell(NamedTuple):
    """A number that a benchmark kept: a table, and in it a row, by how it begins, and a column."""

    table: str
    row: str
    column: str


class Count(NamedTuple):
    """How many rows of a table begin so in a column, of how many.

    Attributes:
        table: kept by a benchmark.
        column: that is looked at.
        counted: beginnings of what is counted.
        among: beginnings of what it is counted among; all rows where there are none.
    """

    table: str
    column: str
    counted: tuple[str, ...]
    among: tuple[str, ...] = ("",)


class Line(NamedTuple):
    """A line of the README's table.

    Attributes:
        what: was measured.
        wanted: of it; what is compared with, where a limit is not.
        found: shown as they stand, between `apart`.
        unit: behind all of them.
        apart: what stands between them.
        over: table whose first row tells over how many flights, and how many got a number.
    """

    what: str
    wanted: str
    found: tuple[Cell | Count, ...]
    unit: str = ""
    apart: str = " / "
    over: str = ""


_OWN, _VANES = "filter_error_ignored", "filter_error_ignored_vanes"
_BOTH = ("forces", "moments")
_TOLD = ("agrees", "departs", "between")
"""What bench_thor.py says of a derivative that is told at all."""


def _errors(table: str, column: str = "error") -> tuple[Cell, ...]:
    return tuple(Cell(table, row, column) for row in _BOTH)


def _method(table: str, method: str) -> tuple[Cell, ...]:
    return tuple(Cell(table, method, column) for column in _BOTH)


LINES = (
    Line(
        "forces / moments on another flight, learnt from 4 min in gusts without vanes or any "
        "first values",
        "5 / 6 %",
        _errors(f"{_OWN}_models"),
        " %",
        over=f"{_OWN}_intervals",
    ),
    Line(
        "the same over the Cramér–Rao bound of that flight",
        "1.2",
        _errors(f"{_OWN}_models", "ratio"),
    ),
    Line(
        "angle of attack / sideslip there, rms",
        "0.3 / 0.5°",
        (Cell(f"{_OWN}_intervals", "", "alpha [°]"), Cell(f"{_OWN}_intervals", "", "beta [°]")),
        "°",
    ),
    Line(
        "95 % intervals of derivatives there that hold the truth",
        "93–97 %",
        (Cell(f"{_OWN}_intervals", "", "95 % intervals that hold"),),
    ),
    Line(
        "those of the derivative where fewest do",
        "88 %",
        (Cell(f"{_OWN}_intervals", "", "fewest"),),
    ),
    Line(
        "95 % intervals there that hold without the millisecond to which the moments' lag is "
        "believed / (found − true)/sd, rms / flights that tell it",
        "93–97 % / 1 / –",
        tuple(
            Cell(f"{_OWN}_intervals", "", column)
            for column in (
                "hold, without the lag's millisecond",
                "spread without it",
                "flights without it",
            )
        ),
    ),
    Line(
        "one stated deviation over the bound, the derivative where it is largest / without the "
        "millisecond to which the moments' lag is believed",
        "1.5",
        tuple(Cell(f"{_OWN}_derivatives", "largest", column) for column in ("sd", "without lag")),
    ),
    Line(
        "forces / moments, two such flights fitted at once",
        "–",
        _errors(f"{_OWN}_2_together_models"),
        " %",
        over=f"{_OWN}_2_together_intervals",
    ),
    Line(
        "forces / moments, first values 30 % wrong",
        "5 / 6 %",
        _errors("filter_error_wrong_models"),
        " %",
        over="filter_error_wrong_intervals",
    ),
    Line(
        "the same on a flight that another program simulated",
        "5 / 6 %",
        _errors("filter_error_clean_wrong_models"),
        " %",
    ),
    Line(
        "forces / moments, with vanes",
        "half of without",
        _errors(f"{_VANES}_models"),
        " %",
        over=f"{_VANES}_intervals",
    ),
    Line(
        "forces / moments, mass and inertia wrong by 8 and 20 %",
        "5 / 6 %",
        _errors("filter_error_coarse_models"),
        " %",
        over="filter_error_coarse_intervals",
    ),
    Line(
        "with a stall that the model does not have, 1.5 min: error of CZ on another flight with "
        "the usual terms / with those that the filter asks for",
        "–",
        (Cell("lacking", "usual terms", "CZ"), Cell("lacking", "with terms", "CZ")),
        " %",
    ),
    Line(
        "flights with nothing missing where the filter asks for a term",
        "none",
        (
            Cell(f"{_OWN}_lacking", "", "where a term was asked for"),
            Cell(f"{_OWN}_lacking", "", "flights"),
        ),
        apart=" of ",
    ),
    Line(
        "one such fit, 4 min at 50 Hz / what compiling adds",
        "60 / 20 s",
        (
            Cell("filter_error_cost", "the fit", "found"),
            Cell("filter_error_cost", "more of a first one, nothing", "found"),
        ),
    ),
    Line(
        "Brumby in gusts of 8 to 15 kt winds, against measured coefficients",
        "below 19.8 / 23.8 % (published, other flights)",
        _method("thesis_measured", "combined on the polynomial"),
        " %",
    ),
    Line(
        "the same against the truth",
        "5 / 6 %",
        _method("thesis_truth", "combined on the polynomial"),
        " %",
    ),
    Line(
        "learning a stall as it comes, NLPD of unseen samples: GPyTorch, ours",
        "below",
        tuple(Cell("gp_libraries", name, "NLPD") for name in ("GPyTorch", "gcs_sysid")),
    ),
    Line(
        "95 % intervals there that hold: GPyTorch, ours",
        "93–97 %",
        tuple(Cell("gp_libraries", name, "in 95 %") for name in ("GPyTorch", "gcs_sysid")),
    ),
    Line(
        "a Gaussian process learns one more sample of six coefficients, median / 99 of 100: at "
        "first, after a million; its map of 10 000 places",
        "5 ms of 99, 0.2 s",
        (
            Cell("gp_cost", "observe one sample, six outputs, p50 / p99", "found"),
            Cell("gp_cost", "the same after 1,000,000 samples", "found"),
            Cell("gp_cost", "mean and sd at 10 000 places", "found"),
        ),
        apart="; ",
    ),
    Line(
        "95 % intervals that hold in a gust that the model does not know: aeroid 0.5.0, ours",
        "95 %",
        (
            Cell("output_error_gust", "aeroid 0.5.0, its JAX gradient", "95 % intervals hold"),
            Cell("output_error_gust", "gcs-sysid", "95 % intervals hold"),
        ),
    ),
    Line(
        "CPU time of a further output-error fit: aeroid 0.5.0, ours",
        "a fifth",
        (
            Cell("output_error_clean", "aeroid 0.5.0, its JAX gradient", "CPU, each further"),
            Cell("output_error_clean", "gcs-sysid", "CPU, each further"),
        ),
    ),
    Line(
        "diagnosis of a dozen blind flights: hidden effects named alone / flights with nothing "
        "hidden where nobody is accused / sizes that 95 % intervals hold",
        "97 / 98 / 95 %",
        tuple(
            Cell("blind_right", row, "right") for row in ("something", "nothing hidden", "sizes")
        ),
    ),
    Line(
        "every cause of the catalogue once, full size, in gusts: named alone / sizes that 95 % "
        "intervals hold",
        "97 / 95 %",
        tuple(Cell("blind_right_every", row, "right") for row in ("something", "sizes")),
    ),
    Line(
        "effects drawn by lot, half to full size, one or two, listed or not, file exact or 5 % "
        "wrong: named alone / flights with nothing hidden where nobody is accused / sizes that "
        "95 % intervals hold",
        "80–97 / 98 / 95 %",
        tuple(
            Cell("blind_right_draws_650_to_665", row, "right")
            for row in ("something", "nothing hidden", "sizes")
        ),
    ),
    Line(
        "one such diagnosis, 4 min of flight, on 2 cores: something hidden / nothing / something "
        "that no catalogue has",
        "180 s",
        tuple(
            Cell("diagnose_cost", f"{what} hidden, compiled code kept", "took")
            for what in ("mass", "nothing", "unlisted")
        ),
    ),
    Line(
        "a minute of suggested maneuvers, deviation of the moments' derivatives over that after "
        "untuned 3-2-1-1 and doublets / well-timed ones / D-optimal multisines, in no more flight; "
        "weak first flights that it was flown after",
        "0.5 / 0.7 / 1 / 100",
        tuple(
            Cell("suggested_over", "all", column)
            for column in ("untuned", "well-timed", "d-optimal", "first flights")
        ),
    ),
    Line(
        "hard pairs of causes, one of them hidden, file 5 % wrong: named alone after a minute and "
        "a half of flight and, where that did not tell, what `suggest --separate` plans",
        "95 %",
        (Count("blind_pairs", "right and alone", ("yes",)),),
    ),
    Line(
        "an elevator input for the short period up to 2 Hz, information a second at the same "
        "largest angle of attack: aeroid's chirp, ours; CPU time of designing them",
        "more, a tenth",
        tuple(
            Cell("design", row, column)
            for column in ("by angle of attack", "CPU")
            for row in ("aeroid 0.5.0: chirp, up to 2 Hz", "ours: elevator multisine")
        ),
    ),
    Line(
        "UMN Thor, a real flight, nothing believed before: derivatives told / of these, agree with "
        "one of both published models at least",
        "–",
        (
            Count("thor_auto", "the flight", _TOLD),
            Count("thor_auto", "the flight", _TOLD[:1], _TOLD),
        ),
    ),
    Line(
        "`identify` on 10 minutes in calm air: time, memory; by least squares, and as it chooses "
        "there, inside the filter, since they would tell too little",
        "30 s, 1000 MB",
        tuple(
            Cell("identify_cost", f"{by}: {what}", "found")
            for by in ("least squares", "as it chooses")
            for what in ("wall time", "peak memory")
        ),
        apart=", ",
    ),
    Line(
        "live: packet to update, median / 99 of 100",
        "5 / 25 ms",
        (
            Cell("live", "packet to update, p50", "found"),
            Cell("live", "packet to update, p99", "found"),
        ),
    ),
    Line(
        "live, in gusts without vanes, told a file 30 % wrong: forces / moments on another flight "
        "with the aerodynamics inside the filter; by kinematics alone",
        "–",
        (
            Cell("live_inside", "at the end", "forces"),
            Cell("live_inside", "at the end", "moments"),
            Cell("live_inside", "first model", "forces"),
            Cell("live_inside", "first model", "moments"),
        ),
    ),
    Line(
        "live: share of one core, memory",
        "40 %, 600 MB",
        (Cell("live", "of one core", "found"), Cell("live", "resident memory, largest", "found")),
        apart=", ",
    ),
    Line(
        "live: the same of the filter with the aerodynamics inside, a process of its own; memory "
        "at most, at the end",
        "–",
        (
            Cell("live", "their process, of one core after that", "found"),
            Cell("live", "its resident memory: largest, at the end", "found"),
        ),
        apart="; ",
    ),
    Line(
        "live: memory after hours of flight (`make soak`), growth",
        "600 MB, none",
        (
            Cell("live-soak", "resident memory", "at the end"),
            Cell("live-soak", "resident memory", "slope, 95 %"),
        ),
        apart=", ",
    ),
    Line(
        "live: a recorded flight replayed to the link at its own timing, the derivative farthest "
        "from that of `identify` on the file, in its deviations",
        "0.5",
        (Cell("live-same-model", "", "apart, in sd of the file (wanted: 0.5)"),),
    ),
    Line(
        "live: frames that the recording misses at 10 times the rate",
        "0",
        (Cell("live", "frames missing", "found"),),
    ),
    Line(
        "reading a .tlog, times as fast as pymavlink",
        "10",
        (Cell("tlog", "clean/flight.tlog", "times"),),
    ),
    Line(
        "simulated flight, times real time",
        "20",
        (Cell("sitl", "demo", "times real time (wanted: 20)"),),
    ),
)
"""What the README shows, in this order."""


def block(folder: Path = KEPT, lines: Iterable[Line] = LINES) -> str:
    """The README's table. Lines of benchmarks that were not run are left out."""
    tables = {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in _paths(folder)}
    rows = [
        [
            line.what,
            line.wanted,
            line.apart.join(_found(tables, one) for one in line.found)
            + line.unit
            + _flights(tables, line.over),
        ]
        for line in lines
        if all(cell.table in tables for cell in line.found)
    ]
    return "\n".join([BEGIN, "", *_rows(("what", "wanted", "found"), rows), "", END])


def _flights(tables: dict[str, dict], over: str) -> str:
    """Of how many flights a line tells; nothing where it does not say."""
    if not over:
        return ""
    flown, told = (_cell(tables, Cell(over, "", name)) for name in ("flights", "with a number"))
    return f" ({flown} flights, {told} with a number)"


def _found(tables: dict[str, dict], one: Cell | Count) -> str:
    return _cell(tables, one) if isinstance(one, Cell) else _count(tables, one)


def _count(tables: dict[str, dict], one: Count) -> str:
    table = tables[one.table]
    place = table["columns"].index(one.column)
    among = [row[place] for row in table["rows"] if row[place].startswith(one.among)]
    return f"{sum(cell.startswith(one.counted) for cell in among)} of {len(among)}"


def _cell(tables: dict[str, dict], cell: Cell) -> str:
    """What a kept table has there, in the first such row.

    Raises:
        KeyError: the table has no such row or column.
    """
    table = tables[cell.table]
    rows = [row for row in table["rows"] if row[0].startswith(cell.row)]
    if not rows or cell.column not in table["columns"]:
        raise KeyError(f"{cell.table}: no {cell.row} or no {cell.column}")
    return rows[0][table["columns"].index(cell.column)]


def page(folder: Path = KEPT) -> str:
    """All kept tables."""
    tables = (json.loads(path.read_text(encoding="utf-8")) for path in _paths(folder))
    return "\n\n".join([HEAD.rstrip(), *map(_markdown, tables)]) + "\n"


def _paths(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.json"))


def _markdown(table: dict) -> str:
    return "\n".join([f"**{table['title']}**", "", *_rows(table["columns"], table["rows"])])


def _rows(columns: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    headings = list(columns)
    return [_row(headings), _row("---" for _ in headings), *map(_row, rows)]


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def renewed(readme: str, results: str) -> str:
    """The README with `results` in place of the block it has."""
    head, rest = readme.split(BEGIN)
    _, tail = rest.split(END)
    return head + results + tail


if __name__ == "__main__":
    README.write_text(renewed(README.read_text(encoding="utf-8"), block()), encoding="utf-8")
    PAGE.write_text(page(), encoding="utf-8")
