"""Memory that is free goes back to the system."""

from __future__ import annotations

import subprocess
import sys

import pytest

from gcs_sysid.live import heap

FREED = """
import os
from pathlib import Path
from gcs_sysid.live import heap

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

# Small pieces come from the heap, where the last one holds up all before it.
kept = [bytearray(20_000) for _ in range(2000)]
last = bytearray(20_000)
del kept
before = resident()
heap.give_back()
print(before - resident())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of glibc")
def test_what_is_free_goes_back_from_below_what_is_not() -> None:
    done = subprocess.run(
        [sys.executable, "-c", FREED], capture_output=True, text=True, timeout=60, check=True
    )
    assert float(done.stdout) > 25.0  # of 38 MB


def test_without_that_library_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise OSError(name)

    monkeypatch.setattr(heap.ctypes, "CDLL", absent)
    heap.give_back()
