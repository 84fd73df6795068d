"""Draws what a blind flight hides: reproducible, and every part may be fixed instead."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft
from tests.blind import plans
from tests.blind.sizes import CAUSES, hidden

DATA = Path(__file__).resolve().parents[2] / "data" / "aircraft"

AIRCRAFT = ("aerosonde", "brumby_mk3", "ultra_stick_25e", "skywalker_x8")
"""An aircraft with a tail, a delta, a small model, and a flying wing without rudder."""

FILES = ("exact", "five_percent")
"""The aircraft file is the truth, or each derivative is 5 % wrong, with a sigma that says so."""

SIZES = ("larger", "half", "between")

_ROUND = (*CAUSES, *["none"] * 10, *["unlisted"] * 4, *["two"] * 6)
"""What is drawn once in as many flights as it is long, in random order."""

_PAIRED = tuple(
    cause
    for cause in CAUSES
    if cause not in ("stall", "ground_effect", "wind_shear", "vane_bias", "aero_derivative")
)
_PLAN = {"wind_shear": "climbs", "stall": "slow", "ground_effect": "low"}


@dataclass(frozen=True)
class Draw:
    """One blind flight.

    Attributes:
        index: of the draw.
        cause: of the catalogue, `none`, `unlisted` or `two`.
        effects: entries of an effect file.
        share: size over the larger size that matters; 0 where nothing is hidden.
        aircraft: name of its file in data/aircraft.
        file: one of `FILES`.
        size: one of `SIZES`.
        plan: one of `plans.PLANS`.
        gust: sigma of the gusts over the airspeed of the second block.
        seed: of everything random in the flight.
        short: a minute and a half instead of four.
    """

    index: int
    cause: str
    effects: tuple[Mapping[str, Any], ...]
    share: float
    aircraft: str
    file: str
    size: str
    plan: str
    gust: float
    seed: int
    short: bool = False

    @property
    def vanes(self) -> bool:
        """Whether the aircraft has flow vanes: only where they are what is wrong."""
        return any(entry["name"] == "vane_bias" for entry in self.effects)

    @property
    def causes(self) -> frozenset[str]:
        """Names of what is hidden."""
        return frozenset(entry["name"] for entry in self.effects)


@dataclass(frozen=True)
class Fixed:
    """What of a draw is not left to chance."""

    cause: str | None = None
    aircraft: str | None = None
    file: str | None = None
    size: str | None = None
    short: bool = False
    effects: tuple[Mapping[str, Any], ...] = ()


def draw(index: int, *, seed: int = 0, fixed: Fixed = Fixed()) -> Draw:
    """The draw of an index: the same for the same arguments, on any machine.

    Args:
        index: from 0; causes come in random order, each as often in every round.
        seed: of the campaign.
        fixed: what is not drawn.
    """
    generator = np.random.default_rng([seed, index])
    # All is drawn whatever is fixed, so that fixing one thing changes no other.
    aircraft_name = str(generator.choice(AIRCRAFT))
    file = str(generator.choice(FILES))
    size = str(generator.choice(SIZES, p=(0.4, 0.3, 0.3)))
    plan = str(generator.choice(plans.PLANS, p=(0.65, 0.17, 0.13, 0.05)))
    gust = float(generator.uniform(0.03, 0.06))
    flight_seed = int(generator.integers(2**31 - 1))
    cause = fixed.cause or _scheduled(index, seed)
    aircraft_name = fixed.aircraft or aircraft_name
    size = fixed.size or size
    share = {"larger": 1.0, "half": 0.5, "between": None}[size]
    names = _names(cause, generator)
    hides = [hidden(name, share, load(aircraft_name), generator) for name in names]
    entries = fixed.effects or tuple(entry for entry, _ in hides)
    return Draw(
        index=index,
        cause=cause,
        effects=entries,
        share=max((part for _, part in hides), default=0.0),
        aircraft=aircraft_name,
        file=fixed.file or file,
        size=size,
        plan=_PLAN.get(cause, "usual" if names and plan == "low" else plan),
        gust=gust,
        seed=flight_seed,
        short=fixed.short,
    )


@functools.cache
def load(name: str) -> Aircraft:
    """An aircraft of data/aircraft without vanes, mass and inertia as known after a weighing."""
    aircraft = aircraft_file.load(DATA / f"{name}.toml")
    mass = replace(aircraft.mass, mass_sigma=0.02, inertia_sigma=0.05)
    return replace(aircraft, mass=mass, vanes=None)


def _scheduled(index: int, seed: int) -> str:
    generator = np.random.default_rng([seed, index // len(_ROUND), 1])
    order = generator.permutation(len(_ROUND))
    return _ROUND[order[index % len(_ROUND)]]


def _names(cause: str, generator: np.random.Generator) -> tuple[str, ...]:
    if cause == "none":
        return ()
    if cause == "two":
        first, second = generator.choice(len(_PAIRED), size=2, replace=False)
        return _PAIRED[first], _PAIRED[second]
    return (cause,)
