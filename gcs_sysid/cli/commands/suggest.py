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
    help="Plan for this coefficient alone, or for one derivative (Cm.qhat), sure or not.",
)
@click.option(
    "--region",
    metavar="LIMITS",
    help="Plan for this part of the envelope: alpha=6:12,V=13:16 (deg, m/s).",
)
@click.option(
    "--separate",
    metavar="CAUSE,CAUSE",
    help="Plan to tell two causes of `diagnose` apart: mass,aero_derivative:CZ_alpha.",
)
@click.option(
    "--minutes",
    metavar="N",
    type=click.FloatRange(min=0.0, min_open=True),
    default=6.0,
    show_default=True,
    help="Flight time of the sortie, turns included.",
)
@click.option(
    "--gust",
    metavar="M_PER_S",
    type=click.FloatRange(min=0.0),
    help="Gusts to reckon with; those of the model's flight unless given.",
)
@click.option(
    "--home",
    metavar="LAT,LON,HEADING",
    help="Where the legs begin and point (deg): writes the sortie as missions.",
)
@click.option(
    "--fly",
    metavar="LINK",
    help="Fly the best maneuver on a simulated vehicle now: udpin:127.0.0.1:14550, mavsdk:….",
)
@click.option(
    "--fly-share",
    metavar="SHARE",
    type=click.FloatRange(min=0.0, max=1.0),
    default=0.25,
    show_default=True,
    help="Part of its amplitude that --fly flies.",
)
@click.option(
    "--fly-aircraft",
    is_flag=True,
    help="Let --fly use a link that leads beyond this machine; a pilot stands by.",
)
@click.option(
    "--flown",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Suggestion flown since; the model is from its flight too: promised against achieved.",
)
@options.out("suggest")
@click.option(
    "--seed",
    metavar="N",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Seed of the aircraft and gusts drawn to see how far a maneuver may go.",
)
@options.as_json
def command(
    model: Path,
    confidence: float,
    target: str | None,
    region: str | None,
    separate: str | None,
    minutes: float,
    gust: float | None,
    home: str | None,
    fly: str | None,
    fly_share: float,
    fly_aircraft: bool,
    flown: Path | None,
    out: Path | None,
    seed: int,
    as_json: bool,
) -> None:
    """Plan maneuvers for what a model is least sure of.

    Inputs of many kinds at three airspeeds, as large as the aircraft file's envelope allows with
    99 % probability, in the order of what they teach for their flight time; a sortie, test cards,
    and a CSV each, to be added to trim and to what the autopilot commands.
    """
    from gcs_sysid.offline import suggest
    from gcs_sysid.offline.suggestion_target import Question

    if separate is not None and (target is not None or region is not None):
        raise click.UsageError("--separate goes without --target and --region")
    numerics.enable()
    question = Question(
        confidence=confidence,
        target=target,
        region=region,
        separate=separate,
        minutes=minutes,
        gust=gust,
        home=home,
        fly=fly,
        fly_share=fly_share,
        fly_beyond=fly_aircraft,
        flown=flown,
        seed=seed,
    )
    with (
        output.folder(out, model, "suggest", WRITES) as destination,
        output.progress(f"suggest {model.name}") as progress,
    ):
        summary = suggest.run(model, question, out=destination, progress=progress)
        progress("report", 1.0)
        text = reports.sheet("suggest", summary, destination / "maneuvers.parquet")
    output.show(summary, text, as_json=as_json)
