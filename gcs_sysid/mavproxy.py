"""A module of MAVProxy: `module load gcs_sysid.mavproxy`, then `sysid start AIRCRAFT.toml`.

MAVProxy's thread does no more than hand frames on: whatever is computed runs in a process of its
own, `gcs-sysid listen` on a local port, so that flying through MAVProxy is never slower for it.
Loaded by MAVProxy only, whose package (GPL-3) it needs.
"""

from __future__ import annotations

import json
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from MAVProxy.modules.lib import mp_module, mp_settings

from gcs_sysid.cli import live_view
from gcs_sysid.live.legs import Leg, Legs
from gcs_sysid.sources.recorder import parts

COMMANDS = ("status", "start", "stop", "suggest", "diagnose", "report")
_LOCAL = "127.0.0.1"
_FAREWELL_S = 2.0
_LAYER = "sysid"
_AFTERWARDS = ("suggest", "diagnose")
"""Commands on a flight that is identified; each has a folder of its own."""
_GREEN, _AMBER = (0, 200, 80), (255, 160, 0)
_QUIET_S = 3600.0
"""The flight ends when its user says so, not when the vehicle is out of reach."""


class Job:
    """A command of this program running beside MAVProxy; what it says waits in a queue.

    Args:
        words: the command and its arguments.
        said: takes its lines, and one that says how it ended behind them.
    """

    def __init__(self, words: Sequence[str], said: queue.SimpleQueue[str]) -> None:
        self.name = words[0]
        self.stopped = False
        self._process = subprocess.Popen(  # noqa: S603 - this program itself
            [sys.executable, "-m", "gcs_sysid", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self._said = said
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    @property
    def running(self) -> bool:
        """Whether it is not done yet."""
        return self._process.poll() is None

    def stop(self) -> None:
        """Asks it to come to its end."""
        self.stopped = True
        if self.running:
            self._process.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Ends it, at once if it does not end by itself; what it recorded stays."""
        self.stop()
        try:
            self._process.wait(_FAREWELL_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join(_FAREWELL_S)

    def _listen(self) -> None:
        if self._process.stdout is None:
            return
        with self._process.stdout as lines:
            for line in lines:
                self._said.put(line.rstrip())
        failed = self._process.wait() != 0
        self._said.put(f"{self.name} {'did not succeed: see above' if failed else 'is done'}")


class SysidModule(mp_module.MPModule):
    """The commands `sysid status | start | stop | suggest | diagnose | report | set`.

    Args:
        mpstate: MAVProxy's state.
    """

    def __init__(self, mpstate: Any) -> None:
        super().__init__(mpstate, "gcs_sysid.mavproxy", "system identification", public=True)
        self.sysid_settings = mp_settings.MPSettings(
            [("aircraft", str, ""), ("out", str, ""), ("prior", str, "file"), ("verbose", bool, 0)]
        )
        self.add_completion_function("(SYSIDSETTING)", self.sysid_settings.completion)
        self.add_command(
            "sysid", self.command, "system identification", [*COMMANDS, "set (SYSIDSETTING)"]
        )
        self._said: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._jobs: list[Job] = []
        self._listening: Job | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._port = 0
        self._out: Path | None = None
        self._phase = ""
        self._place: tuple[float, float] | None = None
        self._flown: queue.SimpleQueue[Leg] = queue.SimpleQueue()
        self._legs: Legs | None = None

    def mavlink_packet(self, packet: Any) -> None:
        """Hands a frame on; one that cannot go at once is lost to the listener, not to MAVProxy."""
        if packet.get_type() == "GLOBAL_POSITION_INT":
            self._place = (packet.lat * 1e-7, packet.lon * 1e-7)
        if self._port and packet.get_type() != "BAD_DATA":
            try:
                self._socket.sendto(bytes(packet.get_msgbuf()), (_LOCAL, self._port))
            except OSError:
                return

    def idle_task(self) -> None:
        """Says what the jobs have said."""
        while not self._said.empty():
            line = self._said.get()
            listening = " frames, " in line
            if self.sysid_settings.verbose or not listening:
                self.say_line(line)
            phase = line.partition(" | ")[0]
            if listening and phase.split(" (")[0] != self._phase:
                self._phase = phase.split(" (")[0]
                self.say_line(phase)
        while not self._flown.empty():
            leg = self._flown.get()
            self.say_line(leg.words)
            self._mark(leg)
        if self._listening is not None and not self._listening.running:
            self._listening, self._port = None, 0
            self._end_legs()
        self._jobs = [job for job in self._jobs if job.running]

    def unload(self) -> None:
        """Ends what was started; recordings stay."""
        self._port = 0
        self._end_legs()
        for job in self._jobs:
            job.kill()
        self._socket.close()
        self.remove_command("sysid")
        super().unload()

    def command(self, words: list[str]) -> None:
        """One of the commands."""
        name, rest = (words[0], words[1:]) if words else ("", [])
        if name == "set":
            self.sysid_settings.command(rest)
        elif name in COMMANDS:
            getattr(self, f"_{name}")(rest)
        else:
            self.say_line(f"usage: sysid <{'|'.join(COMMANDS)}|set>")

    def _mark(self, leg: Leg) -> None:
        """Draws a leg on every map that is open."""
        maps = self.module_matching("map*")
        if not maps or len(leg.track) < 2:
            return
        from MAVProxy.modules.mavproxy_map import mp_slipmap

        colour = _GREEN if leg.done else _AMBER
        for one in maps:
            one.map.add_object(
                mp_slipmap.SlipPolygon(
                    f"sysid leg {leg.number}", list(leg.track), layer=_LAYER, linewidth=3,
                    colour=colour, arrow=True, showcircles=False,
                )
            )  # fmt: skip
            one.map.add_object(
                mp_slipmap.SlipLabel(
                    f"sysid label {leg.number}", leg.track[0], leg.words.partition(",")[0],
                    layer=_LAYER, colour=colour,
                )
            )  # fmt: skip

    def _end_legs(self) -> None:
        if self._legs is not None:
            self._legs.close()
            self._legs = None

    def say_line(self, text: str) -> None:
        """A line on MAVProxy's console."""
        self.mpstate.console.writeln(f"sysid: {text}")

    def _start(self, words: list[str]) -> None:
        aircraft = words[0] if words else self.sysid_settings.aircraft
        if self._listening is not None:
            self.say_line("listens already; `sysid stop` ends it")
            return
        if not Path(aircraft).is_file():
            self.say_line(f"no aircraft file `{aircraft}`; give one: sysid start AIRCRAFT.toml")
            return
        self.sysid_settings.set("aircraft", aircraft)
        named = self.sysid_settings.out
        self._out = Path(named or f"sysid-{datetime.now(UTC):%Y%m%d-%H%M%S}").resolve()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind((_LOCAL, 0))
            port = int(free.getsockname()[1])
        options = ["--aircraft", aircraft, "--out", str(self._out), "--listen-only"]
        options += ["--prior", self.sysid_settings.prior, "--quiet-after", str(_QUIET_S)]
        self._listening = self._run(["listen", f"udpin:{_LOCAL}:{port}", *options])
        self._port = port
        self._legs = Legs(self._out, lambda: self._place, self._flown)
        self.say_line(f"listens; {self._out}")

    def _stop(self, _words: list[str]) -> None:
        if self._listening is None:
            self.say_line("does not listen")
            return
        if self._listening.stopped:
            # Asked again, it would end at once, and the identification with it.
            self.say_line("stopped already; what was flown is being identified")
            return
        self._port = 0
        self._listening.stop()
        self.say_line("stopped; what was flown is being identified")

    def _status(self, _words: list[str]) -> None:
        try:
            found = json.loads((self._folder() / "live.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            self.say_line("nothing known yet" if self._out else "does not listen: sysid start")
            return
        self.say_line(live_view.line(found))

    def _report(self, _words: list[str]) -> None:
        pages = [self._folder() / name / "report.html" for name in (".", *_AFTERWARDS)]
        made = [str(page) for page in pages if page.exists()]
        for line in made or [self._lacking() or f"no report in {self._folder()}"]:
            self.say_line(line)

    def _suggest(self, words: list[str]) -> None:
        self._afterwards("suggest", ["--model", str(self._folder())], words)

    def _diagnose(self, words: list[str]) -> None:
        # What was flown, whoever edits the file meanwhile.
        flown = self._folder() / "aircraft-flown.toml"
        recordings = map(str, parts(self._folder() / "recording.tlog"))
        self._afterwards("diagnose", [*recordings, "--aircraft", str(flown)], words)

    def _afterwards(self, name: str, words: Sequence[str], more: Sequence[str]) -> None:
        """Runs a command on a flight that is identified, or says what is to be done before."""
        lacking = self._lacking()
        if any(job.name == name and job.running for job in self._jobs):
            self.say_line(f"{name} runs already; its end will be said")
        elif lacking:
            self.say_line(lacking)
        else:
            self._run([name, *words, "--out", str(self._folder() / name), *more])
            self.say_line(f"{name} runs; its end will be said")

    def _lacking(self) -> str:
        """What must be done before there is a model; empty where there is one."""
        if self._listening is not None and not self._listening.stopped:
            return "the flight goes on: `sysid stop`, and ask again when `listen is done`"
        if self._listening is not None:
            return "the flight is being identified: ask again when `listen is done`"
        if not (self._folder() / "model").is_dir():
            return "no model yet: sysid start, fly, sysid stop"
        return ""

    def _folder(self) -> Path:
        return self._out or Path(self.sysid_settings.out or ".").resolve()

    def _run(self, words: Sequence[str]) -> Job:
        job = Job(words, self._said)
        self._jobs.append(job)
        return job


def init(mpstate: Any) -> SysidModule:
    """What MAVProxy calls."""
    return SysidModule(mpstate)
