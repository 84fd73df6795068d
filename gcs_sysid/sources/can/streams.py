"""What CAN nodes measured, as pieces of streams with the names that telemetry has."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs_sysid.sources.can.dsdl import LAYOUTS, decode
from gcs_sysid.sources.can.transfers import Transfer
from gcs_sysid.sources.joined import Piece
from gcs_sysid.sources.messages import stream_name

Values = Mapping[str, np.ndarray]

UNIT = "CAN_IMU"
"""Stream of an inertial unit on the bus. It has a name of its own, as its place is its own."""
POSITIONS = "ACTUATOR_STATUS"
AUTOPILOT, BUS = "autopilot", "can"
"""What tells two streams of one name apart, for instance `AOA_SSA[autopilot]`."""
ESTIMATES = ("AOA_SSA",)
"""Streams that an autopilot computes where nothing measures them."""
MEASURED: Mapping[int, tuple[str, Callable[[Values], dict[str, np.ndarray]]]] = {
    1003: (
        UNIT,
        lambda v: {
            **{name: v[f"rate_{axis}"] for name, axis in zip("pqr", "xyz", strict=True)},
            **{f"acc_{axis}": v[f"acceleration_{axis}"] for axis in "xyz"},
        },
    ),
    1020: ("TRUE_AIRSPEED", lambda v: {"true_airspeed": v["true_airspeed"]}),
    1021: ("AIRSPEED", lambda v: {"airspeed": v["indicated_airspeed"]}),
    1025: ("AOA_SSA", lambda v: {"alpha": v["aoa"]}),
    1026: ("AOA_SSA", lambda v: {"beta": v["sideslip_angle"]}),
    1027: (
        "SCALED_PRESSURE",
        lambda v: {
            "static_pressure": v["static_pressure"],
            "dynamic_pressure": v["differential_pressure"],
        },
    ),
    1028: ("SCALED_PRESSURE", lambda v: {"static_pressure": v["static_pressure"]}),
    1029: ("SCALED_PRESSURE", lambda v: {"temperature": v["static_temperature"]}),
}
"""Data type id -> stream, and its channels."""


@dataclass(frozen=True)
class Numbered:
    """A message that one of several nodes of a kind sends about itself.

    Attributes:
        stream: the stream that all of them share.
        index: field that numbers them.
        first: number of the one whose index is zero.
        channels: channel, without its number -> its values.
    """

    stream: str
    index: str
    first: int
    channels: Mapping[str, Callable[[Values], np.ndarray]]


NUMBERED: Mapping[int, Numbered] = {
    1011: Numbered(POSITIONS, "actuator_id", 0, {"position": lambda v: v["position"]}),
    1034: Numbered(
        "ESC_STATUS",
        "esc_index",
        1,
        {"rpm": lambda v: v["rpm"], "power": lambda v: v["voltage"] * v["current"]},
    ),
}
"""Data type id -> what it carries."""


def pieces(found: Sequence[Transfer]) -> tuple[list[Piece], int]:
    """Measurements of all nodes, and how many transfers were too short for their type."""
    result: list[Piece] = []
    short = 0
    for kind in sorted({one.type for one in found}):
        layout = LAYOUTS[kind]
        own = [one for one in found if one.type == kind]
        whole = [one for one in own if len(one.payload) >= layout.length]
        short += len(own) - len(whole)
        if not whole:
            continue
        if kind in NUMBERED:
            result += _numbered(kind, whole)
            continue
        stream, read = MEASURED[kind]
        for number, node in enumerate(sorted({one.node for one in whole})):
            theirs = [one for one in whole if one.node == node]
            time, values = _table(kind, theirs)
            result.append(Piece(stream_name(stream, number), time, read(values)))
    return result, short


def _numbered(kind: int, whole: Iterable[Transfer]) -> Iterator[Piece]:
    one = NUMBERED[kind]
    time, values = _table(kind, list(whole))
    for number in np.unique(values[one.index]).astype(int).tolist():
        mine = values[one.index] == number
        yield Piece(
            one.stream,
            time[mine],
            {f"{c}_{number + one.first}": read(values)[mine] for c, read in one.channels.items()},
        )


def _table(kind: int, whole: list[Transfer]) -> tuple[np.ndarray, Values]:
    layout = LAYOUTS[kind]
    length = layout.length
    data = np.frombuffer(b"".join(one.payload[:length] for one in whole), dtype=np.uint8)
    time = np.array([one.time_us for one in whole], dtype=np.float64)
    sort = np.argsort(time, kind="stable")
    values = decode(layout, data.reshape(-1, length)[sort])
    return time[sort], {
        name: np.where(np.isfinite(column), column, np.nan) for name, column in values.items()
    }
