"""The wing loses lift slope beyond an angle of attack."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="stall",
    parameters=(
        Parameter("slope_loss", "stall.{at}", nominal=0.0, sigma=0.5, matters=0.4, unit="1"),
    ),
    explanation="beyond {alpha_break:.3f} rad of angle of attack {slope_loss:.2f} of the lift slope"
    " is lost, which the file does not say",
    shown_by="slow decelerations to the stall at two rates",
    where="alpha_break",
    places=(0.08, 0.09, 0.1, 0.11, 0.12, 0.13, 0.14, 0.16, 0.18, 0.2),
    where_unit="rad",
)
