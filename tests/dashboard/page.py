"""The page as a process of its own, as `gcs-sysid dashboard` serves it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def shown(folder: Path) -> Iterator[str]:
    """Serves what `listen` writes into a folder; yields the address."""
    words = [sys.executable, "-m", "gcs_sysid", "dashboard", str(folder), "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process.stdout.readline().split()[-1]
        finally:
            process.terminate()
