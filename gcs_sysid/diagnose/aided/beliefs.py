"""What is ordinarily wrong: beliefs about every parameter of the flight model before any cause.

Ordinary errors are part of every hypothesis, so that what they can explain accuses nobody.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.estimate.suspects import RIGGING
from gcs_sysid.model.aided import ATTITUDE_TILT

SENSORS = {
    "gyro_bias": float(np.radians(0.3)),
    "accelerometer_bias": 0.1,
    "vane_bias": float(np.radians(0.3)),
    "vane_scale": 0.02,
    "moment_lag": 0.01,
    "airspeed_delay": 0.02,
    "velocity_delay": 0.02,
    "attitude_delay": 0.01,
    "vane_delay": 0.001,
    "attitude_tilt": ATTITUDE_TILT,
}
"""Ordinary errors of sensors and streams, SI and radians."""
AIRSPEED_SCALE = 0.01
SERVO_DELAY = 0.01
"""Unless the aircraft file says otherwise [1, s]."""
MASS, INERTIA, THRUST = 0.02, 0.05, 0.05
"""Of a weighed, swung and measured aircraft, relative: a third of what is worth naming. A file that
is less sure may well be wrong by more, and that is then what its simulation gets wrong."""
CG = 0.01
"""Of a weighed centre of gravity [mean chords]."""
IMU_PLACE = 0.02
"""Of where the inertial unit sits [m]."""
IMU_TILT = float(np.radians(0.4))
"""Of how it is mounted [rad]."""
GYRO_SCALE = 0.003
HEADING = 0.02
"""Of a compass that was calibrated [rad]."""
NEGLIGIBLE = 0.01
"""Of a coefficient's spread over the flights: what no simulation is good to, whatever its file says
[1]. A damping in lift that nobody looks at may be half of what it is said to be, and is nobody's
fault."""
SHEAR = 0.003
"""Of the wind over the heights of one flight [1/s]."""


def ordinary(
    names: Sequence[str], aircraft: Aircraft, *, vanes: bool
) -> Float[np.ndarray, " parameter"]:
    """One standard deviation of each parameter of the model; 0 for what only a cause frees.

    Args:
        names: of the parameters, as `quantities.names` gives them.
        aircraft: what its file says.
        vanes: whether flow vanes were recorded.
    """
    stated = aircraft.pitot.error.scale_sigma
    servo = aircraft.streams.get("SERVO_OUTPUT_RAW", StreamTiming())
    thrust = max((each.thrust_sigma for each in aircraft.propulsion), default=0.0)
    usual = {f"sensors.{name}": value for name, value in SENSORS.items()}
    usual |= {
        "sensors.airspeed_scale": AIRSPEED_SCALE if stated is None else stated,
        "sensors.airspeed_lag": aircraft.pitot.error.lag_sigma or 0.0,
        "sensors.surface_delay": SERVO_DELAY if servo.sigma is None else servo.sigma,
        "departures.mass": min(aircraft.mass.mass_sigma, MASS),
        "departures.inertia": min(aircraft.mass.inertia_sigma, INERTIA),
        "departures.cg": CG * aircraft.geometry.mean_chord,
        "departures.thrust": min(thrust, THRUST),
        "departures.offset": RIGGING,
        "departures.imu_position": IMU_PLACE,
        "departures.imu_tilt": IMU_TILT,
        "departures.gyro_scale": GYRO_SCALE,
        "departures.heading": HEADING,
        "departures.shear": SHEAR,
    }
    found = np.zeros(len(names))
    for index, name in enumerate(names):
        kind, _, rest = name.partition(".")
        if kind == "aerodynamics":
            coefficient, _, key = rest.partition(".")
            found[index] = aircraft.aerodynamics[coefficient].terms[key].sigma
        elif vanes or ".vane_" not in name:
            root = name if name in usual else name.rpartition(".")[0]
            found[index] = usual.get(root, 0.0)
    return found


def negligible(
    names: Sequence[str], aircraft: Aircraft, flow: Mapping[str, Float[np.ndarray, " sample"]]
) -> Float[np.ndarray, " parameter"]:
    """By how much each aerodynamic parameter may be off without anybody caring; 0 of the others.

    Args:
        names: of the parameters, as `quantities.names` gives them.
        aircraft: of whose terms they are.
        flow: variables and controls over the flights.
    """
    place, controls = {name: index for index, name in enumerate(names)}, aircraft.control_names
    found = np.zeros(len(names))
    for coefficient, model in aircraft.aerodynamics.items():
        terms = {key: regressors.parse(key, controls=controls) for key in model.terms}
        columns = {
            key: regressors.evaluate(term, flow)
            for key, term in terms.items()
            if set(term.variables) <= set(flow)
        }
        spread = float(np.std(sum(model.terms[key].value * columns[key] for key in columns)))
        for key, column in columns.items():
            # A constant acts by its size.
            acts = float(np.std(column)) if terms[key].factors else 1.0
            if acts > 0.0:
                found[place[f"aerodynamics.{coefficient}.{key}"]] = NEGLIGIBLE * spread / acts
    return found
