"""The engine gives more or less thrust than the file says."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="thrust_scale",
    parameters=(Parameter("ratio", "thrust", nominal=1.0, sigma=0.25, matters=0.15, unit="1"),),
    explanation="the thrust is {ratio:.2f} of the file's: look at propeller, battery and the thrust"
    " map",
    shown_by="throttle steps at constant angle of attack, and glides",
    needs="engine",
)
