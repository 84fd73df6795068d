"""The DroneCAN messages that tell of a flight, and how their fields lie in a payload.

From the public regulated data types (dronecan.github.io, `uavcan/equipment`). Bits are taken from
the most significant one of each byte on; the bytes of a field come least significant first, its
last, incomplete byte with its bits at the bottom.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8


@dataclass(frozen=True)
class Bits:
    """A field: its name, kind, and number of bits; `void` fields have no name."""

    name: str
    kind: Literal["u", "i", "f"]
    size: int


@dataclass(frozen=True)
class Layout:
    """A message type.

    Attributes:
        id: its data type id.
        name: full name in DSDL.
        signature: of the data type, which the checksum of long transfers begins with.
        fields: those that are read, in order; what follows them is not.
    """

    id: int
    name: str
    signature: int
    fields: tuple[Bits, ...]

    @property
    def length(self) -> int:
        """Bytes that hold all fields."""
        return (sum(field.size for field in self.fields) + 7) // 8


def _vector(name: str, kind: Literal["u", "i", "f"], size: int) -> tuple[Bits, ...]:
    return tuple(Bits(f"{name}_{axis}", kind, size) for axis in "xyz")


LAYOUTS: Mapping[int, Layout] = {
    one.id: one
    for one in (
        Layout(
            1003, "uavcan.equipment.ahrs.RawIMU", 0x8280632C40E574B5,
            (
                Bits("timestamp", "u", 56), Bits("integration_interval", "f", 32),
                *_vector("rate", "f", 16), *_vector("rate_integral", "f", 32),
                *_vector("acceleration", "f", 16),
            ),
        ),
        Layout(
            1011, "uavcan.equipment.actuator.Status", 0x5E9BBA44FAF1EA04,
            (Bits("actuator_id", "u", 8), Bits("position", "f", 16)),
        ),
        Layout(
            1020, "uavcan.equipment.air_data.TrueAirspeed", 0x306F69E0A591AFAA,
            (Bits("true_airspeed", "f", 16),),
        ),
        Layout(
            1021, "uavcan.equipment.air_data.IndicatedAirspeed", 0x0A1892D72AB8945F,
            (Bits("indicated_airspeed", "f", 16),),
        ),
        Layout(
            1025, "uavcan.equipment.air_data.AngleOfAttack", 0xD5513C3F7AFAC74E,
            (Bits("sensor_id", "u", 8), Bits("aoa", "f", 16)),
        ),
        Layout(
            1026, "uavcan.equipment.air_data.Sideslip", 0x7B48E55FCFF42A57,
            (Bits("sideslip_angle", "f", 16),),
        ),
        Layout(
            1027, "uavcan.equipment.air_data.RawAirData", 0xC77DF38BA122F5DA,
            (
                Bits("flags", "u", 8), Bits("static_pressure", "f", 32),
                Bits("differential_pressure", "f", 32),
            ),
        ),
        Layout(
            1028, "uavcan.equipment.air_data.StaticPressure", 0xCDC7C43412BDC89A,
            (Bits("static_pressure", "f", 32),),
        ),
        Layout(
            1029, "uavcan.equipment.air_data.StaticTemperature", 0x49272A6477D96271,
            (Bits("static_temperature", "f", 16),),
        ),
        Layout(
            1034, "uavcan.equipment.esc.Status", 0xA9AF28AEA2FBB254,
            (
                Bits("error_count", "u", 32), Bits("voltage", "f", 16), Bits("current", "f", 16),
                Bits("temperature", "f", 16), Bits("rpm", "i", 18),
                Bits("power_rating_pct", "u", 7), Bits("esc_index", "u", 5),
            ),
        ),
    )
}  # fmt: skip
"""Data type id -> layout."""


def decode(
    layout: Layout, payloads: UInt8[np.ndarray, "transfer byte"]
) -> dict[str, Float[np.ndarray, " transfer"]]:
    """Field values of many transfers of one type; each payload at least `layout.length` long."""
    bits = np.unpackbits(payloads, axis=1)
    values: dict[str, np.ndarray] = {}
    at = 0
    for field in layout.fields:
        values[field.name] = _value(field, bits[:, at : at + field.size])
        at += field.size
    return values


def _value(field: Bits, bits: UInt8[np.ndarray, "transfer bit"]) -> np.ndarray:
    number = np.zeros(bits.shape[0], dtype=np.uint64)
    for byte, first in enumerate(range(0, field.size, 8)):
        part = bits[:, first : first + 8]
        weights = (1 << np.arange(part.shape[1])[::-1]).astype(np.uint64)
        number |= (part.astype(np.uint64) @ weights) << np.uint64(8 * byte)
    if field.kind == "f":
        raw, real = (np.uint16, np.float16) if field.size == 16 else (np.uint32, np.float32)
        return number.astype(raw).view(real).astype(np.float64)
    values = number.astype(np.float64)
    if field.kind == "i":
        values = np.where(values >= 2.0 ** (field.size - 1), values - 2.0**field.size, values)
    return values
