"""How late an autopilot's own filter shows what its inertial unit feels.

ArduPilot passes rate and specific force through two poles of Butterworth's at INS_GYRO_FILTER and
INS_ACCEL_FILTER [Hz] before anybody sees them (AP_InertialSensor, LowPassFilter2p), while attitude
and velocity are made of what was not filtered. H(s) = ω²/(s² + √2 ω s + ω²) has, at |s| ≪ ω, gain
1 to (s/ω)⁴ and a delay of √2/ω: 11 ms at 20 Hz, which shows as moments that lead the motion that
causes them. Aircraft move at a few hertz, so that the delay is all there is to undo.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from gcs_sysid.aircraft import Aircraft, SensorError

GYRO, ACCELEROMETER = "INS_GYRO_FILTER", "INS_ACCEL_FILTER"
"""Parameters of the cut-off frequencies [Hz]."""


def delay(cutoff: float) -> float:
    """Of a Butterworth filter of two poles at frequencies far below its cut-off.

    Args:
        cutoff: [Hz]; 0 or less for no filter.

    Returns:
        [s].
    """
    return math.sqrt(2.0) / (2.0 * math.pi * cutoff) if cutoff > 0.0 else 0.0


def behind(aircraft: Aircraft, parameters: Mapping[str, float]) -> Aircraft:
    """The aircraft with its inertial unit as late as the autopilot's filter makes it.

    Args:
        aircraft: where its file states a lag of a sensor, that stays.
        parameters: of the autopilot, as far as they were told.
    """

    def filtered(error: SensorError, name: str) -> SensorError:
        return error if error.lag else replace(error, lag=delay(parameters.get(name, 0.0)))

    imu = aircraft.imu
    return replace(
        aircraft,
        imu=replace(
            imu,
            gyro=filtered(imu.gyro, GYRO),
            accelerometer=filtered(imu.accelerometer, ACCELEROMETER),
        ),
    )
