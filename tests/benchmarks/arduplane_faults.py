"""Faults put into a real autopilot's flight, or into its aircraft's file: what `diagnose` says.

ArduPlane's own simulation departs from the aircraft file in ways that are there already (see
`arduplane.py`): a pitot tube that lags, an airspeed 3.4 % low, forces and moments 7 % too small.
Here one fault more has to be found among them. A sensor's is written into the recorded messages, as
the simulation's own parameter (`SIM_GYR1_SCALE_X`, `SIM_ACC1_BIAS_Z`, …) would have put it there,
but for what the autopilot's filter would have made of it; an airframe's is an aircraft file that is
wrong by as much the other way. What is true of it is what the file would have to say with nothing
else put right: a thrust of 0.7 is 0.752 of one whose aircraft's mass is 7.4 % short, a moment's
derivative of 0.7 is 0.652 where the inertia is.

Four minutes of flight A, maneuvers of all kinds at 16 and 20 m/s. Some minutes a fault; what was
diagnosed before is kept in `--out`, and with `--save` rows of faults that are not asked for stay.
"""

from __future__ import annotations

import argparse
import json
import math
import struct
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.report.numbers import probability  # noqa: E402 - found from ROOT
from tests.benchmarks import table  # noqa: E402 - found from ROOT
from tests.benchmarks.arduplane import EAS2TAS, FOLDER  # noqa: E402 - found from ROOT

FROM, TO = 135.0, 366.0
"""What is kept of flight A [s since the autopilot's start]."""
OWN = ("pitot_lag", "airspeed_scale", "mass", "inertia", "surface_offset")
"""What the simulation departs in from its file without any fault (`arduplane.py`)."""
Message = Any
Change = Callable[[Message], None]


class Fault(NamedTuple):
    """What is made wrong.

    Attributes:
        cause: by its name in the catalogue.
        about: the control or stream that it is about; empty where it is about none.
        truth: of its parameters, those that are more than the simulation's own departures.
        messages: changes of messages, by type.
        file: lines of the aircraft file and what they become.
    """

    cause: str
    about: str
    truth: Mapping[str, float]
    messages: Mapping[str, Change] = {}
    file: Mapping[str, str] = {}


def _gyro_scale(message: Message) -> None:
    for axis in "xyz":
        name = f"{axis}gyro"
        setattr(message, name, round(1.05 * getattr(message, name)))


def _accelerometer_bias(message: Message) -> None:
    message.zacc = round(message.zacc + 0.6 / 9.80665 * 1000.0)


def _tilted(message: Message) -> None:
    """The unit turned by 0.07 rad about y: its x axis points down in the airframe."""
    cos, sin = math.cos(0.07), math.sin(0.07)
    for kind in ("acc", "gyro"):
        x, z = getattr(message, f"x{kind}"), getattr(message, f"z{kind}")
        setattr(message, f"x{kind}", round(cos * x - sin * z))
        setattr(message, f"z{kind}", round(sin * x + cos * z))


def _heading(message: Message) -> None:
    message.yaw = (message.yaw + 0.15 + math.pi) % (2.0 * math.pi) - math.pi


def _late(message: Message) -> None:
    """Stamped late, so that surfaces move before they are told to."""
    message.time_usec += 80_000


def _fast(message: Message) -> None:
    message.airspeed *= 1.1


class _Displaced:
    """The unit so far from where the file says that it is, which turning accelerates.

    a = ω̇ × r + ω × (ω × r), with ω̇ by central differences of what the gyros say; that is noisy, and
    slower than a real unit's (a test input of 2 Hz comes out 1 % weak at 50 Hz).

    Args:
        place: r in body axes [m].
    """

    def __init__(self, *place: float) -> None:
        self._place = np.asarray(place)
        self._added: dict[int, np.ndarray] = {}

    def __call__(self, message: Message) -> None:
        if not self._added:
            self._added = self._worked_out()
        added = self._added[message.time_usec]
        for axis, more in zip("xyz", added / 9.80665 * 1000.0, strict=True):
            name = f"{axis}acc"
            setattr(message, name, round(getattr(message, name) + more))

    def _worked_out(self) -> dict[int, np.ndarray]:
        log = mavutil.mavlink_connection(str(FOLDER / "A.tlog"), dialect="ardupilotmega")
        rates = dict[int, tuple[float, float, float]]()
        while (one := log.recv_match(type="RAW_IMU")) is not None:
            rates[one.time_usec] = one.xgyro / 1e3, one.ygyro / 1e3, one.zgyro / 1e3
        stamps, turning = np.array(list(rates)), np.array(list(rates.values()))
        change = np.gradient(turning, stamps / 1e6, axis=0)
        whirled = np.cross(turning, np.cross(turning, self._place))
        return dict(zip(rates, np.cross(change, self._place) + whirled, strict=True))


_ELEVATOR = 'surface = "elevator"\npwm = [1000, 1500, 2000]\ndeflection = '
_NEUTRAL = _ELEVATOR + "[-57.29578, 0.0, 57.29578]"
_SERVO = _NEUTRAL + "\ntime_constant = "

FAULTS: dict[str, Fault] = {
    "nothing": Fault("", "", {}),
    "gyro_scale": Fault(
        "gyro_scale",
        "",
        dict.fromkeys(("scale_x", "scale_y", "scale_z"), 0.05),
        {"RAW_IMU": _gyro_scale},
    ),
    "accelerometer_bias": Fault(
        "accelerometer_bias", "", {"bias_z": 0.6}, {"RAW_IMU": _accelerometer_bias}
    ),
    "imu_misalignment": Fault("imu_misalignment", "", {"tilt_y": 0.07}, {"RAW_IMU": _tilted}),
    "heading_bias": Fault("heading_bias", "", {"heading_bias": 0.15}, {"ATTITUDE": _heading}),
    "time_skew": Fault(
        "time_skew", "SERVO_OUTPUT_RAW", {"delay": -0.08}, {"SERVO_OUTPUT_RAW": _late}
    ),
    "airspeed_scale": Fault(
        "airspeed_scale",
        "",
        {"airspeed_scale": 1.1 * 0.9663 - 1.0},
        {"VFR_HUD": _fast, "AIRSPEED": _fast},
    ),
    "thrust_scale": Fault(
        "thrust_scale", "", {"ratio": 0.7 * EAS2TAS**2}, file={"[28.02, 28.02]": "[40.03, 40.03]"}
    ),
    "surface_effectiveness": Fault(
        "surface_effectiveness",
        "aileron",
        {"ratio": 0.7 / EAS2TAS**2},
        file={'"aileron" = 0.25': '"aileron" = 0.357'},
    ),
    "actuator_lag": Fault(
        "actuator_lag",
        "elevator",
        {"time_constant": 0.12},
        file={_SERVO + "0.14": _SERVO + "0.02"},
    ),
    "aero_derivative": Fault(
        "aero_derivative",
        "Cm.qhat",
        {"ratio": 0.7 / EAS2TAS**2},
        file={'"qhat" = -20.0': '"qhat" = -28.6'},
    ),
    "mass": Fault("mass", "", {"mass_ratio": 1.25}, file={"mass = 2.0": "mass = 1.718"}),
    "inertia": Fault(
        "inertia", "", {"Iyy_ratio": EAS2TAS**2 / 0.8}, file={"Iyy = 1.0": "Iyy = 0.8"}
    ),
    "cg_shift": Fault(
        "cg_shift",
        "",
        # What the simulation's own moment is short of looks like a twentieth of a chord more.
        {"cg_x_chord": -0.16},
        # Of an aircraft whose centre of gravity is a tenth of its chord ahead: ΔCm = 0.1 CZ.
        file={
            '"1" = -0.305': '"1" = -0.361',
            '"alpha" = -5.01': '"alpha" = -5.711',
            '"beta" = 0.328': '"beta" = 0.3405',
        },
    ),
    "surface_offset": Fault(
        "surface_offset",
        "elevator",
        {"offset": math.radians(6.0) / EAS2TAS**2 + 0.0265},
        file={_NEUTRAL: _ELEVATOR + "[-63.29578, -6.0, 51.29578]"},
    ),
    "elevator_effectiveness": Fault(
        "surface_effectiveness",
        "elevator",
        {"ratio": 0.7 / EAS2TAS**2},
        file={'"elevator" = 1.0\n': '"elevator" = 1.43\n'},
    ),
    "drag_increase": Fault(
        "drag_increase",
        "",
        {"CX0": 0.08 - 0.114 / EAS2TAS**2},
        file={'"1" = -0.114': '"1" = -0.08'},
    ),
    "asymmetry": Fault(
        "asymmetry",
        "",
        {"Cl0": -0.01},
        file={"[aerodynamics.Cl]\n": '[aerodynamics.Cl]\n"1" = 0.01\n'},
    ),
    "cross_coupling": Fault(
        "cross_coupling",
        "",
        {"Cm_beta": -1.3},
        file={"[aerodynamics.Cm]\n": '[aerodynamics.Cm]\n"beta" = 1.3\n'},
    ),
    "imu_position": Fault("imu_position", "", {"dx": 0.2}, {"RAW_IMU": _Displaced(0.2, 0.0, 0.0)}),
}


def write_flight(fault: Fault, path: Path) -> None:
    """Part of flight A with the fault in its messages."""
    log = mavutil.mavlink_connection(str(FOLDER / "A.tlog"), dialect="ardupilotmega")
    boot = -math.inf
    part = path.with_suffix(".part")
    with part.open("wb") as out:
        while (message := log.recv_msg()) is not None:
            boot = getattr(message, "time_boot_ms", 1e3 * boot) / 1e3
            frame, kind = bytes(message.get_msgbuf()), message.get_type()
            # Parameters are asked for when the ground station connects.
            if kind != "PARAM_VALUE" and not FROM <= boot <= TO:
                continue
            if kind in fault.messages:
                fault.messages[kind](message)
                frame = _packed(message)
            out.write(struct.pack(">Q", round(1e6 * message._timestamp)) + frame)
    part.replace(path)


def _packed(message: Message) -> bytes:
    sender = ardupilotmega.MAVLink(
        None, srcSystem=message.get_srcSystem(), srcComponent=message.get_srcComponent()
    )
    sender.seq = message.get_seq()
    return message.pack(sender)


def write_aircraft(fault: Fault, path: Path) -> None:
    """The aircraft file with the fault in it."""
    text = (FOLDER / "aircraft.toml").read_text(encoding="utf-8")
    for line, wrong in fault.file.items():
        if text.count(line) != 1:
            raise ValueError(f"{line!r} is not once in the aircraft file")
        text = text.replace(line, wrong)
    path.write_text(text, encoding="utf-8")


def diagnosed(name: str, out: Path) -> dict[str, Any]:
    kept = out / "diagnosis.json"
    if not kept.exists():
        out.mkdir(parents=True, exist_ok=True)
        log, aircraft = out / "flight.tlog", out / "aircraft.toml"
        write_flight(FAULTS[name], log)
        write_aircraft(FAULTS[name], aircraft)
        words = ["diagnose", log, "--aircraft", aircraft, "--out", out]
        subprocess.run([sys.executable, "-m", "gcs_sysid", *map(str, words)], check=True)
        log.unlink()
    return json.loads(kept.read_text(encoding="utf-8"))


def row(name: str, found: dict[str, Any]) -> tuple[str, ...]:
    """What is named, and how far what is found of the fault is from it."""
    fault, best = FAULTS[name], found["ranking"][0]
    named = best["causes"] if found["verdict"] == "effect" else []
    values = [
        f"{key} {best['parameters'][key]['value']:.3g} ± {best['parameters'][key]['sd']:.2g}"
        f" ({truth:.3g})"
        for key, truth in fault.truth.items()
        if key in best["parameters"] and fault.cause in named
    ]
    perhaps = ", ".join(f"{key} {probability(value)}" for key, value in found["perhaps"].items())
    return (
        " ".join((name, fault.about)).strip(),
        " + ".join(named) or found["verdict"],
        "; ".join(values),
        perhaps,
        "named" if fault.cause in named else "missed" if fault.cause else "",
        ", ".join(one for one in named if one not in (fault.cause, *OWN)),
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--faults", nargs="*", choices=FAULTS, default=list(FAULTS))
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "arduplane_faults")
    parser.add_argument("--save", action="store_true")
    asked = parser.parse_args()
    rows = [row(name, diagnosed(name, asked.out / name)) for name in asked.faults]
    table.show(
        "arduplane_faults",
        "Four minutes of ArduPlane's own simulation with one fault more: what is named",
        ("fault", "named", "found, one sd (true)", "perhaps", "the fault", "not there"),
        table.beside("arduplane_faults", rows, list(FAULTS)),
    )


if __name__ == "__main__":
    main()
