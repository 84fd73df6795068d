"""The airspeed indicator reads a constant factor too much or too little."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="airspeed_scale",
    parameters=(
        Parameter("airspeed_scale", "airspeed", nominal=0.0, sigma=0.06, matters=0.03, unit="1"),
    ),
    explanation="the airspeed indicated is {change:.1f| % higher| % lower} than the true "
    "one: speed over ground and wind do not close in the turns, and all coefficients are off with "
    "the dynamic pressure",
    shown_by="two full circles, and a box in steady wind",
)
