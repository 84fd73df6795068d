"""What pages that follow cost the filter's latency: none, then five, in turns on one flight.

`gcs-sysid listen` is fed as in `bench_live`; `gcs-sysid dashboard` serves its folder, and clients
in a process of their own read its stream of documents as pages do. `--seconds N` is the length of a
turn; the percentiles are those of the newest 4096 updates at its end.
"""

from __future__ import annotations

import http.client
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import table
from bench_live import PATIENCE_S, Listener, fed, listening
from live_feed import Feed

SECONDS = 45.0
"""At 100 updates a second the newest 4096 are all of one turn."""
TURNS = 3
CLIENTS = 5
_FOLLOW = "--follow"


def follow(port: int, clients: int) -> None:
    """Reads the stream of documents in so many clients, and tells at the end how many each got."""
    counts = [0] * clients

    def read(number: int) -> None:
        connection = http.client.HTTPConnection("127.0.0.1", port)
        connection.request("GET", "/events")
        with connection.getresponse() as answer:
            for line in answer:
                counts[number] += line.startswith(b"data: ")

    for number in range(clients):
        threading.Thread(target=read, args=(number,), daemon=True).start()
    sys.stdin.read()
    print(min(counts))


@contextmanager
def followed(folder: Path) -> Generator[list[int], None, None]:
    """Pages open meanwhile; yields a list that holds the documents of the poorest afterwards."""
    got: list[int] = []
    pipes = {"stdout": subprocess.PIPE, "text": True}
    program = [sys.executable, "-m", "gcs_sysid", "dashboard", str(folder), "--port", "0"]
    with subprocess.Popen(program, **pipes) as page:
        try:
            port = re.search(r":(\d+)/", page.stdout.readline())[1]
            readers = [sys.executable, __file__, _FOLLOW, port]
            with subprocess.Popen(readers, stdin=subprocess.PIPE, **pipes) as clients:
                yield got
                got.append(int(clients.communicate("")[0]))
        finally:
            page.terminate()


@contextmanager
def fed_meanwhile(send: Callable[[bytes], object]) -> Generator[None, None, None]:
    """Feeds in a thread of its own: what waits here must not make a burst of frames there."""
    enough = threading.Event()

    def feed() -> None:
        for _ in fed(Feed().frames(), send):
            if enough.is_set():
                return

    thread = threading.Thread(target=feed)
    thread.start()
    try:
        yield
    finally:
        enough.set()
        thread.join()


def turn(listener: Listener, seconds: float) -> tuple[str, str, str]:
    """Latency, and processor time of the listener, over a turn of the feed."""
    cpu, begun = listener.cpu(), time.monotonic()
    time.sleep(seconds)
    used = (listener.cpu() - cpu) / (time.monotonic() - begun)
    found = listener.live()["latency"]["packet_to_update"]
    return f"{found['p50_ms']:.1f} ms", f"{found['p99_ms']:.1f} ms", f"{100.0 * used:.0f} %"


def measured(seconds: float) -> list[tuple[str, ...]]:
    rows = []
    with listening() as (listener, send), fed_meanwhile(send):
        until = time.monotonic() + PATIENCE_S
        while not listener.live().get("state"):
            assert time.monotonic() < until, "no estimate"
            time.sleep(0.2)
        for number in range(1, TURNS + 1):
            rows.append((f"{number}", "none", *turn(listener, seconds), ""))
            with followed(listener.folder) as got:
                beside = turn(listener, seconds)
            rows.append((f"{number}", f"{CLIENTS}", *beside, f"{got[0]}"))
    return rows


if __name__ == "__main__":
    if _FOLLOW in sys.argv:
        follow(int(sys.argv[-1]), CLIENTS)
        sys.exit()
    words = sys.argv
    length = float(words[words.index("--seconds") + 1]) if "--seconds" in words else SECONDS
    table.show(
        "live_clients",
        f"Listening to 340 messages a second without and with pages that follow, in turns of "
        f"{length:.0f} s; packet to update, and of one core by the listener alone",
        ("turn", "pages", "p50", "p99", "of one core", "documents that the poorest got"),
        measured(length),
    )
