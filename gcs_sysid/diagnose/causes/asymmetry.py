"""The aircraft is not symmetric: a twisted wing, a bent fin."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="asymmetry",
    parameters=(
        Parameter("Cl0", "term.Cl.1", nominal=0.0, sigma=0.009, matters=0.006, unit="1"),
        Parameter("Cn0", "term.Cn.1", nominal=0.0, sigma=0.005, matters=0.006, unit="1"),
    ),
    explanation="constant rolling and yawing moments, Cl {Cl0:+.4f} and Cn {Cn0:+.4f}: look at "
    "twist, rigging and symmetry",
    shown_by="level legs at three airspeeds, load factors and powers",
)
