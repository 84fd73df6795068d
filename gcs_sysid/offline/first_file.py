"""The text of a first aircraft file: what a log's parameters tell, and what must be filled in.

Three kinds of numbers, told apart by their comments: those that a parameter states, `ASSUMED` ones
that are usual and should be measured, and `"?"`, which only a person can know; a file that still
holds one of these is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gcs_sysid.aircraft_toml.section import quoted_text
from gcs_sysid.offline.outputs import MIXES, Motor, Outputs, Surface, controls, outputs
from gcs_sysid.recording import Recording

HEADER = """\
# First aircraft file, from the parameters in {source}.
#   "?"       must be filled in: no log knows it. The file is refused while one is left.
#   ASSUMED   usual for small aircraft: measure it, or the answer is as wrong as the assumption.
# SI units; angles in degrees, except in [aerodynamics], which is in radians.
# Body axes: x forward, y right, z down. Positions from one airframe point, about which the
# moments of [aerodynamics] are given; the centre of gravity does well.
schema = 1
name = {name}"""

MASS = """\
[mass]
mass = "?"                     # kg, as flown: weigh it with battery and payload
Ixx = "?"                      # kg·m², about the centre of gravity: swing it on two strings
Iyy = "?"                      #   (bifilar pendulum), or sum up its parts
Izz = "?"
Ixz = 0.0                      # ASSUMED: ∫xz dm
cg = [0.0, 0.0, 0.0]           # m from the airframe point; here the two are one
mass_sigma = 0.02              # ASSUMED: relative, one sigma
inertia_sigma = 0.1            # ASSUMED: relative, one sigma; 0.05 for a careful swing test

[geometry]
wing_area = "?"                # m², reference area
wing_span = "?"                # m
mean_chord = "?"               # m, mean aerodynamic chord"""

DELAY = """\
[streams.SERVO_OUTPUT_RAW]
delay = 0.02                   # ASSUMED: s from a command in the log to its servo
sigma = 0.02                   # s; identify finds the delay from the flight within this"""

SPEEDS = (
    ("AIRSPEED_MIN", "AIRSPEED_MAX"),
    ("ARSPD_FBW_MIN", "ARSPD_FBW_MAX"),
    ("FW_AIRSPD_MIN", "FW_AIRSPD_MAX"),
)
BANKS = (("ROLL_LIMIT_DEG", 1.0), ("LIM_ROLL_CD", 0.01), ("FW_R_LIM", 1.0))


@dataclass(frozen=True)
class FirstFile:
    """A first aircraft file and what is in it.

    Attributes:
        text: the file.
        surfaces, motors: names and channels found.
        missing: keys to be filled in.
        assumed: what was assumed, in words.
        notes: what else to know.
    """

    text: str
    surfaces: tuple[str, ...]
    motors: tuple[int, ...]
    missing: tuple[str, ...]
    assumed: tuple[str, ...]
    notes: tuple[str, ...]


def draft(recording: Recording) -> FirstFile:
    """The first aircraft file of the vehicle in a recording."""
    found = outputs(recording.parameters)
    notes = [*_notes(recording, found)]
    parts = [
        HEADER.format(source=recording.source, name=quoted_text(_name(recording))),
        MASS,
        _imu(recording),
        _pitot(recording),
        *_vanes(recording),
        DELAY,
        *([_servo(surface) for surface in found.surfaces] or [_no_servos(recording)]),
        *_controls(found),
        _propulsion(found.motors),
        _envelope(recording),
        "\n".join(f"# {note}" for note in notes),
    ]
    missing = ("mass.mass", "mass.Ixx", "mass.Iyy", "mass.Izz")
    missing += ("geometry.wing_area", "geometry.wing_span", "geometry.mean_chord")
    return FirstFile(
        text="\n\n".join(part for part in parts if part) + "\n",
        surfaces=tuple(f"{one.name} (output {one.channel})" for one in found.surfaces),
        motors=tuple(one.channel for one in found.motors),
        missing=missing,
        assumed=(
            *(("throw of every surface", "time constant of every servo") if found.surfaces else ()),
            "delay of servo outputs",
            "sigmas of mass and inertia",
            *(("flow angles and load factor of the envelope",) if _speeds(recording) else ()),
        ),
        notes=tuple(notes),
    )


def _name(recording: Recording) -> str:
    vehicle = recording.vehicle
    kind = vehicle.kind.removeprefix("MAV_TYPE_").replace("_", " ").lower()
    firmware = next((line for _, line in recording.texts if line.startswith("Ardu")), "")
    return f"vehicle {vehicle.system}, {kind}" + (f", {firmware}" if firmware else "")


def _imu(recording: Recording) -> str:
    place = [recording.parameters.get(f"INS_POS1_{axis}") for axis in "XYZ"]
    known = [value for value in place if value is not None]
    turned = int(
        recording.parameters.get("AHRS_ORIENTATION", recording.parameters.get("SENS_BOARD_ROT", 0))
    )
    if len(known) == 3 and any(known):
        position = f"[{', '.join(f'{value:g}' for value in known)}]"
        comment = "m from the centre of gravity: INS_POS1_X, Y, Z"
    else:
        position = "[0.0, 0.0, 0.0]"
        comment = "ASSUMED: m; measure it, 0.1 m off shows as a false accelerometer error"
    lines = ["[imu]", f"position = {position}".ljust(30) + f" # {comment}"]
    if turned:
        lines.append(
            f"# mounted as orientation {turned} says; the autopilot logs in body axes already"
        )
    return "\n".join(lines)


def _pitot(recording: Recording) -> str:
    parameters = recording.parameters
    lines = [
        "[pitot]",
        "position = [0.0, 0.0, 0.0]     # ASSUMED: m; where the tube's opening is",
        'measures = "EAS"               # indicated airspeed, as the autopilot computes it',
    ]
    kind = parameters.get("ARSPD_TYPE")
    if kind == 0.0:
        lines.append(
            "# ARSPD_TYPE is 0: there is no sensor; airspeeds are the autopilot's estimate"
        )
    if parameters.get("ARSPD_USE") == 0.0:
        lines.append("# ARSPD_USE is 0: the autopilot did not fly by this sensor")
    if "ARSPD_RATIO" in parameters:
        lines.append(
            f"# ARSPD_RATIO is {parameters['ARSPD_RATIO']:g}"
            + (", calibrated in flight (ARSPD_AUTOCAL)" if parameters.get("ARSPD_AUTOCAL") else "")
            + "; 2 is the usual one, and speed goes with its root"
        )
    scale = next((v for k, v in parameters.items() if k.startswith("ASPD_SCALE_")), None)
    if scale is not None:
        lines.append(f"# ASPD_SCALE_n is {scale:g}")
    return "\n".join(lines)


def _vanes(recording: Recording) -> list[str]:
    stream = recording.streams.get("AOA_SSA")
    if stream is None or not stream.has("alpha"):
        return []
    return [
        "# The log holds flow angles (AOA_SSA). ArduPilot computes them without vanes, from its\n"
        "# estimate of the wind, and then they are no measurement. Where vanes are fitted:\n"
        "# [vanes]\n"
        "# position = [0.3, 0.0, 0.0]\n"
        "# upwash = 0.0"
    ]


def _servo(surface: Surface) -> str:
    pwm = ", ".join(f"{value:g}" for value in surface.pwm)
    deflection = ", ".join(f"{value:.1f}" for value in surface.deflection)
    return "\n".join(
        (
            "[[servos]]",
            f"channel = {surface.channel}".ljust(30) + f" # {surface.told}",
            f"surface = {quoted_text(surface.name)}",
            f"pwm = [{pwm}]".ljust(30) + " # µs: MIN, TRIM, MAX",
            f"deflection = [{deflection}]".ljust(30) + f" # deg. ASSUMED throw; {_way(surface)}",
            "time_constant = 0.05".ljust(30) + " # ASSUMED: s",
        )
    )


def _way(surface: Surface) -> str:
    if surface.role == "aileron":
        return "positive rolls right"
    if surface.role == "rudder":
        return "positive is trailing edge left"
    return "positive is trailing edge down"


def _no_servos(recording: Recording) -> str:
    stream = recording.streams.get("SERVO_OUTPUT_RAW")
    moving = []
    if stream is not None:
        moving = [
            name.removeprefix("pwm_")
            for name, values in stream.channels.items()
            if name.startswith("pwm_") and stream.has(name) and np.nanstd(values) > 1.0
        ]
    return (
        "# No parameter in this log says what the outputs do"
        + (f"; outputs that moved: {', '.join(moving)}" if moving else "")
        + ".\n# One [[servos]] for each surface, and one [[controls]] for what it does:\n"
        "# [[servos]]\n"
        "# channel = 2\n"
        '# surface = "elevator"\n'
        "# pwm = [1000, 1500, 2000]\n"
        "# deflection = [-25.0, 0.0, 25.0]   # deg, trailing edge down positive\n"
        "# time_constant = 0.05\n"
        "# [[controls]]\n"
        '# name = "elevator"\n'
        "# mix = { elevator = 1.0 }"
    )


def _controls(found: Outputs) -> Iterator[str]:
    for name, mix in controls(found.surfaces).items():
        gains = ", ".join(f"{surface} = {gain:.4g}" for surface, gain in mix.items())
        yield f'[[controls]]\nname = "{name}"\nmix = {{ {gains} }}'


def _propulsion(motors: tuple[Motor, ...]) -> str:
    if not motors:
        return "# No output drives a motor, so no [propulsion]: CX is drag less thrust."
    lines = [
        "# Without [propulsion] CX is drag less thrust. Measure thrust on a stand, or take it from",
        "# the propeller's data, take the # away and correct the numbers:",
    ]
    for motor in motors:
        head = "[propulsion]" if len(motors) == 1 else "[[propulsion]]"
        lines += [
            f"# {head}",
            f"# throttle_channel = {motor.channel}      # {motor.told}",
            f"# pwm = [{motor.pwm[0]:g}, {motor.pwm[1]:g}]          # µs at throttle 0 and 1",
            "# axis = [1.0, 0.0, 0.0]",
            "# position = [0.3, 0.0, 0.0]    # m",
            "# time_constant = 0.1           # s",
            "# throttle = [0.0, 0.5, 1.0]",
            "# airspeed = [0.0, 15.0, 30.0]  # m/s",
            "# thrust = [[0.0, 0.0, 0.0], [8.0, 4.0, 0.0], [25.0, 18.0, 8.0]]   # N at sea level",
            "# thrust_sigma = 0.2",
        ]
    return "\n".join(lines)


def _speeds(recording: Recording) -> tuple[float, float] | None:
    for low, high in SPEEDS:
        if low in recording.parameters and high in recording.parameters:
            return recording.parameters[low], recording.parameters[high]
    return None


def _envelope(recording: Recording) -> str:
    speeds = _speeds(recording)
    if speeds is None or not 0.0 < speeds[0] < speeds[1]:
        return "# No [envelope]: nothing in the log says how slow and how fast it may fly."
    bank = next(
        (
            scale * recording.parameters[name]
            for name, scale in BANKS
            if name in recording.parameters
        ),
        None,
    )
    said = "the autopilot's limit" if bank is not None else "ASSUMED"
    return "\n".join(
        (
            "[envelope]",
            f"airspeed = [{speeds[0]:g}, {speeds[1]:g}]".ljust(30)
            + " # m/s, the autopilot's limits",
            "alpha = [-6.0, 12.0]".ljust(30) + " # ASSUMED: deg",
            "beta = [-12.0, 12.0]".ljust(30) + " # ASSUMED: deg",
            "load_factor = [-1.0, 3.0]".ljust(30) + " # ASSUMED: g",
            f"bank = {bank if bank is not None else 60.0:g}".ljust(30) + f" # deg, {said}",
            "height_min = 60.0".ljust(30) + " # ASSUMED: m above ground",
        )
    )


def _notes(recording: Recording, found: Outputs) -> Iterator[str]:
    parameters = recording.parameters
    if not parameters:
        yield (
            "the log holds no parameters: connect a ground station until it has read them all, or "
            "give the onboard log"
        )
    yield from (f"left out: {line}" for line in found.left_out)
    roles = {surface.role for surface in found.surfaces}
    if any(len(MIXES[role]) > 1 for role in roles):
        yield (
            "mixed surfaces: the autopilot's own gain between them is in the pulses already "
            f"(MIXING_GAIN {parameters.get('MIXING_GAIN', 0.5):g})"
        )
    mixed = parameters.get("KFF_RDDRMIX", 0.0)
    if mixed:
        yield (
            f"KFF_RDDRMIX is {mixed:g}: the rudder follows the ailerons; set it to 0 while "
            "testing, or the two cannot be told apart"
        )
    mapped = [
        (name, parameters.get(f"RCMAP_{name}")) for name in ("ROLL", "PITCH", "THROTTLE", "YAW")
    ]
    if any(value is not None for _, value in mapped):
        said = ", ".join(f"{name.lower()} {value:g}" for name, value in mapped if value is not None)
        yield f"the pilot's channels (RC_CHANNELS): {said}"
    trims = [parameters.get(f"AHRS_TRIM_{axis}", 0.0) for axis in "XY"]
    if any(trims):
        yield (
            f"AHRS_TRIM_X, Y are {trims[0]:g}, {trims[1]:g} rad: the autopilot takes the inertial "
            "unit as mounted that far from level"
        )
