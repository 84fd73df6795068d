"""An aircraft in flight: JSBSim integrates it, this module speaks SI to JSBSim.

Everything read after a step belongs to one instant: state, air, forces, coefficients and
accelerations.
"""

from __future__ import annotations

import logging
import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import jsbsim

from gcs_sysid.aircraft import COEFFICIENTS, ZERO, Aircraft, Vector
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl import jsbsim_xml, units
from gcs_sysid.sitl.jsbsim_xml import Feel, Fuel

_log = logging.getLogger(__name__)

STEP = 0.004
"""Integration step [s]. Third-order Adams-Bashforth is off by 3/8·(λ·STEP)³ in the rate λ of a
mode: 4e-4 for a roll mode of 40 ms."""

MILSPEC = 3
ADAMS_BASHFORTH_3 = 4
TURBULENCE_CEILING = 1000.0 * units.FOOT
"""Height above sea level [m] up to which `Wind.gust` alone sets the turbulence (MIL-F-8785C,
3.7.3.4; JSBSim uses the height above sea level here, not above ground)."""


@dataclass(frozen=True)
class Wind:
    """Moving air.

    Attributes:
        steady: velocity of the air, north east down [m/s].
        gust: standard deviation of the vertical turbulence below 300 m [m/s], a tenth of the wind
            at 6 m (MIL-F-8785C, figure 11); the horizontal ones follow from the height. 0 for calm.
        gradient: growth of the steady wind with height from where the flight begins [1/s]; towards
            the north where it is calm there.
    """

    steady: Vector = ZERO
    gust: float = 0.0
    gradient: float = 0.0

    def at(self, climbed: float) -> Vector:
        """The steady wind `climbed` metres above where the flight begins [m/s]."""
        north, east, down = self.steady
        speed = math.hypot(north, east)
        along = (north / speed, east / speed) if speed > 0.0 else (1.0, 0.0)
        more = self.gradient * climbed
        return north + more * along[0], east + more * along[1], down


@dataclass(frozen=True)
class Start:
    """Where a flight begins, in the air: degrees of latitude and longitude, m, m/s, rad."""

    latitude_deg: float = 47.3
    longitude_deg: float = 8.5
    elevation: float = 20.0
    height: float = 120.0
    heading: float = 0.0
    airspeed: float = 20.0
    alpha: float = 0.0
    bank: float = 0.0


@dataclass(frozen=True)
class State:
    """The aircraft and the air around it at one instant: SI, rad, body axes, NED.

    `p q r` are inertial; `p_air …` is the rotation against the air, which the aerodynamics feel;
    `u_air …` the velocity of the centre of gravity against the air; `force_*` everything but
    gravity. Coefficients are about the airframe point.
    """

    time: float
    latitude: float
    longitude: float
    altitude: float
    height: float
    v_north: float
    v_east: float
    v_down: float
    phi: float
    theta: float
    psi: float
    p: float
    q: float
    r: float
    p_dot: float
    q_dot: float
    r_dot: float
    force_x: float
    force_y: float
    force_z: float
    u_air: float
    v_air: float
    w_air: float
    p_air: float
    q_air: float
    r_air: float
    V: float
    qbar: float
    alpha: float
    beta: float
    wind_north: float
    wind_east: float
    wind_down: float
    density: float
    pressure: float
    temperature: float
    CX: float
    CY: float
    CZ: float
    Cl: float
    Cm: float
    Cn: float


_MOTION: Mapping[str, tuple[str, float]] = {
    "time": ("simulation/sim-time-sec", 1.0),
    "latitude": ("position/lat-geod-rad", 1.0),
    "longitude": ("position/long-gc-rad", 1.0),
    "altitude": ("position/h-sl-ft", units.FOOT),
    "height": ("position/h-agl-ft", units.FOOT),
    "v_north": ("velocities/v-north-fps", units.FOOT),
    "v_east": ("velocities/v-east-fps", units.FOOT),
    "v_down": ("velocities/v-down-fps", units.FOOT),
    "phi": ("attitude/phi-rad", 1.0),
    "theta": ("attitude/theta-rad", 1.0),
    "psi": ("attitude/psi-rad", 1.0),
    "p": ("velocities/pi-rad_sec", 1.0),
    "q": ("velocities/qi-rad_sec", 1.0),
    "r": ("velocities/ri-rad_sec", 1.0),
    "p_dot": ("accelerations/pidot-rad_sec2", 1.0),
    "q_dot": ("accelerations/qidot-rad_sec2", 1.0),
    "r_dot": ("accelerations/ridot-rad_sec2", 1.0),
    "force_x": ("forces/fbx-total-lbs", units.POUND_FORCE),
    "force_y": ("forces/fby-total-lbs", units.POUND_FORCE),
    "force_z": ("forces/fbz-total-lbs", units.POUND_FORCE),
    "u_air": ("velocities/u-aero-fps", units.FOOT),
    "v_air": ("velocities/v-aero-fps", units.FOOT),
    "w_air": ("velocities/w-aero-fps", units.FOOT),
    "p_air": ("velocities/p-aero-rad_sec", 1.0),
    "q_air": ("velocities/q-aero-rad_sec", 1.0),
    "r_air": ("velocities/r-aero-rad_sec", 1.0),
    "V": ("velocities/vt-fps", units.FOOT),
    "qbar": ("aero/qbar-psf", units.PSF),
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    "wind_north": ("atmosphere/total-wind-north-fps", units.FOOT),
    "wind_east": ("atmosphere/total-wind-east-fps", units.FOOT),
    "wind_down": ("atmosphere/total-wind-down-fps", units.FOOT),
    "density": ("atmosphere/rho-slugs_ft3", units.SLUG_FOOT3),
    "pressure": ("atmosphere/P-psf", units.PSF),
    "temperature": ("atmosphere/T-R", units.RANKINE),
}


class _Log(jsbsim.FGLogger):
    """JSBSim's messages on this program's log; by default it prints them on standard output."""

    def __init__(self) -> None:
        super().__init__()
        self._level = jsbsim.LogLevel.BULK
        self._text: list[str] = []

    def set_level(self, level: jsbsim.LogLevel) -> None:
        self._level = level
        self._text = []

    def file_location(self, filename: str, line: int) -> None:
        self._text.append(f"{filename}:{line}: ")

    def message(self, message: str) -> None:
        self._text.append(message)

    def format(self, format: jsbsim.LogFormat) -> None:
        pass

    def flush(self) -> None:
        grave = self._level in (jsbsim.LogLevel.ERROR, jsbsim.LogLevel.FATAL)
        _log.log(logging.WARNING if grave else logging.DEBUG, "%s", "".join(self._text).strip())


class Jsbsim:
    """JSBSim with some aircraft in it: the way into its air, and what moves.

    Args:
        fdm: with its model loaded.
        start: where it begins.
        wind: moving air.
        seed: of the turbulence, 0 to 2³¹ - 1.
        step: integration step [s].
    """

    def __init__(
        self, fdm: jsbsim.FGFDMExec, *, start: Start, wind: Wind, seed: int, step: float
    ) -> None:
        self._fdm = fdm
        self._wind = wind
        fdm.set_dt(step)
        fdm["simulation/randomseed"] = float(seed)
        self._begin(start, wind)
        node = self._node
        self._motion = [(key, node(path), factor) for key, (path, factor) in _MOTION.items()]
        self._winds = [node(f"atmosphere/wind-{axis}-fps") for axis in ("north", "east", "down")]
        self._altitude = node("position/h-sl-ft")
        self._mass = node("inertia/mass-slugs")
        self._start_altitude = self._altitude.get_double_value()

    def _begin(self, start: Start, wind: Wind) -> None:
        fdm, heading = self._fdm, start.heading
        for name in ("rate/rotational", "rate/translational"):
            fdm[f"simulation/integrator/{name}"] = ADAMS_BASHFORTH_3
        for name in ("position/rotational", "position/translational"):
            fdm[f"simulation/integrator/{name}"] = ADAMS_BASHFORTH_3
        fdm["ic/lat-geod-deg"] = start.latitude_deg
        fdm["ic/long-gc-deg"] = start.longitude_deg
        fdm["ic/terrain-elevation-ft"] = start.elevation / units.FOOT
        fdm["ic/h-agl-ft"] = start.height / units.FOOT
        fdm["ic/psi-true-rad"] = heading
        fdm["ic/theta-rad"] = start.alpha
        fdm["ic/phi-rad"] = start.bank
        north, east, down = wind.steady
        fdm["ic/vn-fps"] = (start.airspeed * math.cos(heading) + north) / units.FOOT
        fdm["ic/ve-fps"] = (start.airspeed * math.sin(heading) + east) / units.FOOT
        fdm["ic/vd-fps"] = down / units.FOOT
        fdm.run_ic()
        for axis, value in zip(("north", "east", "down"), wind.steady, strict=True):
            fdm[f"atmosphere/wind-{axis}-fps"] = value / units.FOOT
        if wind.gust > 0.0:
            fdm["atmosphere/turb-type"] = MILSPEC
            fdm["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = (
                10.0 * wind.gust / units.FOOT
            )
            # Below the ceiling any index but 0 (off) gives the same.
            fdm["atmosphere/turbulence/milspec/severity"] = 3

    def _node(self, path: str) -> jsbsim.FGPropertyNode:
        node = self._fdm.get_property_manager().get_node(path)
        if node is None:
            raise KeyError(f"JSBSim has no property {path}")
        return node

    def _run(self) -> None:
        if self._wind.gradient != 0.0:
            self._shear()
        self._fdm.run()

    def _shear(self) -> None:
        climbed = (self._altitude.get_double_value() - self._start_altitude) * units.FOOT
        for node, value in zip(self._winds, self._wind.at(climbed), strict=True):
            node.set_double_value(value / units.FOOT)

    def mass(self) -> float:
        """What is left of it [kg]."""
        return self._mass.get_double_value() * units.SLUG

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._fdm.get_sim_time()

    def _moving(self) -> dict[str, float]:
        return {key: node.get_double_value() * factor for key, node, factor in self._motion}


def executive(root: str | None) -> jsbsim.FGFDMExec:
    """JSBSim without anything in it; `root` holds its own aircraft, engines and systems."""
    jsbsim.set_logger(_Log())
    return jsbsim.FGFDMExec(root)


class JsbsimAircraft(Jsbsim):
    """The aircraft of a file in JSBSim.

    Args:
        aircraft: what flies.
        start: where it begins; the controls stand at zero and it is not in trim.
        wind: moving air.
        seed: of the turbulence, 0 to 2³¹ - 1.
        step: integration step [s].
        feel: what the air feels of a control, by control; all of it by default.
        stall_lag: how late what lies beyond a knot of alpha comes and goes [s].
        fuel: that the engines burn.

    Raises:
        UsageError: the aircraft cannot be flown; the message says why.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        *,
        start: Start = Start(),
        wind: Wind = Wind(),
        seed: int = 0,
        step: float = STEP,
        feel: Mapping[str, Feel] | None = None,
        stall_lag: float = 0.0,
        fuel: Fuel | None = None,
    ) -> None:
        self.aircraft = aircraft
        self._stall_lag = stall_lag
        self._fuel, self._burnt = fuel, 0.0
        self._step = step
        fdm = executive(None)
        _load(
            fdm,
            jsbsim_xml.model_xml(aircraft, feel=feel, late_stall=stall_lag > 0.0, fuel=fuel),
            name=aircraft.name,
        )
        super().__init__(fdm, start=start, wind=wind, seed=seed, step=step)
        node = self._node
        self._motion += [
            (name, node(jsbsim_xml.coefficient_property(name)), 1.0) for name in COEFFICIENTS
        ]
        self._controls = {
            name: node(jsbsim_xml.control_property(name)) for name in aircraft.control_names
        }
        thrusters = range(len(aircraft.propulsion))
        self._throttles = [node(jsbsim_xml.throttle_property(i)) for i in thrusters]
        self._thrusts = [node(jsbsim_xml.thrust_property(i)) for i in thrusters]
        self._alpha = node("aero/alpha-rad")
        knots = jsbsim_xml.knots(aircraft) if stall_lag > 0.0 else ()
        self._late = [(knot, node(jsbsim_xml.late_property(i))) for i, knot in enumerate(knots)]
        self._tank = None if fuel is None else node("inertia/pointmass-weight-lbs")

    def advance(self, controls: Mapping[str, float], throttles: list[float]) -> None:
        """Take one step; `controls` [rad] and `throttles` (0 to 1) are those at its end."""
        for name, value in controls.items():
            self._controls[name].set_double_value(value)
        for node, value in zip(self._throttles, throttles, strict=True):
            node.set_double_value(value)
        if self._late:
            self._separate()
        if self._fuel is not None and self._tank is not None:
            self._burn(self._fuel, self._tank, throttles)
        self._run()

    def _separate(self) -> None:
        alpha = self._alpha.get_double_value()
        share = -math.expm1(-self._step / self._stall_lag)
        for knot, node in self._late:
            late = node.get_double_value()
            node.set_double_value(late + share * (max(0.0, alpha - knot) - late))

    def _burn(self, fuel: Fuel, tank: jsbsim.FGPropertyNode, throttles: list[float]) -> None:
        self._burnt += self._step * fuel.burn * sum(throttles) / max(len(throttles), 1)
        tank.set_double_value(jsbsim_xml.weight(max(fuel.mass - self._burnt, 0.0)))

    def state(self) -> State:
        """Everything at the present instant."""
        return State(**self._moving())

    def thrusts(self) -> list[float]:
        """Thrust of each thruster [N]."""
        return [node.get_double_value() for node in self._thrusts]


def _load(fdm: jsbsim.FGFDMExec, text: str, *, name: str) -> None:
    with tempfile.TemporaryDirectory(prefix="gcs-sysid-") as folder:
        model = Path(folder) / "sitl"
        model.mkdir()
        (model / "sitl.xml").write_text(text, encoding="utf-8")
        loaded = fdm.load_model_with_paths("sitl", folder, folder, folder)
    if not loaded:
        raise UsageError(f"JSBSim refuses the model of {name}; its reason is in the log")
