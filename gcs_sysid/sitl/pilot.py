"""The hands of the flight computer: from targets, attitudes or sticks to controls."""

from __future__ import annotations

import math
from dataclasses import replace

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl.autopilot import Autopilot, Sensed, autopilot
from gcs_sysid.sitl.inputs import THROTTLE
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.servo import control_range
from gcs_sysid.sitl.slopes import trim


class Pilot:
    """Flies one aircraft; `airspeed` [m/s] is where it begins, in trim."""

    def __init__(self, aircraft: Aircraft, airspeed: float) -> None:
        self._aircraft = aircraft
        self._trim = trim(aircraft, airspeed)
        self._autopilots: dict[float, Autopilot] = {}
        self._airspeed = airspeed
        self._memory = self._at(airspeed).settled(self._trim)

    @property
    def trimmed_throttle(self) -> float:
        """Throttle of level flight where it began, 0 to 1."""
        return self._trim.throttle

    @property
    def trimmed_alpha(self) -> float:
        """Angle of attack, and pitch attitude, of level flight where it began [rad]."""
        return self._trim.alpha

    def settle(self, theta: float, throttle: float) -> None:
        """Go on from an attitude [rad] and a throttle that something else has flown."""
        pilot = self._at(self._airspeed)
        thrust = throttle * pilot.thrust_slope / pilot.mass
        self._memory = replace(pilot.settled(self._trim), theta=theta, thrust=thrust)

    def follow(self, sensed: Sensed, leg: Leg) -> dict[str, float]:
        """Towards airspeed, height and heading."""
        self._airspeed = leg.airspeed
        commands, self._memory = self._at(leg.airspeed).command(self._memory, sensed, leg)
        return dict(commands)

    def hold(
        self, sensed: Sensed, *, theta: float, bank: float, throttle: float
    ) -> dict[str, float]:
        """Towards an attitude [rad], with a throttle."""
        pilot = self._at(self._airspeed)
        commands, self._memory = pilot.attitude(self._memory, sensed, theta=theta, bank=bank)
        return commands | {THROTTLE: throttle}

    def direct(self, *, pitch: float, roll: float, yaw: float, throttle: float) -> dict[str, float]:
        """Sticks to surfaces around the trim: shares of full deflection, up and right positive."""
        slope, others = self._at(self._airspeed).slope, self._trim.others
        commands = {THROTTLE: throttle}
        axes = [
            (slope.pitch_name, slope.pitch_control, pitch, self._trim.control),
            (slope.roll_name, slope.roll_control, roll, others.get(slope.roll_name, 0.0)),
        ]
        if slope.yaw_name is not None:
            neutral = others.get(slope.yaw_name, 0.0)
            axes.append((slope.yaw_name, slope.yaw_control, yaw, neutral))
        for name, effect, share, neutral in axes:
            full = control_range(self._aircraft, name)
            commands[name] = neutral + math.copysign(full, effect) * share
        return commands

    def _at(self, airspeed: float) -> Autopilot:
        # Gains change little over half a metre a second.
        near = 0.5 * round(2.0 * airspeed)
        if near not in self._autopilots:
            self._autopilots[near] = autopilot(self._aircraft, near)
        return self._autopilots[near]
