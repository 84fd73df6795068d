"""Keys of the aircraft file that are understood but that no run looks at yet."""

from __future__ import annotations

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.offline.flight import SERVO_STREAM
from gcs_sysid.reconstruct import measurements

_LATENESS_READ = {
    *measurements.GYRO_STREAMS,
    *measurements.AIRSPEED_STREAMS,
    *measurements.VELOCITY_STREAMS,
    "AOA_SSA",
    SERVO_STREAM,
}
_INERTIAL = set(measurements.IMU_STREAMS)


def without_effect(aircraft: Aircraft) -> list[str]:
    """Keys that the file sets and that change nothing, as they are written in it."""
    imu, pitot, vanes = aircraft.imu, aircraft.pitot, aircraft.vanes
    stated = {
        "[imu] misalignment_sigma": imu.misalignment_sigma,
        "[imu] gyro lag_sigma": imu.gyro.lag_sigma,
        "[imu] accelerometer lag_sigma": imu.accelerometer.lag_sigma,
        "[pitot] bias_sigma": pitot.error.bias_sigma,
    }
    if vanes is not None:
        stated["[vanes] upwash_sigma"] = vanes.upwash_sigma
        either = vanes.alpha.lag_sigma if vanes.beta.lag_sigma is None else vanes.beta.lag_sigma
        stated["[vanes] lag_sigma"] = either
    for name, timing in aircraft.streams.items():
        if name not in _LATENESS_READ:
            stated[f"[streams.{name}] delay"] = timing.delay or None
        if name not in _LATENESS_READ - _INERTIAL:
            stated[f"[streams.{name}] sigma"] = timing.sigma
    return [key for key, value in stated.items() if value is not None]


def warnings(aircraft: Aircraft) -> list[str]:
    """One line for all of them; none where every key has its effect."""
    keys = without_effect(aircraft)
    if not keys:
        return []
    verb = "has" if len(keys) == 1 else "have"
    return [f"aircraft file: {', '.join(keys)} {verb} no effect yet"]
