"""Servos and motors in motion, exactly: delay, first-order lag, rate limit, backlash.

Commands are held between their arrivals, so that the motion between two instants has a closed form
and does not depend on the simulator's step.
"""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from gcs_sysid.aircraft import Aircraft, Propulsion, Servo


def follow(
    position: float, target: float, duration: float, *, time_constant: float, rate_limit: float
) -> float:
    """Where a rate-limited first-order lag stands after `duration` with its target held.

    dx/dt = (u - x)/τ, held to ±R. While |u - x| > R·τ it moves at R; from there on it decays.

    Args:
        position: where it starts, in the unit of `target`.
        target: held command u.
        duration: elapsed time [s].
        time_constant: τ [s]; 0 follows at once, within the rate limit.
        rate_limit: R [unit/s]; infinite for none.

    Returns:
        The position after `duration`.
    """
    error = target - position
    distance = abs(error)
    linear = rate_limit * time_constant
    if distance > linear:
        ramp = (distance - linear) / rate_limit
        if ramp >= duration:
            return position + math.copysign(rate_limit * duration, error)
        duration -= ramp
        distance = linear
    if time_constant == 0.0:
        return target
    return target - math.copysign(distance * math.exp(-duration / time_constant), error)


def interpolate(x: float, xs: Sequence[float], ys: Sequence[float]) -> float:
    """Linear interpolation in increasing `xs`, held at both ends."""
    if x <= xs[0]:
        return ys[0]
    if x >= xs[-1]:
        return ys[-1]
    i = bisect.bisect_right(xs, x)
    return ys[i - 1] + (ys[i] - ys[i - 1]) * (x - xs[i - 1]) / (xs[i] - xs[i - 1])


class Actuator:
    """One output channel's mechanics; it remembers where it stands and what is under way.

    Args:
        pwm: calibration points [µs], monotone.
        output: what each point commands (rad, or throttle 0 to 1).
        start: command that it has settled on [µs].
        time_constant: lag [s].
        delay: time between a command and its first effect [s].
        rate_limit: fastest motion [unit/s], None for no limit.
        backlash: full width of the play between the servo and what it moves [unit].
        gain: factor on the commanded output.
        offset: added to the commanded output [unit].
    """

    def __init__(
        self,
        pwm: Sequence[float],
        output: Sequence[float],
        *,
        start: float,
        time_constant: float = 0.0,
        delay: float = 0.0,
        rate_limit: float | None = None,
        backlash: float = 0.0,
        gain: float = 1.0,
        offset: float = 0.0,
    ) -> None:
        points = sorted(zip(pwm, output, strict=True))
        self._pwm = [point[0] for point in points]
        self._output = [offset + gain * point[1] for point in points]
        self._time_constant = time_constant
        self._delay = delay
        self._rate_limit = math.inf if rate_limit is None else rate_limit
        self._half_play = 0.5 * backlash
        self._pending: deque[tuple[float, float]] = deque()
        self._target = interpolate(start, self._pwm, self._output)
        self._shaft = self._target
        self._time = 0.0
        self.position = self._target
        """What the air or the propeller sees [unit]."""

    def command(self, time: float, pwm: float) -> None:
        """Take a command that arrives at `time` [s], not earlier than the one before."""
        target = interpolate(pwm, self._pwm, self._output)
        self._pending.append((time + self._delay, target))

    def advance(self, time: float) -> float:
        """Move on to `time` [s] and return the position there."""
        while self._pending and self._pending[0][0] <= time:
            start, target = self._pending.popleft()
            self._move(start)
            self._target = target
        self._move(time)
        return self.position

    def _move(self, time: float) -> None:
        if time <= self._time:
            return
        self._shaft = follow(
            self._shaft,
            self._target,
            time - self._time,
            time_constant=self._time_constant,
            rate_limit=self._rate_limit,
        )
        self._time = time
        # Between two commands the shaft moves one way, so the play is exact at their ends.
        low, high = self._shaft - self._half_play, self._shaft + self._half_play
        self.position = min(max(self.position, low), high)


def shares(aircraft: Aircraft, control: str) -> dict[str, float]:
    """Deflection of each surface that moves one control by 1 and no other (pseudo-inverse)."""
    surfaces = [servo.surface for servo in aircraft.servos]
    mix = np.array([[c.mix.get(name, 0.0) for name in surfaces] for c in aircraft.controls])
    column = np.linalg.pinv(mix)[:, aircraft.control_names.index(control)].tolist()
    # What the inverse leaves of a zero is rounding.
    return {name: share for name, share in zip(surfaces, column, strict=True) if abs(share) > 1e-9}


def control_range(aircraft: Aircraft, control: str) -> float:
    """How far a control goes both ways before the first of its surfaces stops [rad]."""
    ends = {servo.surface: servo.deflection for servo in aircraft.servos}
    return min(
        min(abs(ends[name][0]), abs(ends[name][-1])) / abs(share)
        for name, share in shares(aircraft, control).items()
    )


def surface(servo: Servo, *, start: float) -> Actuator:
    """The mechanics of a servo of the aircraft file, settled on `start` [µs]."""
    return Actuator(
        servo.pwm,
        servo.deflection,
        start=start,
        time_constant=servo.time_constant,
        delay=servo.delay,
        rate_limit=servo.rate_limit,
        backlash=servo.backlash,
        gain=servo.effectiveness,
        offset=servo.offset,
    )


def throttle(propulsion: Propulsion, *, start: float) -> Actuator:
    """The lagged throttle (0 to 1 over `pwm`) of a thruster, settled on `start` [µs]."""
    output = [i / (len(propulsion.pwm) - 1) for i in range(len(propulsion.pwm))]
    return Actuator(propulsion.pwm, output, start=start, time_constant=propulsion.time_constant)
