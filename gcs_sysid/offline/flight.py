"""From one recorded flight to measured coefficients: the part that all runs share."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft, Propulsion, StreamTiming
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate import coefficients
from gcs_sysid.estimate.coefficients import Samples, Thrust
from gcs_sysid.estimate.surface_delay import Delay, surface_delay
from gcs_sysid.model import actuators, propulsion
from gcs_sysid.offline import requirements
from gcs_sysid.offline.measured_surfaces import in_place_of_commands
from gcs_sysid.offline.servo_outputs import control_channels, known, pulses
from gcs_sysid.reconstruct import compatibility, measurements, saturation
from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.reconstruct.compatibility import Compatibility
from gcs_sysid.reconstruct.control_history import SERVO_STREAM
from gcs_sysid.reconstruct.measurements import FlightData
from gcs_sysid.reconstruct.reconstruction import Reconstruction, States, reconstruct
from gcs_sysid.reconstruct.segments import INPUTS, Segment
from gcs_sysid.recording import Recording, gaps
from gcs_sysid.sources.registry import open_recording

RPM_STREAMS = ("RPM", "ESC_TELEMETRY_1_TO_4", "ESC_STATUS")
HOLE = 3.5
BESIDE = 0.2
"""Around a hole of more than `HOLE` samples, this much flight [s] on both sides is not used."""
SHORTEST_INPUTS = 15.0
"""Deliberate inputs shorter than this in all [s] do not tell a delay by themselves."""
CLOSED_LOOP = 0.03
"""What an autopilot that answers gusts may feign of a delay where nothing else moves the surfaces
[s]: with gusts alone behind every deflection, a made flight of 60 ms gave -5 ms."""
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Flight:
    """One flight, read, reconstructed and measured.

    Attributes:
        recording: its telemetry.
        aircraft: as flown: what was measured of the surfaces is no longer looked up, controls
            whose servo outputs the log lacks are taken out.
        absent: controls whose servo outputs the log lacks.
        segments: its maneuvers.
        airborne: length of wing-borne flight [s].
        reconstruction: states, wind, sensor errors.
        compatibility: whether the sensors agree.
        delay: of the surfaces behind the servo commands.
        samples: measured coefficients.
        warnings: what the engineer should know.
        read_seconds: wall time spent on reading.
        reconstruct_seconds: wall time spent on reconstruction.
    """

    recording: Recording
    aircraft: Aircraft
    absent: tuple[str, ...]
    segments: tuple[Segment, ...]
    airborne: float
    reconstruction: Reconstruction
    compatibility: Compatibility
    delay: Delay
    samples: Samples
    warnings: tuple[str, ...]
    read_seconds: float
    reconstruct_seconds: float

    def pieces(self, kept: Sequence[int] | None = None) -> Int[np.ndarray, " sample"]:
        """Id of the maneuver each sample belongs to; -1 outside, or not among `kept`.

        Samples next to a hole in the telemetry are left out, and those after a silence of the servo
        stream in which a command changed: neither the angular acceleration nor the surfaces are
        known there.
        """
        piece = np.full(self.samples.time.size, -1)
        for segment in self.segments:
            if kept is None or segment.id in kept:
                inside = (self.samples.time >= segment.start) & (self.samples.time < segment.end)
                piece[inside] = segment.id
        return np.where(_unknown(self.recording, self.aircraft, self.samples.time), -1, piece)


def _unknown(
    recording: Recording, aircraft: Aircraft, time: Float[np.ndarray, " sample"]
) -> Bool[np.ndarray, " sample"]:
    """Samples at which the motion is not known, or where surfaces stand and what engines do."""
    before = np.concatenate([time[:1], time[:-1]])
    return beside_holes(time) | ~known(recording, aircraft, before, time)


def beside_holes(time: Float[np.ndarray, " sample"]) -> Bool[np.ndarray, " sample"]:
    """Samples less than `BESIDE` before or after a hole of more than `HOLE` sample intervals."""
    steps = np.diff(time)
    holes = np.flatnonzero(steps > HOLE * np.median(steps))
    edges = np.concatenate([[-np.inf], time[holes], time[holes + 1], [np.inf]])
    edges.sort()
    after = np.searchsorted(edges, time, side="right")
    nearest = np.minimum(time - edges[after - 1], edges[np.minimum(after, edges.size - 1)] - time)
    return nearest < BESIDE


def read(
    path: Path,
    aircraft: Aircraft,
    *,
    vehicle: int | None,
    segments: Callable[[Recording], tuple[Segment, ...]],
    delay: Delay | None,
    progress: Progress,
    columns: Path | None = None,
    can: Path | None = None,
    measured: bool = False,
) -> Flight:
    """Reads a log and measures its coefficients.

    Args:
        path: the log.
        aircraft: what is believed of the aircraft.
        vehicle: which vehicle of the log.
        segments: finds the maneuvers of a recording.
        delay: of the surfaces where it is known already; None finds it in this flight.
        progress: told what is being done and how far it is.
        columns: what the columns are where the log is a table.
        can: a CAN log of the same flight.
        measured: whether measured positions of surfaces take the place of their commands.

    Raises:
        InputError: the log cannot be read, or cannot answer.
    """
    started = clock.perf_counter()
    progress(f"reading {path.name}", 0.0)
    recording = open_recording(
        path,
        vehicle=vehicle,
        columns=columns,
        can=can,
        progress=lambda fraction: progress(f"reading {path.name}", 0.1 * fraction),
    )
    surfaces: tuple[str, ...] = ()
    if measured:
        recording, aircraft, surfaces = in_place_of_commands(recording, aircraft)
        if surfaces and delay is not None:
            # What was found of commands is not the delay of measured positions.
            stated = aircraft.streams.get(SERVO_STREAM, StreamTiming())
            delay = Delay(stated.delay, stated.sigma or 0.0, found=False)
    needed = requirements.check(recording, aircraft)
    needed.raise_if_unusable()
    read_at = clock.perf_counter()
    intervals = airborne(recording, aircraft)
    found = segments(recording)
    if not intervals or not found:
        raise RefusedError(
            recording.source,
            "the aircraft never flew in this log",
            fix="record from before take-off to after landing",
        )
    progress("reconstructing the flight", 0.1)
    window = (intervals[0][0], intervals[-1][1])
    recording, limits = saturation.without_saturated(recording, intervals)
    data = measurements.select(recording, aircraft, window)
    states = reconstruct(data, aircraft)
    progress("finding the delay of the surfaces", 0.7)
    absent = _absent(recording, aircraft)
    flown = without_controls(aircraft, absent)
    refused = {name: why for name, why in needed.usable.items() if why is not None}
    told = _input_rows(states.time, found) & ~_unknown(recording, flown, states.time)
    samples, latency = _measured(recording, flown, states, refused, delay or told)
    if delay is None and latency.found and not _deliberate(found):
        wide = float(np.hypot(latency.deviation, CLOSED_LOOP))
        latency = Delay(latency.value, wide, found=True)
    return Flight(
        recording=recording,
        aircraft=flown,
        absent=absent,
        segments=found,
        airborne=float(sum(end - start for start, end in intervals)),
        reconstruction=states,
        compatibility=compatibility.check(states),
        delay=latency,
        samples=samples,
        warnings=(
            *needed.warnings,
            *limits,
            *_holes(recording, data),
            *_seen(recording, surfaces),
        ),
        read_seconds=read_at - started,
        reconstruct_seconds=clock.perf_counter() - read_at,
    )


def _holes(recording: Recording, data: FlightData) -> list[str]:
    """What is said of what the inertial unit left out in flight."""
    holes = gaps(data.time)
    if not holes.size:
        return []
    return [
        f"{recording.source}: {data.used['gyro']} tells nothing for {holes.sum():.1f} s of the "
        f"flight, {holes.max():.1f} s at the longest: states are bridged there, and no coefficient "
        "is measured there or beside"
    ]


def _seen(recording: Recording, surfaces: tuple[str, ...]) -> list[str]:
    if not surfaces:
        return []
    return [
        f"{recording.source}: measured positions took the place of the commands of "
        f"{', '.join(surfaces)}"
    ]


def _measured(
    recording: Recording,
    aircraft: Aircraft,
    states: Reconstruction,
    refused: Mapping[str, str],
    delay: Delay | Bool[np.ndarray, " sample"],
) -> tuple[Samples, Delay]:
    """Coefficients with the surfaces delayed as known, or as found on the given samples."""
    stated = aircraft.streams.get(SERVO_STREAM, StreamTiming())

    def moved(late: float) -> dict[str, Float[np.ndarray, " sample"]]:
        return deflections(recording, aircraft, states.time, late)

    def measured(late: float) -> Samples:
        return coefficients.measure(
            states,
            aircraft,
            controls=moved(late),
            thrust=thrust(recording, aircraft, states),
            refused=refused,
        )

    if isinstance(delay, Delay):
        return measured(delay.value), delay
    found = surface_delay(
        measured(stated.delay),
        moved,
        delay,
        stated=stated.delay,
        stated_sigma=stated.sigma,
    )
    return measured(found.value), found


def deflections(
    recording: Recording, aircraft: Aircraft, time: Float[np.ndarray, " sample"], late: float
) -> dict[str, Float[np.ndarray, " sample"]]:
    """Every control [rad] at given times, the surfaces `late` [s] behind what their servos do."""
    sent_at, sent = pulses(recording.streams[SERVO_STREAM], control_channels(aircraft))
    moved = actuators.controls(aircraft, sent, sent_at, at=time, extra_delay=late)
    return {name: np.broadcast_to(np.asarray(value), time.shape) for name, value in moved.items()}


def _deliberate(segments: Sequence[Segment]) -> list[Segment]:
    """Maneuvers with deliberate inputs, where these are long enough to tell a delay."""
    inputs = [item for item in segments if item.kind in INPUTS]
    return inputs if sum(item.duration for item in inputs) > SHORTEST_INPUTS else []


def _input_rows(
    time: Float[np.ndarray, " sample"], segments: Sequence[Segment]
) -> Bool[np.ndarray, " sample"]:
    """Samples of the deliberate inputs; of all maneuvers where these are too short."""

    def inside(chosen: Sequence[Segment]) -> Bool[np.ndarray, " sample"]:
        return np.any([(time >= item.start) & (time < item.end) for item in chosen], axis=0)

    return inside(_deliberate(segments) or segments)


def _absent(recording: Recording, aircraft: Aircraft) -> tuple[str, ...]:
    """Controls that need a servo output which the log does not have."""
    stream = recording.streams[SERVO_STREAM]
    gone = {servo.surface for servo in aircraft.servos if not stream.has(f"pwm_{servo.channel}")}
    return tuple(control.name for control in aircraft.controls if gone & set(control.mix))


def without_controls(aircraft: Aircraft, names: Collection[str]) -> Aircraft:
    """The aircraft less some controls and every aerodynamic term that depends on them."""
    if not names:
        return aircraft
    every = aircraft.control_names

    def free(key: str) -> bool:
        return not set(names) & set(regressors.parse(key, controls=every).variables)

    aerodynamics = {
        name: replace(
            model,
            terms={key: value for key, value in model.terms.items() if free(key)},
            tables=tuple(table for table in model.tables if all(map(free, table.regressors))),
        )
        for name, model in aircraft.aerodynamics.items()
    }
    kept = tuple(control for control in aircraft.controls if control.name not in names)
    return replace(aircraft, controls=kept, aerodynamics=aerodynamics)


def thrust(recording: Recording, aircraft: Aircraft, states: States) -> Thrust:
    """Thrust of all engines over a reconstructed flight, as the aircraft file has it."""
    engines = [_engine(recording, aircraft, engine, states) for engine in aircraft.propulsion]
    return combined_thrust(aircraft, engines, states.time.size)


def combined_thrust(
    aircraft: Aircraft,
    engines: Sequence[tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]],
    count: int,
) -> Thrust:
    """Force and moment of all engines.

    Args:
        aircraft: where they are and where they push.
        engines: thrust [N] and reaction torque [N·m] of each, in the order of the file.
        count: samples.
    """
    force = np.zeros((count, 3))
    moment = np.zeros((count, 3))
    for engine, (push, torque) in zip(aircraft.propulsion, engines, strict=True):
        axis = np.array(engine.axis) / np.linalg.norm(engine.axis)
        along = push[:, None] * axis
        force += along
        lever = np.array(engine.position) - np.array(aircraft.mass.cg)
        moment += np.cross(lever, along) + torque[:, None] * axis
    sigma = max((engine.thrust_sigma for engine in aircraft.propulsion), default=0.0)
    return Thrust(force, moment, sigma)


def _engine(
    recording: Recording, aircraft: Aircraft, engine: Propulsion, states: States
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
    """Thrust [N] and reaction torque [N·m] of one engine."""
    flow = (states.airspeed, states.density)
    at = setting(recording, aircraft, engine, states.time)
    return (
        np.asarray(propulsion.static_thrust(engine, at, *flow)),
        np.asarray(propulsion.static_torque(engine, at, *flow)),
    )


def setting(
    recording: Recording,
    aircraft: Aircraft,
    engine: Propulsion,
    at: Float[np.ndarray, " grid"],
) -> Float[np.ndarray, " grid"]:
    """Throttle, 0 to 1, or rotation speed [rpm] of one engine, whichever its table is over.

    Servo outputs that the aircraft file says come late are late for the throttle too.

    Raises:
        RefusedError: the recording does not have it.
    """
    if engine.rpm is not None:
        channel = f"rpm_{engine.rpm_channel}"
        stream = recording.first(RPM_STREAMS, channel)
        if stream is None:
            raise RefusedError(
                recording.source,
                "the aircraft file gives thrust over rotation speed, and that of motor "
                f"{engine.rpm_channel} was not recorded",
                fix="ask the autopilot for RPM or ESC_TELEMETRY_1_TO_4 at 10 Hz",
            )
        good = stream.valid(channel)
        return np.interp(
            at, np.asarray(stream.time)[good], np.asarray(stream.channels[channel])[good]
        )
    stream = recording.streams[SERVO_STREAM]
    if not stream.has(f"pwm_{engine.throttle_channel}"):
        raise RefusedError(
            recording.source,
            f"throttle is not in the log: {SERVO_STREAM} has no servo{engine.throttle_channel}",
            fix="correct `throttle_channel` in the aircraft file's [propulsion]",
        )
    time, sent = pulses(stream, (engine.throttle_channel,))
    late = aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
    own = sent[engine.throttle_channel]
    return np.asarray(propulsion.throttle(engine, own, time, at=at, extra_delay=late))
