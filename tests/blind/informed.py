"""The aircraft file of somebody who was told everything: what a mended file can reach at best."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.sitl import scenario
from gcs_sysid.sitl.flight import Hidden
from gcs_sysid.sitl.jsbsim_xml import Feel


def informed(path: Path) -> Aircraft | None:
    """What flies in a scenario's flight as an aircraft file; None where a file has no words for it.

    Those are a compass that is off, wind that grows with height, a tail in the propeller's stream
    and a structure that gives way.
    """
    (planned,) = scenario.load(path).flights
    flight = planned.flight
    hidden = flight.hidden
    unsaid = replace(hidden, delays={}, feel={}) != Hidden() or flight.wind.gradient != 0.0
    gains = {name: feel.gain for name, feel in hidden.feel.items()}
    if unsaid or any(feel != Feel(gain=feel.gain) for feel in hidden.feel.values()):
        return None
    streams = {name: StreamTiming(delay=delay) for name, delay in hidden.delays.items()}
    told = replace(flight.flown, streams={**flight.flown.streams, **streams})
    return _weakened(told, gains)


def _weakened(aircraft: Aircraft, gains: Mapping[str, float]) -> Aircraft:
    """Every term of a control times its gain."""
    models = {
        name: replace(
            model,
            terms={
                key: replace(term, value=term.value * _gain(key, gains))
                for key, term in model.terms.items()
            },
        )
        for name, model in aircraft.aerodynamics.items()
    }
    return replace(aircraft, aerodynamics=models)


def _gain(key: str, gains: Mapping[str, float]) -> float:
    """Of a term that is a product of regressors."""
    return next((gain for name, gain in gains.items() if name in re.split(r"\W+", key)), 1.0)
