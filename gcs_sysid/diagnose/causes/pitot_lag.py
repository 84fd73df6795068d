"""The airspeed lags behind, as with a long tube."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="pitot_lag",
    parameters=(
        Parameter("pitot_lag", "airspeed_delay", nominal=0.0, sigma=0.2, matters=0.1, unit="s"),
    ),
    explanation="the airspeed comes {pitot_lag:.2f} s late: it follows every change of speed at "
    "that distance",
    shown_by="throttle steps and short dives",
)
