"""`replay` sends every frame of a log, whole and in order, to whoever listens."""

from __future__ import annotations

import json
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs_sysid.cli import entry
from tests.sources.made_dataflash import Dataflash


@pytest.fixture
def listener():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        opened.settimeout(10.0)
        yield opened


@pytest.fixture
def flight(tmp_path):
    """A log of five attitude messages and the frames in it."""
    mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = []
    for i in range(5):
        message = dialect.MAVLink_attitude_message(20 * i, 0.1 * i, 0.0, 0.0, 0.0, 0.0, 0.0)
        frames.append(bytes(message.pack(mav)))
    stamped = [
        (1_700_000_000_000_000 + 20_000 * i).to_bytes(8, "big") + frame
        for i, frame in enumerate(frames)
    ]
    path = tmp_path / "flight.tlog"
    path.write_bytes(b"".join(stamped))
    return path, frames


@pytest.mark.parametrize("scheme", ["udp", "udpout"])
def test_all_frames_arrive(scheme, flight, listener, capsys):
    path, frames = flight
    link = f"{scheme}:127.0.0.1:{listener.getsockname()[1]}"
    assert entry.main(["replay", str(path), "--to", link, "--speed", "inf"]) == 0
    assert [listener.recv(2048) for _ in frames] == frames
    assert capsys.readouterr().out == f"5 messages sent to {link}\n"


def test_a_log_without_messages_is_refused(tmp_path, listener, capsys):
    path = tmp_path / "noise.tlog"
    path.write_bytes(b"no telemetry in here")
    link = f"udp:127.0.0.1:{listener.getsockname()[1]}"
    assert entry.main(["replay", str(path), "--to", link]) == 1
    assert "noise.tlog: holds no MAVLink message" in capsys.readouterr().err


@pytest.mark.parametrize("speed", ["0", "-1", "fast"])
def test_speed_is_positive(speed, flight, capsys):
    path, _ = flight
    assert entry.main(["replay", str(path), "--to", "udp:127.0.0.1:9", "--speed", speed]) == 2
    assert "--speed" in capsys.readouterr().err


def test_a_link_that_is_none_says_what_is_one(flight, capsys):
    path, _ = flight
    assert entry.main(["replay", str(path), "--to", "carrier-pigeon"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "udp:" in err


def test_an_onboard_log_is_sent_as_the_vehicle_would_have(listener, tmp_path, capsys):
    log = Dataflash()
    for i in range(5):
        log.add("ATT", 20_000 * (i + 1), 10.0, 1.0, 90.0)
    path = tmp_path / "flight.bin"
    path.write_bytes(log.binary)
    port = listener.getsockname()[1]
    words = ["replay", str(path), "--to", f"udp:127.0.0.1:{port}", "--speed", "inf", "--json"]
    assert entry.main(words) == 0
    document = json.loads(capsys.readouterr().out)
    parser = dialect.MAVLink(None)
    received = [parser.parse_buffer(listener.recv(300))[0] for _ in range(document["sent"])]
    attitudes = [m for m in received if m.get_type() == "ATTITUDE"]
    assert [m.roll for m in attitudes] == pytest.approx([0.17453293] * 5)
    assert {m.get_type() for m in received} == {"ATTITUDE", "HEARTBEAT", "SYSTEM_TIME"}
    assert document["left_out"] == {}
