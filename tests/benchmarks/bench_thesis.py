"""`make bench-thesis`: the published comparison on flights whose truth is known.

One flight to learn from, three to foretell (scenario `brumby`: gusts in winds of 8 to 15 kt, no
flow vanes, mass and inertia only coarsely known), and the AD-1 at four sweep angles. With `--out
DIR` the runs stay in DIR, and those that are there are not repeated.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import jax  # noqa: E402 - needs the path above

from tests.benchmarks import thesis_brumby, thesis_oblique  # noqa: E402

jax.config.update("jax_enable_x64", True)


PARTS = ("brumby", "states", "ad1")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gcs-sysid-thesis-") as folder:
        out = given.out or Path(folder)
        wanted = PARTS if given.only is None else (given.only,)
        if "brumby" in wanted:
            thesis_brumby.brumby(out / "brumby")
        if "states" in wanted:
            thesis_brumby.causes(out / "brumby")
        if "ad1" in wanted:
            thesis_oblique.oblique_wing(out / "ad1")


if __name__ == "__main__":
    main()
