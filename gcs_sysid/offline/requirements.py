"""What a flight must hold before anything can be identified from it, and what to do if it does not.

Each refusal is one sentence a flight-test engineer can act on before the next flight: what is
missing, why it matters, which message to ask the autopilot for and at which rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcs_sysid.aircraft import COEFFICIENTS, FORCES, Aircraft
from gcs_sysid.errors import RefusedError
from gcs_sysid.offline.asking import ask
from gcs_sysid.offline.modes import AXES, Modes, axes_of, modes
from gcs_sysid.reconstruct.airborne import Interval, airborne
from gcs_sysid.reconstruct.control_history import SERVO_STREAM, control_history
from gcs_sysid.reconstruct.measurements import (
    AIRSPEED_STREAMS,
    ALTITUDE_STREAMS,
    ATTITUDE_STREAMS,
    GYRO_STREAMS,
    IMU_STREAMS,
    PRESSURE_STREAMS,
    VELOCITY_STREAMS,
)
from gcs_sysid.recording import NO_AUTOPILOT, Recording, Stream


@dataclass(frozen=True)
class Finding:
    """Something that a flight lacks.

    Attributes:
        coefficients: which cannot be identified for it; empty for a remark.
        what: what is missing, and why it matters.
        fix: what to change before the next flight.
    """

    coefficients: tuple[str, ...]
    what: str
    fix: str

    def __str__(self) -> str:
        """Both in one line."""
        return f"{self.what}; {self.fix}"


@dataclass(frozen=True)
class Requirements:
    """What can be asked of a flight.

    Attributes:
        source: the log.
        refusals: what rules coefficients out, gravest first.
        remarks: what weakens them.
    """

    source: str
    refusals: tuple[Finding, ...]
    remarks: tuple[Finding, ...]

    @property
    def usable(self) -> dict[str, str | None]:
        """By coefficient: None where it can be identified, otherwise why not and what to change."""
        return {
            name: next((str(f) for f in self.refusals if name in f.coefficients), None)
            for name in COEFFICIENTS
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        """Everything found, a sentence each."""
        return tuple(str(finding) for finding in (*self.refusals, *self.remarks))

    @property
    def next_flight(self) -> tuple[str, ...]:
        """What to change before the next flight, each once."""
        return tuple(dict.fromkeys(f.fix for f in (*self.refusals, *self.remarks)))

    def raise_if_unusable(self) -> None:
        """Refuses the flight when no coefficient at all can be identified from it.

        Raises:
            RefusedError: with the gravest findings that together rule all coefficients out.
        """
        if any(reason is None for reason in self.usable.values()):
            return
        open_still = set(COEFFICIENTS)
        grave: list[Finding] = []
        for finding in sorted(self.refusals, key=lambda finding: -len(finding.coefficients)):
            if open_still & set(finding.coefficients):
                grave.append(finding)
                open_still -= set(finding.coefficients)
        raise RefusedError(
            self.source,
            ", and ".join(finding.what for finding in grave),
            fix=", and ".join(dict.fromkeys(finding.fix for finding in grave)),
        )


def check(recording: Recording, aircraft: Aircraft | None = None) -> Requirements:
    """What of the six coefficients this flight can be asked for.

    All need airspeed, attitude, velocity over ground, angular rate, air density and the surfaces;
    forces need an accelerometer too; each needs its axis sampled fast enough. Without an aircraft
    file the modes are guessed from the airspeed.
    """
    flights = airborne(recording, aircraft)
    controls = aircraft.control_names if aircraft is not None else ()
    refusals = [*_streams(recording, flights, controls)]
    if not flights:
        refusals.insert(0, _never_airborne(recording, aircraft))
    else:
        refusals += _surfaces(recording, aircraft)
        guess = modes(recording, aircraft, flights)
        if guess is not None:
            refusals += _rates(recording, guess, flights)
    return Requirements(
        source=recording.source,
        refusals=tuple(sorted(refusals, key=lambda finding: -len(finding.coefficients))),
        remarks=tuple(_remarks(recording, aircraft)),
    )


def _streams(
    recording: Recording, flights: tuple[Interval, ...], controls: tuple[str, ...]
) -> list[Finding]:
    """Sensors that were not recorded while airborne."""

    def missing(names: tuple[str, ...], *channels: str) -> bool:
        return not any(
            _covers(recording.streams[name], channels, flights)
            for name in names
            if name in recording.streams
        )

    found = []
    if missing(AIRSPEED_STREAMS, "airspeed"):
        found.append(
            Finding(
                COEFFICIENTS,
                "no airspeed was recorded, and every coefficient is a force over dynamic pressure",
                "fit and enable a pitot tube (ArduPilot: ARSPD_TYPE, ARSPD_USE = 1) and "
                + ask(recording, "VFR_HUD", 10.0),
            )
        )
    needs = (
        (GYRO_STREAMS, ("p", "q", "r"), "angular rate", "RAW_IMU", 50.0, COEFFICIENTS),
        (ATTITUDE_STREAMS, ("roll", "pitch", "yaw"), "attitude", "ATTITUDE", 50.0, COEFFICIENTS),
        (
            VELOCITY_STREAMS,
            ("v_north", "v_east", "v_down"),
            "velocity over ground (wind cannot be told from flow angles)",
            "GLOBAL_POSITION_INT",
            10.0,
            COEFFICIENTS,
        ),
        ((SERVO_STREAM,), (), "surface command", SERVO_STREAM, 50.0, COEFFICIENTS),
        (IMU_STREAMS, ("acc_x", "acc_y", "acc_z"), "specific force", "RAW_IMU", 50.0, FORCES),
    )
    for names, channels, what, message, rate, coefficients in needs:
        if missing(names, *channels):
            only = ": forces cannot be measured" if coefficients == FORCES else ""
            if message == SERVO_STREAM and controls:
                only = f", so nothing is known of {', '.join(controls)}"
            found.append(
                Finding(
                    coefficients,
                    f"no {what} was recorded{' in flight' if flights else ''}{only}",
                    ask(recording, message, rate),
                )
            )
    if missing(PRESSURE_STREAMS, "static_pressure") and missing(ALTITUDE_STREAMS, "altitude"):
        found.append(
            Finding(
                COEFFICIENTS,
                "neither static pressure nor altitude was recorded, so air density is unknown",
                ask(recording, "SCALED_PRESSURE", 10.0),
            )
        )
    return found


def _covers(stream: Stream, channels: tuple[str, ...], flights: tuple[Interval, ...]) -> bool:
    """Whether the channels were measured for at least a fifth of the time airborne."""
    good = np.ones(stream.count, dtype=bool)
    for channel in channels:
        good &= stream.valid(channel)
    if not flights:
        return bool(good.any())
    seconds = sum(
        np.unique(np.floor(stream.time[good & (stream.time >= a) & (stream.time <= b)])).size
        for a, b in flights
    )
    return seconds >= 0.2 * sum(b - a for a, b in flights)


def _never_airborne(recording: Recording, aircraft: Aircraft | None) -> Finding:
    stream = recording.first(AIRSPEED_STREAMS, "airspeed")
    if stream is None:
        what = "no wing-borne flight in this log"
    else:
        fastest = float(np.nanpercentile(stream.channels["airspeed"], 99.0))
        what = f"no wing-borne flight in this log: airspeed stays below {fastest:.1f} m/s"
    if aircraft is not None and aircraft.envelope is not None:
        what += f", and {aircraft.name} flies from {aircraft.envelope.airspeed[0]:.1f} m/s"
    return Finding(COEFFICIENTS, what, "give the log of a flight, or mend `[envelope] airspeed`")


def _surfaces(recording: Recording, aircraft: Aircraft | None) -> list[Finding]:
    """Controls of the aircraft file whose outputs the log lacks."""
    history = control_history(recording, aircraft)
    if history is None:
        return []
    found = []
    for name, channels in history.missing.items():
        outputs = ", ".join(f"servo{channel}" for channel in channels) or "no servo"
        if recording.vehicle.autopilot == NO_AUTOPILOT:
            found.append(_unmapped(name, channels, aircraft))
            continue
        have = sorted(
            int(channel.removeprefix("pwm_"))
            for channel in recording.streams[SERVO_STREAM].channels
            if channel.startswith("pwm_") and recording.streams[SERVO_STREAM].has(channel)
        )
        found.append(
            Finding(
                _affected(name, aircraft),
                f"`{name}` is not in the log: {SERVO_STREAM} has no {outputs} "
                f"(it has {', '.join(map(str, have)) or 'none'})",
                "check `[[servos]] channel` in the aircraft file against the autopilot's outputs",
            )
        )
    if aircraft is None and not history.surfaces:
        found.append(
            Finding(
                COEFFICIENTS,
                f"no output in {SERVO_STREAM} ever moves",
                ask(recording, SERVO_STREAM, 50.0),
            )
        )
    return found


def _unmapped(control: str, channels: tuple[int, ...], aircraft: Aircraft | None) -> Finding:
    columns = " and ".join(f"`pwm_{channel}`" for channel in channels) or "its servo"
    return Finding(
        _affected(control, aircraft),
        f"`{control}` is not in the table: the column map names no {columns}",
        "log the servo's pulse or the surface's deflection at 50 Hz and add it to the column map",
    )


def _affected(control: str, aircraft: Aircraft | None) -> tuple[str, ...]:
    """Coefficients that need a control: those whose model names it, otherwise those of its axis."""
    if aircraft is not None and aircraft.aerodynamics:
        named = tuple(
            coefficient
            for coefficient, model in aircraft.aerodynamics.items()
            if any(control in term.split("*") for term in model.terms)
        )
        if named:
            return named
    return tuple(name for axis in axes_of(control) for name in AXES[axis]) or COEFFICIENTS


def _rates(recording: Recording, guess: Modes, flights: tuple[Interval, ...]) -> list[Finding]:
    """Axes whose mode is faster than the streams that must show it."""
    gyro = rate_in_flight(recording, GYRO_STREAMS, ("p", "q", "r"), flights)
    servo = rate_in_flight(recording, (SERVO_STREAM,), (), flights)
    found = []
    for axis, (mode, frequency) in guess.by_axis.items():
        for stream, rate, message in (
            ("angular rate", gyro, "RAW_IMU"),
            ("surface commands", servo, SERVO_STREAM),
        ):
            least = guess.slowest_rate(axis)
            if 0.0 < rate < least:
                found.append(
                    Finding(
                        AXES[axis],
                        f"{stream} at {rate:.1f} Hz: the {mode} ({frequency:.1f} Hz, "
                        f"{guess.origin}) needs {least:.0f} Hz at the very least",
                        ask(recording, message, guess.wanted_rate),
                    )
                )
    return found


def rate_in_flight(
    recording: Recording,
    names: tuple[str, ...],
    channels: tuple[str, ...],
    flights: tuple[Interval, ...],
) -> float:
    """Rate [Hz] of the fastest of the streams while airborne, lost samples counted; 0 without."""
    rates = [0.0]
    for name in names:
        stream = recording.streams.get(name)
        if stream is None or not stream.has(*channels):
            continue
        inside = np.zeros(stream.count, dtype=bool)
        for start, end in flights:
            inside |= (stream.time >= start) & (stream.time <= end)
        steps = np.diff(stream.time[inside])
        steps = steps[steps > 0.0]
        if steps.size:
            rates.append(float(1.0 / np.median(steps)))
    return max(rates)


NEAR = 0.02
"""Places of the inertial unit closer to each other than this [m] count as one."""


def _unit_place(recording: Recording, aircraft: Aircraft) -> list[Finding]:
    """Whether autopilot and aircraft file agree on where the inertial unit is.

    ArduPilot gives velocity of the point from which INS_POS1_X, Y, Z are measured, and the file's
    reader takes it as that of the centre of gravity. PX4's places are not compared.
    """
    told = [recording.parameters.get(f"INS_POS1_{axis}") for axis in "XYZ"]
    place = np.array(aircraft.imu.position) - np.array(aircraft.mass.cg)
    known = np.array([value for value in told if value is not None])
    if known.size < 3 or np.linalg.norm(place - known) <= NEAR:
        return []
    written = ", ".join(f"{value:.2f}" for value in place)
    fix = f"set INS_POS1_X, Y, Z = {written}, or mend `[imu] position` in the aircraft file"
    if not known.any():
        what = (
            "INS_POS1_X, Y, Z are 0, so velocity in this log is that of the inertial unit, "
            f"{np.linalg.norm(place):.2f} m from the centre of gravity by the aircraft file; it is "
            "taken as that of the centre of gravity, and turning makes the difference"
        )
    else:
        said = ", ".join(f"{value:.2f}" for value in known)
        what = (
            f"the autopilot has the inertial unit at {said} m from the centre of gravity "
            f"(INS_POS1_X, Y, Z), the aircraft file at {written} m"
        )
    return [Finding((), what, fix)]


def _remarks(recording: Recording, aircraft: Aircraft | None) -> list[Finding]:
    found = [] if aircraft is None else _unit_place(recording, aircraft)
    if recording.parameters.get("ARSPD_TYPE") == 0.0:
        found.append(
            Finding(
                (),
                "ARSPD_TYPE is 0: this airspeed is the autopilot's own estimate, not a measurement",
                "fit a pitot tube and set ARSPD_TYPE and ARSPD_USE",
            )
        )
    if recording.others:
        systems = ", ".join(str(vehicle.system) for vehicle in recording.others)
        found.append(
            Finding(
                (),
                f"other vehicles in this log: {systems}; this is vehicle "
                f"{recording.vehicle.system}",
                "`--vehicle SYSID` chooses another",
            )
        )
    if aircraft is not None and not aircraft.propulsion:
        found.append(
            Finding(
                (),
                "the aircraft file has no thrust: CX will be drag less thrust",
                "write `[propulsion]` with a thrust table",
            )
        )
    return found
