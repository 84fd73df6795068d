"""From an input on controls to what is added to each output channel's pulse."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft, Servo
from gcs_sysid.maneuvers.axes import THROTTLE


def added(
    aircraft: Aircraft, columns: Mapping[str, Float[np.ndarray, " sample"]]
) -> dict[int, Float[np.ndarray, " sample"]]:
    """Change of the pulse of every channel that moves [µs].

    Args:
        aircraft: its servos, controls and engines.
        columns: by control [rad], and `throttle` [0 to 1].
    """
    mix = np.array(
        [
            [item.mix.get(servo.surface, 0.0) for servo in aircraft.servos]
            for item in aircraft.controls
        ]
    )
    count = len(next(iter(columns.values())))
    controls = np.stack(
        [columns.get(name, np.zeros(count)) for name in aircraft.control_names], axis=1
    )
    surfaces = controls @ np.linalg.pinv(mix).T
    found = {
        servo.channel: surfaces[:, index] * slope(servo)
        for index, servo in enumerate(aircraft.servos)
    }
    for engine in aircraft.propulsion:
        if engine.rpm is None and THROTTLE in columns:
            idle, full = engine.pwm
            found[engine.throttle_channel] = columns[THROTTLE] * (full - idle)
    return {channel: value for channel, value in found.items() if np.abs(value).max() >= 0.5}


def slope(servo: Servo) -> float:
    """Pulse over deflection around no deflection [µs/rad]."""
    order = np.argsort(servo.deflection)
    deflection, pwm = np.array(servo.deflection)[order], np.array(servo.pwm)[order]
    step = 1e-3 * float(np.ptp(deflection))
    at = float(np.clip(0.0, deflection[0] + step, deflection[-1] - step))
    low, high = np.interp([at - step, at + step], deflection, pwm)
    return float((high - low) / (2.0 * step))
