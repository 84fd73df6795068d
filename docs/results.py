"""Renews the block of README.md that shows measured results: `python docs/results.py`."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
KEPT = Path(__file__).with_name("results")
BEGIN = "<!-- results: written by `make results` -->"
END = "<!-- end of results -->"


def block(folder: Path = KEPT) -> str:
    """All kept tables as Markdown, in the order of their names."""
    tables = (
        json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))
    )
    parts = [
        "\n".join(
            [
                f"**{table['title']}**",
                "",
                _row(table["columns"]),
                _row("---" for _ in table["columns"]),
                *(_row(row) for row in table["rows"]),
            ]
        )
        for table in tables
    ]
    return "\n\n".join([BEGIN, *parts, END])


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def renewed(readme: str, results: str) -> str:
    """The README with `results` in place of the block it has."""
    head, rest = readme.split(BEGIN)
    _, tail = rest.split(END)
    return head + results + tail


if __name__ == "__main__":
    README.write_text(renewed(README.read_text(encoding="utf-8"), block()), encoding="utf-8")
