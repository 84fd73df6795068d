"""What a diagnosis costs: a flight of four minutes in gusts against the whole catalogue.

Flights of `make blind`: one with something hidden, diagnosed once more with the compiled code that
it left; one with nothing; one whose hidden term no catalogue has; and one with two effects.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.cli import numerics  # noqa: E402 - found from ROOT
from tests.benchmarks import table  # noqa: E402
from tests.blind import fly  # noqa: E402
from tests.blind.campaign import DOZEN  # noqa: E402
from tests.blind.draw import draw  # noqa: E402

HIDDEN, NOTHING, UNLISTED, TWO = 3, 0, 10, 11
"""Draws of the dozen."""


def main() -> None:
    """Five diagnoses, one after the other."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        os.environ[numerics.CACHE] = f"{folder}/compiled"
        for words, number in (
            ("nothing compiled before", HIDDEN),
            ("compiled code kept", HIDDEN),
            ("compiled code kept", NOTHING),
            ("compiled code kept", UNLISTED),
            ("compiled code kept", TWO),
        ):
            place = Path(folder) / str(number)
            one = draw(number, fixed=DOZEN[number])
            found, seconds = fly.diagnose(fly.fly(one, place), place / "diagnosis")
            hidden = " + ".join(sorted(one.causes)) or "nothing"
            said = " + ".join(sorted(found["effects"])) or found["verdict"]
            rows.append((f"{hidden} hidden, {words}", said, "180 s", f"{seconds:.0f} s"))
    table.show(
        "diagnose_cost",
        f"Diagnosis of 4 minutes in gusts, {len(os.sched_getaffinity(0))} cores",
        ("flight", "said", "wanted", "took"),
        rows,
    )


if __name__ == "__main__":
    main()
