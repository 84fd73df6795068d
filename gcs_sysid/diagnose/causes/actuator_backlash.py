"""A control has play."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="actuator_backlash",
    parameters=(
        Parameter("width", "backlash.{about}", nominal=0.0, sigma=0.03, matters=0.017, unit="rad"),
    ),
    explanation="the {about} has {width:.3f} rad of play that the file does not know",
    shown_by="slow triangles and small doublets on that control",
    about="control",
)
