"""Shows measured results: `python docs/results.py` renews measured.md and the README's block."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
PAGE = Path(__file__).with_name("measured.md")
KEPT = Path(__file__).with_name("results")
BEGIN = "<!-- results: written by `make results` -->"
END = "<!-- end of results -->"
LONGEST = 12
"""Rows that a table in the README may have; longer ones are in measured.md only."""

HEAD = """\
# Measured results

What the benchmarks found when they were last run with `make results`. Those of flights that are not
part of the repository are left out where these flights are absent.
"""


def block(folder: Path = KEPT) -> str:
    """The short headline tables as Markdown, in the order of their names."""
    shown = (
        _markdown(table)
        for table in _tables(folder)
        if len(table["rows"]) <= LONGEST and table.get("headline", True)
    )
    return "\n\n".join([BEGIN, *shown, END])


def page(folder: Path = KEPT) -> str:
    """All kept tables."""
    return "\n\n".join([HEAD.rstrip(), *map(_markdown, _tables(folder))]) + "\n"


def _tables(folder: Path) -> list[dict]:
    return [json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))]


def _markdown(table: dict) -> str:
    rule = _row("---" for _ in table["columns"])
    rows = map(_row, table["rows"])
    return "\n".join([f"**{table['title']}**", "", _row(table["columns"]), rule, *rows])


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
