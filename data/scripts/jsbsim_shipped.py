"""An aircraft that comes with JSBSim: its aircraft file without aerodynamics, and a flight of it.

    .venv/bin/python -m data.scripts.jsbsim_shipped c172p --out out/c172p
    .venv/bin/gcs-sysid identify out/c172p/flight.tlog --aircraft out/c172p/aircraft.toml --out ...

An aircraft that nobody here made, flown through the recorder, the sensors and the test inputs of
`gcs-sysid sitl`. Mass, inertia, geometry, surface travel and thrust are asked of JSBSim; servos,
sensors and the envelope's angles are chosen.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from data.scripts import files
from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import (
    COEFFICIENTS,
    MOMENTS,
    Aircraft,
    CoefficientModel,
    Control,
    Envelope,
    Geometry,
    Imu,
    Mass,
    Pitot,
    Propulsion,
    Servo,
    Value,
    Vanes,
)
from gcs_sysid.sitl import plan, record, scenario, units
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.jsbsim_aircraft import Start, Wind
from gcs_sysid.sitl.shipped import CONTROLS, ShippedAircraft

THROTTLES = (0.0, 0.25, 0.5, 0.75, 1.0)
CALM = Wind()
STALL = math.radians(14.0)
STEP = 1e-3

_CHANNELS = {"aileron": 1, "elevator": 2, "rudder": 4}
_THROTTLE_CHANNELS = (3, 6, 7, 8)
# Until an engine and its propeller turn steadily [s].
_SETTLE = 20.0


@dataclass(frozen=True)
class Derived:
    """What is known of a shipped aircraft.

    Attributes:
        told: its aircraft file, which has no aerodynamics.
        flown: the same with derivatives asked of JSBSim, for the autopilot alone.
    """

    told: Aircraft
    flown: Aircraft


def derive(model: str, *, airspeed: float) -> Derived:
    """What JSBSim says of one of its aircraft, about an airspeed [m/s] at sea level."""
    start = Start(height=120.0, elevation=0.0, airspeed=airspeed)
    flying = ShippedAircraft(model, start=start, wind=CALM, seed=0)
    ask = flying.property
    geometry = Geometry(
        wing_area=files.rounded(ask("metrics/Sw-sqft") * units.FOOT**2),
        wing_span=files.rounded(ask("metrics/bw-ft") * units.FOOT),
        mean_chord=files.rounded(ask("metrics/cbarw-ft") * units.FOOT),
    )
    mass = _mass(flying)
    terms = _aerodynamics(model, airspeed, geometry)
    lift = [-sum(terms["CZ"][key].value * x for key, x in (("1", 1.0), ("alpha", STALL)))]
    slowest = math.sqrt(2.0 * mass.mass * 9.81 / (1.225 * geometry.wing_area * lift[0]))
    told = Aircraft(
        name=f"JSBSim's {model}",
        mass=mass,
        geometry=geometry,
        imu=Imu(),
        pitot=Pitot(),
        vanes=Vanes(),
        servos=tuple(
            Servo(
                _CHANNELS[name],
                name,
                (1000.0, 1500.0, 2000.0),
                flying.travel[name],
                time_constant=0.05,
                delay=0.02,
            )
            for name in CONTROLS
        ),
        controls=tuple(Control(name, {name: 1.0}) for name in CONTROLS),
        propulsion=_propulsion(model, flying, airspeed),
        envelope=Envelope(
            airspeed=(files.rounded(1.3 * slowest), files.rounded(2.1 * slowest)),
            alpha=(math.radians(-6.0), math.radians(12.0)),
            beta=(math.radians(-12.0), math.radians(12.0)),
            load_factor=(-0.5, 3.0),
            bank=math.radians(50.0),
            height_min=60.0,
        ),
    )
    models = {name: CoefficientModel(values) for name, values in terms.items()}
    return Derived(told, replace(told, aerodynamics=models))


def flight(derived: Derived, model: str, *, wind: Wind, seed: int) -> Flight:
    """The standard flight of a shipped aircraft."""
    legs = plan.standard(derived.flown)
    return Flight(
        believed=derived.flown,
        flown=derived.flown,
        legs=legs,
        start=scenario.start(legs[0]),
        wind=wind,
        seed=seed,
        shipped=model,
    )


def _mass(flying: ShippedAircraft) -> Mass:
    tensor = flying.inertia()
    return Mass(
        mass=files.rounded(flying.mass()),
        Ixx=files.rounded(tensor[0, 0]),
        Iyy=files.rounded(tensor[1, 1]),
        Izz=files.rounded(tensor[2, 2]),
        Ixz=files.rounded(-tensor[0, 2]),
        Ixy=files.rounded(-tensor[0, 1]),
        Iyz=files.rounded(-tensor[1, 2]),
    )


def _aerodynamics(model: str, airspeed: float, geometry: Geometry) -> dict[str, dict[str, Value]]:
    """Linear terms between -2° and 6° and by small rates and deflections."""
    flying = ShippedAircraft(
        model, start=Start(height=120.0, elevation=0.0, airspeed=airspeed), wind=CALM, seed=0
    )

    def at(**changes: float) -> Float[np.ndarray, " coefficient"]:
        state = flying.placed(airspeed=airspeed, **changes)
        return np.array([getattr(state, name) for name in COEFFICIENTS])

    low, high = math.radians(-2.0), math.radians(6.0)
    slope = (at(alpha=high) - at(alpha=low)) / (high - low)
    found = {"1": at(alpha=low) - slope * low, "alpha": slope}
    lengths = {"p": geometry.wing_span, "q": geometry.mean_chord, "r": geometry.wing_span}
    for rate, length in lengths.items():
        per = length / (2.0 * airspeed)
        found[f"{rate}hat"] = (at(**{rate: STEP}) - at(**{rate: -STEP})) / (2.0 * STEP * per)
    for name in ("beta", *CONTROLS):
        found[name] = (at(**{name: STEP}) - at(**{name: -STEP})) / (2.0 * STEP)
    return {
        name: {
            key: Value(files.rounded(float(row[i])), 0.0)
            for key, row in found.items()
            if _belongs(name, key)
        }
        for i, name in enumerate(COEFFICIENTS)
    }


def _belongs(coefficient: str, key: str) -> bool:
    """Whether a term is one of an aircraft with a plane of symmetry."""
    lateral = key in ("beta", "phat", "rhat", "aileron", "rudder")
    return lateral == (coefficient in ("CY", MOMENTS[0], MOMENTS[2]))


def _propulsion(model: str, flying: ShippedAircraft, airspeed: float) -> tuple[Propulsion, ...]:
    """Thrust and torque of steadily running engines, on a grid."""
    speeds = tuple(files.rounded(airspeed * share) for share in (0.5, 0.7, 0.9, 1.1, 1.3, 1.5))
    rows: list[list[tuple[list[float], float]]] = []
    for throttle in THROTTLES:
        rows.append([_running(model, speed, throttle) for speed in speeds])
    lag = _lag(model, airspeed)
    return tuple(
        Propulsion(
            throttle_channel=_THROTTLE_CHANNELS[engine],
            pwm=(1000.0, 2000.0),
            throttle=THROTTLES,
            airspeed=speeds,
            thrust=tuple(
                tuple(files.rounded(thrusts[engine]) for thrusts, _ in row) for row in rows
            ),
            torque=tuple(
                tuple(files.rounded(torque / flying.engines) for _, torque in row) for row in rows
            ),
            position=tuple(np.round(place, 3).tolist()),
            time_constant=lag,
        )
        for engine, place in enumerate(flying.thrust_places())
    )


def _running(model: str, airspeed: float, throttle: float) -> tuple[list[float], float]:
    """Thrust of each engine [N] and torque of all about x [N·m], held at an airspeed."""
    held = _held(model, airspeed)
    for _ in range(round(_SETTLE / 0.01)):
        held.advance({}, [throttle] * held.engines)
    density = held.state().density / 1.225
    torque = held.property("moments/l-prop-lbsft") * units.POUND_FORCE * units.FOOT
    return [thrust / density for thrust in held.thrusts()], torque / density


def _lag(model: str, airspeed: float) -> float:
    """Time after which two thirds of a step in thrust are there [s]."""
    held = _held(model, airspeed)
    thrusts = []
    for throttle in (0.4, 0.7):
        for _ in range(round(_SETTLE / 0.01)):
            held.advance({}, [throttle] * held.engines)
            thrusts.append(sum(held.thrusts()))
    steps = len(thrusts) // 2
    before, after = thrusts[steps - 1], thrusts[-1]
    there = (np.array(thrusts[steps:]) - before) / (after - before) > 1.0 - math.exp(-1.0)
    return files.rounded(0.01 * (int(np.argmax(there)) + 1))


def _held(model: str, airspeed: float) -> ShippedAircraft:
    start = Start(height=120.0, elevation=0.0, airspeed=airspeed)
    held = ShippedAircraft(model, start=start, wind=CALM, seed=0, step=0.01)
    held.hold()
    return held


def main() -> None:
    """Derive, write the file, and fly."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", help="a folder of JSBSim's aircraft/, for instance c172p")
    parser.add_argument("--airspeed", type=float, default=52.0, help="m/s, about which it is asked")
    parser.add_argument("--gust", type=float, default=0.0, help="vertical gusts, sigma in m/s")
    parser.add_argument("--wind", type=float, default=4.0, help="m/s, from the west")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    derived = derive(options.model, airspeed=options.airspeed)
    options.out.mkdir(parents=True, exist_ok=True)
    aircraft_file.save(derived.told, options.out / "aircraft.toml")
    wind = scenario.wind(math.radians(270.0), options.wind, options.gust)
    record.run(
        flight(derived, options.model, wind=wind, seed=options.seed),
        record=options.out / "flight.tlog",
        truth=options.out / "truth.npz",
    )


if __name__ == "__main__":
    main()
