"""`init`: a first aircraft file from a log."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_sysid.cli import options, output


@click.command("init")
@options.log
@options.vehicle
@options.columns
@options.out("init")
@options.seed
@options.as_json
def command(
    log: Path, vehicle: int | None, columns: Path | None, out: Path | None, as_json: bool
) -> None:
    """Write a first aircraft file from the parameters in a LOG.

    Outputs, trims, limits and sensor places come from the autopilot's parameters; what no log can
    know is marked, and must be filled in.
    """
    from gcs_sysid.offline import init

    with (
        output.folder(out, log, "init", [init.FILE]) as destination,
        output.progress(f"init {log.name}") as progress,
    ):
        document = init.run(
            log, vehicle=vehicle, columns=columns, out=destination, progress=progress
        )
    output.show(document, init.text(document), as_json=as_json)
