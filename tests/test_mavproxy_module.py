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
ROOT = Path(__file__).resolve().parents[1]


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
    asked = ("", "dance", "status", "stop", "suggest", "diagnose", "report", "start none")
    for words in asked:
        loaded.command(words.split())
    assert said == [
        "sysid: usage: sysid <status|start|stop|suggest|diagnose|report|set>",
        "sysid: usage: sysid <status|start|stop|suggest|diagnose|report|set>",
        "sysid: does not listen: sysid start",
        "sysid: does not listen",
        *["sysid: no model yet: sysid start, fly, sysid stop"] * 3,
        "sysid: no aircraft file `none`; give one: sysid start AIRCRAFT.toml",
    ]


@pytest.fixture
def started(module, tmp_path, monkeypatch):
    """The module after a flight that was identified; its jobs are kept, not run."""
    from gcs_sysid import mavproxy

    loaded, said, _ = module
    ran: list[list[str]] = []

    class Kept(mavproxy.Job):
        """One that goes on when it was told to stop, as a flight that is being identified does."""

        running, asked = True, 0

        def __init__(self, words, _said) -> None:
            self.name, self.stopped = words[0], False
            ran.append(words)

        def stop(self) -> None:
            self.stopped, self.asked = True, self.asked + 1

        kill = stop

    monkeypatch.setattr(mavproxy, "Job", Kept)
    (tmp_path / "model").mkdir()
    loaded.command(["set", "out", str(tmp_path)])
    said.clear()
    return loaded, said, ran


def test_what_comes_after_a_flight_waits_for_its_end(started, tmp_path):
    """`suggest` took the model of a flight before; a second `stop` ended the identification."""
    loaded, said, ran = started
    loaded.command(["start", str(examples.ULTRA_STICK)])
    listening = loaded._listening
    del ran[:], said[:]
    goes_on = "sysid: the flight goes on: `sysid stop`, and ask again when `listen is done`"
    for words in ("suggest", "diagnose", "report", "stop", "stop", "suggest"):
        loaded.command([words])
    assert said == [
        *[goes_on] * 3,
        "sysid: stopped; what was flown is being identified",
        "sysid: stopped already; what was flown is being identified",
        "sysid: the flight is being identified: ask again when `listen is done`",
    ]
    assert listening.asked == 1
    listening.running = False
    loaded.idle_task()
    loaded.command(["suggest"])
    assert [words[0] for words in ran] == ["suggest"]


def test_suggest_and_diagnose_run_on_what_was_flown(started, tmp_path):
    """All parts of the recording, and the aircraft file as it was when they began."""
    loaded, said, ran = started
    for name in ("recording.tlog", "recording-002.tlog", "recording-001.tlog", "recording-x.tlog"):
        (tmp_path / name).touch()
    loaded.command(["suggest", "--target", "Cm"])
    loaded.command(["diagnose"])
    loaded.command(["suggest"])
    folder = str(tmp_path)
    assert ran == [
        ["suggest", "--model", folder, "--out", f"{folder}/suggest", "--target", "Cm"],
        [
            "diagnose", *(f"{folder}/recording{n}.tlog" for n in ("-001", "-002", "")),
            "--aircraft", f"{folder}/aircraft-flown.toml", "--out", f"{folder}/diagnose",
        ],
    ]  # fmt: skip
    assert said == [
        "sysid: suggest runs; its end will be said",
        "sysid: diagnose runs; its end will be said",
        "sysid: suggest runs already; its end will be said",
    ]
    for name in ("report.html", "diagnose/report.html"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    del said[:]
    loaded.command(["report"])
    assert said == [f"sysid: {folder}/report.html", f"sysid: {folder}/diagnose/report.html"]


def said_of(loaded, said: list[str], words: str) -> list[str]:
    """What is said until a line ends with `words`, which MAVProxy's thread only hands on."""
    until = time.monotonic() + PATIENCE_S
    while not (said and said[-1].endswith(words)):
        assert time.monotonic() < until, said
        loaded.idle_task()
        time.sleep(0.02)
    return said


def test_a_job_that_fails_says_why_and_that_it_did(module, tmp_path):
    loaded, said, _ = module
    (tmp_path / "model").mkdir()
    loaded.command(["set", "out", str(tmp_path)])
    del said[:]
    loaded.command(["suggest"])
    said_of(loaded, said, "suggest did not succeed: see above")
    assert len(said) == 3, "what runs, why it failed, and that it did"
    assert "holds no model.json; give" in said[1]


def test_a_job_says_what_it_found_and_that_it_is_done(module, tmp_path):
    from gcs_sysid.mavproxy import Job

    loaded, said, _ = module
    words = ["inspect", str(ROOT / "data/flights/demo.tlog"), "--out", str(tmp_path / "found")]
    loaded._jobs.append(Job(words, loaded._said))
    assert len(said_of(loaded, said, "inspect is done")) > 1
    assert (tmp_path / "found/inspect.json").is_file()


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
    console.type("sysid suggest")
    console.expect("sysid: the flight goes on: `sysid stop`")
    console.type("module unload gcs_sysid.mavproxy")
    console.expect("Unloaded module gcs_sysid.mavproxy")
    size = recording.stat().st_size
    time.sleep(1.0)
    assert recording.stat().st_size == size, "the listener is still there"


def frames(path: Path) -> list[bytes]:
    return FrameStream().feed(path.read_bytes(), 0).raw()
