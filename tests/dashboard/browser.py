"""A page in headless Chromium, driven over a pipe (Chrome DevTools Protocol)."""

from __future__ import annotations

import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
PATIENCE_S = 60.0


class Browser:
    """One open page; close it."""

    def __init__(self, url: str, profile: Path, *, width: int = 1280, height: int = 1600) -> None:
        (theirs, self._out), (self._in, back) = os.pipe(), os.pipe()
        words = [
            str(CHROMIUM), "--headless=new", "--no-sandbox", "--disable-gpu",
            "--remote-debugging-pipe", f"--user-data-dir={profile}",
        ]  # fmt: skip
        # The browser reads its pipe as descriptor 3 and writes to 4, which must be free for it.
        ends = theirs, back
        theirs, back = (fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (theirs, back))
        script = f'exec 3<&{theirs} 4>&{back} {theirs}<&- {back}>&-; exec "$@"'
        self._process = subprocess.Popen(
            ["bash", "-c", script, "bash", *words],
            pass_fds=(theirs, back),
            stderr=subprocess.DEVNULL,
        )
        for end in (*ends, theirs, back):
            os.close(end)
        self._rest, self._number = b"", 0
        self._session = ""
        try:
            self._open(url, width, height)
        except BaseException:
            self.close()
            raise

    def _open(self, url: str, width: int, height: int) -> None:
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)[
            "sessionId"
        ]
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )
        self.call("Page.navigate", url=url)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self._rest:
                ready, _, _ = select.select([self._in], [], [], PATIENCE_S)
                assert ready, "the browser does not answer"
                piece = os.read(self._in, 65536)
                assert piece, "the browser is gone"
                self._rest += piece
            line, _, self._rest = self._rest.partition(b"\0")
            answer = json.loads(line)
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def evaluate(self, expression: str) -> Any:
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        return answer["result"].get("value")

    def until(self, expression: str) -> None:
        """Waits until an expression is true."""
        until = time.monotonic() + PATIENCE_S
        while not self.evaluate(expression):
            assert time.monotonic() < until, f"never: {expression}"
            time.sleep(0.1)

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(PATIENCE_S)
        os.close(self._in)
        os.close(self._out)
