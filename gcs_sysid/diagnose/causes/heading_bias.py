"""The heading is off by a constant, so that the wind seems to turn with the aircraft."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="heading_bias",
    parameters=(
        Parameter("heading_bias", "heading", nominal=0.0, sigma=0.13, matters=0.087, unit="rad"),
    ),
    explanation="the heading is off by {heading_bias:+.3f} rad: the wind found turns with the "
    "aircraft",
    shown_by="full circles, and a box in steady wind",
)
