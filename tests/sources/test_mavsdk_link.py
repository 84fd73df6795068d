from __future__ import annotations

import json
import math
import time
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid.errors import SourceError
from gcs_sysid.sources import adapters, link, mavsdk_link
from gcs_sysid.sources.link import Link, open_link
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.registry import open_recording
from gcs_sysid.sources.stream import FrameStream

PORT = 24_771
PATIENCE_S = 20.0
AT_ONCE = 20
"""Datagrams under way at most: a receive buffer holds them all, however busy the machine is."""


def flight(writer: type) -> object:
    log = writer(7).heartbeat(0)
    for i in range(200):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=5000 + 20 * i, roll=0.001 * i, pitch=-0.3)
        log.add(20_000 * i + 10, "RAW_IMU", time_usec=5_000_000 + 20_000 * i, zacc=-1000 - i)
        if i % 50 == 0:
            log.add(20_000 * i + 20, "STATUSTEXT", severity=6, text=b"Throttle armed")
            log.add(20_000 * i + 30, "PARAM_VALUE", param_id=b"ARSPD_RATIO", param_value=1.9936)
    return log


def test_a_flight_through_mavsdk_is_the_flight(writer: type, tmp_path: Path) -> None:
    """Frames over loopback into MAVSDK, messages out of it, frames again, a Recording: the same."""
    log = flight(writer)
    sent_path, path = tmp_path / "sent.tlog", tmp_path / "recording.tlog"
    sent_path.write_bytes(log.data)
    beat = writer(7).frame("HEARTBEAT", type=1, autopilot=3, base_mode=128)
    stream, frames = FrameStream(), [frame for _, frame in sorted(log.records, key=lambda r: r[0])]
    with (
        open_link(f"mavsdk:udpin://127.0.0.1:{PORT}") as ground,
        Link(f"udpout:127.0.0.1:{PORT}") as vehicle,
        Recorder(path) as recorder,
    ):
        until = time.monotonic() + PATIENCE_S
        while not (found := ground.read(0.1)):  # MAVSDK discovers it by its heartbeat
            vehicle.write(beat)
            assert time.monotonic() < until
        recorder.write(stream.feed(found, 1_790_000_000_000_000))
        while found := ground.read(0.5):  # late heartbeats do not count below
            recorder.write(stream.feed(found, 1_790_000_000_050_000))
        for start in range(0, len(frames), AT_ONCE):
            sent = frames[start : start + AT_ONCE]
            for frame in sent:
                vehicle.write(frame)
            missing, until = len(sent), time.monotonic() + PATIENCE_S
            while missing > 0 and time.monotonic() < until:
                batch = stream.feed(ground.read(0.1), 1_790_000_000_100_000 + start)
                recorder.write(batch)
                missing -= len(batch.raw())
    sent, received = open_recording(sent_path), open_recording(path)
    assert received.vehicle.system == 7
    assert received.parameters == sent.parameters
    assert [line for _, line in received.texts] == [line for _, line in sent.texts]
    for name in ("ATTITUDE", "RAW_IMU"):
        mine, theirs = received.streams[name], sent.streams[name]
        assert mine.count == theirs.count
        np.testing.assert_allclose(np.diff(mine.time), np.diff(theirs.time), atol=1e-9)
        for channel, values in theirs.channels.items():
            np.testing.assert_array_equal(mine.channels[channel], values, channel)


def test_every_message_survives_the_way_through_json(writer: type) -> None:
    """As MAVSDK writes it: extension fields may be absent, not-a-number is null."""
    for kind in mavsdk_link._kinds().values():
        values = mavsdk_link.fields(kind, json.dumps({"message_name": kind.msgname}))
        kind(**values).pack(mavsdk_link.dialect.MAVLink(None, 1, 1))
    attitude = mavsdk_link._kinds()["ATTITUDE"]
    values = mavsdk_link.fields(attitude, '{"roll": null, "time_boot_ms": 12, "pitch": 0.25}')
    assert math.isnan(values["roll"])
    assert (values["time_boot_ms"], values["pitch"], values["yaw"]) == (12, 0.25, 0)


@pytest.mark.parametrize("address", ["mavsdk:nonsense", "mavsdk:udpin://127.0.0.1:none"])
def test_an_address_that_mavsdk_does_not_know(address: str) -> None:
    with pytest.raises(SourceError, match="MAVSDK cannot open it") as error:
        open_link(address)
    assert "\n" not in str(error.value)


def test_other_links_are_opened_as_before() -> None:
    with open_link("udpin:127.0.0.1:0") as opened:
        assert isinstance(opened, link.Link)
    with pytest.raises(SourceError, match=r"begin with one of udp:.*mavsdk:"):
        open_link("nonsense:1")


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(adapters.OWN["links"], "odd:", "package_that_is_not_there")
    with pytest.raises(SourceError, match="needs the package package_that_is_not_there"):
        open_link("odd:1")


def test_an_unknown_ending_lists_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=r"give one of \.tlog, \.bin, \.log, \.ulg, \.csv"):
        open_recording(tmp_path / "flight.xyz")
