"""The aircraft is heavier or lighter than its file says; inertia stays."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="mass",
    parameters=(Parameter("mass_ratio", "mass", nominal=1.0, sigma=0.1, matters=0.06, unit="1"),),
    explanation="the mass is {change:.1f| % more| % less} than the file says: all three forces are "
    "wrong by one factor, the moments are not",
    shown_by="load-factor turns and push-overs at two powers, or the same flight with a weighed "
    "ballast",
)
