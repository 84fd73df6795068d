"""One derivative of the file is wrong, and nothing else explains it."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="aero_derivative",
    parameters=(
        Parameter("ratio", "derivative.{about}", nominal=1.0, sigma=0.3, matters=0.2, unit="1"),
    ),
    explanation="{about} is {ratio:.2f} of what the file says",
    shown_by="a multisine on the axis of that derivative",
    about="derivative",
)
