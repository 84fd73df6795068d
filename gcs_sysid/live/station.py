"""What a ground station knows of one flight while it goes on: from frames to states and a model.

Nothing here waits, opens or writes anything; nothing grows with the length of the flight.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live.alarms import Alarms
from gcs_sysid.live.choice import measured
from gcs_sysid.live.coefficients import KEPT, CoefficientWindow
from gcs_sysid.live.commands import CommandMaps, Commands
from gcs_sysid.live.departure import Departures, DerivativeDepartures
from gcs_sysid.live.envelope_map import EnvelopeMap
from gcs_sysid.live.failures import Failures
from gcs_sysid.live.filter import Estimate, LiveFilter
from gcs_sysid.live.flying import FlyingWatch
from gcs_sysid.live.inside_feed import InsideFeed
from gcs_sysid.live.inside_known import Filtering
from gcs_sysid.live.latency import Latency
from gcs_sysid.live.maneuver import ManeuverWatch
from gcs_sysid.live.processes import Processes
from gcs_sysid.live.regression import Regressors, RunningModel, TermEstimate
from gcs_sysid.live.rows import Row, RowMaker
from gcs_sysid.reconstruct import inertial_filter
from gcs_sysid.reconstruct.measurements import AIRSPEED_STREAMS, IMU_STREAMS
from gcs_sysid.sources.samples import Sample, SampleDecoder
from gcs_sysid.sources.stream import Batch

WAITING = 20_000
"""Samples that may wait for the filter: a minute's; older ones are left out and counted."""
LOST_S = 4.0
"""What is older is not filtered any more: the state shown must be that of now."""
TAUGHT_S = 1.0
KEEP = ((1.0, 1), (2.5, 2), (3.0, 4), (3.5, 8), (math.inf, 16))
"""One in so many inertial samples is used when the filter is less than so late [s]."""


class Compiled:
    """The functions of an aircraft that are compiled; stations of the same aircraft share them.

    Args:
        aircraft: its file.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self.maps = CommandMaps(aircraft)
        self.regressors = Regressors(regressors.default_structure(aircraft), aircraft.control_names)


class Station:
    """Decodes, filters and fits.

    Args:
        aircraft: its file.
        compiled: of the same aircraft.
        prior: derivatives believed before; None ignores the file's.
        vehicle: MAVLink system id to follow; None takes the first autopilot heard.
        clock_us: the ground station's clock [µs since 1970].
        observer: told every estimate; for those who want more than the newest.
        inside: a filter with the aerodynamics inside, which is fed; None leaves it out.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        compiled: Compiled,
        *,
        prior: Mapping[str, Prior] | None,
        vehicle: int | None,
        clock_us: Callable[[], int],
        observer: Callable[[Estimate | Samples], None] | None = None,
        inside: Filtering | None = None,
    ) -> None:
        self.aircraft = aircraft
        self.decoder = SampleDecoder(vehicle=vehicle, watched=(inertial_filter.GYRO,))
        self.rows = RowMaker(aircraft)
        self.filter = LiveFilter(aircraft)
        self.commands = Commands(aircraft, compiled.maps)
        self.window = CoefficientWindow(aircraft, self.commands)
        self.model = RunningModel(aircraft, compiled.regressors, prior)
        self.processes = Processes(aircraft, believing=prior is not None)
        self.inside = InsideFeed(aircraft, self.commands, prior, inside)
        self.departures = Departures(aircraft)
        self.departed_inside = DerivativeDepartures(aircraft)
        self.alarms = Alarms(self.commands.watched)
        self.map = EnvelopeMap(aircraft)
        self.maneuvers = ManeuverWatch(aircraft)
        self.watch = FlyingWatch(aircraft)
        self.ahead = FlyingWatch(aircraft)
        self.latency = Latency()
        self.effort = Latency()
        self.failures = Failures(clock_us)
        self.newest: Estimate | None = None
        self._unfinished: Estimate | None = None
        self.samples: Samples | None = None
        self.updates = 0
        self.skipped = 0
        self._taught: dict[str, dict[str, TermEstimate]] = {}
        self._taught_at = -math.inf
        self._clock_us = clock_us
        self._observer = observer
        self._troubles = 0
        self._known_at = -math.inf
        self._waiting: deque[Sample] = deque()

    @property
    def idle(self) -> bool:
        """Whether nothing waits to be worked on."""
        return not self._waiting

    def receive(self, batch: Batch) -> None:
        """Takes what arrived; it is worked on by `work`."""
        samples = self.decoder.samples(batch)
        self.rows.told(self.decoder.parameters)
        self.take(samples)

    def take(self, samples: Iterable[Sample]) -> None:
        """As `receive`, of samples."""
        for sample in samples:
            self._waiting.append(sample)
            # What waits for the filter, or has waited too long for it, flies none the less.
            if sample.stream in AIRSPEED_STREAMS and measured(sample, ("airspeed",)):
                self.ahead.take(sample.time_us * 1e-6, sample.channels["airspeed"])
            if len(self._waiting) > WAITING:
                self._skip(self._waiting.popleft())

    def work(self, until_us: int) -> None:
        """Works on what waits, at most until the clock says `until_us`."""
        while self._waiting:
            sample = self._waiting.popleft()
            behind = (self._clock_us() - sample.link_us) * 1e-6
            if behind > LOST_S:
                self._skip(sample)
                continue
            self.rows.keep = next(keep for late, keep in KEEP if behind < late)
            self._take(sample)
            if self._clock_us() >= until_us:
                return
        # Not before: what an autopilot sends together is worked on together.
        self._flown(self.rows.once_more())

    def restart(self, error: Exception) -> None:
        """Begins the filter anew after an error that it did not see coming."""
        self.failures.note("the filter, which begins anew", error)
        self.filter.restart()
        self._forget_window()

    def _flown(self, row: Row | None) -> None:
        if row is not None and self.watch.flying:
            self._step(row)

    def _skip(self, sample: Sample) -> None:
        self.skipped += sample.stream in IMU_STREAMS

    def _take(self, sample: Sample) -> None:
        time = self.rows.seconds(sample)
        self.commands.take(sample, time)
        if sample.stream in AIRSPEED_STREAMS and measured(sample, ("airspeed",)):
            before = self.watch.flying
            if before and not self.watch.take(time, sample.channels["airspeed"]):
                self.filter.stop()
                self._forget_window()
            elif not before:
                self.watch.take(time, sample.channels["airspeed"])
        if self.alarms.usable(sample, time, flying=self.watch.flying):
            for row in self.rows.take(sample):
                self._flown(row)

    def _step(self, row: Row) -> None:
        begun = self._clock_us()
        before = self.filter.restarts
        estimates = self.filter.take(row, self.rows.used)
        if self.filter.restarts != before:
            self._forget_window()
        if not estimates:
            return
        self.newest = estimates[-1]
        self.alarms.innovations(row.time, row.new, self.newest.nis)
        done = self._clock_us()
        self.latency.add((done - row.link_us) * 1e-6)
        self.effort.add((done - begun) * 1e-6)
        for estimate in estimates:
            # A row is whole when the next one has begun: until then messages may be added to it.
            if self._unfinished is not None and not estimate.row.again:
                self._finished(self._unfinished)
            self._unfinished = estimate

    def _forget_window(self) -> None:
        self.alarms.restarted()
        self._unfinished = None
        self.window.clear()
        self.inside.clear()

    def _finished(self, estimate: Estimate) -> None:
        """Takes an estimate to which nothing will be added any more."""
        self.updates += 1
        if self._observer is not None:
            self._observer(estimate)
        self._look_inside(estimate)
        samples = self.window.take(
            estimate,
            self.filter.noise,
            self.filter.lever,
            has_accelerometer="accelerometer" in self.rows.used,
        )
        if samples is not None:
            self.samples = samples
            try:
                self._learn(samples)
            except Exception as error:  # noqa: BLE001 - states go on without what is learned
                self.failures.note("learning, which leaves out a part of the flight", error)
            if self._observer is not None:
                self._observer(samples)

    def _look_inside(self, estimate: Estimate) -> None:
        """Feeds the filter with the aerodynamics inside, and hears of its troubles."""
        try:
            self.inside.take(estimate, self.filter.noise, self.filter.lever, self.rows.used)
        except Exception as error:  # noqa: BLE001 - the kinematic filter goes on without
            self.failures.note("feeding the filter with the aerodynamics inside", error)
            self.inside.clear()
        known = self.inside.known
        if known.newest is not None and known.newest.time > self._known_at:
            self._known_at = known.newest.time
            self.departed_inside.take(known.newest.time, known.derivatives)
        if known.troubles > self._troubles:
            self._troubles = known.troubles
            error = RuntimeError(known.trouble)
            self.failures.note("the filter with the aerodynamics inside, which begins anew", error)

    def _learn(self, samples: Samples) -> None:
        """Takes what a window has that is new.

        Raises:
            FloatingPointError: what it holds is no number, and would stay in every sum.
        """
        tables = (samples.regressors, samples.measured, samples.noise, samples.regressor_variance)
        broken = [
            name for part in tables for name, one in part.items() if not np.isfinite(one).all()
        ]
        if broken:
            raise FloatingPointError(f"{', '.join(dict.fromkeys(broken))} not finite")
        # A landing roll lasts some seconds before it is known as one, and teaches nothing.
        if self.watch.fast_enough(samples.regressors["V"][KEPT]):
            self.model.take(samples, KEPT)
            self.processes.take(samples, KEPT, self.model.flow_variance(self.taught()))
            self.departures.take(samples, KEPT)
            self.map.take(samples, KEPT)
            self.maneuvers.take(samples, KEPT, self.taught)

    def taught(self) -> dict[str, dict[str, TermEstimate]]:
        """What this flight alone says of the derivatives, whatever the file believes.

        Solved once a second of flight: the gauge of a maneuver asks three times as often.
        """
        now = -math.inf if self.newest is None else self.newest.row.time
        if not self._taught or now - self._taught_at >= TAUGHT_S:
            found = self.model.solutions(believing=False)
            self._taught, self._taught_at = {n: one.terms() for n, one in found.items()}, now
        return self._taught

    def phase(self) -> str:
        """What is going on, in a few words."""
        if self.decoder.vehicle is None:
            heard = self.decoder.received
            return "waiting for an autopilot's heartbeat" if heard else "waiting for data"
        if not self.watch.flying:
            return "flying, the filter is behind" if self.ahead.flying else "on the ground"
        if not self.filter.started:
            missing = self.rows.missing or self.filter.missing
            return f"starting, needs {', '.join(missing)}" if missing else "starting"
        if self.commands.missing is not None:
            return f"flying, coefficients need {self.commands.missing}"
        return "flying"
