"""`simulate`: the simulation flown on a flight's own controls."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_sysid.cli import numerics, options, output, reports

WRITES = ("simulate.json", "simulated.parquet", "report.html")


@click.command("simulate")
@options.log
@options.aircraft(required=False)
@options.model_instead
@options.segments
@click.option(
    "--tolerances", metavar="FILE", type=options.Existing("file"),
    help="How far each channel may be off (TOML), instead of flight simulators' tolerances.",
)  # fmt: skip
@options.vehicle
@options.columns
@options.can
@options.out("simulate")
@options.seed
@options.as_json
def command(
    log: Path,
    aircraft: Path | None,
    model: Path | None,
    segments: Path | None,
    tolerances: Path | None,
    vehicle: int | None,
    columns: Path | None,
    can: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Fly the simulation on a LOG's own controls.

    Short windows, each from the measured state, show in which channels and where in the flight the
    simulation departs from what was flown.
    """
    from gcs_sysid.offline import simulate

    numerics.enable()
    with (
        output.folder(out, log, "simulate", WRITES) as destination,
        output.progress(f"simulate {log.name}") as progress,
    ):
        summary = simulate.run(
            log,
            aircraft=aircraft,
            model=model,
            vehicle=vehicle,
            segments=segments,
            tolerances=tolerances,
            columns=columns,
            can=can,
            out=destination,
            progress=progress,
        )
        progress("report", 1.0)
        text = reports.sheet("simulate", summary, destination / "simulated.parquet")
    output.show(summary, text, as_json=as_json)
