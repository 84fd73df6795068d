"""MAVProxy, as its users start it, on a real socket in real time."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.sitl import examples

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_spec("MAVProxy") is None, reason="MAVProxy is not installed"),
]

MODULES = "link,mode,arm,param,wp,rc"
"""Of MAVProxy: without the ones that draw."""

MISSION = """QGC WPL 110
0	1	0	16	0	0	0	0	47.3	8.5	20	1
1	0	3	16	0	0	0	0	47.302	8.5	120	1
2	0	3	16	0	0	0	0	47.302	8.502	120	1
"""


class Console:
    """What a user of MAVProxy types and reads."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._heard = threading.Condition()
        self._text = ""
        self._read = 0
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._heard:
                self._text += line
                self._heard.notify_all()

    def type(self, command: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()

    def ask(self, command: str, words: str) -> None:
        """Ask, again every second, until the answer is what it should be."""
        for _ in range(30):
            self.type(command)
            if self._hears(words, seconds=1.0):
                return
        pytest.fail(f"no {words!r} in {self._text!r}")

    def expect(self, words: str) -> None:
        """Wait until something is said, after what was expected before."""
        assert self._hears(words, seconds=30.0), f"no {words!r} in {self._text[self._read :]!r}"

    def _hears(self, words: str, *, seconds: float) -> bool:
        with self._heard:
            said = self._heard.wait_for(lambda: words in self._text[self._read :], timeout=seconds)
            if said:
                self._read = self._text.index(words, self._read) + len(words)
            return said


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Console]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        port = opened.getsockname()[1]
    flying = [
        *(sys.executable, "-m", "gcs_sysid", "sitl", "--aircraft", str(examples.ULTRA_STICK)),
        *("--link", f"udpout:127.0.0.1:{port}"),
    ]
    station = [
        *(sys.executable, "-u", "-m", "MAVProxy.mavproxy", f"--master=udpin:127.0.0.1:{port}"),
        *("--no-state", f"--default-modules={MODULES}"),
    ]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with (
        subprocess.Popen(
            station, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, cwd=tmp_path, env=os.environ | {"HOME": str(tmp_path)},
        ) as proxy,
        subprocess.Popen(flying, **quiet) as vehicle,
    ):  # fmt: skip
        yield Console(proxy)
        proxy.kill()
        vehicle.kill()


def test_mavproxy_flies_a_simulated_aircraft(console: Console, tmp_path: Path) -> None:
    (tmp_path / "mission.txt").write_text(MISSION, encoding="ascii")
    console.expect("online system 1")
    console.expect("ARMED")
    console.expect("Mode AUTO")
    console.expect("Received 38 parameters")
    console.type("mode LOITER")
    console.expect("DO_SET_MODE: ACCEPTED")
    console.expect("Mode LOITER")
    console.type("disarm force")
    console.expect("DISARMED")
    console.type("arm throttle")
    console.expect("ARMED")
    console.type("param set WP_LOITER_RAD 90")
    console.ask("param fetch WP_LOITER_RAD", "WP_LOITER_RAD = 90.0")
    console.type("wp load mission.txt")
    console.expect("Sent all 3 waypoints")
    console.expect("MISSION_ACK: TYPE_MISSION: ACCEPTED")
    console.type("rc 1 1700")
    console.ask("status RC_CHANNELS", "chan1_raw : 1700")
