"""`predict`: coefficients of a flight that a model has not seen."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from gcs_sysid.cli import numerics, options, output, reports

WRITES = ("predictions.parquet", "summary.json", "report.html")


@click.command("predict")
@options.log
@options.model
@click.option(
    "--method",
    type=click.Choice(["auto", "filter-error", "kinematic"]),
    default="auto",
    show_default=True,
    help="States of the flight: by a filter that holds the model and so tells gusts from motion, "
    "or by kinematics alone. By itself the filter's in gusts, if the model was made inside it.",
)
@options.segments
@options.vehicle
@options.columns
@options.can
@options.out("predict")
@options.seed
@options.as_json
def command(
    log: Path,
    model: Path,
    method: Literal["auto", "filter-error", "kinematic"],
    segments: Path | None,
    vehicle: int | None,
    columns: Path | None,
    can: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Predict the coefficients of an unseen LOG.

    The prediction is compared with what the flight measured.
    """
    from gcs_sysid.offline import predict

    numerics.enable()
    with (
        output.folder(out, log, "predict", WRITES) as destination,
        output.progress(f"predict {log.name}") as progress,
    ):
        summary = predict.run(
            log,
            model,
            method=method,
            vehicle=vehicle,
            columns=columns,
            can=can,
            segments=segments,
            out=destination,
            progress=progress,
        )
        progress("report", 1.0)
        text = reports.write("predict", summary, destination / "predictions.parquet")
    output.show(summary, text, as_json=as_json)
