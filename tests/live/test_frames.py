"""From frames on: an autopilot that restarts in flight, and frames that hold anything at all."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterable
from random import Random

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.live import document
from gcs_sysid.live.filter import Estimate
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.offline import documents
from gcs_sysid.sources.stream import FrameStream
from tests.sources.conftest import defaults, message_class

Frames = list[tuple[int, bytes]]

FLOWN_S, AWAY_S, AGAIN_S = 25.0, 3.0, 15.0
BASE_S, QUIET_S = 8.0, 5.5
"""The part of the flight between whose frames others are put, and from when: states are known."""
HEARD = (
    *("ATTITUDE", "ATTITUDE_QUATERNION", "RAW_IMU", "SCALED_IMU2", "HIGHRES_IMU", "VFR_HUD"),
    *("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "GPS_RAW_INT", "SERVO_OUTPUT_RAW", "RPM"),
    *("SCALED_PRESSURE", "ESC_TELEMETRY_1_TO_4", "AOA_SSA", "SYSTEM_TIME"),
    *("HEARTBEAT", "CAN_FRAME", "CANFD_FRAME", "PARAM_VALUE", "WIND_COV", "COMMAND_ACK"),
)
FLOATS = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, -3.3e38, 3.3e38, 1e-38, 1e9, 57.3)


class Ground:
    """A station, and the clock beside it.

    Args:
        aircraft: its file.
        compiled: of the same aircraft.
    """

    def __init__(self, aircraft: Aircraft, compiled: Compiled) -> None:
        self.now = 0
        self.estimates: list[Estimate] = []
        self._frames = FrameStream()
        self.station = Station(
            aircraft,
            compiled,
            prior=None,
            vehicle=None,
            clock_us=lambda: self.now,
            observer=lambda item: (
                self.estimates.append(item) if isinstance(item, Estimate) else None
            ),
        )

    def hear(self, frames: Iterable[tuple[int, bytes]]) -> None:
        for self.now, frame in frames:
            self.station.receive(self._frames.feed(frame, self.now))
            self.station.work(2**62)

    def told(self) -> dict:
        around = document.Outside(link="", phase=self.station.phase(), now_us=self.now)
        return document.document(self.station, around)


def test_an_autopilot_that_restarts_is_followed(
    played: Frames, aircraft: Aircraft, compiled: Compiled
) -> None:
    """Its clock begins anew, and all that it sends; time goes on, and so does the flight."""
    first = played[0][0]
    before = [item for item in played if item[0] < first + FLOWN_S * 1e6]
    later_us = before[-1][0] - first + round(AWAY_S * 1e6)
    ground = Ground(aircraft, compiled)
    ground.hear(before)
    count = len(ground.estimates)
    assert count > 100
    again_until = first + AGAIN_S * 1e6
    ground.hear((at + later_us, frame) for at, frame in before if at < again_until)
    again = ground.estimates[count:]
    assert len(again) > 100
    told = ground.told()
    assert told["counts"]["reboots"] == 1
    assert told["counts"]["failures"] == 0
    assert told["alarms"] == []
    assert told["state_age_s"] < 0.5
    times = np.array([one.row.time for one in ground.estimates])
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] == pytest.approx(FLOWN_S + AWAY_S + AGAIN_S, abs=1.0)
    for one in ground.estimates:
        assert np.isfinite(one.flow).all()
        assert np.isfinite(one.rest).all()
        assert np.isfinite(one.covariance).all()


def anything(chance: Random, boot_ms: int) -> bytes:
    """A frame with a good checksum whose fields hold anything, its stamp often what it should."""
    name = chance.choice(HEARD)
    kind = message_class(name)
    fields = defaults(name)
    for field, code in zip(kind.ordered_fieldnames, kind.native_format[1:], strict=True):
        letter, zero = chr(code), fields[field]
        if letter in "sc":
            fields[field] = bytes(chance.randrange(256) for _ in range(3))
            continue

        def value(letter: str = letter) -> float | int:
            if letter in "fd":
                return chance.choice(FLOATS)
            bits = 8 * struct.calcsize("<" + letter)
            low, high = (
                (0, 2**bits - 1) if letter.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
            )
            return chance.choice((low, high, 0, 1, chance.randint(low, high)))

        fields[field] = [value() for _ in zero] if isinstance(zero, list) else value()
    if chance.random() < 0.8:
        stamp = max(boot_ms + chance.randint(-200, 200), 1)
        fields |= {"time_boot_ms": stamp % 2**32} if "time_boot_ms" in fields else {}
        fields |= {"time_usec": 1000 * stamp % 2**32} if "time_usec" in fields else {}
    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=chance.choice((1, 1, 1, 0, 255)))
    return bytes(kind(**fields).pack(sender))


# Four flights: a smaller one would say no more, and take minutes to be found.
@settings(max_examples=2, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(st.integers(0, 2**32), st.sampled_from([0.02, 0.3]))
def test_whatever_frames_hold_a_document_is_made(
    played: Frames, aircraft: Aircraft, compiled: Compiled, seed: int, share: float
) -> None:
    """Between the frames of a flight, on a station that nothing guards.

    A pressure of nothing made an airspeed of 1e21 m/s, which ruined the covariance.
    """
    chance, first = Random(seed), played[0][0]
    base = [item for item in played if item[0] < first + BASE_S * 1e6]
    ground = Ground(aircraft, compiled)
    for count, (link_us, frame) in enumerate(base):
        ground.hear([(link_us, frame)])
        if link_us > first + QUIET_S * 1e6 and chance.random() < share:
            # Their stamps are of the same clock: others would be taken for a restart, or left out.
            boot_us = ground.station.decoder.clock._boot_us or 0
            ground.hear([(link_us, anything(chance, boot_us // 1000))])
        if count % 200 == 0:
            json.loads(documents.dump_json(ground.told()))
    told = json.loads(documents.dump_json(ground.told()))
    assert told["counts"]["failures"] == 0
    newest = ground.station.newest
    assert newest is not None
    assert np.isfinite(newest.flow).all()
