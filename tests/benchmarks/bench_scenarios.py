"""Every scenario of replay/, run as a user runs it: what is found of what was put in.

With `--out DIR` the runs stay in DIR, and those that are there already are not repeated.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.cli import entry  # noqa: E402 - needs the path above
from tests.benchmarks import table  # noqa: E402 - needs the path above

COLUMNS = ("scenario", "expectations that hold", "not as expected", "known not to hold")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="scenarios; all of them unless given")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    given = parser.parse_args()
    names = given.names or sorted(path.parent.name for path in ROOT.glob("replay/*/scenario.toml"))
    with tempfile.TemporaryDirectory(prefix="gcs-sysid-scenarios-") as folder:
        kept = given.out or Path(folder)
        rows = []
        for name in names:
            rows.append(_row(name, _document(name, kept / name)))
            print(*rows[-1], file=sys.stderr)
    table.show("scenarios", "Scenarios against what they expect", COLUMNS, rows)


def _document(name: str, out: Path) -> Mapping[str, Any]:
    document = out / "scenario.json"
    if not document.exists():
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            entry.main(["scenario", str(ROOT / "replay" / name), "--out", str(out)])
    return json.loads(document.read_text(encoding="utf-8"))


def _row(name: str, document: Mapping[str, Any]) -> tuple[str, str, str, str]:
    checks: Sequence[Mapping[str, Any]] = document["checks"]
    held = sum(check["passed"] for check in checks)
    odd = [check for check in checks if check["passed"] == bool(check["shortfall"])]
    known = [check for check in checks if check["shortfall"] and not check["passed"]]
    return (
        name,
        f"{held} of {len(checks)}",
        "; ".join(map(_words, odd)),
        "; ".join(f"{_words(check)}: {check['shortfall']}" for check in known),
    )


def _words(check: Mapping[str, Any]) -> str:
    return f"{check['run']} {check['place']} {check['found']}, expected {check['wanted']}"


if __name__ == "__main__":
    main()
