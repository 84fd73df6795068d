"""What causes leave along a flight that is no derivative of the aircraft.

A lag of a control by τ takes τ·dδ/dt off its deflection; an airspeed that comes τ late reads
V − τ·dV/dt, so that coefficients seem larger by 2τ·(dV/dt)/V, those of rates by half of it; thrust
that the file has wrong is left in the force coefficients as T/(q̄S) and in those of the moments by
its arm; a bias of the accelerometer as m·b/(q̄S). Each is a direction over regressors like those of
`suspects`, of which some hold what a model's do not: `names`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import FORCES, Aircraft
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.suspects import RATES, Direction, Suspect, file_values
from gcs_sysid.reconstruct.control_history import SERVO_STREAM
from gcs_sysid.reconstruct.measurements import AIRSPEED_STREAMS
from gcs_sysid.regressors import Factor, Regressor

GAINING, PER_PRESSURE = "V_rate", "per_qbar"
"""Rate of change of the airspeed over itself [1/s]; one over the dynamic pressure [1/Pa]."""


def names(controls: Sequence[str]) -> tuple[str, ...]:
    """Variables that these causes need beside those of a model."""
    return (*map(_rate, controls), GAINING, PER_PRESSURE)


def values(
    flown: Values, controls: Sequence[str], time: Float[np.ndarray, " sample"]
) -> dict[str, Float[np.ndarray, " sample"]]:
    """What `names` are along a flight.

    Args:
        flown: airspeed, dynamic pressure and controls there.
        controls: of the aircraft.
        time: of the samples [s], growing.
    """
    return {
        **{_rate(name): np.gradient(flown[name], time) for name in controls},
        GAINING: np.gradient(flown["V"], time) / flown["V"],
        PER_PRESSURE: 1.0 / flown["qbar"],
    }


def traces(aircraft: Aircraft) -> Iterator[Suspect]:
    """Causes that show in this way, for an aircraft file's aerodynamics."""
    file = file_values(aircraft)
    lags = {name: _lagging(file, name, aircraft.control_names) for name in aircraft.control_names}
    for name, moved in lags.items():
        yield Suspect("actuator_lag", name, moved, 0.1, "s")
    late: dict[tuple[str, str], float] = {}
    for moved in lags.values():
        for at, value in moved.items():
            late[at] = late.get(at, 0.0) + value
    yield Suspect("time_skew", SERVO_STREAM, late, 0.05, "s")
    slow = {
        (name, _times(key, GAINING, aircraft.control_names)): value
        * (1.0 if RATES & set(_parsed(key, aircraft.control_names).variables) else 2.0)
        for (name, key), value in file.items()
    }
    yield Suspect("pitot_lag", "", slow, 0.1, "s")
    for stream in AIRSPEED_STREAMS:
        yield Suspect("time_skew", stream, slow, 0.05, "s")
    for axis, name in zip("xyz", FORCES, strict=True):
        weight = aircraft.mass.mass / aircraft.geometry.wing_area
        yield Suspect("accelerometer_bias", axis, {(name, PER_PRESSURE): weight}, 0.3, "m/s²")
    if aircraft.propulsion:
        yield Suspect("thrust_scale", "", _pushing(aircraft), 0.2, "1")


def _rate(control: str) -> str:
    """dδ/dt of a control [rad/s]."""
    return f"{control}_rate"


def _parsed(key: str, controls: Sequence[str]) -> Regressor:
    return regressors.parse(key, controls=(*controls, *names(controls)))


def _times(key: str, variable: str, controls: Sequence[str]) -> str:
    return _parsed(f"{key}*{variable}", controls).key


def _lagging(file: Direction, control: str, controls: Sequence[str]) -> Direction:
    """What a second of lag takes off all terms that hold a control: −∂C/∂δ·dδ/dt.

    One side of a control beyond a knot is left out.
    """
    found: dict[tuple[str, str], float] = {}
    for (name, key), value in file.items():
        factors = _parsed(key, controls).factors
        for index, factor in enumerate(factors):
            if factor.variable != control or factor.side:
                continue
            rest = [*factors[:index], Factor(_rate(control)), *factors[index + 1 :]]
            if factor.exponent > 1:
                rest.append(replace(factor, exponent=factor.exponent - 1))
            at = (name, _parsed(Regressor(tuple(rest)).key, controls).key)
            found[at] = found.get(at, 0.0) - factor.exponent * value
    return found


def _pushing(aircraft: Aircraft) -> Direction:
    """Thrust along the axes and about them, per Tc; of several engines, each has as much."""
    axes = np.array([np.divide(one.axis, np.linalg.norm(one.axis)) for one in aircraft.propulsion])
    arms = np.array([np.subtract(one.position, aircraft.mass.cg) for one in aircraft.propulsion])
    shape = aircraft.geometry
    lengths = np.array([shape.wing_span, shape.mean_chord, shape.wing_span])
    # Tc is the sum of all components of the force, over q̄S.
    total = float(axes.sum())
    sums = np.concatenate([axes.sum(axis=0), np.cross(arms, axes).sum(axis=0) / lengths]) / total
    moved = zip((*FORCES, "Cl", "Cm", "Cn"), sums, strict=True)
    return {(name, "Tc"): float(value) for name, value in moved if value}
