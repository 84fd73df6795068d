"""What an engineer believes about an aircraft: plain data, in SI units and radians.

`aircraft_file` reads and writes it as TOML; nothing here touches a file. Positions are in body
axes (x forward, y right, z down) from one airframe point, the one about which the aerodynamic
moments are given; `Mass.cg` is measured from it too. Angles that the file holds in degrees are
radians here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)

COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
FORCES = COEFFICIENTS[:3]
MOMENTS = COEFFICIENTS[3:]


@dataclass(frozen=True)
class Mass:
    """Mass [kg], inertia about the centre of gravity [kg·m²] and its place [m].

    Products of inertia are ∫xy dm, ∫yz dm, ∫xz dm (positive integrals). Sigmas are relative, one
    standard deviation of a common scale error.
    """

    mass: float
    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float = 0.0
    Ixy: float = 0.0
    Iyz: float = 0.0
    cg: Vector = ZERO
    mass_sigma: float = 0.02
    inertia_sigma: float = 0.1

    @property
    def inertia_rows(self) -> tuple[tuple[Any, ...], ...]:
        """Rows of the inertia tensor about the centre of gravity, body axes [kg·m²].

        Of numbers, or of what stands for them where this is compiled.
        """
        return (
            (self.Ixx, -self.Ixy, -self.Ixz),
            (-self.Ixy, self.Iyy, -self.Iyz),
            (-self.Ixz, -self.Iyz, self.Izz),
        )

    @property
    def inertia(self) -> Float[np.ndarray, "axis axis"]:
        """Inertia tensor as an array."""
        return np.array(self.inertia_rows)


@dataclass(frozen=True)
class Geometry:
    """Reference area [m²], span [m] and mean aerodynamic chord [m]."""

    wing_area: float
    wing_span: float
    mean_chord: float


@dataclass(frozen=True)
class SensorError:
    """Known error of one sensor channel: indicated = (1 + scale)·true + bias, seen `lag` late.

    Each sigma is one standard deviation of what is not known; None leaves the program's default.
    `bias` and `scale` hold one entry per axis (accelerometer, gyro) or one (airspeed, a vane).
    """

    bias: tuple[float, ...] = (0.0,)
    scale: tuple[float, ...] = (0.0,)
    lag: float = 0.0
    bias_sigma: float | None = None
    scale_sigma: float | None = None
    lag_sigma: float | None = None


@dataclass(frozen=True)
class Imu:
    """Inertial unit: position [m], mounting error (roll, pitch, yaw of the unit) [rad]."""

    position: Vector = ZERO
    misalignment: Vector = ZERO
    misalignment_sigma: float | None = None
    accelerometer: SensorError = SensorError(bias=ZERO, scale=ZERO)
    gyro: SensorError = SensorError(bias=ZERO, scale=ZERO)


@dataclass(frozen=True)
class Pitot:
    """Airspeed sensor; `measures` says which airspeed its reading is. `error.bias` in m/s."""

    position: Vector = ZERO
    measures: Literal["EAS", "CAS", "TAS"] = "EAS"
    error: SensorError = SensorError()


@dataclass(frozen=True)
class Vanes:
    """Flow angle sensor: position [m]; upwash (indicated = (1 + upwash)·true), biases [rad]."""

    position: Vector = ZERO
    upwash: float = 0.0
    alpha: SensorError = SensorError()
    beta: SensorError = SensorError()
    upwash_sigma: float | None = None


@dataclass(frozen=True)
class StreamTiming:
    """How late a stream is [s].

    A measurement describes the aircraft `delay` before its time stamp; a servo command moves it
    `delay` after.
    """

    delay: float = 0.0
    sigma: float | None = None


@dataclass(frozen=True)
class Servo:
    """One output channel and the surface behind it.

    `pwm` [µs, increasing] maps to `deflection` [rad], linear between, held beyond; then
    `effectiveness`·deflection + `offset` after `delay`, first-order lag `time_constant`,
    `rate_limit` [rad/s] and `backlash` (full width) [rad].
    """

    channel: int
    surface: str
    pwm: tuple[float, ...]
    deflection: tuple[float, ...]
    time_constant: float = 0.0
    delay: float = 0.0
    rate_limit: float | None = None
    backlash: float = 0.0
    offset: float = 0.0
    effectiveness: float = 1.0


@dataclass(frozen=True)
class Control:
    """What the aerodynamics are a function of: Σ gain·surface, by surface name."""

    name: str
    mix: Mapping[str, float]


@dataclass(frozen=True)
class Propulsion:
    """One thruster: thrust [N] over throttle (0 to 1) and airspeed [m/s] at sea level.

    `pwm` [µs] holds the pulses of throttle 0 and 1, linear between, held beyond. Thrust is scaled
    by the density ratio; first-order lag `time_constant`. `torque` [N·m] has the shape of `thrust`
    (reaction on the airframe about `axis`), or is None. When `rpm` is given the rows are rotation
    speeds [rpm], `throttle` is empty, and the speed measured by motor `rpm_channel` is used.
    """

    throttle_channel: int
    pwm: tuple[float, ...]
    throttle: tuple[float, ...]
    airspeed: tuple[float, ...]
    thrust: tuple[tuple[float, ...], ...]
    axis: Vector = (1.0, 0.0, 0.0)
    position: Vector = ZERO
    time_constant: float = 0.0
    thrust_sigma: float = 0.1
    torque: tuple[tuple[float, ...], ...] | None = None
    rpm: tuple[float, ...] | None = None
    rpm_channel: int | None = None


@dataclass(frozen=True)
class Envelope:
    """Limits nothing suggested or flown may leave: m/s, rad, g, m above ground."""

    airspeed: tuple[float, float]
    alpha: tuple[float, float]
    beta: tuple[float, float]
    load_factor: tuple[float, float]
    bank: float
    height_min: float


@dataclass(frozen=True)
class Value:
    """A number believed with one standard deviation `sigma` (absolute, in the value's unit)."""

    value: float
    sigma: float


@dataclass(frozen=True)
class TableTerm:
    """An aerodynamic table over one or two regressors: bilinear inside, held at its edges.

    `values` has one row per entry of `breakpoints[0]`, one column per entry of `breakpoints[1]`;
    over one regressor it is one row. `sigma` is relative: one standard deviation of a common scale.
    """

    name: str
    regressors: tuple[str, ...]
    breakpoints: tuple[tuple[float, ...], ...]
    values: tuple[float, ...] | tuple[tuple[float, ...], ...]
    sigma: float


@dataclass(frozen=True)
class CoefficientModel:
    """One coefficient: Σ value·regressor + Σ tables. Keys are regressors (see `regressors`)."""

    terms: Mapping[str, Value] = field(default_factory=dict)
    tables: tuple[TableTerm, ...] = ()


@dataclass(frozen=True)
class Aircraft:
    """An aircraft as its file describes it. `aerodynamics` is empty when the file has none.

    `beyond` is no part of the file: what was learned beyond terms and tables, CX…Cn of the flow by
    name (`regressors.VARIABLES` and controls), added to them. A tree of arrays as JAX has them.
    """

    name: str
    mass: Mass
    geometry: Geometry
    imu: Imu = Imu()
    pitot: Pitot = Pitot()
    vanes: Vanes | None = None
    streams: Mapping[str, StreamTiming] = field(default_factory=dict)
    servos: tuple[Servo, ...] = ()
    controls: tuple[Control, ...] = ()
    propulsion: tuple[Propulsion, ...] = ()
    envelope: Envelope | None = None
    aerodynamics: Mapping[str, CoefficientModel] = field(default_factory=dict)
    schema: int = 1
    beyond: Callable[[Mapping[str, Any]], Any] | None = None

    @property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls, in the file's order."""
        return tuple(control.name for control in self.controls)
