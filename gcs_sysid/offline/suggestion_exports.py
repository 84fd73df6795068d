"""A suggestion for the aircraft: scripts, parameters and missions beside its CSV files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import UsageError
from gcs_sysid.maneuvers import axes
from gcs_sysid.maneuvers.axes import Axes
from gcs_sysid.maneuvers.design import Maneuver
from gcs_sysid.maneuvers.export import lua, mission, pulses, system_id
from gcs_sysid.maneuvers.export.mission import Home
from gcs_sysid.offline import documents


def home(text: str) -> Home:
    """Latitude, longitude and heading [deg] as the command line has them.

    Raises:
        UsageError: it is not three numbers.
    """
    try:
        latitude, longitude, heading = (float(part) for part in text.split(","))
    except ValueError as error:
        raise UsageError(
            f"--home {text}: write latitude, longitude and heading of the legs in degrees, as in "
            "47.3,8.5,270"
        ) from error
    if abs(latitude) > 90.0 or abs(longitude) > 180.0:
        raise UsageError(f"--home {text}: no place on Earth; latitude comes first")
    return Home(latitude, longitude, heading)


def write(
    out: Path,
    kept: Sequence[Maneuver],
    listed: Sequence[Mapping[str, Any]],
    aircraft: Aircraft,
    moved_by: Axes,
    names: tuple[str, ...],
) -> None:
    """A Lua script for every maneuver, and parameters for sweeps.

    Args:
        out: folder.
        kept: maneuvers.
        listed: their documents.
        aircraft: with its outputs.
        moved_by: which control moves which axis.
        names: columns of the maneuvers' inputs.
    """
    for item, entry in zip(kept, listed, strict=True):
        columns = {name: item.added[:, names.index(name)] for name in entry["controls"]}
        added = pulses.added(aircraft, columns)
        if added:
            text = lua.script(entry, aircraft.name, added)
            documents.write_text(out / f"{item.name}.lua", text)
        if item.recipe.kind == "sweep":
            documents.write_text(
                out / f"{item.name}.param", _sweep(item, entry, aircraft, moved_by)
            )


def _sweep(item: Maneuver, entry: Mapping[str, Any], aircraft: Aircraft, moved_by: Axes) -> str:
    [name] = item.recipe.moved
    places = {moved_by.pitch: "pitch", moved_by.yaw: "yaw", moved_by.roll: "roll"}
    return system_id.file(
        system_id.parameters(
            places[name],
            amplitude=entry["amplitude"][name],
            travel=axes.travel(aircraft, name),
            last=item.recipe.fastest,
        )
    )


def missions(out: Path, steps: Sequence[Mapping[str, Any]], at: Home) -> None:
    """The sortie's legs for ArduPilot and PX4, as plans and as a waypoint file."""
    if not steps:
        return
    found = mission.items(steps, at)
    cruise = float(steps[0]["airspeed"])
    documents.write_text(out / "sortie.waypoints", mission.waypoints(found))
    for name, firmware in (("ardupilot", mission.ARDUPILOT), ("px4", mission.PX4)):
        text = mission.plan(found, firmware=firmware, cruise=cruise)
        documents.write_text(out / f"sortie_{name}.plan", text)
