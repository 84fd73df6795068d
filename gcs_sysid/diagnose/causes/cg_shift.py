"""The centre of gravity lies further forward or aft than the file says."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="cg_shift",
    parameters=(
        Parameter("cg_x_chord", "cg.x", nominal=0.0, sigma=0.08, matters=0.03, unit="mean chords"),
    ),
    explanation="the centre of gravity is {cg_x_chord:.3f| mean chords forward| mean chords aft} "
    "of where the file has it: the pitching moment is off by the lift, the yawing moment by the "
    "side force, at one arm",
    shown_by="elevator multisine and rudder doublets at three airspeeds",
)
