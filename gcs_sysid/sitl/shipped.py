"""An aircraft that comes with JSBSim, aerodynamics, engine and all, in place of an aircraft file's.

Its controls are those of an aircraft file: the flight control system's gearing between command and
surface is undone, so that a surface stands where a servo put it.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import jsbsim
import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS, Vector
from gcs_sysid.errors import UsageError
from gcs_sysid.sitl import units
from gcs_sysid.sitl.jsbsim_aircraft import STEP, Jsbsim, Start, State, Wind, executive
from gcs_sysid.sitl.servo import interpolate

CONTROLS: Mapping[str, tuple[str, str]] = {
    "elevator": ("fcs/elevator-cmd-norm", "fcs/elevator-pos-rad"),
    "aileron": ("fcs/aileron-cmd-norm", "fcs/left-aileron-pos-rad"),
    "rudder": ("fcs/rudder-cmd-norm", "fcs/rudder-pos-rad"),
}
"""By control: command from -1 to 1, and position [rad]. The left aileron stands for both."""

COMMANDS = (-1.0, 0.0, 1.0)

_FORCES = ("fbx", "fby", "fbz")
_MOMENTS = ("l", "m", "n")


class ShippedAircraft(Jsbsim):
    """One of JSBSim's own aircraft, its engines running, its mass constant.

    Its coefficients are about the centre of gravity.

    Args:
        model: name of its folder, for instance `c172p`.
        start: where it begins.
        wind: moving air.
        seed: of the turbulence, 0 to 2³¹ - 1.
        step: integration step [s].

    Raises:
        UsageError: JSBSim has no such aircraft, or it has other controls.
    """

    def __init__(
        self,
        model: str,
        *,
        start: Start,
        wind: Wind,
        seed: int,
        step: float = STEP,
    ) -> None:
        fdm = executive(jsbsim.get_default_root_dir())
        if not fdm.load_model(model):
            raise UsageError(f"JSBSim brings no aircraft `{model}`; see its folder aircraft/")
        missing = [
            name
            for pair in CONTROLS.values()
            for name in pair
            if not fdm.get_property_manager().hasNode(name)
        ]
        if missing:
            raise UsageError(
                f"{model} has no {missing[0]}; an aircraft with three controls is asked"
            )
        self.travel = {name: _travel(fdm, *pair) for name, pair in CONTROLS.items()}
        super().__init__(fdm, start=start, wind=wind, seed=seed, step=step)
        fdm["propulsion/set-running"] = -1.0
        fdm["propulsion/fuel_freeze"] = 1.0
        node = self._node
        self._commands = {name: node(command) for name, (command, _) in CONTROLS.items()}
        self.engines = fdm.get_propulsion().get_num_engines()
        for engine in range(self.engines):
            fdm[f"fcs/mixture-cmd-norm[{engine}]"] = 1.0
        self._throttles = [node(f"fcs/throttle-cmd-norm[{i}]") for i in range(self.engines)]
        self._thrusts = [node(f"propulsion/engine[{i}]/thrust-lbs") for i in range(self.engines)]
        self._forces = [node(f"forces/{name}-aero-lbs") for name in _FORCES]
        self._moments = [node(f"moments/{name}-aero-lbsft") for name in _MOMENTS]
        area, span, chord = (
            node(f"metrics/{name}").get_double_value() for name in ("Sw-sqft", "bw-ft", "cbarw-ft")
        )
        self._area, self._lengths = area, (span, chord, span)

    def advance(self, controls: Mapping[str, float], throttles: list[float]) -> None:
        """Take one step; `controls` [rad] and `throttles` (0 to 1) are those at its end."""
        for name, value in controls.items():
            command = interpolate(value, self.travel[name], COMMANDS)
            self._commands[name].set_double_value(command)
        for node, value in zip(self._throttles, throttles, strict=True):
            node.set_double_value(value)
        self._run()

    def state(self) -> State:
        """Everything at the present instant."""
        moving = self._moving()
        scale = moving["qbar"] / units.PSF * self._area
        forces = [node.get_double_value() / scale for node in self._forces]
        moments = [
            node.get_double_value() / (scale * length)
            for node, length in zip(self._moments, self._lengths, strict=True)
        ]
        return State(**moving, **dict(zip(COEFFICIENTS, forces + moments, strict=True)))

    def property(self, path: str) -> float:
        """A property of JSBSim, in JSBSim's unit."""
        return self._node(path).get_double_value()

    def inertia(self) -> Float[np.ndarray, "axis axis"]:
        """Inertia tensor about the centre of gravity, body axes [kg·m²]."""
        with warnings.catch_warnings():
            # JSBSim's Python layer answers with numpy.matrix.
            warnings.simplefilter("ignore", PendingDeprecationWarning)
            return np.asarray(self._fdm.get_mass_balance().get_J()) * units.SLUG_FOOT2

    def thrust_places(self) -> list[Vector]:
        """Where each engine's thrust acts, from the centre of gravity, body axes [m]."""
        # JSBSim's structural frame: x aft, y right, z up.
        signs = {"x": -units.INCH, "y": units.INCH, "z": -units.INCH}

        def along(axis: str, engine: int) -> float:
            place = self.property(f"propulsion/engine[{engine}]/{axis}-reference-position")
            return signs[axis] * (place - self.property(f"inertia/cg-{axis}-in"))

        return [(along("x", i), along("y", i), along("z", i)) for i in range(self.engines)]

    def hold(self) -> None:
        """Leave position, attitude and speed as they are from now on; engines go on turning."""
        for kind in ("rate", "position"):
            for motion in ("rotational", "translational"):
                self._fdm[f"simulation/integrator/{kind}/{motion}"] = 0.0

    def placed(
        self,
        *,
        airspeed: float,
        alpha: float = 0.0,
        beta: float = 0.0,
        p: float = 0.0,
        q: float = 0.0,
        r: float = 0.0,
        **controls: float,
    ) -> State:
        """The state it has when put into still air so [m/s, rad, rad/s], at the height it is at."""
        fdm = self._fdm
        for name, value in controls.items():
            fdm[CONTROLS[name][0]] = interpolate(value, self.travel[name], COMMANDS)
        fdm["ic/vt-fps"] = airspeed / units.FOOT
        for name, value in (("alpha-rad", alpha), ("beta-rad", beta)):
            fdm[f"ic/{name}"] = value
        for name, value in (("p", p), ("q", q), ("r", r)):
            fdm[f"ic/{name}-rad_sec"] = value
        fdm.run_ic()
        state = self.state()
        for name in controls:
            fdm[CONTROLS[name][0]] = 0.0
        return state

    def thrusts(self) -> list[float]:
        """Thrust of each engine [N]."""
        return [node.get_double_value() * units.POUND_FORCE for node in self._thrusts]


def _travel(fdm: jsbsim.FGFDMExec, command: str, position: str) -> tuple[float, float, float]:
    """Position [rad] at each of `COMMANDS`."""
    found = []
    for value in COMMANDS:
        fdm[command] = value
        fdm.run_ic()
        found.append(fdm[position])
    fdm[command] = 0.0
    low, middle, high = found
    return low, middle, high
