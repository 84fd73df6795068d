"""Every key that an aircraft file may hold, by the table it belongs in."""

from __future__ import annotations

from collections.abc import Mapping

TOP = "the top of the file"
SENSOR_KEYS = ("bias", "bias_sigma", "scale", "scale_sigma", "lag", "lag_sigma")

KEYS: Mapping[str, tuple[str, ...]] = {
    TOP: (
        *("schema", "name", "mass", "geometry", "imu", "pitot", "vanes", "streams", "servos"),
        *("controls", "propulsion", "envelope", "aerodynamics"),
    ),
    "[mass]": (
        *("mass", "Ixx", "Iyy", "Izz", "Ixz", "Ixy", "Iyz", "cg", "mass_sigma", "inertia_sigma"),
    ),
    "[geometry]": ("wing_area", "wing_span", "mean_chord"),
    "[imu]": ("position", "misalignment", "misalignment_sigma", "accelerometer", "gyro"),
    "[imu.accelerometer]": SENSOR_KEYS,
    "[imu.gyro]": SENSOR_KEYS,
    "[pitot]": ("position", "measures", *SENSOR_KEYS),
    "[vanes]": ("position", "upwash", "upwash_sigma", *SENSOR_KEYS),
    "[streams.NAME]": ("delay", "sigma"),
    "[[servos]]": (
        *("channel", "surface", "pwm", "deflection", "time_constant", "delay", "rate_limit"),
        *("backlash", "offset", "effectiveness"),
    ),
    "[[controls]]": ("name", "mix"),
    "[propulsion]": (
        *("throttle_channel", "pwm", "throttle", "rpm", "rpm_channel", "airspeed", "thrust"),
        *("thrust_sigma", "torque", "axis", "position", "time_constant"),
    ),
    "[envelope]": ("airspeed", "alpha", "beta", "load_factor", "bank", "height_min"),
    "[aerodynamics]": ("sigma", "CX", "CY", "CZ", "Cl", "Cm", "Cn"),
}
