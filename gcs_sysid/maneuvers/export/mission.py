"""The legs of a sortie as a mission: a QGroundControl plan and a waypoint file.

References:
    QGroundControl developer guide, "Plan File Format"; MAVLink, "Mission Plain-Text File Format"
    and the numbers of MAV_CMD and MAV_FRAME.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from gcs_sysid.maneuvers.design import SETTLE

WAYPOINT, RETURN, CHANGE_SPEED = 16, 20, 178
GLOBAL, MISSION_FRAME, RELATIVE = 0, 2, 3
NOTHING = (0.0, 0.0, 0.0, 0.0)
ARDUPILOT, PX4 = 3, 12
"""Firmware types of a plan."""
FIXED_WING = 1
EARTH = 6371000.0
OFFSET = 120.0
"""Between the leg out and the leg back [m]."""
ROOM = 10.0
"""Flown straight before the first maneuver of a leg and after its last [s]."""


@dataclass(frozen=True)
class Home:
    """Where the legs begin, and their heading: degrees, as people give them."""

    latitude_deg: float
    longitude_deg: float
    heading_deg: float


@dataclass(frozen=True)
class Item:
    """One item of a mission; a `z` is a height above home [m]."""

    command: int
    frame: int
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    latitude_deg: float = 0.0
    longitude_deg: float = 0.0
    z: float = 0.0


def items(steps: Sequence[Mapping], home: Home) -> tuple[Item, ...]:
    """Home, then a pair of waypoints for each leg with its airspeed, then the return.

    Args:
        steps: of the sortie's document.
        home: of the legs.
    """
    found = [Item(WAYPOINT, GLOBAL, NOTHING, home.latitude_deg, home.longitude_deg, 0.0)]
    for number in dict.fromkeys(step["leg"] for step in steps):
        runs = [step for step in steps if step["leg"] == number]
        airspeed, height = runs[0]["airspeed"], max(run["height"] for run in runs)
        seconds = 2.0 * ROOM + sum(SETTLE + run["duration_s"] for run in runs)
        length = airspeed * seconds
        out = runs[0]["direction"] == "out"
        ends = [(0.0, 0.0), (length, 0.0)] if out else [(length, OFFSET), (0.0, OFFSET)]
        first, last = (_place(home, *end) for end in ends)
        found.append(Item(WAYPOINT, RELATIVE, NOTHING, *first, height))
        found.append(Item(CHANGE_SPEED, MISSION_FRAME, (0.0, airspeed, -1.0, 0.0)))
        found.append(Item(WAYPOINT, RELATIVE, NOTHING, *last, height))
    return (*found, Item(RETURN, MISSION_FRAME))


def waypoints(mission: Sequence[Item]) -> str:
    """A waypoint file (QGC WPL 110)."""
    rows = ["QGC WPL 110"]
    for number, item in enumerate(mission):
        cells = [
            str(number),
            "1" if number == 0 else "0",
            str(item.frame),
            str(item.command),
            *(f"{value:.8f}" for value in item.parameters),
            *(f"{value:.8f}" for value in (item.latitude_deg, item.longitude_deg)),
            f"{item.z:.6f}",
            "1",
        ]
        rows.append("\t".join(cells))
    return "\n".join(rows) + "\n"


def plan(mission: Sequence[Item], *, firmware: Literal[3, 12], cruise: float) -> str:
    """A plan file of QGroundControl.

    Args:
        mission: its first item is home.
        firmware: `ARDUPILOT` or `PX4`.
        cruise: airspeed [m/s].
    """
    home, *rest = mission
    document = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": cruise,
            "firmwareType": firmware,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": 5,
            "items": [_simple(number, item) for number, item in enumerate(rest, 1)],
            "plannedHomePosition": [home.latitude_deg, home.longitude_deg, home.z],
            "vehicleType": FIXED_WING,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    return json.dumps(document, indent=1) + "\n"


def _simple(number: int, item: Item) -> dict[str, object]:
    placed = item.command == WAYPOINT
    where = (item.latitude_deg, item.longitude_deg, item.z) if placed else (0.0, 0.0, 0.0)
    found: dict[str, object] = {
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": [*item.parameters, *where],
        "type": "SimpleItem",
    }
    if placed:
        found |= {"AMSLAltAboveTerrain": None, "Altitude": item.z, "AltitudeMode": 1}
    return found


def _place(home: Home, along: float, right: float) -> tuple[float, float]:
    """Latitude and longitude [deg] of a point along and right of the heading [m]."""
    heading = math.radians(home.heading_deg)
    north = along * math.cos(heading) - right * math.sin(heading)
    east = along * math.sin(heading) + right * math.cos(heading)
    narrow = math.cos(math.radians(home.latitude_deg))
    return (
        home.latitude_deg + math.degrees(north / EARTH),
        home.longitude_deg + math.degrees(east / (EARTH * narrow)),
    )
