"""First-order behaviour of an aircraft, for gains, pulse widths and amplitudes.

Not good for anything else: slopes at zero angles, constant density, one control an axis.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl.coupling import Coupling, coupling, is_coupled
from gcs_sysid.sitl.motor import settings
from gcs_sysid.sitl.servo import interpolate
from gcs_sysid.sitl.terms import slope

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

SEA_LEVEL_DENSITY = 1.225
"""ICAO standard atmosphere [kg/m³]."""


@dataclass(frozen=True)
class Slopes:
    """Angular acceleration by state and control at one airspeed.

    `*_damping` [1/s] by the axis's own rate, `*_stiffness` [1/s²] by alpha or beta, `*_control`
    [1/s²] by the control with the most effect on that axis; `lift` [1/s] is how fast lift turns the
    flight path per rad of alpha. `yaw_name` is None without a control beside the one for roll.
    """

    airspeed: float
    roll_name: str
    roll_control: float
    roll_damping: float
    pitch_name: str
    pitch_control: float
    pitch_damping: float
    pitch_stiffness: float
    lift: float
    yaw_name: str | None
    yaw_control: float
    yaw_stiffness: float
    coupling: Coupling | None = None
    """Where pitching does not stay apart from roll and yaw; then everything above is the share of
    each axis alone."""

    @property
    def short_period(self) -> float:
        """Undamped frequency of the short period [rad/s]."""
        return math.sqrt(max(-self.pitch_stiffness - self.pitch_damping * self.lift, 1.0))

    @property
    def dutch_roll(self) -> float:
        """Undamped frequency of the Dutch roll [rad/s]."""
        return math.sqrt(max(self.yaw_stiffness, 1.0))


def slopes(aircraft: Aircraft, airspeed: float) -> Slopes:
    """Slopes at an equivalent airspeed [m/s].

    Raises:
        UsageError: no control moves the aircraft in pitch, or none in roll.
    """
    mass, geometry = aircraft.mass, aircraft.geometry
    qbar = 0.5 * SEA_LEVEL_DENSITY * airspeed**2
    force = qbar * geometry.wing_area
    roll = force * geometry.wing_span / mass.Ixx
    pitch = force * geometry.mean_chord / mass.Iyy
    yaw = force * geometry.wing_span / mass.Izz
    half_span = 0.5 * geometry.wing_span / airspeed
    half_chord = 0.5 * geometry.mean_chord / airspeed
    pitch_name = _strongest(aircraft, "Cm")
    roll_name = _strongest(aircraft, "Cl")
    if pitch_name is None or roll_name is None:
        raise UsageError(
            f"{aircraft.name}: no control acts in {'Cm' if pitch_name is None else 'Cl'}; the "
            "autopilot needs one for pitch and one for roll in `[aerodynamics]`"
        )
    yaw_name = _strongest(aircraft, "Cn", other_than=roll_name)
    names = tuple(name for name in (roll_name, pitch_name, yaw_name) if name)
    return Slopes(
        airspeed=airspeed,
        roll_name=roll_name,
        roll_control=roll * slope(aircraft, "Cl", roll_name),
        roll_damping=roll * half_span * slope(aircraft, "Cl", "phat"),
        pitch_name=pitch_name,
        pitch_control=pitch * slope(aircraft, "Cm", pitch_name),
        pitch_damping=pitch * half_chord * slope(aircraft, "Cm", "qhat"),
        pitch_stiffness=pitch * slope(aircraft, "Cm", "alpha"),
        lift=-force * slope(aircraft, "CZ", "alpha") / (mass.mass * airspeed),
        yaw_name=yaw_name,
        yaw_control=yaw * slope(aircraft, "Cn", yaw_name) if yaw_name else 0.0,
        yaw_stiffness=yaw * slope(aircraft, "Cn", "beta"),
        coupling=coupling(aircraft, airspeed, names, SEA_LEVEL_DENSITY)
        if is_coupled(aircraft, names)
        else None,
    )


@dataclass(frozen=True)
class Trim:
    """Steady level flight, roughly.

    Attributes:
        alpha: angle of attack [rad].
        control: pitch control [rad].
        throttle: 0 to 1.
        others: further controls that must stand off zero [rad]; none with a plane of symmetry.
        bank: bank angle at which the weight balances the side force [rad].
    """

    alpha: float
    control: float
    throttle: float
    others: Mapping[str, float] = field(default_factory=dict)
    bank: float = 0.0


def trim(aircraft: Aircraft, airspeed: float) -> Trim:
    """Level flight at an equivalent airspeed [m/s], from constant and linear terms and alpha²."""
    force = 0.5 * SEA_LEVEL_DENSITY * airspeed**2 * aircraft.geometry.wing_area
    weight = aircraft.mass.mass * GRAVITY
    lift = slope(aircraft, "CZ", "alpha") or -1.0
    alpha = (-weight / force - slope(aircraft, "CZ", "1")) / lift
    moment = slope(aircraft, "Cm", "1") + slope(aircraft, "Cm", "alpha") * alpha
    control = -moment / slope(aircraft, "Cm", slopes(aircraft, airspeed).pitch_name)
    drag = sum(slope(aircraft, "CX", f"alpha{p}") * alpha**n for n, p in ((1, ""), (2, "^2")))
    thrust = weight * math.sin(alpha) - force * (slope(aircraft, "CX", "1") + drag)
    throttle = _throttle(aircraft, airspeed, thrust)
    found = slopes(aircraft, airspeed)
    if found.coupling is None:
        return Trim(alpha, control, throttle)
    controls = found.coupling.balance(alpha)
    side = slope(aircraft, "CY", "1") + slope(aircraft, "CY", "alpha") * alpha
    side += sum(slope(aircraft, "CY", name) * value for name, value in controls.items())
    bank = math.asin(min(max(-force * side / weight, -0.5), 0.5))
    control = controls.pop(found.pitch_name)
    return Trim(alpha, control, throttle, controls, bank)


def thrust_at(aircraft: Aircraft, airspeed: float, throttle: float) -> float:
    """Thrust of all thrusters together at sea level [N]."""
    return sum(
        interpolate(
            throttle,
            settings(thruster),
            [interpolate(airspeed, thruster.airspeed, row) for row in thruster.thrust],
        )
        for thruster in aircraft.propulsion
    )


def _throttle(aircraft: Aircraft, airspeed: float, thrust: float) -> float:
    low, high = 0.0, 1.0
    # Halved until the pulse is known to a tenth of a microsecond.
    while high - low > 1e-4:
        middle = 0.5 * (low + high)
        enough = thrust_at(aircraft, airspeed, middle) >= thrust
        low, high = (low, middle) if enough else (middle, high)
    return high


def _strongest(aircraft: Aircraft, coefficient: str, *, other_than: str = "") -> str | None:
    candidates = {
        name: abs(slope(aircraft, coefficient, name))
        for name in aircraft.control_names
        if name != other_than
    }
    best = max(candidates, key=lambda name: candidates[name], default=None)
    return best if best is not None and candidates[best] > 0.0 else None
