"""Aircraft files that are made by a script."""

from __future__ import annotations

from pathlib import Path

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft


def rounded(value: float) -> float:
    """Four digits: what differs in the last bits between machines is the same in the file."""
    return float(f"{value:.4g}")


def text(aircraft: Aircraft, *, made_by: str) -> str:
    """The file's text; its first line tells how to make it again."""
    return (
        f"# Written by `python -m {made_by}`; where each number comes from: data/MANIFEST.md.\n"
        + aircraft_file.dumps(aircraft)
    )


def write(aircraft: Aircraft, path: Path, *, made_by: str) -> None:
    """Write the file."""
    path.write_text(text(aircraft, made_by=made_by), encoding="utf-8")
