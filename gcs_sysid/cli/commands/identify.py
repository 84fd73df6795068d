"""`identify`: from recorded flights to coefficients, a model and a report."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from gcs_sysid.cli import numerics, options, output, reports

WRITES = ("model", "summary.json", "samples.parquet", "report.html")


@click.command("identify")
@options.logs
@options.aircraft()
@click.option(
    "--prior",
    type=click.Choice(["file", "none"]),
    default="file",
    show_default=True,
    help="Start from the aircraft file's aerodynamics, or ignore them.",
)
@click.option(
    "--method",
    type=click.Choice(["auto", "filter-error", "equation-error"]),
    default="auto",
    show_default=True,
    help="Filter error: inside a filter that knows the aerodynamics and so tells gusts from "
    "motion, some minutes. Equation error: least squares on coefficients measured with "
    "kinematic states, seconds, for calm air. By itself it goes by the gusts.",
)
@click.option(
    "--mass-properties",
    type=click.Choice(["file", "flight"]),
    default="file",
    show_default=True,
    help="Mass, inertia and thrust as the aircraft file has them or, with filter error, found with "
    "the aerodynamics, starting from the file's values and how sure it is of them.",
)
@click.option(
    "--stepwise", is_flag=True, help="Choose the model's terms from the data, step by step."
)
@options.segments
@options.vehicle
@options.columns
@options.can
@options.out("identify")
@options.seed
@options.as_json
def command(
    logs: tuple[Path, ...],
    aircraft: Path,
    prior: Literal["file", "none"],
    method: Literal["auto", "filter-error", "equation-error"],
    mass_properties: Literal["file", "flight"],
    stepwise: bool,
    segments: Path | None,
    vehicle: int | None,
    columns: Path | None,
    can: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Compute an aerodynamic model from LOGS.

    Reconstructs the flight, computes the coefficients at every sample, and fits a model to all
    maneuvers but those held out to score it.
    """
    from gcs_sysid.offline import identify

    numerics.enable()
    numerics.keep_freed_memory()
    with (
        output.folder(out, logs[0], "identify", WRITES) as destination,
        output.progress(f"identify {logs[0].name}") as progress,
    ):
        summary = identify.run(
            logs,
            aircraft,
            prior=prior,
            method=method,
            body=mass_properties,
            segments=segments,
            vehicle=vehicle,
            columns=columns,
            can=can,
            stepwise=stepwise,
            out=destination,
            progress=progress,
        )
        progress("report", 1.0)
        text = reports.write("identify", summary, destination / "samples.parquet")
    output.show(summary, text, as_json=as_json)
