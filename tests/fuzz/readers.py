"""Coverage-guided fuzzing of every reader of logs: `python -m tests.fuzz.readers --seconds 60`.

Inputs that reach lines of a reader which none before reached are kept and damaged further: bytes
flipped, cut out, repeated, moved, overwritten by numbers that are often mishandled. A reader must
give a Recording whose times do not fall, or one line that says why not, within time and memory. An
input that breaks this is written to `out/fuzz/`.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any

import numpy as np

import gcs_sysid.sources
from gcs_sysid.errors import InputError
from gcs_sysid.sources.can import files, streams, transfers
from gcs_sysid.sources.registry import open_recording
from tests.sources.can.made_can import Bus
from tests.sources.conftest import Writer
from tests.sources.made_dataflash import flight as dataflash
from tests.sources.made_ulog import flight as ulog

LONGEST_S = 10
MEMORY = 4 << 30
KEPT = Path("out/fuzz")
_CODE = str(Path(gcs_sysid.sources.__file__).parent)
_NUMBERS = (b"\0" * 8, b"\xff" * 8, b"\x80" + b"\0" * 7, b"\xff" * 7 + b"\x7f", b"\xfd", b"\xfe")
COLUMNS = 'time = { name = "t", unit = "s" }\np = { name = "p", unit = "rad/s" }\n'

Lines = set[tuple[int, int]]


def telemetry() -> bytes:
    log = Writer().heartbeat(0)
    for i in range(20):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=5000 + 20 * i, roll=0.1)
        log.add(20_000 * i, "RAW_IMU", time_usec=5_000_000 + 20_000 * i, zacc=-1000)
        log.add(20_000 * i, "SYSTEM_TIME", time_boot_ms=5000, time_unix_usec=10**15 + i)
        log.add(20_000 * i, "PARAM_VALUE", param_id=b"ARSPD_RATIO", param_value=2.0)
        log.add(20_000 * i, "CAN_FRAME", id=0x90000000 | 1025 << 8 | 42, len=6, data=[192] * 8)
    return log.data


def bus(folder: Path, suffix: str) -> bytes:
    log = Bus()
    for i in range(20):
        log.send(0.02 * i, "air_data.AngleOfAttack", sensor_id=254, aoa=0.1)
        log.send(0.02 * i, "ahrs.RawIMU", rate_gyro_latest=[0.1, 0.2, 0.3])
        log.send(0.02 * i, "esc.Status", esc_index=1, rpm=7000)
    return log.save(folder / f"seed{suffix}").read_bytes()


def check_log(path: Path) -> None:
    """A Recording whose times do not fall."""
    found = open_recording(path, columns=path.with_name("map.toml"))
    for stream in found.streams.values():
        assert np.all(np.isfinite(stream.time)), stream.name
        assert np.all(np.diff(stream.time) >= 0.0), stream.name


def check_can(path: Path) -> None:
    found, _ = transfers.transfers(files.frames(path))
    streams.pieces(found)


def damaged(data: bytes, other: bytes, chance: Random) -> bytes:
    """One to eight mutations of an input; `other` lends pieces."""
    result = bytearray(data)
    for _ in range(chance.randint(1, 8)):
        if not result:
            return bytes(other)
        at, length = chance.randrange(len(result)), chance.choice((1, 2, 4, 8, 60, 300))
        match chance.randrange(6):
            case 0:
                result[at] ^= 1 << chance.randrange(8)
            case 1:
                result[at] = chance.randrange(256)
            case 2:
                del result[at : at + length]
            case 3:
                result[at:at] = result[at : at + length]
            case 4:
                number = chance.choice(_NUMBERS)
                result[at : at + len(number)] = number
            case 5:
                place = chance.randrange(len(other))
                result[at:at] = other[place : place + length]
    return bytes(result[: 4 * len(data) + 4096])


@contextlib.contextmanager
def traced(lines: Lines) -> Iterator[None]:
    """Collects lines of the readers that run."""

    def line(frame: FrameType, event: str, _argument: Any) -> Any:
        if event == "line":
            lines.add((id(frame.f_code), frame.f_lineno))
        return line

    def call(frame: FrameType, _event: str, _argument: Any) -> Any:
        return line if frame.f_code.co_filename.startswith(_CODE) else None

    sys.settrace(call)
    try:
        yield
    finally:
        sys.settrace(None)


def attempt(check: Callable[[Path], None], path: Path, data: bytes) -> tuple[Lines, str | None]:
    """Lines that an input reaches, and what is wrong, if anything."""
    path.write_bytes(data)
    lines: Lines = set()
    signal.alarm(LONGEST_S)
    try:
        with traced(lines):
            check(path)
    except InputError as error:
        return lines, None if "\n" not in str(error) else f"two lines: {error}"
    except Exception:  # noqa: BLE001 - whatever it is, it is what is looked for
        return lines, traceback.format_exc()
    finally:
        signal.alarm(0)
    return lines, None


def fuzz(name: str, seed: bytes, check: Callable[[Path], None], folder: Path, seconds: int) -> int:
    """Fuzzes one reader; returns how many inputs broke it."""
    path = folder / f"input{name}"
    corpus, seen, tried, broken = [seed], set(), 0, 0
    chance = Random(name)
    until = time.monotonic() + seconds
    data = seed
    while time.monotonic() < until and broken < 3:
        lines, wrong = attempt(check, path, data)
        tried += 1
        if wrong is not None:
            broken += 1
            KEPT.mkdir(parents=True, exist_ok=True)
            kept = KEPT / f"{tried}{name}"
            kept.write_bytes(data)
            sys.stdout.write(f"{kept}:\n{wrong}\n")
        elif not lines <= seen:
            seen |= lines
            corpus.append(data)
        data = damaged(chance.choice(corpus), chance.choice(corpus), chance)
    sys.stdout.write(
        f"{name:<9} {tried:6d} inputs, {len(corpus):4d} kept, {len(seen):5d} lines, "
        f"{broken} broke it\n"
    )
    return broken


def _too_long(_signal: int, _frame: object) -> None:
    raise TimeoutError(f"more than {LONGEST_S} s")


def main() -> int:
    """Fuzzes all readers in turn; the exit status is 1 if an input broke one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60, help="for each reader")
    seconds = parser.parse_args().seconds
    signal.signal(signal.SIGALRM, _too_long)
    logging.disable(logging.CRITICAL)  # python-can says of every odd byte what it thinks of it
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "map.toml").write_text(COLUMNS)
        rows = "".join(f"{0.02 * i},{0.1 * i}\n" for i in range(50))
        seeds: dict[str, tuple[bytes, Callable[[Path], None]]] = {
            ".tlog": (telemetry(), check_log),
            ".bin": (dataflash(0.2).binary, check_log),
            ".log": (dataflash(0.2).text, check_log),
            ".ulg": (ulog(0.1).data, check_log),
            ".csv": (f"t,p\n{rows}".encode(), check_log),
            ".asc": (bus(folder, ".asc"), check_can),
            ".blf": (bus(folder, ".blf"), check_can),
        }
        broken = [fuzz(kind, *seed, folder, seconds) for kind, seed in seeds.items()]
    return int(any(broken))


if __name__ == "__main__":
    sys.exit(main())
