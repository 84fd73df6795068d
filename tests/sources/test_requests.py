"""What is asked of a vehicle, of the program's own simulated one and of stubborn ones."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.errors import SourceError
from gcs_sysid.recording import Vehicle
from gcs_sysid.sources.frames import search
from gcs_sysid.sources.link import LinkReader, Mailbox
from gcs_sysid.sources.reconnecting import open_lasting
from gcs_sysid.sources.requests import ANSWER_S, TRIES, Needs, Requests
from gcs_sysid.sources.samples import SampleDecoder
from gcs_sysid.sources.sender import SYSTEM, Sender
from gcs_sysid.sources.signing import Signatures
from gcs_sysid.sources.stream import FrameStream
from tests.sitl.live.ground import Ground

PATIENCE_S = 40.0
PLANE = Vehicle(1, 1, "MAV_AUTOPILOT_ARDUPILOTMEGA", "MAV_TYPE_FIXED_WING", 0)


class Station:
    """Requests on the wire of a simulated vehicle that flies as fast as the machine can."""

    def __init__(self, *, needs: Needs | None = None, deaf: Callable[[object], bool] | None = None):
        self.ground = Ground()
        self.requests = Requests(Sender(), needs or Needs())
        self.sent: Counter[str] = Counter()
        self._stream, self._decoder = FrameStream(), SampleDecoder()
        self._parser = mavlink.MAVLink(None)
        self._deaf = deaf or (lambda _message: False)

    def fly(self, seconds: float) -> None:
        wire = self.ground._wire
        for _ in range(round(seconds * 10)):
            for _ in range(5):
                self.ground.vehicle.tick()
            now = self.ground.vehicle.time
            batch = self._stream.feed(bytes(wire.down), round(now * 1e6))
            wire.down.clear()
            self._decoder.samples(batch)
            self.requests.heard(self._decoder.vehicle, batch.tables(), now)
            for frame in self.requests.due(now):
                (message,) = self._parser.parse_buffer(frame)
                self.sent[message.get_type()] += 1
                if not self._deaf(message):
                    wire.up += frame

    def answers(self) -> dict[str, object]:
        now = self.ground.vehicle.time
        return {name: item["answer"] for name, item in self.requests.told(now).items()}


def slowed(station: Station, *names: str) -> Station:
    for name in names:
        assert station.ground.computer.streams.set_interval(name, 1e6)
    return station


def test_what_comes_fast_enough_is_left_alone_and_what_is_refused_is_told() -> None:
    """This aircraft has no sensors of rotation speed, so it denies what tells them."""
    station = Station(needs=Needs(motor_speeds=True))
    station.fly(8.0)
    answers = station.answers()
    assert answers.pop("RPM") == answers.pop("ESC_TELEMETRY_1_TO_4") == "refused"
    assert set(answers.values()) == {"enough"}
    assert station.sent == {"HEARTBEAT": station.sent["HEARTBEAT"], "COMMAND_LONG": 2}
    assert 7 <= station.sent["HEARTBEAT"] <= 9


def test_slow_streams_are_asked_for_and_again_after_a_restart() -> None:
    station = slowed(Station(), "RAW_IMU", "VFR_HUD")
    station.fly(9.0)
    assert station.sent["COMMAND_LONG"] == 2
    told = station.requests.told(station.ground.vehicle.time)
    assert {item["answer"] for item in told.values()} == {"enough"}
    assert told["RAW_IMU"]["rate_hz"] == pytest.approx(50.0, abs=1.0)
    assert station.ground.computer.streams.interval("VFR_HUD") == 40_000
    slowed(station, "RAW_IMU")  # a restart puts its rates back
    station.fly(8.0)
    assert set(station.answers().values()) == {"enough"}
    assert station.sent["COMMAND_LONG"] == 3
    assert "REQUEST_DATA_STREAM" not in station.sent


def test_without_an_answer_it_is_asked_again_and_then_by_group() -> None:
    """As autopilots of before 2018, which do not know the command."""
    station = slowed(
        Station(deaf=lambda message: message.get_type() == "COMMAND_LONG"), "RAW_IMU", "VFR_HUD"
    )
    station.fly(11.0)
    assert station.sent["COMMAND_LONG"] == TRIES
    assert station.sent["REQUEST_DATA_STREAM"] == 2
    assert set(station.answers().values()) == {"enough"}


def test_one_that_agrees_and_does_nothing_is_given_up() -> None:
    requests, now = Requests(Sender(), Needs()), 0.0
    parser, asked = mavlink.MAVLink(None), Counter()
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    stream = FrameStream()
    beat = mavlink.MAVLink_heartbeat_message(1, 3, 128, 10, 4, 3)
    while now < 150.0:
        frames = [beat.pack(vehicle)]
        for frame in requests.due(now):
            (message,) = parser.parse_buffer(frame)
            if message.get_type() == "COMMAND_LONG":
                asked[message.param1] += 1
                frames.append(
                    mavlink.MAVLink_command_ack_message(511, 0, 0, 0, SYSTEM, 25).pack(vehicle)
                )
        requests.heard(PLANE, stream.feed(b"".join(frames), 0).tables(), now)
        now += 0.5
    assert set(asked.values()) == {3}
    assert {item["answer"] for item in requests.told(now).values()} == {"too slow"}


def test_nothing_is_asked_of_a_link_that_fell_silent() -> None:
    requests = Requests(Sender(), Needs())
    beat = mavlink.MAVLink_heartbeat_message(1, 3, 128, 10, 4, 3)
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    tables = FrameStream().feed(bytes(beat.pack(vehicle)), 0).tables()
    requests.heard(PLANE, tables, 0.0)
    parser = mavlink.MAVLink(None)
    sent = Counter(
        message.get_type()
        for step in range(600)
        for frame in requests.due(0.1 * step)
        for message in parser.parse_buffer(frame)
    )
    assert sent == {"HEARTBEAT": 60, "COMMAND_LONG": sent["COMMAND_LONG"]}
    assert sent["COMMAND_LONG"] <= 1 + 1.0 / ANSWER_S


def test_a_narrow_serial_line_is_not_filled() -> None:
    narrow = Needs(bytes_per_second=5760.0).rates("MAV_AUTOPILOT_ARDUPILOTMEGA")
    wide = Needs().rates("MAV_AUTOPILOT_ARDUPILOTMEGA")
    assert narrow["RAW_IMU"] < 0.8 * wide["RAW_IMU"]
    assert min(narrow.values()) >= 1.0
    assert Needs(bytes_per_second=92_160.0).rates("MAV_AUTOPILOT_ARDUPILOTMEGA") == wide


def test_what_is_sent_is_signed_where_a_key_is_given() -> None:
    """Judged by the reader of signatures, and by pymavlink with the same key and another."""
    key = bytes(range(32))
    sender = Sender(key)
    frames = (
        sender.heartbeat() + sender.interval((1, 1), 27, 50.0, 0) + sender.group((1, 1), 1, 9.0)
    )
    raw = np.frombuffer(frames, dtype=np.uint8)
    assert Signatures(key).good(raw, search(raw).frames).tolist() == [True] * 3
    for other, taken in ((key, 3), (bytes(32), 0)):
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        parser.signing.secret_key = other
        kinds = [m.get_type() for m in parser.parse_buffer(frames)]
        assert sum(kind != "BAD_DATA" for kind in kinds) == taken
    assert not Signatures(key).good(raw[:0], search(raw[:0]).frames).size


AIRCRAFT = Path(__file__).resolve().parents[2] / "data/aircraft/ultra_stick_25e.toml"


@pytest.fixture
def flying() -> Iterator[Callable[[str], None]]:
    """The program's simulated vehicle as its users start it, on a real socket in real time."""
    started: list[subprocess.Popen[bytes]] = []

    def start(address: str) -> None:
        words = ["sitl", "--aircraft", str(AIRCRAFT), "--link", address, "--duration", "60"]
        started.append(
            subprocess.Popen(
                [sys.executable, "-m", "gcs_sysid", *words],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        )

    yield start
    for process in started:
        process.terminate()
        process.wait(10.0)


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


@pytest.mark.parametrize("kind", ["udp", "tcp"])
def test_over_a_real_socket_in_real_time(flying, kind: str) -> None:
    if kind == "udp":
        port = free_port(socket.SOCK_DGRAM)
        ours, theirs = f"udp:127.0.0.1:{port}", f"udpout:127.0.0.1:{port}"
        opened = open_lasting(ours)
        flying(theirs)
    else:
        port = free_port(socket.SOCK_STREAM)
        flying(f"tcpin:127.0.0.1:{port}")
        opened = _connected(f"tcp:127.0.0.1:{port}")
    sender, mailbox = Sender(), Mailbox()
    requests, stream, decoder = Requests(sender, Needs()), FrameStream(), SampleDecoder()
    until, slowed, told = time.monotonic() + PATIENCE_S, False, {}
    with opened, LinkReader(opened, mailbox) as reader:
        while not (slowed and told and told["RAW_IMU"]["rate_hz"] > 40.0):
            now = time.monotonic()
            assert now < until, json.dumps(told)
            chunks = mailbox.take(0.1)
            if chunks:  # all at once: a checked test is slower than a flight
                batch = stream.feed(b"".join(c.data for c in chunks), chunks[-1].link_us)
                decoder.samples(batch)
                requests.heard(decoder.vehicle, batch.tables(), now)
                if not slowed:
                    reader.send(sender.interval((1, 1), 27, 1.0, 0))
                    slowed = decoder.vehicle is not None
            for frame in requests.due(now):
                reader.send(frame)
            told = requests.told(now)
            time.sleep(0.1)
    assert told["RAW_IMU"]["answer"] in ("granted", "enough")


def _connected(address: str) -> object:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        try:
            return open_lasting(address)
        except SourceError:  # the vehicle is not there yet
            time.sleep(0.1)
    raise AssertionError("nobody listens")
