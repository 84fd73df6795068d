"""Flights identified once and shared by all tests of the runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from gcs_sysid.offline import flight, identify
from gcs_sysid.reconstruct.measurements import FlightData

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "data" / "flights" / "demo.tlog"
SECOND = ROOT / "data" / "flights" / "demo_second.tlog"
AIRCRAFT = ROOT / "data" / "aircraft" / "ultra_stick_25e.toml"


@dataclass(frozen=True)
class Identified:
    """What one run of `identify` returned and left."""

    summary: dict[str, Any]
    out: Path

    @property
    def table(self) -> dict[str, np.ndarray]:
        columns = pq.read_table(self.out / "samples.parquet")
        return {name: columns[name].to_numpy() for name in columns.column_names}


def silent(text: str, share: float) -> None:
    """Progress that nobody watches."""


def run(logs: list[Path], out: Path, **changes: Any) -> Identified:
    """`identify` without prior, and by least squares (seconds) where a test does not say how."""
    options = {
        "prior": "none", "segments": None, "vehicle": None, "stepwise": False,
        "aircraft": AIRCRAFT, "method": "equation-error",
    } | changes  # fmt: skip
    aircraft = options.pop("aircraft")
    return Identified(identify.run(logs, aircraft, out=out, progress=silent, **options), out)


def beginning(log: Path, share: float, path: Path) -> Path:
    """The first part of a log, cut in the middle of a message as a lost link would."""
    data = log.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    return path


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Identified:
    """The bundled flight."""
    return run([DEMO], tmp_path_factory.mktemp("demo"))


@pytest.fixture(scope="session")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first minute of it."""
    return beginning(DEMO, 0.25, tmp_path_factory.mktemp("short") / "short.tlog")


@pytest.fixture(scope="session")
def short_run(short: Path) -> Identified:
    return run([short], short.parent / "first")


@pytest.fixture(scope="module")
def reconstructed_once() -> Iterator[None]:
    """Within a module, a flight already reconstructed is not reconstructed again."""
    seen: dict[bytes, Any] = {}
    once = flight.reconstruct

    def remembered(data: FlightData, aircraft: Any) -> Any:
        key = data.gyro.tobytes()
        if key not in seen:
            seen[key] = once(data, aircraft)
        return seen[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flight, "reconstruct", remembered)
        yield
