"""A maneuver as a script for ArduPlane, which adds it to the outputs on board.

References:
    ArduPilot, `libraries/AP_Scripting/generator/description/bindings.desc` (methods and their
    arguments), `libraries/SRV_Channel/SRV_Channel.cpp` (from scaled outputs to pulses).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import resources

import numpy as np
from jaxtyping import Float

WIDTH = 5
"""Characters that a sample takes in the script: a table of numbers would need three times the
memory, which scripts have little of."""


def script(
    entry: Mapping,
    aircraft: str,
    pulses: Mapping[int, Float[np.ndarray, " sample"]],
) -> str:
    """The script.

    Args:
        entry: the maneuver's document: `name`, `how`, `entry`, `abort`.
        aircraft: its name.
        pulses: added to each output channel's pulse every 20 ms [µs].
    """
    stop: Mapping[str, Sequence[float]] = entry["abort"]
    count = len(next(iter(pulses.values())))
    outputs = "".join(
        f'  {{ number = {channel}, samples = "{_packed(values)}" }},\n'
        for channel, values in sorted(pulses.items())
    )
    values = {
        "NAME": str(entry["name"])[:24],
        "HOW": " ".join(str(entry["how"]).split()),
        "AIRCRAFT": " ".join(aircraft.split()),
        "COUNT": str(count),
        "AIRSPEED": f"{entry['entry']['airspeed']:.2f}",
        "AIRSPEED_MIN": f"{stop['airspeed'][0]:.2f}",
        "AIRSPEED_MAX": f"{stop['airspeed'][1]:.2f}",
        "LOAD_MIN": f"{stop['load_factor'][0]:.2f}",
        "LOAD_MAX": f"{stop['load_factor'][1]:.2f}",
        "BANK_MAX": f"{min(abs(value) for value in stop['bank']):.3f}",
        "HEIGHT_MIN": f"{stop['height_min'][0]:.0f}",
        "OUTPUTS": outputs,
    }
    text = resources.files("gcs_sysid.maneuvers.export").joinpath("maneuver.lua").read_text("utf-8")
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    return text


def _packed(values: Float[np.ndarray, " sample"]) -> str:
    return "".join(f"{round(float(value)):+0{WIDTH}d}" for value in values)
