"""Messages a CPU second that the DataFlash reader takes, against pymavlink's on the same log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rate
import table
from pymavlink import DFReader

from gcs_sysid.sources.dataflash import binary
from gcs_sysid.sources.registry import open_recording

ROOT = Path(__file__).resolve().parents[2]
LOGS = (ROOT.parent / "shared/data/arduplane_sitl/B_first_part.BIN",)
ROUNDS = 5


def by_pymavlink(path: Path) -> int:
    """Messages only: pymavlink converts their values when they are looked at."""
    log = DFReader.DFReader_binary(str(path))
    count = 0
    while log.recv_msg() is not None:
        count += 1
    return count


def with_values(path: Path) -> int:
    log = DFReader.DFReader_binary(str(path))
    count = 0
    while (message := log.recv_msg()) is not None:
        message.to_dict()
        count += 1
    return count


def by_us(path: Path) -> int:
    return binary.read(np.memmap(path, dtype=np.uint8, mode="r")).count


def whole(path: Path) -> int:
    return open_recording(path).vehicle.messages


def row(path: Path) -> tuple[str, int, str, str, str, str, str]:
    count, theirs = rate.best(by_pymavlink, path, 2)
    _, converted = rate.best(with_values, path, 1)
    ours_count, ours = rate.best(by_us, path, ROUNDS)
    assert ours_count == count, f"{path}: {ours_count} messages, pymavlink {count}"
    _, finished = rate.best(whole, path, ROUNDS)
    return (
        f"{path.parent.name}/{path.name}",
        count,
        f"{theirs:,.0f}",
        f"{converted:,.0f}",
        f"{ours:,.0f}",
        f"{ours / theirs:.0f} and {ours / converted:.0f}",
        f"{finished:,.0f}",
    )


if __name__ == "__main__":
    table.show(
        "dataflash",
        "Messages per CPU second, read from a DataFlash .bin (wanted: 10 times pymavlink, aim 30)",
        (
            "log",
            "messages",
            "pymavlink, messages",
            "pymavlink, values",
            "gcs-sysid",
            "times",
            "with clock and SI units",
        ),
        [row(path) for path in LOGS if path.exists()],
    )
