"""Takes the pictures of docs/live.md: `make live-pictures`, up to seven minutes, needs Chromium.

An aircraft flies whose elevator is weaker than its file says (replay/weak_elevator, its legs four
times over). `listen` hears it in real time; once the filter with the aerodynamics inside keeps up,
in the next long maneuver, the page is looked at by a screen and a phone, in light and in dark.
"""

from __future__ import annotations

import base64
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from gcs_sysid.sitl import record, scenario
from tests.dashboard import page
from tests.dashboard.browser import CHROMIUM, Browser
from tests.live import flown

HERE = Path(__file__).parent
REPLAY = HERE.parent / "replay"
SIZES = {"screen": (1200, 900), "phone": (400, 860)}
THEMES = ("light", "dark")
LONG_S = 10.0
"""Of a maneuver in progress that is worth a picture."""


def picture(size: str, theme: str) -> Path:
    """Where a picture is kept."""
    return HERE / f"live-{size}-{theme}.png"


@contextmanager
def fed(frames: list[tuple[int, bytes]], port: int) -> Iterator[threading.Thread]:
    """Plays a flight meanwhile, in what it yields."""
    enough = threading.Event()

    def play() -> None:
        for _ in flown.play(frames, port, speed=1.0):
            if enough.is_set():
                return

    thread = threading.Thread(target=play)
    thread.start()
    try:
        yield thread
    finally:
        enough.set()
        thread.join()


def telling(document: dict[str, Any]) -> bool:
    """Whether a maneuver is in progress and the filter with the aerodynamics inside keeps up."""
    maneuver, inside = document.get("maneuver"), document.get("derivatives_by")
    shown = inside == "inside the filter"
    return shown and maneuver is not None and maneuver["seconds"] > LONG_S


def take(url: str, profile: Path) -> None:
    """Looks at the page and keeps what is seen."""
    for size, (width, height) in SIZES.items():
        with closing(Browser(url, profile / size, width=width, height=height)) as browser:
            browser.until("document.querySelectorAll('.tile').length > 5")
            for theme in THEMES:
                dark = browser.evaluate("document.documentElement.className === 'dark'")
                if dark != (theme == "dark"):
                    browser.evaluate("document.getElementById('theme').click()")
                shot = browser.call("Page.captureScreenshot", format="png")
                picture(size, theme).write_bytes(base64.b64decode(shot["data"]))


def main() -> None:
    """Flies, listens and looks."""
    if CHROMIUM is None:
        sys.exit("live_pictures: Chromium is not installed")
    flight = scenario.load(REPLAY / "weak_elevator/scenario.toml").flights[0].flight
    told = record.fly(replace(flight, legs=4 * flight.legs))
    frames = [(frame.arrival_us, frame.data) for frame in told.frames]
    port = flown.free_port()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "flight"
        folder.mkdir()
        aircraft = REPLAY / "ultra_stick_25e.toml"
        with flown.listening(folder, port, aircraft) as listener, page.shown(folder) as url:
            listener.ready()
            with fed(frames, port) as playing:
                while not telling(listener.document()):
                    if not playing.is_alive():
                        sys.exit("live_pictures: the filter inside never kept up; is it busy here?")
                    time.sleep(0.5)
                take(url, Path(name))


if __name__ == "__main__":
    main()
