"""Messages a CPU second that the tlog reader takes, against pymavlink's on the same log."""

from __future__ import annotations

from pathlib import Path

import rate
import table
from pymavlink import mavutil

from gcs_sysid.sources import tlog
from gcs_sysid.sources.registry import open_recording

ROOT = Path(__file__).resolve().parents[2]
LOGS = (
    ROOT / "data/flights/demo.tlog",
    ROOT.parent / "shared/cases/clean/flight.tlog",
    ROOT.parent / "shared/data/umn_thor/thor_flight75.tlog",
    ROOT.parent / "shared/data/arduplane_sitl/B_lowrate.tlog",
)
ROUNDS = 5


def by_pymavlink(path: Path) -> int:
    log = mavutil.mavlink_connection(str(path), dialect="all")
    count = 0
    while log.recv_msg() is not None:
        count += 1
    log.close()
    return count


def by_us(path: Path) -> int:
    tables = tlog.read(path.read_bytes()).tables
    return sum(messages.count for messages in tables.values())


def whole(path: Path) -> int:
    return open_recording(path).vehicle.messages


def row(path: Path) -> tuple[str, int, str, str, str, str]:
    count, theirs = rate.best(by_pymavlink, path, 2)
    ours_count, ours = rate.best(by_us, path, ROUNDS)
    assert ours_count == count, f"{path}: {ours_count} messages, pymavlink {count}"
    _, finished = rate.best(whole, path, ROUNDS)
    return (
        f"{path.parent.name}/{path.name}",
        count,
        f"{theirs:,.0f}",
        f"{ours:,.0f}",
        f"{ours / theirs:.0f}",
        f"{finished:,.0f}",
    )


if __name__ == "__main__":
    table.show(
        "tlog",
        "Messages per CPU second, read from a .tlog (wanted: 10 times pymavlink, aim 30)",
        ("log", "messages", "pymavlink", "gcs-sysid", "times", "with clock and SI units"),
        [row(path) for path in LOGS if path.exists()],
    )
