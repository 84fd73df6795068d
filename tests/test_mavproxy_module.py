"""The module of MAVProxy: alone, and loaded beside a simulated vehicle as its users do."""

from __future__ import annotations

import importlib
import json
import queue
import socket
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gcs_sysid.live.legs import Legs
from gcs_sysid.sources.stream import FrameStream
from tests.sitl import examples
from tests.sitl.live.test_mavproxy import Console, console
from tests.sources.conftest import Writer

pytestmark = pytest.mark.skipif(find_spec("MAVProxy") is None, reason="MAVProxy is not installed")
__all__ = ["console"]
PATIENCE_S = 60.0


@pytest.fixture
def module():
    from gcs_sysid import mavproxy

    said: list[str] = []
    state = SimpleNamespace(
        console=SimpleNamespace(writeln=said.append),
        command_map={},
        completions={},
        completion_functions={},
        public_modules={},
        multi_instance={},
    )
    loaded = mavproxy.init(state)
    yield loaded, said, state
    if "sysid" in state.command_map:
        loaded.unload()


def test_commands_say_what_is_missing(module):
    loaded, said, _ = module
    for words in ([], ["dance"], ["status"], ["stop"], ["suggest"], ["report"], ["start", "none"]):
        loaded.command(words)
    assert said == [
        "sysid: usage: sysid <status|start|stop|suggest|diagnose|report|set>",
        "sysid: usage: sysid <status|start|stop|suggest|diagnose|report|set>",
        "sysid: does not listen: sysid start",
        "sysid: does not listen",
        "sysid: no model yet: sysid start, fly, sysid stop",
        "sysid: no report yet; `sysid stop` makes it",
        "sysid: no aircraft file `none`; give one: sysid start AIRCRAFT.toml",
    ]


def test_frames_are_handed_on_as_they_came(module):
    loaded, _, state = module
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there:
        there.bind(("127.0.0.1", 0))
        there.settimeout(PATIENCE_S)
        loaded._port = there.getsockname()[1]
        frame = Writer().frame("HEARTBEAT")
        for kind in ("BAD_DATA", "HEARTBEAT"):
            loaded.mavlink_packet(
                SimpleNamespace(get_type=lambda kind=kind: kind, get_msgbuf=lambda: frame)
            )
        assert there.recv(300) == frame
    loaded.mavlink_packet(  # nobody listens any more: MAVProxy must not notice
        SimpleNamespace(get_type=lambda: "HEARTBEAT", get_msgbuf=lambda: frame)
    )
    loaded.unload()
    assert state.command_map == {}


def test_a_leg_is_told_and_marked_on_the_map(module, tmp_path, monkeypatch):
    """The thread sees maneuvers come and go; MAVProxy's thread only draws what it found."""
    loaded, said, state = module
    drawn = []
    state.public_modules["map"] = SimpleNamespace(map=SimpleNamespace(add_object=drawn.append))
    # What draws needs a window system; what is drawn is looked at.
    slipmap = SimpleNamespace(
        SlipPolygon=lambda key, points, **how: ("polygon", key, points, how["colour"]),
        SlipLabel=lambda key, point, label, **_how: ("label", key, point, label),
    )
    package = importlib.import_module("MAVProxy.modules.mavproxy_map")
    monkeypatch.setattr(package, "mp_slipmap", slipmap, raising=False)
    monkeypatch.setitem(sys.modules, "MAVProxy.modules.mavproxy_map.mp_slipmap", slipmap)
    legs = Legs(tmp_path, lambda: loaded._place, loaded._flown)
    legs.close()
    told = {"number": 1, "controls": ["elevator"], "seconds": 7.6, "learned": 0.95, "stop": "known"}
    for step in range(3):
        loaded.mavlink_packet(
            SimpleNamespace(
                get_type=lambda: "GLOBAL_POSITION_INT",
                get_msgbuf=lambda: b"",
                lat=450000000 + step,
                lon=-930000000,
            )
        )
        legs.look(told)
    legs.look({**told, "number": 2, "learned": 0.2, "stop": ""})
    legs.look(None)
    assert drawn == [], "the other thread draws nothing"
    loaded.idle_task()
    assert said == [
        "sysid: leg 1: elevator, 8 s, 95 % learned (known)",
        "sysid: leg 2: elevator, 8 s, 20 % learned",
    ]
    track = [(45.0 + step * 1e-7, -93.0) for step in range(3)]
    assert [one[:2] for one in drawn] == [("polygon", "sysid leg 1"), ("label", "sysid label 1")]
    np.testing.assert_allclose(drawn[0][2], track, rtol=0.0, atol=1e-9)
    assert drawn[1][2:] == (pytest.approx(track[0]), "leg 1: elevator")


def test_legs_are_read_from_what_listening_writes(tmp_path):
    flown = queue.SimpleQueue()
    legs = Legs(tmp_path, lambda: (45.0, -93.0), flown)
    path, until = tmp_path / "live.json", time.monotonic() + PATIENCE_S
    told = {"number": 4, "controls": ["rudder"], "seconds": 1.0, "learned": 0.0, "stop": ""}
    while flown.empty():
        assert time.monotonic() < until
        for text in ("{", json.dumps({"maneuver": told}), json.dumps({"maneuver": None})):
            path.write_text(text)
            time.sleep(0.7)
    assert flown.get().number == 4
    legs.close()


@pytest.mark.slow
def test_in_mavproxy_beside_a_simulated_vehicle(console: Console, tmp_path: Path) -> None:
    console.expect("online system 1")
    console.type("module load gcs_sysid.mavproxy")
    console.expect("Loaded module gcs_sysid.mavproxy")
    console.type(f"sysid set out {tmp_path / 'flight'}")
    console.type(f"sysid start {examples.ULTRA_STICK}")
    console.expect("sysid: listens;")
    recording, until = tmp_path / "flight/recording.tlog", time.monotonic() + PATIENCE_S
    while not recording.exists() or len(frames(recording)) < 200:
        assert time.monotonic() < until
        time.sleep(0.2)
    console.ask("sysid status", " frames, ")
    console.type("module unload gcs_sysid.mavproxy")
    console.expect("Unloaded module gcs_sysid.mavproxy")
    size = recording.stat().st_size
    time.sleep(1.0)
    assert recording.stat().st_size == size, "the listener is still there"


def frames(path: Path) -> list[bytes]:
    return FrameStream().feed(path.read_bytes(), 0).raw()
