"""Moments of inertia are not what the file says."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="inertia",
    parameters=(
        Parameter("Ixx_ratio", "inertia.0", nominal=1.0, sigma=0.2, matters=0.15, unit="1"),
        Parameter("Iyy_ratio", "inertia.1", nominal=1.0, sigma=0.2, matters=0.15, unit="1"),
        Parameter("Izz_ratio", "inertia.2", nominal=1.0, sigma=0.2, matters=0.15, unit="1"),
    ),
    explanation="moments of inertia are {Ixx_ratio:.2f}, {Iyy_ratio:.2f} and {Izz_ratio:.2f} of the"
    " file's: each scales everything that moves its axis",
    shown_by="rolls with pitch and yaw rates together, or a swing test",
)
