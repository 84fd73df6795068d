"""What the autopilot commands, as deflections and thrust on the filter's clock.

The newest commands are kept in memory of fixed size, and what the surfaces and engines make of them
is computed by functions of fixed shapes, compiled once.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.aircraft import Aircraft, Propulsion, StreamTiming
from gcs_sysid.estimate.coefficients import Thrust
from gcs_sysid.frames import Array
from gcs_sysid.live.choice import measured
from gcs_sysid.live.ring import Ring
from gcs_sysid.model import actuators, propulsion
from gcs_sysid.offline import servo_outputs
from gcs_sysid.offline.flight import (
    RPM_STREAMS,
    SERVO_STREAM,
    combined_thrust,
    control_channels,
)
from gcs_sysid.sources.samples import Sample

HISTORY = 512
"""Commands kept: ten seconds at 50 Hz."""
SILENT_S = 1.2
"""Where the newest command is older than this [s] nobody knows whether it still holds: messages of
1 Hz come that far apart."""
USUAL = 24
"""Intervals between commands that tell the usual one."""
Watched = Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]
"""By name in an alarm: streams, and the channels in them."""


class CommandMaps:
    """What surfaces and engines make of commands: functions of fixed shapes, compiled once.

    Args:
        aircraft: its servos, controls and engines.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._delay = aircraft.streams.get(SERVO_STREAM, StreamTiming()).delay
        self.deflect = jax.jit(self._deflections)
        self.push = jax.jit(self._pushes)
        self.set = jax.jit(self._settings)

    def _deflections(
        self,
        time: Float[Array, " command"],
        pulses: Mapping[int, Array],
        at: Float[Array, " sample"],
    ) -> dict[str, Array]:
        return actuators.controls(self._aircraft, pulses, time, at=at, extra_delay=self._delay)

    def _settings(
        self,
        time: Float[Array, " command"],
        pulses: Mapping[int, Array],
        speeds: Mapping[int, Array],
        at: Float[Array, " sample"],
    ) -> list[Array]:
        def setting(engine: Propulsion) -> Array:
            channel = engine.throttle_channel
            if engine.rpm is not None:
                return speeds[channel]
            return propulsion.throttle(
                engine, pulses[channel], time, at=at, extra_delay=self._delay
            )

        return [setting(engine) for engine in self._aircraft.propulsion]

    def _pushes(
        self,
        time: Float[Array, " command"],
        pulses: Mapping[int, Array],
        speeds: Mapping[int, Array],
        at: Float[Array, " sample"],
        airspeed: Float[Array, " sample"],
        density: Float[Array, " sample"],
    ) -> list[tuple[Array, Array]]:
        settings = self._settings(time, pulses, speeds, at)
        return [
            (
                propulsion.static_thrust(engine, setting, airspeed, density),
                propulsion.static_torque(engine, setting, airspeed, density),
            )
            for engine, setting in zip(self._aircraft.propulsion, settings, strict=True)
        ]


class _Heard:
    """When the newest command of a kind was heard, and since when without a hole [s]."""

    def __init__(self) -> None:
        self.since = self._newest = -math.inf

    def take(self, time: float) -> None:
        if abs(time - self._newest) > SILENT_S:
            self.since = time
        self._newest = time

    def holds(self, now: float) -> bool:
        """Whether the newest one still counts."""
        return self._newest >= now - SILENT_S


class Commands:
    """The newest commands of one aircraft.

    Args:
        aircraft: its servos, controls and engines.
        maps: of the same aircraft.
    """

    def __init__(self, aircraft: Aircraft, maps: CommandMaps) -> None:
        self._aircraft = aircraft
        self._maps = maps
        throttles = [item.throttle_channel for item in aircraft.propulsion if item.rpm is None]
        self._channels = tuple(dict.fromkeys((*control_channels(aircraft), *throttles)))
        self._names = tuple(f"pwm_{channel}" for channel in self._channels)
        self._servos = Ring(HISTORY, 1 + len(self._channels))
        self._engines = {
            engine.throttle_channel: engine.rpm_channel
            for engine in aircraft.propulsion
            if engine.rpm is not None
        }
        self._speeds = {channel: Ring(HISTORY, 2) for channel in self._engines}
        self._servos_heard = _Heard()
        self._speeds_heard = {channel: _Heard() for channel in self._engines}
        self._outputs = tuple(servo_outputs.outputs(aircraft))
        self._doubts: deque[tuple[float, float]] = deque(maxlen=HISTORY)
        self._now = -math.inf

    @property
    def watched(self) -> Watched:
        """What must be heard as long as the aircraft flies; it may stand still."""
        outputs = {"servo outputs": ((SERVO_STREAM,), self._names)} if self._channels else {}
        speeds = {
            f"speed of motor {motor}": (RPM_STREAMS, (f"rpm_{motor}",))
            for motor in self._engines.values()
        }
        return {**outputs, **speeds}

    @property
    def missing(self) -> str | None:
        """Why there are no deflections or no thrust now; None when there are."""
        if self._channels and not self._servos_heard.holds(self._now):
            return f"{SERVO_STREAM} with channels {', '.join(map(str, self._channels))}"
        silent = [
            str(channel)
            for channel, heard in self._speeds_heard.items()
            if not heard.holds(self._now)
        ]
        return f"RPM of motor {', '.join(silent)}" if silent else None

    @property
    def heard(self) -> bool:
        """Whether there ever was one of each kind."""
        rings = (*((self._servos,) if self._channels else ()), *self._speeds.values())
        return all(ring.added for ring in rings)

    def unbroken(self, since: float) -> bool:
        """Whether none was missing from then on [s]: over a hole the last one is no deflection."""
        servos = (self._servos_heard,) if self._channels else ()
        return all(one.since <= since for one in (*servos, *self._speeds_heard.values()))

    def known(
        self, begin: Float[np.ndarray, " step"], end: Float[np.ndarray, " step"]
    ) -> Bool[np.ndarray, " step"]:
        """Whether it is known through each step where surfaces stood and what engines did.

        As after landing (`servo_outputs.known`), but for a silence that still lasts, in which
        nobody knows yet whether a command changed.

        Args:
            begin: of the steps [s].
            end: of the steps [s].
        """
        there = self.heard and self.unbroken(float(begin[0])) and not self.missing
        seen = np.full(begin.size, there)
        for first, last in (*self._doubts, *self._silence()):
            seen &= (end <= first) | (begin >= last)
        return seen

    def _silence(self) -> list[tuple[float, float]]:
        """What is in doubt by a silence that still lasts."""
        time = self._servos.newest(USUAL + 1)[:, 0]
        if time.size < servo_outputs.LEAST_RATE or not self._outputs:
            return []
        if self._now - time[-1] <= servo_outputs.longest(time):
            return []
        return [(float(time[-1]) + min(one.delay for one in self._outputs), math.inf)]

    def take(self, sample: Sample, time: float) -> None:
        """Keeps a command, or a motor's speed; of other samples only the time."""
        self._now = time
        if sample.stream == SERVO_STREAM and measured(sample, self._names):
            row = np.array([time, *(sample.channels[name] for name in self._names)])
            self._bridge(row)
            self._servos.add(row)
            self._servos_heard.take(time)
        elif sample.stream in RPM_STREAMS:
            for channel, motor in self._engines.items():
                name = f"rpm_{motor}"
                if measured(sample, (name,)):
                    self._speeds[channel].add(np.array([time, sample.channels[name]]))
                    self._speeds_heard[channel].take(time)

    def _bridge(self, row: Float[np.ndarray, " column"]) -> None:
        """Makes up for messages that a radio lost before this one: see `servo_outputs`.

        After a silence that is longer than that, what was commanded in it is in doubt.
        """
        newest = self._servos.newest(USUAL + 1)
        if len(newest) <= servo_outputs.LEAST_RATE:
            return
        # Nearly always, and for a tenth of what the median costs.
        if row[0] - newest[-1, 0] < 1.5 * np.diff(newest[:, 0]).min():
            return
        time = np.append(newest[:, 0], row[0])
        count = int(np.diff(servo_outputs.places(time))[-1])
        if count == 1 and time[-1] - time[-2] > servo_outputs.longest(time):
            for output in self._outputs:
                change = (row - newest[-1])[[1 + self._channels.index(output.channel)]]
                self._doubts.extend(output.doubted(time[-2:-1], time[-1:], change))
        share = np.arange(1, count)[:, None] / count
        for lost in newest[-1] + share * (row - newest[-1]):
            self._servos.add(lost)

    def controls(self, at: Float[np.ndarray, " sample"]) -> dict[str, Float[np.ndarray, " sample"]]:
        """Deflections as the air feels them [rad]; `at` always of the same length."""
        if not self._channels:
            return {}
        moved = self._maps.deflect(*self._pulses(), jnp.asarray(at))
        return {name: np.broadcast_to(np.asarray(value), at.shape) for name, value in moved.items()}

    def thrust(
        self,
        at: Float[np.ndarray, " sample"],
        airspeed: Float[np.ndarray, " sample"],
        density: Float[np.ndarray, " sample"],
    ) -> Thrust:
        """Thrust of all engines; `at` always of the same length."""
        flow = (jnp.asarray(at), jnp.asarray(airspeed), jnp.asarray(density))
        pushes = (
            self._maps.push(*self._pulses(), self._turning(at), *flow)
            if self._aircraft.propulsion
            else []
        )
        return combined_thrust(
            self._aircraft,
            [(np.asarray(push), np.asarray(torque)) for push, torque in pushes],
            at.size,
        )

    def settings(self, at: Float[np.ndarray, " sample"]) -> Float[np.ndarray, "sample engine"]:
        """Throttle, 0 to 1, or rotation speed [rpm] of each engine; `at` always as long."""
        if not self._aircraft.propulsion:
            return np.zeros((at.size, 0))
        found = self._maps.set(*self._pulses(), self._turning(at), jnp.asarray(at))
        return np.stack([np.broadcast_to(np.asarray(one), at.shape) for one in found], axis=-1)

    def _turning(self, at: Float[np.ndarray, " sample"]) -> dict[int, Array]:
        """Rotation speed of each engine whose thrust is over it [rpm]."""
        return {
            channel: jnp.asarray(np.interp(at, *ring.padded().T))
            for channel, ring in self._speeds.items()
        }

    def _pulses(self) -> tuple[Array, dict[int, Array]]:
        if not self._servos.added:
            return jnp.zeros(HISTORY), {}
        rows = self._servos.padded()
        return jnp.asarray(rows[:, 0]), {
            channel: jnp.asarray(rows[:, 1 + index]) for index, channel in enumerate(self._channels)
        }
