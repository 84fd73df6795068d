"""From single messages to the rows that the filter reads, in the order in which they arrive.

What `measurements` does with a whole recording, without its future: a message belongs to the
nearest inertial sample. A row is made as soon as its inertial sample has come, of what came before;
messages that belong to it and come later make the row once more, with what is new in it. One that
belongs to an earlier row goes to the newest one, with its age; one too late is left out and
counted.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid import atmosphere, frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.live.choice import InertialChoice, StreamChoice
from gcs_sysid.model.kinematics import GRAVITY, MEASURED, Imu, Measurements
from gcs_sysid.reconstruct import cut, inertial_filter, measurements
from gcs_sysid.reconstruct.measurements import GAP, SLOWEST_AIRSPEED
from gcs_sysid.sources.samples import Sample

NEEDED = ("airspeed", "velocity", "attitude")
"""Groups of measurements without which there is no reconstruction."""
SHORTEST_STEP = 0.0069
"""Inertial samples that follow closer than this [s], 145 Hz, are left out: no aircraft that this is
for moves faster, and a filter's step costs the same however short it is."""
_OPEN = 8
"""Messages of one kind that wait for a row; more than come between two inertial samples."""


@dataclass(frozen=True)
class Row:
    """One step of the filter: what happened up to one inertial sample.

    Attributes:
        time: of that sample [s after the epoch].
        link_us: when it arrived [µs since 1970].
        before: inertial sample at the start of the step.
        after: inertial sample at its end.
        step: length of the step [s].
        measured: messages nearest to the end of the step, those of before included.
        new: which groups of them were not in the row when it came before.
        again: whether the row was there before, with fewer messages.
        density: of the air [kg/m³].
        height: above where the first altitude was heard [m].
    """

    time: float
    link_us: int
    before: Imu
    after: Imu
    step: float
    measured: Measurements
    new: Bool[np.ndarray, " group"]
    again: bool
    density: float
    height: float


@dataclass(frozen=True)
class _Inertial:
    time: float
    link_us: int
    imu: Imu


_NOTHING = Measurements(
    airspeed=np.zeros(1),
    velocity=np.zeros(3),
    attitude=np.array([1.0, 0.0, 0.0, 0.0]),
    vanes=np.zeros(2),
    valid=np.zeros(len(MEASURED), dtype=bool),
    age=np.zeros(len(MEASURED)),
)


class RowMaker:
    """Makes rows of samples.

    Attributes:
        epoch_us: log clock at time zero, that of the first sample; None before it.
        late: messages that came too late to be used.
        decimated: inertial samples left out to catch up.
        keep: one in so many inertial samples is used.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._file = self._aircraft = aircraft
        self._parameters: dict[str, float] = {}
        self._inertial = InertialChoice()
        self._cut = cut.Watch()
        self._streams = {
            "airspeed": StreamChoice(measurements.AIRSPEED_STREAMS, ("airspeed",)),
            "velocity": StreamChoice(
                measurements.VELOCITY_STREAMS, ("v_north", "v_east", "v_down")
            ),
            "attitude": StreamChoice(measurements.ATTITUDE_STREAMS, ("roll", "pitch", "yaw")),
        }
        if aircraft.vanes is not None:
            self._streams["vanes"] = StreamChoice(("AOA_SSA",), ("alpha", "beta"))
        self._pressure = StreamChoice(measurements.PRESSURE_STREAMS, ("static_pressure",))
        self._altitude = StreamChoice(measurements.ALTITUDE_STREAMS, ("altitude",))
        self._open: dict[str, deque[tuple[float, Float[np.ndarray, " value"]]]] = {
            group: deque(maxlen=_OPEN) for group in self._streams
        }
        self._airspeed = np.array([np.nan])
        self._current: _Inertial | None = None
        self._row: Row | None = None
        self._told_us: int | None = None
        self._reach = 0.0
        self._static: float | None = None
        self._height: float | None = None
        self._ground = 0.0
        self._still = np.array([0.0, 0.0, -GRAVITY])
        self._skipped = 0
        self.epoch_us: int | None = None
        self.late = 0
        self.decimated = 0
        self.keep = 1

    @property
    def used(self) -> dict[str, str]:
        """Stream behind each group of measurements and behind `gyro` and `accelerometer`."""
        used = {group: item.chosen for group, item in self._streams.items() if item.chosen}
        if self._inertial.chosen:
            used["gyro"] = self._inertial.chosen
            if self._inertial.has_accelerometer:
                used["accelerometer"] = self._inertial.chosen
        return used

    @property
    def missing(self) -> tuple[str, ...]:
        """What is needed and has not been heard."""
        unheard = [group for group in NEEDED if not self._streams[group].chosen]
        if not self._inertial.chosen:
            unheard.insert(0, "angular rate")
        if self._static is None:
            unheard.append("static pressure or altitude")
        return tuple(unheard)

    @property
    def inertial_delay(self) -> float:
        """By how much inertial samples are moved back [s]."""
        # Rate and specific force of a row are one sample: the gyro's lag stands for both.
        return measurements.lateness(self._aircraft, self._inertial.chosen, "gyro")

    def told(self, parameters: Mapping[str, float]) -> None:
        """Takes note of the autopilot's parameters: its inertial filter delays what it shows."""
        if parameters != self._parameters:
            self._parameters = dict(parameters)
            self._aircraft = inertial_filter.behind(self._file, parameters)

    def seconds(self, sample: Sample) -> float:
        """Time of a sample [s after the epoch]."""
        if self.epoch_us is None:
            self.epoch_us = sample.time_us
        return (sample.time_us - self.epoch_us) * 1e-6

    def take(self, sample: Sample) -> list[Row]:
        """Adds a sample; returns the row that it makes, behind what the one before still lacks."""
        time = self.seconds(sample)
        self._air(sample, time)
        for group, choice in self._streams.items():
            if choice.takes(sample, time):
                self._measure(group, time, np.array([sample.channels[c] for c in choice.channels]))
                self._told_us = self._told_us or sample.link_us
        if not self._inertial.takes(sample, time):
            return []
        before = self.once_more()
        return [row for row in (before, self._step(sample, time - self.inertial_delay)) if row]

    def once_more(self) -> Row | None:
        """The newest row with what came after it and belongs to it; None if nothing does."""
        row, told_us = self._row, self._told_us
        if row is None or told_us is None:
            return None
        self._told_us = None
        measured = self._nearest(row.time, row.measured)
        new = measured.valid & ~np.asarray(row.measured.valid)
        if not new.any():
            return None
        self._row = replace(row, link_us=told_us, measured=measured, new=new, again=True)
        return self._row

    def _air(self, sample: Sample, time: float) -> None:
        if self._altitude.takes(sample, time):
            altitude = sample.channels["altitude"]
            if self._height is None:
                self._ground = altitude
            self._height = altitude - self._ground
            if not self._pressure.chosen:
                self._static = float(atmosphere.pressure(np.asarray(altitude)))
        if self._pressure.takes(sample, time):
            self._static = sample.channels["static_pressure"]

    def _measure(self, group: str, time: float, values: Float[np.ndarray, " value"]) -> None:
        """Puts a measurement, in the model's quantities, among those that wait for a row."""
        taken = time - measurements.lateness(self._aircraft, self._streams[group].chosen, group)
        if group == "attitude":
            values = frames.quaternion_from_euler(values)
            self._still = frames.unrotate(values, np.array([0.0, 0.0, -GRAVITY]))
        elif group == "airspeed":
            before, self._airspeed = self._airspeed, values
            again = measurements.held(before, values).item()
            if again or values[0] <= SLOWEST_AIRSPEED or self._static is None:
                return
            values = measurements.true_airspeed(
                self._aircraft, values[None], np.array([self._static])
            )[0]
        elif group == "vanes":
            values = measurements.vane_errors_off(self._aircraft, values[None])[0]
        if self._current is not None and taken < self._current.time - 0.5 * GAP:
            self.late += 1
            return
        self._open[group].append((taken, values))

    def _step(self, sample: Sample, time: float) -> Row | None:
        """Makes the row of this inertial sample."""
        if self._current is not None and time <= self._current.time:
            self.late += 1
            return None
        self._skipped += 1
        close = self._current is not None and time - self._current.time < SHORTEST_STEP
        if self._skipped < self.keep or close:
            self.decimated += 1
            return None
        self._skipped = 0
        previous, self._current = self._current, self._without_errors(sample, time)
        if self._static is None:
            return None
        self._row = self._made(previous or self._current, self._current)
        return self._row

    def _without_errors(self, sample: Sample, time: float) -> _Inertial:
        gyro, force = np.array([sample.channels[name] for name in cut.CHANNELS[:3]]), self._still
        if self._inertial.has_accelerometer:
            both = self._restored(sample)
            gyro, force = both[:3], both[3:]
        gyro, without_errors = measurements.known_errors_off(
            self._aircraft, gyro[None], force[None]
        )
        if self._inertial.has_accelerometer:
            force = without_errors[0]
        return _Inertial(time, sample.link_us, Imu(gyro[0], force))

    def _restored(self, sample: Sample) -> Float[np.ndarray, " channel"]:
        """Rate and force, with what was cut off them."""
        values = np.array([sample.channels[name] for name in cut.CHANNELS])
        return self._cut.restored(values) if sample.stream in cut.STREAMS else values

    def _made(self, before: _Inertial, current: _Inertial) -> Row:
        step = current.time - before.time
        # Where samples were lost, the next one comes sooner than this one did.
        last = step if self._row is None else self._row.step
        self._reach = 0.5 * min(step, last if last > 0.0 else step)
        measured = self._nearest(current.time, _NOTHING)
        return Row(
            time=current.time,
            link_us=current.link_us,
            before=before.imu,
            after=current.imu,
            step=step,
            measured=measured,
            new=measured.valid,
            again=False,
            density=float(atmosphere.density_from_pressure(np.asarray(self._static))),
            height=self._height or 0.0,
        )

    def _nearest(self, time: float, known: Measurements) -> Measurements:
        """Takes out what does not belong to the row after `time`; of each kind the nearest.

        What is `known` of the row already stays: one message of each kind makes a row, whatever a
        radio repeats.
        """
        valid, age = np.array(known.valid), np.array(known.age)
        values = {group: getattr(known, group) for group in MEASURED}
        for index, group in enumerate(MEASURED):
            waiting = self._open.get(group)
            if not waiting:
                continue
            here = [item for item in waiting if item[0] - time < self._reach]
            later = [item for item in waiting if item[0] - time >= self._reach]
            waiting.clear()
            waiting.extend(later)
            if not here or valid[index]:
                continue
            taken, value = min(here, key=lambda item: abs(item[0] - time))
            if abs(taken - time) < 0.5 * GAP:
                valid[index], age[index], values[group] = True, taken - time, value
        return Measurements(**values, valid=valid, age=age)
