"""The inertial unit is turned in the airframe."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="imu_misalignment",
    parameters=(
        Parameter("tilt_x", "imu_tilt.0", nominal=0.0, sigma=0.05, matters=0.035, unit="rad"),
        Parameter("tilt_y", "imu_tilt.1", nominal=0.0, sigma=0.05, matters=0.035, unit="rad"),
        Parameter("tilt_z", "imu_tilt.2", nominal=0.0, sigma=0.05, matters=0.035, unit="rad"),
    ),
    explanation="the inertial unit is turned by {tilt_x:+.3f}, {tilt_y:+.3f} and {tilt_z:+.3f} rad:"
    " one axis shows a share of the next one",
    shown_by="push-overs and pull-ups with power on and off",
)
