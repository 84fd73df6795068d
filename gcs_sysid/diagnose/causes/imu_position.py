"""The inertial unit sits elsewhere."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="imu_position",
    parameters=(
        Parameter("dx", "imu_position.0", nominal=0.0, sigma=0.1, matters=0.1, unit="m"),
        Parameter("dy", "imu_position.1", nominal=0.0, sigma=0.1, matters=0.1, unit="m"),
        Parameter("dz", "imu_position.2", nominal=0.0, sigma=0.1, matters=0.1, unit="m"),
    ),
    explanation="the inertial unit sits {dx:+.3f}, {dy:+.3f}, {dz:+.3f} m from where the file has "
    "it: it feels angular acceleration as force",
    shown_by="short doublets and multisines above the short period on all axes",
)
