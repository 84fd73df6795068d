"""Every scenario of replay/, run as a user runs it: what is found of what was put in."""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.cli import entry  # noqa: E402 - needs the path above
from tests.benchmarks import table  # noqa: E402 - needs the path above


def main() -> None:
    chosen = [name for name in sys.argv[1:] if not name.startswith("-")]
    names = chosen or sorted(path.parent.name for path in ROOT.glob("replay/*/scenario.toml"))
    rows = []
    with tempfile.TemporaryDirectory(prefix="gcs-sysid-scenarios-") as folder:
        for name in names:
            begun, out = time.perf_counter(), Path(folder) / name
            with (
                contextlib.redirect_stdout(io.StringIO()),
                contextlib.redirect_stderr(io.StringIO()),
            ):
                entry.main(["scenario", str(ROOT / "replay" / name), "--out", str(out)])
            checks = json.loads((out / "scenario.json").read_text(encoding="utf-8"))["checks"]
            held = f"{sum(check['passed'] for check in checks)} of {len(checks)}"
            seconds = f"{time.perf_counter() - begun:.0f} s"
            rows.append((name, held, *_short(checks), seconds))
            print(*rows[-1], file=sys.stderr)
    columns = (
        *("scenario", "expectations that hold", "not as expected", "known not to"),
        "flown, run and compared in",
    )
    table.show("scenarios", "Scenarios against what they expect", columns, rows)


def _short(checks: Sequence[Mapping[str, Any]]) -> tuple[str, str]:
    """What is not as expected, and what is known not to hold."""
    odd = [check for check in checks if check["passed"] == bool(check["shortfall"])]
    known = [check for check in checks if check["shortfall"] and not check["passed"]]
    return "; ".join(map(_words, odd)), "; ".join(map(_words, known))


def _words(check: Mapping[str, Any]) -> str:
    return f"{check['run']} {check['place']} {check['found']}, expected {check['wanted']}"


if __name__ == "__main__":
    main()
