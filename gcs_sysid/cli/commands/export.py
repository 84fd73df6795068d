"""`export`: the identified model for other tools."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

import click

from gcs_sysid.cli import numerics, options, output
from gcs_sysid.errors import InputError

Format = Literal["control", "matlab", "jsbsim"]
SUFFIX: Mapping[Format, str] = {"control": ".json", "matlab": ".mat", "jsbsim": ".xml"}


@click.command("export")
@options.aircraft(required=False)
@options.model_instead
@click.option(
    "--to",
    "to",
    type=click.Choice(list(get_args(Format))),
    required=True,
    help="control: JSON for python-control; matlab: .mat; jsbsim: the whole model as XML.",
)
@click.option(
    "--airspeed",
    "airspeeds",
    metavar="V",
    type=click.FloatRange(min=0.0, min_open=True),
    multiple=True,
    help="True airspeed of steady flight, m/s; may be given several times. "
    "By default one from the envelope.",
)
@click.option(
    "--height",
    metavar="H",
    type=click.FloatRange(-500.0, 20000.0),
    default=100.0,
    show_default=True,
    help="Height above sea level, m.",
)
@click.option(
    "--bank",
    metavar="DEG",
    type=click.FloatRange(-80.0, 80.0),
    default=0.0,
    show_default=True,
    help="Bank of a coordinated turn, right wing down, degrees; 0 flies straight.",
)
@click.option(
    "--climb",
    metavar="DEG",
    type=click.FloatRange(-60.0, 60.0),
    default=0.0,
    show_default=True,
    help="Angle of the flight path above level, degrees; a glide's is negative.",
)
@click.option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write; ./AIRCRAFT-export with the format's suffix unless given.",
)
@options.seed
@options.as_json
def command(
    aircraft: Path | None,
    model: Path | None,
    to: Format,
    airspeeds: Sequence[float],
    height: float,
    bank: float,
    climb: float,
    out: Path | None,
    as_json: bool,
) -> None:
    """Write a model for other tools.

    To python-control and MATLAB go linear models of steady flight at each airspeed, level or
    climbing, straight or turning, with one standard deviation of every entry, and modes. To JSBSim
    goes the aircraft with its aerodynamics.
    """
    numerics.enable()
    source = (model or aircraft or Path("model")).resolve()
    stem = source.parent.name if source.name == "model" else source.stem
    destination = out if out is not None else Path(f"{stem}-export{SUFFIX[to]}")
    _may_write(destination, source)
    if to == "jsbsim":
        document = _jsbsim(aircraft, model, destination)
        text = "\n".join([*document["warnings"], str(destination)])
        output.show(document, text, as_json=as_json)
        return
    from gcs_sysid.offline import export

    document = export.linear(
        *(aircraft, model, to),
        airspeeds=airspeeds,
        height=height,
        bank=math.radians(bank),
        climb=math.radians(climb),
        out=destination,
    )
    output.show(document, f"{_text(document)}\n{destination}", as_json=as_json)


def _may_write(destination: Path, source: Path) -> None:
    if destination.resolve() == source:
        raise InputError(
            str(destination), "is both read and written", fix="name another file with --out"
        )


def _jsbsim(aircraft: Path | None, model: Path | None, out: Path) -> dict[str, Any]:
    from gcs_sysid.offline import documents, tested
    from gcs_sysid.sitl import jsbsim_xml

    source = tested.load(aircraft, model)
    documents.write_text(out, jsbsim_xml.model_xml(source.aircraft))
    return {
        "command": "export",
        "aircraft": source.aircraft.name,
        "source": source.source,
        "file": str(out),
        "warnings": source.left_out(out.name),
    }


def _text(document: Mapping[str, Any]) -> str:
    """Every mode of every condition in a line."""
    lines = []
    for one in document["models"]:
        turn = f", bank {math.degrees(one['bank']):.0f}°" if one["bank"] else ""
        climb = f", climb {math.degrees(one['climb']):.1f}°" if one["climb"] else ""
        at = f"{one['airspeed']:.1f} m/s, {one['height']:.0f} m{turn}{climb}"
        lines.append(f"{document['aircraft']} at {at}:")
        lines += [f"  {_mode(mode)}" for mode in one["modes"]]
    return "\n".join(lines)


def _mode(mode: Mapping[str, Any]) -> str:
    parts = []
    if mode["frequency"] is not None:
        parts.append(f"{_pair(mode['frequency'])} rad/s, damping {_pair(mode['damping'])}")
    if mode["frequency"] is None or mode["roots"][0]["imag"] == 0.0:
        parts += [f"time constant {_pair(item)} s" for item in mode["time_constants"]]
    grows = "" if mode["stable"] else " (diverges)"
    return f"{mode['name']}: {', '.join(parts)}{grows}"


def _pair(item: Mapping[str, Any]) -> str:
    if item["value"] is None:
        return "infinite"
    return f"{item['value']:.3g} ± {item['sd']:.2g}"
