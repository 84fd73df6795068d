"""One flight's telemetry: every stream on one clock, in SI units, with what is valid marked.

This is the one door between the outside (logs, links, formats) and the mathematics. Sources produce
a `Recording`; everything above only reads it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

GAP = 0.2
"""A hole of more than three usual intervals and of more than this [s] counts as a gap."""


def gaps(time: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " gap"]:
    """Lengths of the gaps between samples [s]."""
    steps = np.diff(time)
    usual = steps[steps > 0.0]
    return steps[steps > max(3.0 * np.median(usual), GAP)] if usual.size else np.zeros(0)


@dataclass(frozen=True)
class Stream:
    """One message type of one vehicle.

    Attributes:
        name: MAVLink message type, for instance `RAW_IMU`.
        time: when the vehicle took the sample, s after the recording's epoch, not decreasing.
        link_time: when the ground station received it, s after the epoch (equal to `time` for
            onboard logs).
        channels: named values in SI units and radians; see `CHANNELS`. A value that was not
            measured (sentinel, not a number, out of the sensor's range) is NaN.
        stamped: whether `time` comes from the vehicle's own clock; otherwise it is inferred from
            the arrival time.
    """

    name: str
    time: Float[np.ndarray, " sample"]
    link_time: Float[np.ndarray, " sample"]
    channels: Mapping[str, Float[np.ndarray, " sample"]]
    stamped: bool = True

    @property
    def count(self) -> int:
        """Number of samples."""
        return int(self.time.size)

    @property
    def rate(self) -> float:
        """Median sample rate [Hz]; 0 for fewer than two samples."""
        steps = np.diff(self.time)
        steps = steps[steps > 0.0]
        return float(1.0 / np.median(steps)) if steps.size else 0.0

    def valid(self, channel: str) -> Bool[np.ndarray, " sample"]:
        """Which samples of `channel` were measured; all false for a channel it does not have."""
        if channel not in self.channels:
            return np.zeros(self.count, dtype=bool)
        return np.isfinite(self.channels[channel])

    def has(self, *channels: str) -> bool:
        """Whether every one of `channels` was measured at least once."""
        return all(bool(self.valid(channel).any()) for channel in channels)


NO_AUTOPILOT = "MAV_AUTOPILOT_INVALID"
"""MAVLink's name for a sender that is no autopilot: here, a table of measurements."""


@dataclass(frozen=True)
class Vehicle:
    """A system heard in a log: `autopilot` and `kind` are MAVLink enum names, `streams` counts."""

    system: int
    component: int
    autopilot: str
    kind: str
    messages: int


@dataclass(frozen=True)
class Recording:
    """All streams of one vehicle in one flight, on one clock.

    Attributes:
        source: file name or link as the user gave it.
        sha256: digest of the file; empty for a live link.
        vehicle: whose telemetry this is.
        epoch_us: log clock at time zero, microseconds since 1970 (UTC as far as the log knows it).
        streams: by message type.
        parameters: the autopilot's parameters, as far as the log holds them.
        texts: (time, text) of STATUSTEXT messages.
        lost: what could not be used, counted by reason: `bad_crc`, `unknown`, `garbage_bytes`,
            `truncated`; of an onboard log also `bad_stamp`, `dropped`; of a CAN bus
            `can_unknown`, `can_bad_crc`, `can_truncated`; of a table
            `rows_without_time`, `rows_at_same_time`.
        clock_notes: what was done to bring the streams onto one clock, one sentence each.
        others: further vehicles heard in the same log.
    """

    source: str
    sha256: str
    vehicle: Vehicle
    epoch_us: int
    streams: Mapping[str, Stream]
    parameters: Mapping[str, float] = field(default_factory=dict)
    texts: tuple[tuple[float, str], ...] = ()
    lost: Mapping[str, int] = field(default_factory=dict)
    clock_notes: tuple[str, ...] = ()
    others: tuple[Vehicle, ...] = ()

    def first(self, names: tuple[str, ...], *channels: str) -> Stream | None:
        """The first stream of `names` in which all `channels` were measured, or None."""
        for name in names:
            stream = self.streams.get(name)
            if stream is not None and stream.has(*channels):
                return stream
        return None

    def time_us(self, time: Float[np.ndarray, " sample"]) -> np.ndarray:
        """Log clock [µs since 1970, int64] of times given in seconds after the epoch."""
        return self.epoch_us + np.round(np.asarray(time) * 1e6).astype(np.int64)


CHANNELS: Mapping[str, str] = {
    "acc_x": "specific force along body x [m/s²]",
    "acc_y": "specific force along body y [m/s²]",
    "acc_z": "specific force along body z [m/s²]",
    "p": "roll rate [rad/s]",
    "q": "pitch rate [rad/s]",
    "r": "yaw rate [rad/s]",
    "mag_x": "magnetic flux density along body x [T]",
    "mag_y": "magnetic flux density along body y [T]",
    "mag_z": "magnetic flux density along body z [T]",
    "roll": "bank angle [rad]",
    "pitch": "pitch angle [rad]",
    "yaw": "heading [rad]",
    "v_north": "velocity over ground, north [m/s]",
    "v_east": "velocity over ground, east [m/s]",
    "v_down": "velocity over ground, down [m/s]",
    "north": "position north of the estimator's origin [m]",
    "east": "position east of the estimator's origin [m]",
    "latitude": "latitude [rad]",
    "longitude": "longitude [rad]",
    "altitude": "height above mean sea level [m]",
    "height": "height above home [m]",
    "pressure_altitude": "altitude from static pressure, as the sensor reports it [m]",
    "true_airspeed": "true airspeed as a sensor reports it [m/s]",
    "position_N": "measured position of actuator N, N as on its bus [rad]",
    "airspeed": "indicated (equivalent) airspeed [m/s]",
    "groundspeed": "speed over ground [m/s]",
    "climb": "climb rate [m/s]",
    "throttle": "throttle as reported, 0 to 1",
    "demand_aileron": "autopilot's aileron demand before mixing, full travel 1",
    "demand_elevator": "autopilot's elevator demand before mixing, full travel 1",
    "demand_rudder": "autopilot's rudder demand before mixing, full travel 1",
    "static_pressure": "static pressure [Pa]",
    "dynamic_pressure": "impact pressure [Pa]",
    "temperature": "temperature reported by the sensor [K]",
    "alpha": "angle of attack at the vane [rad]",
    "beta": "sideslip at the vane [rad]",
    "pwm_N": "output or input pulse of channel N, N from 1 [µs]",
    "rpm_N": "rotation speed of motor N, N from 1 [rpm]",
    "power_N": "electrical power into the controller of motor N, N from 1 [W]",
    "voltage": "battery voltage [V]",
    "current": "battery current [A]",
    "mode": "custom mode number",
    "armed": "1 armed, 0 not",
    "wind_north": "wind blowing toward north, autopilot's estimate [m/s]",
    "wind_east": "wind blowing toward east, autopilot's estimate [m/s]",
    "wind_down": "wind blowing down, autopilot's estimate [m/s]",
    "time_unix": "wall time by the vehicle [s since 1970]",
}
"""Channel names shared by all sources. `N` stands for a channel number."""
