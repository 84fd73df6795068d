"""Takes the pictures of a diagnosis and of a test card: `make report-pictures`, needs Chromium.

Both are of `make demo`'s first flight, whose elevator is weaker than its file says; the diagnosis
is that by the filter, held against the second flight.
"""

from __future__ import annotations

import base64
import sys
import tempfile
from contextlib import closing
from pathlib import Path

from tests.dashboard.browser import CHROMIUM, Browser

HERE = Path(__file__).parent
WIDTH = 960
SHARP = 1.5
"""Pixels of the picture to one of the page."""


def take(report: Path, part: str, kept: Path, profile: Path) -> None:
    """Keeps what a report shows in one of its parts.

    Args:
        report: HTML file.
        part: selector of the part.
        kept: picture.
        profile: folder for the browser.
    """
    with closing(Browser(report.resolve().as_uri(), profile, width=WIDTH)) as browser:
        browser.until(f"document.readyState === 'complete' && !!document.querySelector('{part}')")
        place = f"document.querySelector('{part}').getBoundingClientRect()"
        # A picture has no scroll bar, and lines are longer without.
        browser.call("Emulation.setScrollbarsHidden", hidden=True)
        top, height = (browser.evaluate(f"{place}.{name}") for name in ("top", "height"))
        clip = {"x": 0, "y": top, "width": WIDTH, "height": height, "scale": SHARP}
        shot = browser.call(
            "Page.captureScreenshot", format="png", clip=clip, captureBeyondViewport=True
        )
        kept.write_bytes(base64.b64decode(shot["data"]))


def main(diagnosis: Path, suggestion: Path) -> None:
    """Looks at the findings of a diagnosis and at the first test card of a suggestion."""
    if CHROMIUM is None:
        sys.exit("report_pictures: Chromium is not installed")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        take(diagnosis, "#findings", HERE / "diagnosis.png", folder / "diagnosis")
        take(suggestion, "article.card", HERE / "test-card.png", folder / "card")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
