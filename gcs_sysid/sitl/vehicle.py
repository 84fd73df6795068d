"""An aircraft with its sensors, servos and motors: what an autopilot is connected to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl import motor
from gcs_sysid.sitl.autopilot import PERIOD, Mixer
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.inputs import THROTTLE
from gcs_sysid.sitl.jsbsim_aircraft import STEP, JsbsimAircraft, Start, State
from gcs_sysid.sitl.sensors import Measurement, Sensors
from gcs_sysid.sitl.servo import Actuator, surface, throttle
from gcs_sysid.sitl.shipped import ShippedAircraft
from gcs_sysid.sitl.slopes import slopes, trim

OUTPUTS = "SERVO_OUTPUT_RAW"


class Vehicle:
    """What flies in a flight, from the trim of what is believed.

    Args:
        flight: aircraft, air and sensors.
        generator: where the randomness of the sensors comes from.
    """

    def __init__(self, flight: Flight, *, generator: np.random.Generator) -> None:
        level = trim(flight.believed, flight.start.airspeed)
        self._aircraft = _in_jsbsim(
            flight, replace(flight.start, alpha=level.alpha, bank=level.bank)
        )
        self._flown, self._throttles = flight.flown, [level.throttle] * len(flight.flown.propulsion)
        self._sensors = Sensors(
            flight.flown,
            flight.noise,
            elevation=flight.start.elevation,
            generator=generator,
            heading_bias=flight.hidden.heading_bias,
        )
        self.mixer = Mixer(flight.believed)
        pitch = slopes(flight.believed, flight.start.airspeed).pitch_name
        self._actuators = _Actuators(
            flight.flown,
            self.mixer.pulses({pitch: level.control, THROTTLE: level.throttle, **level.others}),
            late=max(flight.hidden.delays.get(OUTPUTS, 0.0), 0.0),
        )

    def sense(self) -> tuple[State, Measurement]:
        """The present state, and what the sensors say of it; call once a period."""
        state = self._aircraft.state()
        return state, self._sensors.measure(state)

    def move(self, pulses: Mapping[int, int]) -> None:
        """Move on by one period with the pulses [µs] by output channel."""
        now = self._aircraft.time
        self._actuators.command(now, pulses)
        for step in range(1, round(PERIOD / STEP) + 1):
            self._throttles = self._actuators.advance(now + step * STEP)
            self._aircraft.advance(self._actuators.controls(), self._throttles)

    def controls(self) -> dict[str, float]:
        """Where the controls stand [rad]."""
        return self._actuators.controls()

    def thrust(self) -> float:
        """Thrust of all engines together [N]."""
        return sum(self._aircraft.thrusts())

    def mass(self) -> float:
        """What is left of it [kg]."""
        return self._aircraft.mass()

    def motors(self) -> dict[int, float]:
        """Rotation speeds [rpm] by motor number."""
        return motor.speeds(self._flown, self._throttles)


def _in_jsbsim(flight: Flight, start: Start) -> JsbsimAircraft | ShippedAircraft:
    if flight.shipped is not None:
        return ShippedAircraft(flight.shipped, start=start, wind=flight.wind, seed=flight.seed)
    return JsbsimAircraft(
        flight.flown,
        start=start,
        wind=flight.wind,
        seed=flight.seed,
        feel=flight.hidden.feel,
        stall_lag=flight.hidden.stall_lag,
        fuel=flight.fuel,
    )


def told_late(delays: Mapping[str, float]) -> dict[str, float]:
    """By how much each message is told too late: an output that is early has moved already."""
    return {name: max(-delay, 0.0) if name == OUTPUTS else delay for name, delay in delays.items()}


class _Actuators:
    """All servos and motors of an aircraft, at rest on `pulses`; commands arrive `late` [s]."""

    def __init__(self, aircraft: Aircraft, pulses: Mapping[int, int], *, late: float = 0.0) -> None:
        self._late = late
        self._servos = [
            (servo.channel, servo.surface, surface(servo, start=float(pulses[servo.channel])))
            for servo in aircraft.servos
        ]
        self._motors: list[tuple[int, Actuator]] = [
            (
                thruster.throttle_channel,
                throttle(thruster, start=float(pulses[thruster.throttle_channel])),
            )
            for thruster in aircraft.propulsion
        ]
        self._mix = [(control.name, tuple(control.mix.items())) for control in aircraft.controls]

    def command(self, time: float, pulses: Mapping[int, int]) -> None:
        for channel, _, actuator in self._servos:
            actuator.command(time + self._late, float(pulses[channel]))
        for channel, actuator in self._motors:
            actuator.command(time + self._late, float(pulses[channel]))

    def advance(self, time: float) -> list[float]:
        """Move all to `time` [s]; returns the throttles."""
        for _, _, actuator in self._servos:
            actuator.advance(time)
        return [actuator.advance(time) for _, actuator in self._motors]

    def controls(self) -> dict[str, float]:
        """Where the controls stand [rad]."""
        at = {name: actuator.position for _, name, actuator in self._servos}
        return {name: sum(gain * at[surface] for surface, gain in mix) for name, mix in self._mix}
