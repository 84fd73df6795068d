"""Every scenario of replay/, run as a user runs it: what is found of what was put in."""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
import time
from pathlib import Path

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
            failed = [f"{check['run']} {check['place']}" for check in checks if not check["passed"]]
            held = f"{len(checks) - len(failed)} of {len(checks)}"
            seconds = f"{time.perf_counter() - begun:.0f} s"
            rows.append((name, held, ", ".join(failed), seconds))
    columns = ("scenario", "expectations that hold", "which do not", "flown, run and compared in")
    table.show("scenarios", "Scenarios against what they expect", columns, rows)


if __name__ == "__main__":
    main()
