"""The thrust acts elsewhere, points elsewhere, or its torque is not known."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="thrust_offset",
    parameters=(
        Parameter("z", "thrust_drop", nominal=0.0, sigma=0.03, matters=0.03, unit="m", per="span"),
        Parameter("tilt", "thrust_tilt", nominal=0.0, sigma=0.05, matters=0.05, unit="rad"),
        Parameter("torque", "torque", nominal=0.0, sigma=0.03, matters=0.03, unit="1"),
    ),
    explanation="the thrust acts {z:.3f| m lower| m higher} than the file says, points "
    "{tilt:.3f| rad further up| rad further down}, and its torque is {torque:+.3f} of itself times "
    "the span",
    shown_by="throttle doublets with the controls held",
    needs="engine",
)
