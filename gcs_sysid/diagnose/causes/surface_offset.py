"""A control stands elsewhere when told to stand at zero."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="surface_offset",
    parameters=(
        Parameter("offset", "offset.{about}", nominal=0.0, sigma=0.05, matters=0.035, unit="rad"),
    ),
    explanation="the {about} stands {offset:+.3f} rad from where it is told to stand: look at its "
    "rigging",
    shown_by="level legs at three airspeeds and two powers",
    about="control",
)
