"""The steady wind grows with height."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="wind_shear",
    parameters=(Parameter("gradient", "shear", nominal=0.0, sigma=0.05, matters=0.05, unit="1/s"),),
    explanation="the wind is {gradient:.3f| m/s stronger| m/s weaker} with each metre of height",
    shown_by="climbs and descents on two headings, in a wind of 2 m/s or more",
    needs="wind",
)
