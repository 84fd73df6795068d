"""Writes DataFlash logs, binary and text, after ArduPilot's LogStructure.h."""

from __future__ import annotations

import struct
from collections.abc import Sequence

LETTERS = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s",
    "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q",
    "Q": "Q",
}  # fmt: skip
SCALED = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 10_000_000}
UNITS = (("s", "s"), ("#", "instance"), ("d", "deg"), ("E", "rad/s"), ("o", "m/s/s"),
         ("n", "m/s"), ("P", "Pa"), ("G", "Gauss"), ("m", "m"), ("-", ""))  # fmt: skip
MULTIPLIERS = (("F", 1e-6), ("C", 1e-3), ("B", 1e-2), ("0", 1.0), ("-", 0.0))
TYPES = {
    "IMU": (130, "QBfffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T"),
    "ATT": (131, "QccC", "TimeUS,Roll,Pitch,Yaw"),
    "GPS": (132, "QBBIHLLefff", "TimeUS,I,Status,GMS,GWk,Lat,Lng,Alt,Spd,GCrs,VZ"),
    "PARM": (133, "QNf", "TimeUS,Name,Value"),
    "MSG": (134, "QZ", "TimeUS,Message"),
    "RCOU": (135, "QHHH", "TimeUS,C1,C2,C3"),
    "MAG": (136, "QBhhh", "TimeUS,I,MagX,MagY,MagZ"),
    "ESC": (137, "QBf", "TimeUS,Instance,RPM"),
    "XKF1": (138, "QBfff", "TimeUS,C,VN,VE,VD"),
    "XKF4": (139, "QBb", "TimeUS,C,PI"),
    "POS": (140, "QLLff", "TimeUS,Lat,Lng,Alt,RelHomeAlt"),
    "DSF": (141, "QI", "TimeUS,Dp"),
    "ARSP": (142, "QBfB", "TimeUS,I,Airspeed,H"),
    "VIBE": (143, "Qf", "TimeUS,VibeX"),
    "FMTU": (144, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    "UNIT": (145, "QbZ", "TimeUS,Id,Label"),
    "MULT": (146, "Qbd", "TimeUS,Id,Mult"),
    "BARO": (148, "QBff", "TimeUS,I,Alt,Press"),
    "AOA": (149, "Qff", "TimeUS,AOA,SSA"),
    "AETR": (147, "Qffff", "TimeUS,Ail,Elev,Thr,Rudd"),
}


def _sizes(letters: str) -> int:
    return 3 + struct.calcsize("<" + "".join(LETTERS[c] for c in letters))


class Dataflash:
    """A log in memory; `binary` and `text` are the same messages in either form."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.lines: list[str] = []
        self._fmt("FMT", 128, "BBnNZ", "Type,Length,Name,Format,Columns", 89)
        for name, (number, letters, columns) in TYPES.items():
            self._fmt(name, number, letters, columns, _sizes(letters))

    def _fmt(self, name: str, number: int, letters: str, columns: str, length: int) -> None:
        fields = (number, length, name.encode(), letters.encode(), columns.encode())
        self.frames.append(b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *fields))
        self.lines.append(f"FMT, {number}, {length}, {name}, {letters}, {columns}")

    def units(self, name: str, unit_ids: str, multiplier_ids: str) -> Dataflash:
        """Says in which units the fields of a type are."""
        for letter, label in UNITS:
            self.add("UNIT", 1, ord(letter), label)
        for letter, value in MULTIPLIERS:
            self.add("MULT", 1, ord(letter), value)
        return self.add("FMTU", 1, TYPES[name][0], unit_ids, multiplier_ids)

    def add(self, name: str, *values: object) -> Dataflash:
        """Adds a message, its values in the units of the format's letters applied."""
        number, letters, _ = TYPES[name]
        packed: list[object] = []
        shown: list[str] = []
        for letter, value in zip(letters, values, strict=True):
            scale = SCALED.get(letter)
            if isinstance(value, str):
                packed.append(value.encode())
            else:
                packed.append(round(value * scale) if scale else value)  # ty: ignore
            shown.append(str(value))
        body = struct.pack("<" + "".join(LETTERS[c] for c in letters), *packed)
        self.frames.append(b"\xa3\x95" + bytes([number]) + body)
        self.lines.append(", ".join([name, *shown]))
        return self

    @property
    def binary(self) -> bytes:
        return b"".join(self.frames)

    @property
    def text(self) -> bytes:
        return ("\n".join(self.lines) + "\n").encode()


def flight(seconds: float = 2.0, *, parameters: Sequence[tuple[str, float]] = ()) -> Dataflash:
    """A short flight: 100 Hz inertial data, the rest slower."""
    log = Dataflash()
    log.add("MSG", 1_000_000, "ArduPlane V4.6.3, made here")
    for name, value in parameters:
        log.add("PARM", 1_000_000, name, value)
    for i in range(int(100 * seconds)):
        t = 1_000_000 + 10_000 * i
        for unit in (0, 1):
            log.add("IMU", t, unit, 0.01 * i, 0.0, 0.5, 0.25 * unit, 0.0, -9.75, 25.5)
        if i % 2 == 0:
            log.add("ATT", t, 10.25, -5.5, 350.0)
            log.add("RCOU", t, 1500 + i, 1100, 0)
            for core in (0, 1):
                log.add("XKF1", t + 40, core, 20.0 + core, 1.0, -0.5)
            log.add("POS", t, -35.3, 149.1, 600.0, 16.0)
        if i % 10 == 0:
            log.add(
                "GPS", t, 0, 3, 574_670_200 + 10 * i, 2445, -35.3, 149.1, 584.0, 20.0, 90.0, 1.5
            )
            log.add("MAG", t, 0, 224, 80, -528)
            log.add("ESC", t, 5, 7000.0)
            log.add("ARSP", t, 0, 21.5, 1)
            log.add("XKF4", t, 0, 1)
            log.add("AETR", t, 4500.0, -2250.0, 40.0, 0.0)
            log.add("VIBE", t, 0.5)
    return log
