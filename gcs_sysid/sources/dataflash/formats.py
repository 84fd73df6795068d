"""How the messages of a DataFlash log lie in it, as the log itself says.

Every type is described by an `FMT` message: number, length with its header of three bytes, name, a
letter for each field, field names. `FMTU`, `UNIT` and `MULT` add the unit of each field and the
power of ten that integers are scaled by. Letters and their meaning: ArduPilot,
libraries/AP_Logger, LogStructure.h.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

HEADER = 3
"""Bytes before the fields of a message: 0xA3, 0x95, type."""
FMT_TYPE = 0x80
FMT_LENGTH = 89

LETTERS: Mapping[str, str | tuple] = {
    "a": ("<i2", (32,)),
    "b": "i1",
    "B": "u1",
    "g": "<f2",
    "h": "<i2",
    "H": "<u2",
    "i": "<i4",
    "I": "<u4",
    "f": "<f4",
    "d": "<f8",
    "n": "S4",
    "N": "S16",
    "Z": "S64",
    "c": "<i2",
    "C": "<u2",
    "e": "<i4",
    "E": "<u4",
    "L": "<i4",
    "M": "u1",
    "q": "<i8",
    "Q": "<u8",
}
"""Letter of a field -> its NumPy type."""
SCALED: Mapping[str, float] = {"c": 1e-2, "C": 1e-2, "e": 1e-2, "E": 1e-2, "L": 1e-7}
"""Letters that say by themselves what one in the field is worth."""
TEXT = "nNZ"
_INSTANCES = ("I", "C", "Inst", "Instance", "IMU")
"""Fields that tell sensors of one kind apart, where the log does not say which one does."""


@dataclass(frozen=True)
class Format:
    """One message type.

    Attributes:
        type: its number.
        name: its name.
        letters: one a field.
        fields: names of the fields.
        units: unit of each field as `UNIT` names it, for instance `deg/s`; empty where not told.
        multipliers: what one in each field is worth in that unit, letters aside; NaN where not
            told.
    """

    type: int
    name: str
    letters: str
    fields: tuple[str, ...]
    units: tuple[str, ...] = ()
    multipliers: tuple[float, ...] = ()
    dtype: np.dtype = field(init=False, compare=False)

    def __post_init__(self) -> None:
        kinds = [(name, LETTERS[c]) for name, c in zip(self.fields, self.letters, strict=True)]
        flat = [(n, *k) if isinstance(k, tuple) else (n, k) for n, k in kinds]
        object.__setattr__(self, "dtype", np.dtype(flat))

    @property
    def length(self) -> int:
        """Bytes of one message, header included."""
        return HEADER + self.dtype.itemsize

    @property
    def instance(self) -> str | None:
        """The field that tells several sensors of one kind apart; None without one."""
        for name, unit in zip(self.fields, self.units, strict=False):
            if unit == "instance":
                return name
        found = [name for name in _INSTANCES if name in self.fields]
        return found[0] if found else None

    def unit(self, name: str) -> str:
        """Unit of a field as the log states it; empty where it does not."""
        at = self.fields.index(name)
        return self.units[at] if at < len(self.units) else ""

    def scale(self, name: str) -> float:
        """What one in a field is worth in its unit."""
        at = self.fields.index(name)
        if self.letters[at] in SCALED:
            return SCALED[self.letters[at]]
        known = self.multipliers[at] if at < len(self.multipliers) else float("nan")
        return known if np.isfinite(known) else 1.0


FMT = Format(FMT_TYPE, "FMT", "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))


def described(number: int, length: int, name: str, letters: str, columns: str) -> Format | None:
    """The format that an `FMT` message describes; None if it contradicts itself."""
    fields = tuple(columns.split(",")) if columns else ()
    known = all(letter in LETTERS for letter in letters)
    if not name or not known or len(letters) != len(fields) or len(set(fields)) != len(fields):
        return None
    if not all(name.isascii() and name.isprintable() and name for name in fields):
        return None
    found = Format(number, name, letters, fields)
    return found if found.length == length and length <= 255 else None


def plain_text(value: bytes) -> str:
    """A text field up to its terminating zero."""
    return value.split(b"\0")[0].decode("utf-8", "replace")


def with_units(
    format_: Format, unit_ids: str, multiplier_ids: str, units: Mapping, multipliers: Mapping
) -> Format:
    """A format with what `FMTU` says of it, by the letters of `UNIT` and `MULT`."""
    return replace(
        format_,
        units=tuple(units.get(letter, "") for letter in unit_ids[: len(format_.fields)]),
        multipliers=tuple(
            _multiplier(multipliers.get(letter)) for letter in multiplier_ids[: len(format_.fields)]
        ),
    )


def _multiplier(value: float | None) -> float:
    # `-` (no multiplier) is sent as zero; powers of ten went through a 32-bit number.
    return float("nan") if not value else float(f"{value:.6g}")
