"""A bus at this computer: frames in, streams on the flight's clock out, live and recorded."""

from __future__ import annotations

import struct
import time
from pathlib import Path

import can
import numpy as np
import pytest

from gcs_sysid.errors import SourceError
from gcs_sysid.sources.can.bus import CanLink
from gcs_sysid.sources.link import open_link
from gcs_sysid.sources.reconnecting import open_lasting
from gcs_sysid.sources.registry import open_recording
from gcs_sysid.sources.samples import Sample, SampleDecoder
from gcs_sysid.sources.stream import FrameStream
from tests.sources.can.made_can import Bus
from tests.sources.conftest import EPOCH_US

PATIENCE_S = 10.0
BUSES = {
    "virtual": ("virtual", "flight"),
    "udp_multicast": ("udp_multicast", "239.74.163.77"),
}


def heard(address: tuple[str, str], bus: Bus) -> bytes:
    """What the link makes of everything that nodes send."""
    interface, channel = address
    data, until = b"", time.monotonic() + PATIENCE_S
    with (
        open_link(f"can:{interface}:{channel}") as link,
        can.Bus(interface=interface, channel=channel) as nodes,
    ):
        for count, message in enumerate(bus.messages(), start=1):
            message.timestamp = 0.0
            nodes.send(message)
            while FrameStream().feed(data, 0).found.frames.start.size < count:
                data += link.read(0.1)
                assert time.monotonic() < until
    return data


def vanes() -> Bus:
    bus = Bus()
    for i in range(5):
        bus.send(0.02 * i, "air_data.AngleOfAttack", sensor_id=254, aoa=0.125 + 0.0625 * i)
        bus.send(0.02 * i, "air_data.Sideslip", sideslip_angle=-0.0625 * i)
        bus.send(0.02 * i, "ahrs.RawIMU", rate_gyro_latest=[0.5, -0.25, 0.125])
    return bus


@pytest.mark.parametrize("address", BUSES.values(), ids=BUSES)
def test_a_bus_and_a_flight_share_a_recording(address, writer, tmp_path: Path) -> None:
    data = heard(address, vanes())
    log = writer().heartbeat(0)
    for i in range(10):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=5000 + 20 * i, roll=0.1)
    path = tmp_path / "recording.tlog"
    whole = FrameStream().feed(data, 0).raw()
    stamped = b"".join(
        struct.pack(">Q", EPOCH_US + 20_000 * (i // (len(whole) // 5))) + frame
        for i, frame in enumerate(whole)
    )
    path.write_bytes(log.data + stamped)
    recording = open_recording(path)
    assert recording.lost == {"bad_crc": 0, "unknown": 0, "garbage_bytes": 0, "truncated": 0}
    found = recording.streams["AOA_SSA"]
    np.testing.assert_array_equal(found.channels["alpha"], 0.125 + 0.0625 * np.arange(5))
    np.testing.assert_array_equal(found.channels["beta"], -0.0625 * np.arange(5))
    assert found.time == pytest.approx(0.02 * np.arange(5), abs=1e-6)
    assert recording.streams["CAN_IMU"].channels["p"].tolist() == [0.5] * 5
    assert any("as prompt as the telemetry" in note for note in recording.clock_notes)


def test_live_samples_are_those_of_the_bus_not_the_autopilots_estimates(writer) -> None:
    """Angle of attack and sideslip, sent one behind the other, are one sample."""
    link_us, stream, decoder = EPOCH_US, FrameStream(), SampleDecoder()
    beat = writer().frame("HEARTBEAT", type=1, autopilot=3)
    estimate = writer().frame("AOA_SSA", time_usec=5_000_000, AOA=1.0)
    attitude = writer().frame("ATTITUDE", time_boot_ms=5000)
    samples: list[Sample] = []
    for data in (beat + attitude, heard(BUSES["virtual"], vanes()), estimate):
        samples += decoder.samples(stream.feed(data, link_us))
        link_us += 20_000
    own = [one for one in samples if one.stream == "AOA_SSA"]
    assert [one.channels["alpha"] for one in own] == [0.125, 0.1875, 0.25, 0.3125]
    assert [one.channels["beta"] for one in own] == [-0.0, -0.0625, -0.125, -0.1875]
    assert {one.time_us for one in own} == {EPOCH_US + 20_000}
    assert samples[-1].stream == "AOA_SSA[autopilot]"
    assert decoder.can.lost == {"can_unknown": 0, "can_bad_crc": 0, "can_truncated": 0}


def test_nothing_is_ever_sent_to_the_bus() -> None:
    with (
        CanLink("can:virtual:quiet") as link,
        pytest.raises(SourceError, match="not sent to a CAN"),
    ):
        link.write(b"\x00")


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("can:virtual", "is no bus"),
        ("can:virtual:a,fast", "is no bus"),
        ("can:carrier:pigeon", "CAN bus failed"),
        ("can:socketcan:no-such-bus", "CAN bus failed"),
    ],
)
def test_buses_that_cannot_be_opened(address: str, words: str) -> None:
    with pytest.raises(SourceError, match=words) as error:
        open_lasting(address)
    assert "\n" not in str(error.value)
