"""Mass, centre of gravity and inertia that are not what the aircraft file says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.sitl.effects import changes
from gcs_sysid.sitl.flight import Flight

_AXES = ("Ixx", "Iyy", "Izz")


def mass(flight: Flight, entry: Section) -> Flight:
    """`mass_ratio`: true over believed mass. Inertia stays."""
    entry.allow_only("name", "mass_ratio")
    body = flight.flown.mass
    ratio = entry.number("mass_ratio", "1", above=0.0)
    return changes.flying(flight, replace(flight.flown, mass=replace(body, mass=ratio * body.mass)))


def cg_shift(flight: Flight, entry: Section) -> Flight:
    """`cg_x_chord`: the centre of gravity is this far forward [mean chords]. Sensors stay."""
    entry.allow_only("name", "cg_x_chord")
    body = flight.flown.mass
    forward = entry.number("cg_x_chord", "1") * flight.flown.geometry.mean_chord
    cg = changes.plus(body.cg, (forward, 0.0, 0.0))
    return changes.flying(flight, replace(flight.flown, mass=replace(body, cg=cg)))


def inertia(flight: Flight, entry: Section) -> Flight:
    """`Ixx_ratio`, `Iyy_ratio`, `Izz_ratio`: true over believed. Products stay."""
    keys = [f"{axis}_ratio" for axis in _AXES]
    entry.allow_only("name", *keys)
    changes.numbers(entry, dict.fromkeys(keys, "1"))
    body = flight.flown.mass
    ratios = [entry.number(key, "1", default=1.0, above=0.0) for key in keys]
    changed = replace(
        body, Ixx=ratios[0] * body.Ixx, Iyy=ratios[1] * body.Iyy, Izz=ratios[2] * body.Izz
    )
    if np.linalg.eigvalsh(changed.inertia)[0] <= 0.0:
        raise entry.error(
            next(key for key in keys if entry.has(key)),
            found=f"Ixx {changed.Ixx:.4g}, Iyy {changed.Iyy:.4g}, Izz {changed.Izz:.4g} kg·m² with "
            "the products of inertia of the aircraft file",
            allowed="a positive definite inertia tensor",
            fix="take a ratio above 1, or one nearer to it",
        )
    return changes.flying(flight, replace(flight.flown, mass=changed))
