"""`diagnose`: what a simulation gets wrong, and why."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from gcs_sysid.cli import numerics, options, output, reports

WRITES = (
    *("diagnosis.json", "aircraft-extended.toml", "aircraft-extended.patch"),
    *("residuals.parquet", "report.html"),
)


@click.command("diagnose")
@options.logs
@options.aircraft(required=False)
@options.model_instead
@click.option(
    "--holdout",
    metavar="LOG",
    type=options.Existing("log"),
    help="Flight to measure the gain on; without one, maneuvers of LOGS that took no part.",
)
@click.option(
    "--method",
    type=click.Choice(["filter", "coefficients"]),
    default="filter",
    show_default=True,
    help="Weigh all causes inside a filter that knows the gusts (minutes), or four of them by what "
    "coefficients tell in calm air (seconds).",
)
@options.segments
@options.vehicle
@options.columns
@options.can
@options.out("diagnose")
@options.seed
@options.as_json
def command(
    logs: tuple[Path, ...],
    aircraft: Path | None,
    model: Path | None,
    holdout: Path | None,
    method: Literal["filter", "coefficients"],
    segments: Path | None,
    vehicle: int | None,
    columns: Path | None,
    can: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Name the cause of what a simulation gets wrong in LOGS.

    Weighs 28 causes in aircraft, servos, sensors and propulsion, alone and together, against
    nothing being wrong; writes the aircraft file with the cause put right and the gain on
    maneuvers that took no part.
    """
    from gcs_sysid.offline import diagnose

    numerics.enable()
    numerics.keep_freed_memory()
    with (
        output.folder(out, logs[0], "diagnose", WRITES) as destination,
        output.progress(f"diagnose {logs[0].name}") as progress,
    ):
        summary = diagnose.run(
            logs,
            aircraft=aircraft,
            model=model,
            holdout=holdout,
            method=method,
            vehicle=vehicle,
            segments=segments,
            columns=columns,
            can=can,
            out=destination,
            progress=progress,
        )
        progress("report", 1.0)
        text = reports.sheet("diagnose", summary, destination / "residuals.parquet")
    output.show(summary, text, as_json=as_json)
