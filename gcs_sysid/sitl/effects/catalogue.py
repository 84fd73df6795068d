"""All effects by name, and the file that says which are hidden in a flight, and how large.

    name = "surface_effectiveness"      # one effect ...
    control = "elevator"
    ratio = 0.65

    [[effects]]                         # ... or several
    name = "mass"
    mass_ratio = 1.1

    [truth]                             # anything else that scoring should know; optional
    scenario = "two at once"

SI units and radians, as everywhere in the catalogue of causes.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.errors import InputError
from gcs_sysid.sitl.effects import air, body, power, sensing, surfaces
from gcs_sysid.sitl.flight import Flight

Effect = Callable[[Flight, Section], Flight]

EFFECTS: Mapping[str, Effect] = {
    function.__name__: function
    for function in (
        body.mass,
        body.cg_shift,
        body.inertia,
        sensing.airspeed_scale,
        sensing.pitot_lag,
        sensing.accelerometer_bias,
        sensing.gyro_scale,
        sensing.imu_misalignment,
        sensing.imu_position,
        sensing.vane_bias,
        sensing.heading_bias,
        sensing.time_skew,
        surfaces.actuator_lag,
        surfaces.actuator_rate_limit,
        surfaces.actuator_backlash,
        surfaces.surface_effectiveness,
        surfaces.surface_offset,
        surfaces.aeroelastic,
        power.thrust_scale,
        power.thrust_offset,
        power.propwash,
        air.wind_shear,
        air.drag_increase,
        air.stall,
        air.asymmetry,
        air.cross_coupling,
        air.ground_effect,
        air.aero_derivative,
        air.unlisted,
    )
}
"""What can be hidden, in the words and the order of the catalogue of causes."""


@dataclass(frozen=True)
class EffectFile:
    """What a file hides: one section an effect, and what else scoring should know."""

    effects: tuple[Section, ...]
    truth: Mapping[str, Any] = field(default_factory=dict)


def load(path: Path) -> EffectFile:
    """Read an effect file.

    Raises:
        InputError: it is no effect file; the message names the key.
    """
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(str(path), "no such file", fix="check the path") from error
    except ValueError as error:
        raise InputError(str(path), f"no TOML ({error})", fix="correct it there") from error
    top = Section(str(path), "", data)
    truth = top.child("truth")
    own = {key: value for key, value in data.items() if key not in ("effects", "truth")}
    single = (Section(str(path), "", own),) if own else ()
    entries = (*single, *top.children("effects", name_key="name"))
    if not entries:
        raise top.error(
            "name", found="nothing", allowed=", ".join(EFFECTS), fix='start with `name = "mass"`'
        )
    return EffectFile(entries, truth.data if truth else {})


def hide(flight: Flight, entries: Sequence[Section]) -> Flight:
    """The flight with effects hidden in it, one after the other.

    Raises:
        AircraftFileError: an effect that does not exist or does not suit the aircraft.
    """
    for entry in entries:
        flight = EFFECTS[entry.text("name", allowed=tuple(EFFECTS))](flight, entry)
    return flight


def truth(flight: Flight, entries: Sequence[Section], more: Mapping[str, Any]) -> dict[str, Any]:
    """What scoring may know of a flight, for JSON.

    Args:
        flight: as flown.
        entries: what is hidden in it.
        more: to be added as it is.
    """
    effects = [{"name": entry.data["name"], "parameters": _parameters(entry)} for entry in entries]
    return {
        "schema": 1,
        "aircraft": flight.believed.name,
        "cause": effects[0]["name"] if len(effects) == 1 else "several" if effects else "none",
        "effects": effects,
        "seed": flight.seed,
        "epoch_us": flight.epoch_us,
        "duration_s": flight.duration,
        "wind_ned": list(flight.wind.steady),
        "gust": flight.wind.gust,
        "vanes": flight.flown.vanes is not None,
        **more,
    }


def _parameters(entry: Section) -> dict[str, Any]:
    return {key: value for key, value in entry.data.items() if key != "name"}
