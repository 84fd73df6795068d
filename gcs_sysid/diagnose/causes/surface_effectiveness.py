"""A control does more or less than the file says, in all its terms by one factor."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="surface_effectiveness",
    parameters=(
        Parameter("ratio", "effectiveness.{about}", nominal=1.0, sigma=0.3, matters=0.2, unit="1"),
    ),
    explanation="the {about} has {ratio:.2f} of the effect that its file says, in forces and "
    "moments alike: look for a loose linkage, a wrong horn or throw, or a gap",
    shown_by="short pulses on each control alone, added after the autopilot",
    about="control",
)
