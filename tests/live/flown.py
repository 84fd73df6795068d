"""`gcs-sysid listen` as a process of its own, fed over loopback; flights played without; files."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from gcs_sysid.aircraft import Aircraft

PATIENCE_S = 120.0
"""Longer than compiling takes on a busy computer."""


class Listener:
    """A process that listens into a folder."""

    def __init__(self, folder: Path, port: int, aircraft: Path, *more: str) -> None:
        self.live = folder / "live.json"
        self._begun_us = time.time_ns() // 1000
        words = ["listen", f"udpin:127.0.0.1:{port}", "--aircraft", str(aircraft), *more]
        words += ["--out", str(folder), "--no-dashboard", "--listen-only", "--quiet-after", "1000"]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "gcs_sysid", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )

    def document(self) -> dict:
        """Its newest live document; empty before the first, whatever was there before."""
        try:
            found = json.loads(self.live.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return {}
        return found if (found["written_us"] or 0) > self._begun_us else {}

    def until(self, true: Callable[[dict], bool]) -> dict:
        """Waits for a document of which something is true; returns it."""
        end = time.monotonic() + PATIENCE_S
        while not ((found := self.document()) and true(found)):
            assert self._process.poll() is None, self._process.communicate()[0]
            assert time.monotonic() < end, found
            time.sleep(0.1)
        return found

    def ready(self) -> None:
        """Waits until everything is compiled."""
        self.until(lambda found: "compiled" not in found["phase"])

    def kill(self) -> str:
        """Ends it as a loss of power would; returns what it had said."""
        self._process.kill()
        return self._process.communicate(timeout=PATIENCE_S)[0]


@contextmanager
def listening(folder: Path, port: int, aircraft: Path, *more: str) -> Iterator[Listener]:
    listener = Listener(folder, port, aircraft, *more)
    try:
        yield listener
    finally:
        listener.kill()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        return int(opened.getsockname()[1])


def play(
    frames: Iterable[tuple[int, bytes]], port: int, *, speed: float
) -> Iterator[tuple[float, bytes]]:
    """Sends frames at so many times their speed; yields each with the time when it was sent [s]."""
    begun, first = time.monotonic(), None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for link_us, frame in frames:
            first = link_us if first is None else first
            wait = begun + (link_us - first) * 1e-6 / speed - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            sender.sendto(frame, ("127.0.0.1", port))
            yield time.monotonic(), frame


def sure(aircraft: Aircraft, share: float) -> Aircraft:
    """The aircraft by a file that knows each of its derivatives to a share of its value."""
    models = {
        name: replace(
            model,
            terms={
                key: replace(one, sigma=share * abs(one.value)) for key, one in model.terms.items()
            },
        )
        for name, model in aircraft.aerodynamics.items()
    }
    return replace(aircraft, aerodynamics=models)
