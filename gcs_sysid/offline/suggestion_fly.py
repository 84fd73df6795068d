"""Flies a suggested maneuver on a vehicle, from the ground, through its sticks.

In MANUAL the sticks are the surfaces. The ground holds the attitude meanwhile, with the gains of
the plan's own attitude hold, and adds the input; before and after, and whenever anything is out of
limits, the mode before flies on. Telemetry there and sticks back take some tens of milliseconds:
good enough for a simulation, and the script on board (`lua`) is the way for an aircraft.
"""

from __future__ import annotations

import ipaddress
import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from gcs_sysid import frames
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.maneuvers import axes
from gcs_sysid.maneuvers.axes import Axes
from gcs_sysid.maneuvers.design import AFTER
from gcs_sysid.maneuvers.flown import STEP
from gcs_sysid.maneuvers.holding import SIZE, Linear
from gcs_sysid.model.trim import Trim
from gcs_sysid.sources.cockpit import Cockpit

MANUAL = 0
"""Custom mode of an ArduPlane in which the sticks are the surfaces."""
ROLL, PITCH, POWER, YAW = 1, 2, 3, 4
LOW, MIDDLE, HIGH = 1000, 1500, 2000
LOST = 1.0
"""Without telemetry for so long the maneuver ends [s]."""
WAIT = 60.0
"""Longest wait for the entry conditions [s]."""
NEAR = 0.1
"""Airspeed at entry may be off by this part."""
LEVEL = math.radians(10.0)
TRIMMED = 1.5
"""Attitude held without an input before it begins [s]."""

_HOST = re.compile(
    r"^(?:mavsdk:)?(?:udp|udpin|udpout|tcp|tcpin|tcpout):(?://)?(\[[^\]]*\]|[^/:\[\]]*):\d+$"
)


@dataclass(frozen=True)
class Flight:
    """What is flown: the maneuver, and what holds the aircraft meanwhile.

    Attributes:
        aircraft: with its controls.
        axes: which control each stick moves.
        trim: level flight that the maneuver was planned from.
        linear: attitude hold.
        name: of the maneuver.
        added: its input: to each control [rad] and last to the throttle, every `STEP`.
        stop: limits [SI, rad], as on its card.
        share: of its amplitude.
    """

    aircraft: Aircraft
    axes: Axes
    trim: Trim
    linear: Linear
    name: str
    added: Float[np.ndarray, "sample input"]
    stop: Mapping[str, Sequence[float]]
    share: float


@runtime_checkable
class _Sticks(Protocol):
    """What is used of a `Cockpit`."""

    newest: dict[str, Any]
    heard: float

    @property
    def mode(self) -> int | None: ...

    def poll(self, timeout_s: float) -> bool: ...

    def find(self, timeout_s: float) -> None: ...

    def set_mode(self, mode: int) -> None: ...

    def set_airspeed(self, airspeed: float) -> None: ...

    def sticks(self, pulses: Mapping[int, int]) -> None: ...

    def release(self, channels: tuple[int, ...]) -> None: ...


def loopback(address: str) -> bool:
    """Whether a link leads to this machine only; a name other than localhost does not count."""
    match = _HOST.match(address)
    if match is None:
        return False
    host = match.group(1).strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check(address: str, *, beyond: bool) -> None:
    """Refuses to fly what is not on this machine.

    Raises:
        UsageError: the address leads elsewhere, and nobody said that this is meant.
    """
    if not loopback(address) and not beyond:
        raise UsageError(
            f"--fly {address}: leads beyond this machine, perhaps to an aircraft; fly simulations "
            "as udpin:127.0.0.1:14550, or add --fly-aircraft if an aircraft is meant and a pilot "
            "stands by"
        )


def on(address: str, flight: Flight, *, progress: Callable[[str, float], None]) -> dict[str, Any]:
    """Flies a maneuver over a link; see `fly`."""
    with Cockpit(address) as cockpit:
        return fly(cockpit, flight, progress=progress)


def fly(
    cockpit: _Sticks,
    flight: Flight,
    *,
    progress: Callable[[str, float], None],
    now: Callable[[], float] = time.monotonic,
    wait: Callable[[float], None] = time.sleep,
) -> dict[str, Any]:
    """Waits for the entry conditions, flies the maneuver, and gives the aircraft back.

    Args:
        cockpit: of the vehicle.
        flight: what to fly.
        progress: told what is being done.
        now: clock [s].
        wait: for so long [s].

    Returns:
        What happened: `outcome` (`flown`, or why it was stopped), `flown_s`, and the ranges of
        what was sensed.

    Raises:
        RefusedError: the vehicle does not come near the entry conditions.
    """
    cockpit.find(10.0)
    before = _entered(cockpit, flight, progress, now)
    rows = flight.added.shape[0]
    lead, tail = round(TRIMMED / STEP), round(AFTER / STEP)
    seen: list[Sensed] = []
    outcome = "flown"
    begun = now()
    cockpit.set_mode(MANUAL)
    try:
        for tick in range(lead + rows + tail):
            while cockpit.poll(0.0):
                pass
            sensed = _sensed(cockpit)
            why = _trouble(sensed, flight, now() - cockpit.heard)
            if why is not None:
                outcome = f"stopped: {why}"
                break
            seen.append(sensed)
            inside = 0 <= tick - lead < rows
            added = flight.share * flight.added[tick - lead] if inside else 0.0
            cockpit.sticks(_pulses(flight, sensed, added))
            progress(f"flying {flight.name}", tick / (lead + rows + tail))
            wait(max(begun + (tick + 1) * STEP - now(), 0.0))
    finally:
        # Whatever happens, the mode before flies on, on its own sticks.
        if before is not None:
            cockpit.set_mode(before)
        cockpit.release((ROLL, PITCH, POWER, YAW))
    return {
        "maneuver": flight.name,
        "share": flight.share,
        "outcome": outcome,
        "flown_s": max(len(seen) - lead, 0) * STEP,
        "ranges": {
            name: [min(values), max(values)]
            for name in ("airspeed", "bank", "height")
            if (values := [getattr(one, name) for one in seen])
        },
    }


@dataclass(frozen=True)
class Sensed:
    """Newest telemetry: attitude [rad], rate [rad/s], air [m/s] and height [m]."""

    bank: float
    pitch: float
    rate: tuple[float, float, float]
    airspeed: float
    height: float


def _entered(
    cockpit: _Sticks,
    flight: Flight,
    progress: Callable[[str, float], None],
    now: Callable[[], float],
) -> int | None:
    """Waits for level flight at the airspeed of entry; the mode that flies then."""
    wanted, until = flight.trim.airspeed, now() + WAIT
    cockpit.set_airspeed(wanted)
    while True:
        cockpit.poll(0.05)
        if {"ATTITUDE", "VFR_HUD", "GLOBAL_POSITION_INT"} <= set(cockpit.newest):
            sensed = _sensed(cockpit)
            off = abs(sensed.airspeed - wanted) / wanted
            if off < NEAR and abs(sensed.bank) < LEVEL and sensed.height > _floor(flight):
                return cockpit.mode
            progress(f"waiting for {wanted:.0f} m/s, wings level", 0.0)
        if now() > until:
            raise RefusedError(
                flight.name,
                f"the vehicle did not fly level at {wanted:.1f} m/s, above {_floor(flight):.0f} m, "
                f"in {WAIT:.0f} s",
                fix="let it hold that airspeed and height first",
            )


def _floor(flight: Flight) -> float:
    return float(flight.stop["height_min"][0])


def _sensed(cockpit: _Sticks) -> Sensed:
    attitude, air = cockpit.newest["ATTITUDE"], cockpit.newest["VFR_HUD"]
    place = cockpit.newest["GLOBAL_POSITION_INT"]
    return Sensed(
        float(attitude.roll),
        float(attitude.pitch),
        (float(attitude.rollspeed), float(attitude.pitchspeed), float(attitude.yawspeed)),
        float(air.airspeed),
        1e-3 * float(place.relative_alt),
    )


def _trouble(sensed: Sensed, flight: Flight, silent: float) -> str | None:
    """Why the maneuver must end; None where it may go on."""
    if silent > LOST:
        return f"no telemetry for {silent:.1f} s"
    for name in ("airspeed", "bank"):
        low, high = flight.stop[name]
        value = getattr(sensed, name)
        if not low <= value <= high:
            return f"{name} {value:.2f} outside {low:.2f} to {high:.2f}"
    if sensed.height < _floor(flight):
        return f"height {sensed.height:.0f} m below {_floor(flight):.0f} m"
    return None


def _pulses(
    flight: Flight, sensed: Sensed, added: Float[np.ndarray, " input"] | float
) -> dict[int, int]:
    """Stick pulses [µs] for the attitude hold's command and the input."""
    euler = np.asarray(frames.euler_from_quaternion(flight.trim.state.attitude))
    change = np.zeros(SIZE)
    change[3:6] = sensed.rate
    change[6:8] = sensed.bank - euler[0], sensed.pitch - euler[1]
    whole = np.zeros(len(flight.aircraft.controls) + 1) + added
    controls = whole[:-1] - flight.linear.gain @ change
    names = flight.aircraft.control_names
    pulses = {POWER: _power(flight, float(whole[-1]))}
    sticks = ((ROLL, flight.axes.roll, 3), (PITCH, flight.axes.pitch, 4), (YAW, flight.axes.yaw, 5))
    for channel, name, row in sticks:
        if name is None or (channel == YAW and name == flight.axes.roll):
            continue
        index = names.index(name)
        # Stick right, up (nose) and right: towards positive roll, pitch and yaw.
        sign = np.sign(flight.linear.inputs[row, index])
        share = float(sign * controls[index]) / axes.travel(flight.aircraft, name)
        pulses[channel] = round(MIDDLE + np.clip(share, -1.0, 1.0) * (HIGH - MIDDLE))
    return pulses


def _power(flight: Flight, added: float) -> int:
    settings = [value for value in flight.trim.settings if value <= 1.0]
    share = float(np.clip((settings[0] if settings else 0.5) + added, 0.0, 1.0))
    return round(LOW + share * (HIGH - LOW))
