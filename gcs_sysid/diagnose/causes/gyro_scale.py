"""The gyros read a constant factor too much or too little."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="gyro_scale",
    parameters=(
        Parameter("scale_x", "gyro_scale.0", nominal=0.0, sigma=0.03, matters=0.03, unit="1"),
        Parameter("scale_y", "gyro_scale.1", nominal=0.0, sigma=0.03, matters=0.03, unit="1"),
        Parameter("scale_z", "gyro_scale.2", nominal=0.0, sigma=0.03, matters=0.03, unit="1"),
    ),
    explanation="the gyros are off by {scale_x:+.3f}, {scale_y:+.3f} and {scale_z:+.3f} of the "
    "rate: turns do not add up to the change of attitude",
    shown_by="full rolls, and two full circles each way",
)
