"""The propeller's stream makes the tail more effective."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="propwash",
    parameters=(Parameter("gain", "wash", nominal=0.0, sigma=0.6, matters=0.4, unit="1"),),
    explanation="with power the tail gains {gain:.2f}·4·Tc of its effect, Tc being thrust over "
    "dynamic pressure and wing area: the propeller blows at it",
    shown_by="multisine on elevator and rudder at three powers and one airspeed",
    needs="engine",
)
