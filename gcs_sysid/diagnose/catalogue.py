"""All causes by name."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_sysid.diagnose.cause import Candidate, Cause
from gcs_sysid.diagnose.causes import (
    accelerometer_bias,
    actuator_backlash,
    actuator_lag,
    actuator_rate_limit,
    aero_derivative,
    aeroelastic,
    airspeed_scale,
    asymmetry,
    cg_shift,
    cross_coupling,
    drag_increase,
    ground_effect,
    gyro_scale,
    heading_bias,
    imu_misalignment,
    imu_position,
    inertia,
    mass,
    pitot_lag,
    propwash,
    stall,
    surface_effectiveness,
    surface_offset,
    thrust_offset,
    thrust_scale,
    time_skew,
    vane_bias,
    wind_shear,
)

CAUSES: Mapping[str, Cause] = {
    item.CAUSE.name: item.CAUSE
    for item in (
        mass,
        cg_shift,
        inertia,
        airspeed_scale,
        pitot_lag,
        accelerometer_bias,
        gyro_scale,
        imu_misalignment,
        imu_position,
        vane_bias,
        heading_bias,
        time_skew,
        actuator_lag,
        actuator_rate_limit,
        actuator_backlash,
        surface_effectiveness,
        surface_offset,
        thrust_scale,
        thrust_offset,
        propwash,
        wind_shear,
        drag_increase,
        stall,
        asymmetry,
        aeroelastic,
        cross_coupling,
        ground_effect,
        aero_derivative,
    )
}
"""In the order in which reports list them."""

OF_COEFFICIENTS = ("mass", "cg_shift", "airspeed_scale", "surface_effectiveness")
"""Those that the comparison of coefficients knows."""


def of_coefficients(controls: tuple[str, ...]) -> tuple[Candidate, ...]:
    """Every cause that the comparison of coefficients knows, once for each control it is about."""
    return tuple(
        Candidate(CAUSES[name], about)
        for name in OF_COEFFICIENTS
        for about in (controls if CAUSES[name].about == "control" else ("",))
    )
