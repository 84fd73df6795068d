"""There is more drag than the file says, at all angles."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="drag_increase",
    parameters=(
        Parameter("CX0", "term.CX.1", nominal=0.0, sigma=0.35, matters=0.25, unit="1", per="CX0"),
    ),
    explanation="CX is off by {CX0:+.4f} everywhere: drag that the file does not know",
    shown_by="glides at three airspeeds",
)
