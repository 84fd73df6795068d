"""A busy link for benchmarks: the bundled flight with its fast messages at 100 Hz.

Inertial unit, attitude and servos come at 100 Hz, everything else at 10 Hz, heartbeats at 1 Hz;
what lies between two recorded messages is interpolated. The flight begins anew, after a hole of
some seconds in which the link is lost, as often as is wanted; the vehicle's clock goes on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.sources import tlog

ROOT = Path(__file__).resolve().parents[2]
AIRCRAFT = ROOT / "data/aircraft/ultra_stick_25e.toml"
FLIGHT = ROOT / "data/flights/demo.tlog"
RATES = {
    **dict.fromkeys(("RAW_IMU", "ATTITUDE", "SERVO_OUTPUT_RAW"), 100.0),
    **dict.fromkeys(("VFR_HUD", "GLOBAL_POSITION_INT", "SCALED_PRESSURE", "AOA_SSA"), 10.0),
}
HOLE_S = 3.0
_TICK_S = 0.01
_ANGLES = {"roll", "pitch", "yaw"}


class Feed:
    """Frames of a vehicle that flies the same flight again and again.

    Args:
        times: all rates but that of heartbeats are so many times theirs.
    """

    def __init__(self, times: int = 1) -> None:
        self._times = times
        recorded: dict[str, list[tuple[float, Any]]] = {}
        parser = dialect.MAVLink(None)
        frames = tlog.frames(FLIGHT.read_bytes())
        first = frames[0][0]
        for link_us, frame in frames:
            for message in parser.parse_buffer(frame) or ():
                recorded.setdefault(message.get_type(), []).append(
                    ((link_us - first) * 1e-6, message)
                )
        self._series = {name: _Series(recorded[name]) for name in RATES}
        self._beat = recorded["HEARTBEAT"][0][1]
        self._sender = dialect.MAVLink(
            None, srcSystem=self._beat.get_srcSystem(), srcComponent=self._beat.get_srcComponent()
        )
        self.lap_s = min(one.end for one in self._series.values())

    def frames(self, *, lap: int = 0) -> Iterator[tuple[float, bytes]]:
        """Times [s] from the first lap's beginning and frames, of this lap and all that follow."""
        while True:
            begun = lap * (self.lap_s + HOLE_S)
            step = _TICK_S / self._times
            for tick in range(int(self.lap_s / step)):
                inside = tick * step
                boot_ms = 1000.0 * (begun + inside) + 1000.0
                if tick % (100 * self._times) == 0:
                    yield begun + inside, self._packed(self._beat)
                for name, rate in RATES.items():
                    if tick % round(1.0 / (rate * _TICK_S)) == 0:
                        message = self._series[name].at(inside, boot_ms)
                        yield begun + inside, self._packed(message)
            lap += 1

    def _packed(self, message: Any) -> bytes:
        frame = bytes(message.pack(self._sender))
        self._sender.seq = (self._sender.seq + 1) % 256
        return frame


class _Series:
    """Messages of one type, interpolated."""

    def __init__(self, messages: list[tuple[float, Any]]) -> None:
        self._kind = type(messages[0][1])
        self._time = np.array([time for time, _ in messages])
        self.end = float(self._time[-1])
        self._columns = {
            name: np.array([getattr(message, name) for _, message in messages], dtype=float)
            for name in self._kind.fieldnames
        }
        for name in _ANGLES & set(self._columns):
            self._columns[name] = np.unwrap(self._columns[name])
        kinds = dict(zip(self._kind.fieldnames, self._kind.fieldtypes, strict=True))
        self._counter = 2**32 if kinds.get("time_usec") == "uint32_t" else 2**64
        self._whole = {name: kind not in ("float", "double") for name, kind in kinds.items()}

    def at(self, time: float, boot_ms: float) -> Any:
        values = {}
        for name, column in self._columns.items():
            value = float(np.interp(time, self._time, column))
            if name in _ANGLES:
                value = math.remainder(value, 2.0 * math.pi)
            values[name] = round(value) if self._whole[name] else value
        if "time_boot_ms" in values:
            values["time_boot_ms"] = round(boot_ms)
        if "time_usec" in values:
            # Servo outputs count in 32 bits, which are full after 71 minutes.
            values["time_usec"] = round(boot_ms * 1000) % self._counter
        return self._kind(*(values[name] for name in self._kind.fieldnames))
