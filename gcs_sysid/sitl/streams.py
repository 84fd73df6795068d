"""Which message is due when: rates that a ground station may change on a live link."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_sysid.sitl import status
from gcs_sysid.sitl.telemetry import TICK_US

GROUPS: Mapping[int, tuple[str, ...]] = {
    1: ("RAW_IMU", "SCALED_IMU2", "SCALED_PRESSURE"),
    2: ("SYS_STATUS", "GPS_RAW_INT", "MISSION_CURRENT", "NAV_CONTROLLER_OUTPUT"),
    3: ("SERVO_OUTPUT_RAW", "RC_CHANNELS"),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE", "AOA_SSA"),
    11: ("VFR_HUD",),
    12: (
        "AIRSPEED",
        "RPM",
        "ESC_TELEMETRY_1_TO_4",
        "WIND",
        "BATTERY_STATUS",
        "SYSTEM_TIME",
        "EKF_STATUS_REPORT",
    ),
}
"""Messages of ArduPlane's data streams, by MAV_DATA_STREAM."""


class Streams:
    """Intervals of all messages, and when each was last due.

    Args:
        untold: messages that the vehicle does not have.
    """

    def __init__(self, *, untold: frozenset[str] = frozenset()) -> None:
        self._untold = untold
        self._intervals = {name: _interval(rate) for name, rate in status.RATES.items()}
        self._next: dict[str, int] = {}

    def interval(self, name: str) -> int:
        """Time between two messages [µs], 0 where it comes only on request."""
        return self._intervals.get(name, 0)

    def set_interval(self, name: str, interval_us: float) -> bool:
        """Change an interval [µs]: 0 is the default, -1 never; False for an unknown message."""
        if name not in self._intervals or name in self._untold:
            return False
        usual = _interval(status.RATES[name])
        chosen = usual if interval_us == 0 else max(round(interval_us), TICK_US)
        self._intervals[name] = 0 if interval_us < 0 else chosen
        self._next.pop(name, None)
        return True

    def set_group(self, group: int, rate: float) -> None:
        """Change the rate of a data stream [Hz], of all of them for group 0; 0 stops it."""
        groups = GROUPS.values() if group == 0 else [GROUPS.get(group, ())]
        for names in groups:
            for name in names:
                self.set_interval(name, 1e6 / rate if rate > 0.0 else -1.0)

    def due(self, time_us: int) -> list[str]:
        """Messages due at a time [µs], which does not go back."""
        found = []
        for name, interval in self._intervals.items():
            if interval == 0 or name in self._untold:
                continue
            when = self._next.get(name, time_us)
            if when <= time_us:
                found.append(name)
                # On from when it was due, so that the mean rate is the one asked for.
                self._next[name] = max(when + interval, time_us + 1)
        return found


def _interval(rate: float) -> int:
    return round(1e6 / rate) if rate > 0.0 else 0
