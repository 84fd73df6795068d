"""Tables of measured results: printed, and with `--save` kept for the README.

A benchmark `bench_NAME.py` measures, and ends with

    table.show("NAME", "What was measured", ("what", "wanted", "found"), rows)

`make bench` prints all tables; `make results` also keeps them in docs/results/ and renews
docs/measured.md, and what README.md shows of them (`docs/results.py`).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

KEPT = Path(__file__).resolve().parents[2] / "docs" / "results"


def kept() -> bool:
    """Whether results are kept, and not only printed."""
    return "--save" in sys.argv


def beside(
    name: str, rows: Sequence[Sequence[object]], order: Sequence[str]
) -> list[Sequence[object]]:
    """Rows, with those that a table kept before of what was not measured now.

    Args:
        name: of the table, see `show`.
        rows: measured now.
        order: in which rows are to be, by the first word of their first column.
    """
    path = KEPT / f"{name}.json"
    if not kept() or not path.exists():
        return list(rows)
    now = {row[0] for row in rows}
    before = json.loads(path.read_text(encoding="utf-8"))["rows"]
    every = [*rows, *(row for row in before if row[0] not in now)]
    return sorted(every, key=lambda row: list(order).index(str(row[0]).split()[0]))


def show(
    name: str,
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[object]],
) -> None:
    """Prints a table; with `--save` on the command line also keeps it as docs/results/NAME.json.

    Args:
        name: file name of the kept table, without its suffix; tables appear in its order.
        title: one sentence that says what was measured on what.
        columns: their headings.
        rows: one entry a column; numbers already rounded as they should be read.
    """
    cells = [[str(cell) for cell in row] for row in rows]
    assert all(len(row) == len(columns) for row in cells)
    widths = [max(map(len, column)) for column in zip(columns, *cells, strict=True)]
    print(f"\n{title}")
    for row in [list(columns), ["-" * width for width in widths], *cells]:
        print(
            "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        )
    if kept():
        document = {"title": title, "columns": list(columns), "rows": cells}
        KEPT.mkdir(exist_ok=True)
        text = json.dumps(document, indent=2, ensure_ascii=False)
        (KEPT / f"{name}.json").write_text(text + "\n", encoding="utf-8")
