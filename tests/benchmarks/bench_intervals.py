"""How often intervals of 95 % hold the truth, with residuals as coloured as those of a flight."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.benchmarks import table  # noqa: E402 - needs the path above
from tests.estimate import made_problems, made_structures  # noqa: E402 - needs the path above

FLIGHTS = range(300)


def main() -> None:
    """Coverage over seeded repetitions, and false terms let in by the stepwise choice."""
    rows = []
    for memory, seconds in ((0.0, "none"), (0.9, "0.2 s"), (0.95, "0.4 s"), (0.98, "1 s")):
        held, white = made_problems.coverage(memory, seeds=FLIGHTS)
        rows.append(
            (
                seconds,
                f"{100 * held[1:].mean():.0f} %",
                f"{100 * white[1:].mean():.0f} %",
                f"{100 * held[0]:.0f} %",
                f"{100 * white[0]:.0f} %",
            )
        )
    table.show(
        "intervals",
        f"Intervals of 95 % that hold the truth, {len(FLIGHTS)} simulated flights of a minute",
        ("residuals remember", "slopes", "slopes, textbook", "constant", "constant, textbook"),
        rows,
    )
    terms = {"1": -0.1, "alpha": -4.6, "elevator": -0.9, "alpha^2": 8.0}
    entries, offered = made_structures.false_entries(
        terms, seeds=range(40), noise=0.02, memory=0.95
    )
    table.show(
        "stepwise",
        "False terms that the stepwise choice lets in, residuals that remember 0.4 s",
        ("flights", "false terms offered", "let in"),
        [(40, offered, entries)],
    )


if __name__ == "__main__":
    main()
