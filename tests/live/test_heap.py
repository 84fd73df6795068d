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


SHARED = """
import ctypes, sys, threading
from gcs_sysid.live import heap

if sys.argv[1] == "shared":
    heap.share()
library = ctypes.CDLL("libc.so.6")
library.malloc.restype = ctypes.c_void_p
places, all_at_once = [], threading.Barrier(8)

def take():
    places.append(library.malloc(1000))
    all_at_once.wait()  # an area is handed on when its thread ends

threads = [threading.Thread(target=take) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(len({place >> 26 for place in places}))  # areas are 64 MB each
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of glibc")
def test_threads_share_two_areas() -> None:
    areas = {
        how: int(subprocess.check_output([sys.executable, "-c", SHARED, how], timeout=60))
        for how in ("shared", "alone")
    }
    assert areas["shared"] <= 2 < areas["alone"]


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
    heap.share()
