"""What a message says was true before its time stamp."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="time_skew",
    parameters=(
        Parameter("delay", "skew.{about}", nominal=0.0, sigma=0.08, matters=0.05, unit="s"),
    ),
    explanation="{about} comes {delay:.3f| s late| s early}: it looks like damping that grows with"
    " frequency",
    shown_by="multisines over a decade of frequency on each control",
    about="stream",
)
