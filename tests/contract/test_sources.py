"""One suite over every source: the same flight gives the same Recording, however it came."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from itertools import groupby
from pathlib import Path

import can
import numpy as np
import pytest

from gcs_sysid.offline import inspect
from gcs_sysid.recording import Recording
from gcs_sysid.sources import encode, tlog
from gcs_sysid.sources.link import Link, LinkReader, Mailbox, open_link
from gcs_sysid.sources.player import play
from gcs_sysid.sources.recorder import Recorder
from gcs_sysid.sources.registry import open_recording
from gcs_sysid.sources.stream import FrameStream
from tests.contract import made_flight
from tests.sources.conftest import EPOCH_US

PATIENCE_S = 30.0
PORT = 24_772
BUS_LATE_S = 0.0375
"""Frames of a bus at the ground station are stamped so late."""

STREAMS = {
    ("ATTITUDE",): {"roll": 1e-6, "pitch": 1e-6, "yaw": 1e-6},
    ("RAW_IMU", "HIGHRES_IMU"): {
        "p": 6e-4, "q": 6e-4, "r": 6e-4, "acc_x": 6e-3, "acc_y": 6e-3, "acc_z": 6e-3,
    },
    ("GLOBAL_POSITION_INT",): {
        "v_north": 6e-3, "v_east": 6e-3, "v_down": 6e-3, "latitude": 2e-9, "longitude": 2e-9,
        "altitude": 1e-3,
    },
    ("SERVO_OUTPUT_RAW",): {"pwm_1": 0.0, "pwm_2": 0.0},
    ("AIRSPEED", "VFR_HUD"): {"airspeed": 2e-6},
    ("SCALED_PRESSURE",): {"static_pressure": 0.01},
    ("AOA_SSA",): {"alpha": 1e-8, "beta": 1e-8},
    ("ESC_TELEMETRY_1_TO_4", "ESC_STATUS", "RPM"): {"rpm_1": 0.0},
}  # fmt: skip
"""Half a step of the coarsest form's field; where all are floating point, their rounding."""
# DroneCAN's air data are 16-bit floating point: 11 bits.
AIR_DATA = {"airspeed": 8e-3, "alpha": 3.1e-5, "beta": 8e-6, "static_pressure": 0.01}
COARSER = {
    # ATT is written in hundredths of a degree here, as ArduPlane before 4.6 does.
    "onboard": {"roll": 9e-5, "pitch": 9e-5, "yaw": 9e-5},
    "onboard_replayed": {"roll": 9e-5, "pitch": 9e-5, "yaw": 9e-5},
    "can": AIR_DATA,
    "can_bus": AIR_DATA,
}


def by_telemetry(folder: Path) -> Recording:
    path = folder / "flight.tlog"
    path.write_bytes(made_flight.telemetry().data)
    return open_recording(path)


def by_onboard_log(folder: Path) -> Recording:
    path = folder / "flight.bin"
    path.write_bytes(made_flight.onboard())
    return open_recording(path)


def by_px4_log(folder: Path) -> Recording:
    path = folder / "flight.ulg"
    path.write_bytes(made_flight.px4())
    return open_recording(path)


def by_table(folder: Path) -> Recording:
    path, columns = made_flight.table(folder)
    return open_recording(path, columns=columns)


def by_udp(folder: Path) -> Recording:
    """Played to a live link and recorded there."""
    path, mailbox, stream = folder / "recording.tlog", Mailbox(), FrameStream()
    with (
        Link("udpin:127.0.0.1:0") as ground,
        Link(f"udpout:127.0.0.1:{ground.local_port}") as vehicle,
        LinkReader(ground, mailbox),
        Recorder(path) as recorder,
    ):
        sent = play(
            tlog.frames(made_flight.telemetry().data), paced(vehicle.write), speed=float("inf")
        )
        until = time.monotonic() + PATIENCE_S
        while recorder.frames < sent:
            assert time.monotonic() < until
            take(mailbox, stream, recorder)
    return open_recording(path)


def take(mailbox: Mailbox, stream: FrameStream, recorder: Recorder) -> None:
    """Records what waits, all at once: a checked test is slower than a flight."""
    news = mailbox.take(0.2)
    if news:
        data = b"".join(chunk.data for chunk in news)
        recorder.write(stream.feed(data, news[-1].link_us))


def by_mavsdk(folder: Path) -> Recording:
    path, mailbox, stream = folder / "recording.tlog", Mailbox(), FrameStream()
    log = made_flight.telemetry()
    with (
        open_link(f"mavsdk:udpin://127.0.0.1:{PORT}") as ground,
        Link(f"udpout:127.0.0.1:{PORT}") as vehicle,
        Recorder(path) as recorder,
    ):
        beat, until = log.frame("HEARTBEAT", type=1, autopilot=3), time.monotonic() + PATIENCE_S
        while not ground.read(0.1):  # what comes before MAVSDK knows the vehicle is lost
            vehicle.write(beat)
            assert time.monotonic() < until
        with LinkReader(ground, mailbox):
            sent = play(tlog.frames(log.data), paced(vehicle.write), speed=float("inf"))
            while recorder.frames < sent:
                assert time.monotonic() < until
                take(mailbox, stream, recorder)
    return open_recording(path)


def by_can(folder: Path) -> Recording:
    """Telemetry without vanes and air data, and the log of the bus on which these are."""
    path = folder / "flight.tlog"
    path.write_bytes(made_flight.telemetry(vanes=False).data)
    return open_recording(path, can=made_flight.bus().save(folder / "bus.blf"))


def replayed(recorded: Callable[[Path], Recording]) -> Callable[[Path], Recording]:
    """What a ground station records of an onboard log or a table that is played to it."""

    def by_replay(folder: Path) -> Recording:
        path = folder / "replayed.tlog"
        encoded = encode.frames(recorded(folder))
        assert not [name for name in encoded.left_out if "(rows)" in name]
        path.write_bytes(b"".join(struct.pack(">Q", t) + frame for t, frame in encoded.frames))
        return open_recording(path)

    return by_replay


def by_can_bus(folder: Path) -> Recording:
    """Telemetry, and a bus at the ground station whose frames come late."""
    path, stream = folder / "flight.tlog", FrameStream()
    records = tlog.frames(made_flight.telemetry(vanes=False).data)
    with (
        open_link("can:virtual:contract") as link,
        can.Bus(interface="virtual", channel="contract") as nodes,
    ):
        together = groupby(made_flight.bus().messages(), lambda one: round(one.timestamp, 2))
        for seconds, sent in together:
            at = EPOCH_US + round(1e6 * (seconds + made_flight.CAN_BEHIND_S + BUS_LATE_S))
            for message in sent:
                nodes.send(message)
            records += [(at, frame) for frame in stream.feed(link.read(1.0), at).raw()]
    records.sort(key=lambda record: record[0])
    path.write_bytes(b"".join(struct.pack(">Q", t) + frame for t, frame in records))
    return open_recording(path)


def paced(send: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """Loopback drops what comes faster than it is read."""
    sent = 0

    def one(data: bytes) -> None:
        nonlocal sent
        sent += 1
        if sent % 50 == 0:
            time.sleep(0.005)
        send(data)

    return one


SOURCES = {
    "telemetry": by_telemetry,
    "onboard": by_onboard_log,
    "px4": by_px4_log,
    "table": by_table,
    "udp": by_udp,
    "mavsdk": by_mavsdk,
    "can": by_can,
    "can_bus": by_can_bus,
    "onboard_replayed": replayed(by_onboard_log),
    "px4_replayed": replayed(by_px4_log),
    "table_replayed": replayed(by_table),
}


@pytest.fixture(scope="module", params=SOURCES)
def source(request, tmp_path_factory) -> tuple[str, Recording]:
    return request.param, SOURCES[request.param](tmp_path_factory.mktemp(request.param))


def test_every_value_is_that_of_the_flight(source: tuple[str, Recording]) -> None:
    name, recording = source
    truth = made_flight.truth()
    for names, channels in STREAMS.items():
        for channel, tolerance in channels.items():
            stream = recording.first(names, channel)
            assert stream is not None, f"{name}: no {channel}"
            good = stream.valid(channel)
            at = 1e-6 * (recording.time_us(stream.time[good]) - EPOCH_US)
            row = np.clip(np.round(at / 0.02).astype(int), 0, made_flight.COUNT - 1)
            # What carries no stamp, and the bus' own clock, may sit on a neighbour of its row.
            seen = stream.channels[channel][good]
            allowed = COARSER.get(name, {}).get(channel, tolerance)
            error = np.min(
                [
                    np.abs(seen - truth[channel][np.clip(row + shift, 0, made_flight.COUNT - 1)])
                    for shift in ((-1, 0, 1) if loose(name, stream.stamped, channel) else (0,))
                ],
                axis=0,
            )
            assert good.sum() >= 0.99 * made_flight.COUNT, (name, channel)
            assert error.max() <= allowed * (1.0 + 1e-9) + 1e-12, (name, channel, error.max())


def loose(name: str, stamped: bool, channel: str) -> bool:
    return not stamped or (name in ("can", "can_bus") and channel in AIR_DATA | {"rpm_1": 0.0})


def test_every_time_is_that_of_the_flight(source: tuple[str, Recording]) -> None:
    """On the wall clock, to a millisecond: the step of the stamps in telemetry."""
    name, recording = source
    attitude = recording.streams["ATTITUDE"]
    at = 1e-6 * (recording.time_us(attitude.time) - EPOCH_US)
    np.testing.assert_allclose(at, made_flight.truth()["t"], atol=1.1e-3, err_msg=name)
    if name in ("can", "can_bus"):
        vanes = recording.streams["AOA_SSA"]
        late = 1e-6 * (recording.time_us(vanes.time) - EPOCH_US) - made_flight.truth()["t"]
        assert np.max(np.abs(late)) < 3e-3


def test_nothing_was_lost_and_rates_are_whole(source: tuple[str, Recording]) -> None:
    _, recording = source
    assert sum(recording.lost.values()) == 0
    assert recording.others == ()
    assert recording.streams["ATTITUDE"].rate == pytest.approx(50.0, rel=1e-3)
    for stream in recording.streams.values():
        assert np.all(np.diff(stream.time) >= 0.0)


def test_inspect_sees_one_flight(source: tuple[str, Recording]) -> None:
    document = inspect.inspected(source[1], None)
    assert document["airborne_s"] == pytest.approx(30.0, abs=1.0)
    assert {"aileron", "servo1", "servo2"} & set(document["controls"])
