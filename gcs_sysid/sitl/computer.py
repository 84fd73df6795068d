"""The flight computer of a live vehicle: its mode, its targets, and what it makes of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs_sysid.sitl import telemetry
from gcs_sysid.sitl.autopilot import HEADING_GAIN, PERIOD, Sensed
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.inputs import THROTTLE, signal
from gcs_sysid.sitl.mission import Item, Mission
from gcs_sysid.sitl.modes import PITCH, POWER, ROLL, STICK_LOW, YAW, Mode, Sticks
from gcs_sysid.sitl.navigation import Home, Place, around, bearing, distance
from gcs_sysid.sitl.parameters import Parameters
from gcs_sysid.sitl.pilot import Pilot
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.sensors import Measurement
from gcs_sysid.sitl.slopes import GRAVITY
from gcs_sysid.sitl.streams import Streams
from gcs_sysid.sitl.telemetry import Message

ATTITUDE_TIMEOUT = 3.0
"""How long an attitude target holds without being repeated [s]."""

_WIND_TIME = 15.0
"""Time constant of the wind estimate [s]."""

_NOTHING = mavlink.MAV_CMD_NAV_WAYPOINT


@dataclass(frozen=True)
class AttitudeTarget:
    """An attitude [rad] and throttle (0 to 1, None for that of the trim), until a time [s]."""

    theta: float
    bank: float
    throttle: float | None
    until: float


class Computer:
    """What a ground station talks to and what flies.

    Args:
        flight: whose `legs` are flown over and over in AUTO until a mission is loaded.
    """

    def __init__(self, flight: Flight) -> None:
        start = flight.start
        self.flight = flight
        self.home = Home(
            math.radians(start.latitude_deg), math.radians(start.longitude_deg), start.elevation
        )
        self.parameters = Parameters(flight.believed, airspeed=start.airspeed)
        self.streams = Streams(untold=telemetry.untold(flight.flown))
        self.mission = Mission(
            Item(_NOTHING, (0.0, 0.0, 0.0, 0.0), start.latitude_deg, start.longitude_deg, 0.0)
        )
        self.mode, self.armed = Mode.AUTO, True
        self.here = Place(0.0, 0.0, start.height)
        self.target = self.here
        self.airspeed = start.airspeed
        self.attitude: AttitudeTarget | None = None
        self.outbox: list[Message] = []
        self._pilot = Pilot(flight.believed, start.airspeed)
        power = STICK_LOW + round(1000.0 * self._pilot.trimmed_throttle)
        self.sticks = Sticks({POWER: power})
        self._program = _program(flight.legs)
        self._reached_at: float | None = None
        self._jumps: dict[int, int] = {}
        self._heading = start.heading
        self._wind = (0.0, 0.0)
        self._leg = ""

    def change_mode(self, mode: Mode) -> None:
        """Fly in another mode from now on."""
        self.mode = mode
        self.target = self.here
        self.attitude = None
        self._reached_at = None

    def status(self, time: float) -> telemetry.Status:
        """What telemetry tells of it."""
        return telemetry.Status(
            mode=self.mode,
            armed=self.armed,
            channels=tuple(self.sticks.pulse(channel, time) for channel in range(1, 9)),
            home=(self.home.latitude, self.home.longitude, self.home.elevation),
            item=self.mission.current,
            items=len(self.mission.items),
            heading=self._heading,
            wind=self._wind,
        )

    def command(self, measurement: Measurement, time: float) -> dict[str, float]:
        """Controls [rad] and throttle at a time [s]; call once a period."""
        sensed = measurement.sensed()
        self.here = self.home.place(measurement.latitude, measurement.longitude, sensed.height)
        self._estimate_wind(measurement)
        commands = dict.fromkeys(self.flight.believed.control_names, 0.0) | self._fly(sensed, time)
        if not self.armed:
            commands[THROTTLE] = 0.0
        return commands

    def _fly(self, sensed: Sensed, time: float) -> dict[str, float]:
        sticks, now = self.sticks, time
        match self.mode:
            case Mode.MANUAL:
                self._pilot.settle(sensed.theta, sticks.power(now))
                return self._pilot.direct(
                    pitch=sticks.share(PITCH, now),
                    roll=sticks.share(ROLL, now),
                    yaw=sticks.share(YAW, now),
                    throttle=sticks.power(now),
                )
            case Mode.STABILIZE | Mode.FBWA:
                return self._by_sticks(sensed, now)
            case Mode.FBWB | Mode.CRUISE:
                return self._cruise(sensed, now)
            case Mode.AUTO if len(self.mission.items) > 1:
                return self._pilot.follow(sensed, self._next_leg(sensed, now))
            case Mode.AUTO:
                return self._by_program(sensed)
            case Mode.RTL:
                place = Place(0.0, 0.0, self.parameters["RTL_ALTITUDE"])
                return self._pilot.follow(sensed, self._circle(sensed, place))
        if self.attitude is not None and now < self.attitude.until:
            return self._by_attitude(sensed, self.attitude)
        return self._pilot.follow(sensed, self._circle(sensed, self.target))

    def _by_sticks(self, sensed: Sensed, time: float) -> dict[str, float]:
        up = self.sticks.share(PITCH, time)
        limit = self.parameters["PTCH_LIM_MAX_DEG" if up > 0.0 else "PTCH_LIM_MIN_DEG"]
        # The attitude of level flight with the sticks in the middle.
        return self._pilot.hold(
            sensed,
            theta=self._pilot.trimmed_alpha + abs(up) * math.radians(limit),
            bank=self.sticks.share(ROLL, time) * self._bank_limit(),
            throttle=self.sticks.power(time),
        )

    def _by_attitude(self, sensed: Sensed, target: AttitudeTarget) -> dict[str, float]:
        throttle = self._pilot.trimmed_throttle if target.throttle is None else target.throttle
        return self._pilot.hold(sensed, theta=target.theta, bank=target.bank, throttle=throttle)

    def _cruise(self, sensed: Sensed, time: float) -> dict[str, float]:
        """The sticks turn the heading, and move the height, to be held."""
        turn = GRAVITY / sensed.airspeed * math.tan(self._bank_limit()) if sensed.airspeed else 0.0
        self._heading += self.sticks.share(ROLL, time) * turn * PERIOD
        climbed = self.target.height + 2.0 * self.sticks.share(PITCH, time) * PERIOD
        self.target = replace(self.target, height=climbed)
        return self._pilot.follow(sensed, self._leg_to(self._heading, self.target.height))

    def _by_program(self, sensed: Sensed) -> dict[str, float]:
        leg, added = next(self._program)
        self._heading = leg.heading
        if leg.name != self._leg:
            self._leg = leg.name
            self.outbox.append(telemetry.text(f"Leg: {leg.name}"))
        commands = self._pilot.follow(sensed, leg)
        return {
            name: commands.get(name, 0.0) + added.get(name, 0.0) for name in {**commands, **added}
        }

    def _next_leg(self, sensed: Sensed, time: float) -> Leg:
        """Towards the current item; those that are done or only switch something are passed."""
        for _ in range(2 * len(self.mission.items)):
            self.mission.current = max(self.mission.current, 1)
            item = self.mission.items[self.mission.current]
            leg = self._leg_of(item, sensed, time)
            if leg is not None:
                return leg
            if self.mode != Mode.AUTO or not self._advance(item):
                break
        return self._circle(sensed, Place(0.0, 0.0, self.parameters["RTL_ALTITUDE"]))

    def _advance(self, item: Item) -> bool:
        """Go to the next item; False at the end, after which the vehicle flies home."""
        number = self.mission.current
        self.outbox.append(mavlink.MAVLink_mission_item_reached_message(number))
        self._reached_at = None
        following = number + 1
        if item.command == mavlink.MAV_CMD_DO_JUMP:
            done, repeat = self._jumps.get(number, 0), item.parameters[1]
            if repeat < 0 or done < repeat:
                self._jumps[number] = done + 1
                following = round(item.parameters[0])
        if self.mission.select(following):
            return True
        self.outbox.append(telemetry.text("Mission complete, changing mode to RTL"))
        self.change_mode(Mode.RTL)
        return False

    def _leg_of(self, item: Item, sensed: Sensed, time: float) -> Leg | None:
        """The leg that flies an item, None when it is done."""
        place = self.place_of(item)
        match item.command:
            case mavlink.MAV_CMD_NAV_WAYPOINT:
                if distance(self.here, place) < self.parameters["WP_RADIUS"]:
                    return None
                return self._leg_to(bearing(self.here, place), place.height)
            case mavlink.MAV_CMD_NAV_LOITER_UNLIM:
                return self._circle(sensed, place, item.parameters[2])
            case mavlink.MAV_CMD_NAV_LOITER_TIME | mavlink.MAV_CMD_NAV_LOITER_TURNS:
                return self._circle_for(item, place, sensed, time)
            case mavlink.MAV_CMD_NAV_TAKEOFF:
                # It begins in the air: what is left is to climb.
                climbing = self.here.height < place.height - 10.0
                return self._leg_to(self._heading, place.height) if climbing else None
            case mavlink.MAV_CMD_DO_CHANGE_SPEED:
                self.airspeed = item.parameters[1] if item.parameters[1] > 0 else self.airspeed
            case mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH:
                self.change_mode(Mode.RTL)
        return None

    def _circle_for(self, item: Item, place: Place, sensed: Sensed, time: float) -> Leg | None:
        leg = self._circle(sensed, place, item.parameters[2])
        radius = abs(item.parameters[2]) or self.parameters["WP_LOITER_RAD"]
        if self._reached_at is None:
            if distance(self.here, place) < 1.5 * radius:
                self._reached_at = time
            return leg
        turns = item.command == mavlink.MAV_CMD_NAV_LOITER_TURNS
        lap = 2.0 * math.pi * radius / self.airspeed
        wanted = item.parameters[0] * (lap if turns else 1.0)
        return leg if time - self._reached_at < wanted else None

    def place_of(self, item: Item) -> Place:
        """Where an item is; without a position of its own it is here, at its height."""
        absolute = item.frame in (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
        height = item.height - (self.home.elevation if absolute else 0.0)
        if item.latitude_deg == 0.0 and item.longitude_deg == 0.0:
            return replace(self.here, height=height)
        latitude, longitude = math.radians(item.latitude_deg), math.radians(item.longitude_deg)
        return self.home.place(latitude, longitude, height)

    def _circle(self, sensed: Sensed, centre: Place, radius: float = 0.0) -> Leg:
        size = radius or self.parameters["WP_LOITER_RAD"]
        bank = math.atan(sensed.airspeed**2 / (GRAVITY * abs(size)))
        heading = around(self.here, centre, size, lead=bank / HEADING_GAIN)
        return self._leg_to(heading, centre.height)

    def _leg_to(self, course: float, height: float) -> Leg:
        self._heading = course
        return Leg("to target", 0.0, self.airspeed, height, course, self._bank_limit())

    def _bank_limit(self) -> float:
        return math.radians(self.parameters["ROLL_LIMIT_DEG"])

    def _estimate_wind(self, measurement: Measurement) -> None:
        north, east, _ = measurement.velocity
        _, theta, psi = measurement.attitude
        level = measurement.indicated_airspeed * math.cos(theta)
        share = PERIOD / _WIND_TIME
        self._wind = (
            self._wind[0] + share * (north - level * math.cos(psi) - self._wind[0]),
            self._wind[1] + share * (east - level * math.sin(psi) - self._wind[1]),
        )


def _program(legs: tuple[Leg, ...]) -> Iterator[tuple[Leg, dict[str, float]]]:
    """The legs over and over, a period at a time, and what their test inputs add."""
    while True:
        for leg in legs:
            tests = [(test.control, signal(test)) for test in leg.inputs]
            for i in range(round(leg.duration / PERIOD)):
                added: dict[str, float] = {}
                for control, value in tests:
                    added[control] = added.get(control, 0.0) + value(i * PERIOD)
                yield leg, added
