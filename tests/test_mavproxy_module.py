"""The module of MAVProxy: alone, and loaded beside a simulated vehicle as its users do."""

from __future__ import annotations

import socket
import time
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest

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
