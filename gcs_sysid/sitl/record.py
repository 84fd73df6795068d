"""Flies a plan faster than real time and keeps what a ground station would have recorded."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid.errors import UsageError
from gcs_sysid.sitl import status, telemetry
from gcs_sysid.sitl import truth as truths
from gcs_sysid.sitl.autopilot import PERIOD, autopilot
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.inputs import THROTTLE, signal
from gcs_sysid.sitl.jsbsim_aircraft import TURBULENCE_CEILING
from gcs_sysid.sitl.link import Frame, Transmitter, tlog
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.sensors import Measurement
from gcs_sysid.sitl.slopes import trim
from gcs_sysid.sitl.truth import Truth, Witness
from gcs_sysid.sitl.vehicle import Vehicle, told_late

SETTLE = 8.0
"""Flown before the recording begins, so that the autopilot finds the trim of what really flies [s].
"""

RESTART = 2.0
"""How long a flight computer that restarts tells nothing and leaves its outputs as they are [s]."""


@dataclass(frozen=True)
class Flown:
    """A flown flight: frames as received, the truth, and how many messages were sent."""

    frames: tuple[Frame, ...]
    truth: Truth
    sent: int


def run(
    flight: Flight,
    *,
    record: Path | None,
    truth: Path | None = None,
    truth_rate: int = telemetry.TICK_RATE,
    told: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Flown:
    """Fly, and write the recording and the truth where asked.

    Args:
        flight: what to fly.
        record: .tlog to write.
        truth: .npz to write: `rows`, `cols`, `t0_us`; single precision below the full rate.
        truth_rate: rows a second in that file, a divisor of 50.
        told: written as JSON beside the truth where given: what is hidden, and how large.
        progress: called with the seconds flown, once a second of flight.

    Returns:
        The flight, with the truth at its full rate.

    Raises:
        UsageError: the flight cannot be flown.
    """
    flown = fly(flight, progress=progress)
    if record is not None:
        record.write_bytes(tlog(flown.frames))
    if truth is not None:
        truths.save(flown.truth, truth, rate=truth_rate, told=told)
    return flown


def fly(flight: Flight, *, progress: Callable[[float], None] | None = None) -> Flown:
    """Fly a flight in memory; see `run`."""
    _check(flight)
    recorder = _Recorder(flight)
    for tick in range(-round(SETTLE / PERIOD), 0):
        recorder.tick(tick, flight.legs[0], {})
    recorder.connect()
    tick = 0
    for leg in flight.legs:
        recorder.announce(leg, tick)
        tests = [(test.control, signal(test)) for test in leg.inputs]
        for i in range(round(leg.duration / PERIOD)):
            added: dict[str, float] = {}
            for control, value in tests:
                added[control] = added.get(control, 0.0) + value(i * PERIOD)
            recorder.tick(tick, leg, added)
            tick += 1
            if progress is not None and tick % telemetry.TICK_RATE == 0:
                progress(tick * PERIOD)
    return recorder.flown()


def _check(flight: Flight) -> None:
    if not flight.legs:
        raise UsageError("the flight plan has no leg; give it at least one")
    known = {*flight.believed.control_names, THROTTLE}
    for leg in flight.legs:
        unknown = [test.control for test in leg.inputs if test.control not in known]
        if unknown:
            raise UsageError(
                f"leg `{leg.name}`: no control `{unknown[0]}`; there are {', '.join(sorted(known))}"
            )
    highest = flight.start.elevation + max(leg.height for leg in flight.legs)
    if flight.wind.gust > 0.0 and highest > TURBULENCE_CEILING - 30.0:
        raise UsageError(
            f"turbulence is set by `gust` only below {TURBULENCE_CEILING:.0f} m above sea level, "
            f"the plan reaches {highest:.0f} m; fly lower"
        )


class _Recorder:
    """Vehicle, autopilot and radio, run together tick by tick."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        sensors, link = np.random.SeedSequence(flight.seed).spawn(2)
        self._vehicle = Vehicle(flight, generator=np.random.default_rng(sensors))
        self._transmitter = Transmitter(flight.link, generator=np.random.default_rng(link))
        self._delays = told_late(flight.hidden.delays)
        self._untold = telemetry.untold(flight.flown)
        pilot = autopilot(flight.believed, flight.start.airspeed)
        self._autopilots = {flight.start.airspeed: pilot}
        self._memory = pilot.settled(trim(flight.believed, flight.start.airspeed))
        self._used = 0.0
        self._pulses: Mapping[int, int] = {}
        self._booted = -telemetry.BOOT_BEFORE_RECORDING
        self._witness = Witness(flight)

    def tick(self, tick: int, leg: Leg, added: Mapping[str, float]) -> None:
        """Sense, command, send, then move on by one period."""
        state, measurement = self._vehicle.sense()
        if tick >= 0:
            self._witness.see(tick, state, self._vehicle)
        if not self._restarting(tick):
            self._work(tick, measurement, leg, added)
        self._vehicle.move(self._pulses)

    def _work(
        self, tick: int, measurement: Measurement, leg: Leg, added: Mapping[str, float]
    ) -> None:
        commands = self._command(measurement, leg, added)
        self._pulses = self._vehicle.mixer.pulses(commands)
        power = min(max(commands[THROTTLE], 0.0), 1.0)
        self._used += telemetry.current(power) * PERIOD / 3600.0
        if tick >= 0:
            self._send(
                telemetry.Snapshot(
                    tick,
                    self._flight.epoch_us,
                    measurement,
                    self._pulses,
                    power,
                    self._used,
                    self._vehicle.motors(),
                    booted=self._booted,
                )
            )

    def _restarting(self, tick: int) -> bool:
        """Whether the flight computer is down; it forgets what it was about."""
        since = tick * PERIOD - (math.inf if self._flight.reboot is None else self._flight.reboot)
        if not 0.0 <= since < RESTART:
            return False
        if self._booted < 0.0:
            self._booted = tick * PERIOD
            self._transmitter.restart(self._flight.epoch_us + tick * telemetry.TICK_US)
            believed, airspeed = self._flight.believed, self._flight.start.airspeed
            self._memory = self._autopilots[airspeed].settled(trim(believed, airspeed))
        return True

    def connect(self) -> None:
        """Send what a ground station asks for when it connects."""
        for message in telemetry.parameters(self._flight.believed):
            self._transmitter.send(message, self._flight.epoch_us, reliable=True)

    def announce(self, leg: Leg, tick: int) -> None:
        """Tell the ground which leg begins."""
        unix_us = self._flight.epoch_us + round(tick * PERIOD * 1e6)
        self._transmitter.send(telemetry.text(f"Leg: {leg.name}"), unix_us)

    def flown(self) -> Flown:
        """What has been flown so far."""
        return Flown(
            tuple(self._transmitter.arrived()), self._witness.truth(), self._transmitter.sent
        )

    def _command(
        self, measurement: Measurement, leg: Leg, added: Mapping[str, float]
    ) -> dict[str, float]:
        if leg.airspeed not in self._autopilots:
            self._autopilots[leg.airspeed] = autopilot(self._flight.believed, leg.airspeed)
        pilot = self._autopilots[leg.airspeed]
        commands, self._memory = pilot.command(self._memory, measurement.sensed(), leg)
        return {
            name: commands.get(name, 0.0) + added.get(name, 0.0)
            for name in (*self._flight.believed.control_names, THROTTLE)
        }

    def _send(self, snapshot: telemetry.Snapshot) -> None:
        for name, rate in self._flight.rates.items():
            if snapshot.tick % (telemetry.TICK_RATE // rate) == 0 and name not in self._untold:
                told = snapshot.told_late(self._delays.get(name, 0.0))
                self._transmitter.send(status.BUILDERS[name](told), told.unix_us)
