"""Takes the pictures of docs/live.md: `make live-pictures`, two minutes, needs Chromium.

An aircraft flies whose elevator is weaker than its file says (replay/weak_elevator). `listen` hears
it in real time, and the page is looked at by a screen and a phone, in light and in dark.
"""

from __future__ import annotations

import base64
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gcs_sysid.sitl import record, scenario
from tests.dashboard import page
from tests.dashboard.browser import CHROMIUM, Browser
from tests.live import flown

HERE = Path(__file__).parent
REPLAY = HERE.parent / "replay"
SIZES = {"screen": (1200, 900), "phone": (400, 860)}
THEMES = ("light", "dark")
SEEN_S = 53.0
"""Of the flight: a maneuver is in progress, and the elevator has been found to be weak."""


def picture(size: str, theme: str) -> Path:
    """Where a picture is kept."""
    return HERE / f"live-{size}-{theme}.png"


@contextmanager
def fed(frames: list[tuple[int, bytes]], port: int) -> Iterator[threading.Event]:
    """Plays a flight meanwhile; yields what is set when it is time to look."""
    look, enough = threading.Event(), threading.Event()
    seen_us = frames[0][0] + SEEN_S * 1e6

    def play() -> None:
        times = (link_us for link_us, _ in frames)
        for link_us, _ in zip(times, flown.play(frames, port, speed=1.0), strict=True):
            if link_us >= seen_us:
                look.set()
            if enough.is_set():
                return

    thread = threading.Thread(target=play)
    thread.start()
    try:
        yield look
    finally:
        enough.set()
        thread.join()


def take(url: str, profile: Path) -> None:
    """Looks at the page and keeps what is seen."""
    for size, (width, height) in SIZES.items():
        browser = Browser(url, profile / size, width=width, height=height)
        try:
            browser.until("document.querySelectorAll('.tile').length > 5")
            for theme in THEMES:
                dark = browser.evaluate("document.documentElement.className === 'dark'")
                if dark != (theme == "dark"):
                    browser.evaluate("document.getElementById('theme').click()")
                shot = browser.call("Page.captureScreenshot", format="png")
                picture(size, theme).write_bytes(base64.b64decode(shot["data"]))
        finally:
            browser.close()


def main() -> None:
    """Flies, listens and looks."""
    if CHROMIUM is None:
        sys.exit("live_pictures: Chromium is not installed")
    told = record.fly(scenario.load(REPLAY / "weak_elevator/scenario.toml").flights[0].flight)
    frames = [(frame.arrival_us, frame.data) for frame in told.frames]
    port = flown.free_port()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "flight"
        folder.mkdir()
        aircraft = REPLAY / "ultra_stick_25e.toml"
        with flown.listening(folder, port, aircraft) as listener, page.shown(folder) as url:
            listener.ready()
            with fed(frames, port) as look:
                look.wait()
                take(url, Path(name))


if __name__ == "__main__":
    main()
