"""The accelerometer reads a constant too much or too little."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="accelerometer_bias",
    parameters=(
        Parameter(
            "bias_x", "accelerometer_bias.0", nominal=0.0, sigma=0.45, matters=0.3, unit="m/s²"
        ),
        Parameter(
            "bias_y", "accelerometer_bias.1", nominal=0.0, sigma=0.45, matters=0.3, unit="m/s²"
        ),
        Parameter(
            "bias_z", "accelerometer_bias.2", nominal=0.0, sigma=0.45, matters=0.3, unit="m/s²"
        ),
    ),
    explanation="the accelerometer is off by {bias_x:+.2f}, {bias_y:+.2f} and {bias_z:+.2f} m/s²: "
    "the same force at all airspeeds",
    shown_by="level legs at airspeeds 25 % apart",
)
