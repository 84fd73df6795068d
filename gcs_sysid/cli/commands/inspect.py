"""`inspect`: what is in a log, and what it can and cannot identify."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_sysid.cli import numerics, options, output


@click.command("inspect")
@options.log
@options.aircraft(required=False)
@options.segments
@options.vehicle
@options.columns
@options.can
@options.out("inspect")
@options.seed
@options.as_json
def command(
    log: Path,
    aircraft: Path | None,
    segments: Path | None,
    vehicle: int | None,
    columns: Path | None,
    can: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Say what is in a LOG and what it can identify.

    Streams, rates, gaps, clocks, maneuvers found, and how well each coefficient can be told.
    """
    from gcs_sysid.offline import inspect

    numerics.enable()
    with (
        output.folder(out, log, "inspect", ["inspect.json"]) as destination,
        output.progress(f"inspect {log.name}") as progress,
    ):
        document = inspect.run(
            log,
            aircraft=aircraft,
            vehicle=vehicle,
            segments=segments,
            columns=columns,
            can=can,
            out=destination,
            progress=progress,
        )
    written = f"{destination / 'inspect.json'}"
    output.show(document, f"{inspect.text(document)}\n{written}", as_json=as_json)
