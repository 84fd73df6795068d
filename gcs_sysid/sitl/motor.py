"""Motors whose thrust is given over rotation speed: a controller makes the speed follow throttle.

The speed is throttle times the fastest of the table, late by the motor's time constant; a motor
tells it as an electronic speed controller does.
"""

from __future__ import annotations

from collections.abc import Sequence

from gcs_sysid.aircraft import Aircraft, Propulsion


def settings(thruster: Propulsion) -> tuple[float, ...]:
    """Throttle of each row of the thrust table, 0 to 1."""
    if thruster.rpm is None:
        return thruster.throttle
    return tuple(speed / thruster.rpm[-1] for speed in thruster.rpm)


def speeds(aircraft: Aircraft, throttles: Sequence[float]) -> dict[int, float]:
    """Rotation speed [rpm] by motor number, of those that tell it, at lagged throttles (0 to 1)."""
    return {
        thruster.rpm_channel: throttle * thruster.rpm[-1]
        for thruster, throttle in zip(aircraft.propulsion, throttles, strict=True)
        if thruster.rpm is not None and thruster.rpm_channel is not None
    }
