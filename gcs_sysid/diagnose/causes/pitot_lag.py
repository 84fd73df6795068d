"""The airspeed lags behind, as with a long tube."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="pitot_lag",
    parameters=(
        Parameter("pitot_lag", "airspeed_lag", nominal=0.0, sigma=0.2, matters=0.1, unit="s"),
    ),
    explanation="the airspeed lags by {pitot_lag:.2f} s: it shows slow changes that late, and "
    "hardly any quick ones",
    shown_by="throttle steps and short dives",
)
