"""`suggest`: maneuvers for what a model is least sure of."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_sysid.cli import numerics, options, output, reports

WRITES = ("maneuvers.json", "suggest.json", "maneuvers.parquet", "report.html")


@click.command("suggest")
@options.model
@click.option(
    "--confidence",
    metavar="SHARE",
    type=click.FloatRange(min=0.0, min_open=True),
    default=0.1,
    show_default=True,
    help="A coefficient is unsure where its sd exceeds this part of its variation.",
)
@click.option(
    "--target",
    metavar="COEFFICIENT",
    type=click.Choice(["Cl", "Cm", "Cn"]),
    help="Plan for this coefficient alone, sure or not.",
)
@options.out("suggest")
@click.option(
    "--seed",
    metavar="N",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the aircraft drawn from the model to see how far a maneuver may go.",
)
@options.as_json
def command(
    model: Path,
    confidence: float,
    target: str | None,
    out: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Plan maneuvers for what a model is least sure of.

    Multisines, 3-2-1-1s and doublets as large as the aircraft file's envelope allows, with the
    deviation expected after flying each; a CSV each, to be added to trim and to what the autopilot
    commands.
    """
    from gcs_sysid.offline import suggest

    numerics.enable()
    with (
        output.folder(out, model, "suggest", WRITES) as destination,
        output.progress(f"suggest {model.name}") as progress,
    ):
        summary = suggest.run(
            model,
            confidence=confidence,
            target=target,
            seed=seed,
            out=destination,
            progress=progress,
        )
        progress("report", 1.0)
        text = reports.sheet("suggest", summary, destination / "maneuvers.parquet")
    output.show(summary, text, as_json=as_json)
