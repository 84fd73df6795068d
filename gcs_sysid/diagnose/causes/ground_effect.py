"""Near the ground lift, drag and moment change."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="ground_effect",
    parameters=(
        Parameter("lift", "ground.lift", nominal=0.0, sigma=0.3, matters=0.2, unit="1"),
        Parameter("drag", "ground.drag", nominal=0.0, sigma=1.0, matters=0.5, unit="1"),
        Parameter("moment", "ground.moment", nominal=0.0, sigma=0.3, matters=0.2, unit="1"),
    ),
    explanation="near the ground lift grows by {lift:+.2f}, drag by {drag:+.2f} of the induced one "
    "and the pitching moment by {moment:+.2f} of the lift times the ground's influence",
    shown_by="low passes below half a span, and the same legs above two",
    needs="ground",
)
