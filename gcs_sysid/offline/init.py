"""`init`: a first aircraft file from the parameters and messages in a log."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs_sysid.offline import documents
from gcs_sysid.offline.first_file import draft
from gcs_sysid.sources.registry import open_recording

Progress = Callable[[str, float], None]
FILE = "aircraft.toml"
_WIDTH = 96


def run(
    log: Path,
    *,
    vehicle: int | None = None,
    columns: Path | None = None,
    out: Path,
    progress: Progress = lambda _stage, _fraction: None,
) -> dict[str, Any]:
    """Writes a first aircraft file.

    Args:
        log: a flight, or a log on the ground, of the vehicle.
        vehicle: which vehicle of the log; needed when there are several.
        columns: what the columns are where the log is a table.
        out: folder for `aircraft.toml`.
        progress: told what is being done and which fraction is behind.

    Returns:
        What was found, what was assumed and what must be filled in.

    Raises:
        InputError: the log cannot be used.
    """
    recording = open_recording(
        log,
        vehicle=vehicle,
        columns=columns,
        progress=lambda fraction: progress("reading", 0.9 * fraction),
    )
    first = draft(recording)
    documents.write_text(out / FILE, first.text)
    progress("done", 1.0)
    return {
        "schema": 1,
        "program": f"gcs-sysid {version('gcs-sysid')}",
        "command": "init",
        "source": recording.source,
        "vehicle": recording.vehicle.system,
        "file": str(out / FILE),
        "parameters": len(recording.parameters),
        "surfaces": list(first.surfaces),
        "motors": list(first.motors),
        "missing": list(first.missing),
        "assumed": list(first.assumed),
        "notes": list(first.notes),
    }


def text(document: Mapping[str, Any]) -> str:
    """The document for a person."""
    motors = ", ".join(str(channel) for channel in document["motors"])
    lines = [
        f"{document['file']}: vehicle {document['vehicle']}, {document['parameters']} parameters",
        *_wrapped("Surfaces", ", ".join(document["surfaces"]) or "none: add [[servos]] by hand"),
        *_wrapped("Motors", f"output {motors}" if motors else "none"),
        *_wrapped("Fill in", ", ".join(document["missing"])),
        *_wrapped("Check", "; ".join(document["assumed"])),
    ]
    for note in document["notes"]:
        lines += _wrapped("Note", note)
    return "\n".join(lines)


def _wrapped(title: str, content: str) -> list[str]:
    lead = f"{title:<10} "
    return textwrap.wrap(
        content, _WIDTH, initial_indent=lead, subsequent_indent=" " * len(lead)
    ) or [lead]
