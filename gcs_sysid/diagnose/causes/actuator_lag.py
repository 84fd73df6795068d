"""A control follows its command more slowly than the file says."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="actuator_lag",
    parameters=(
        Parameter("time_constant", "lag.{about}", nominal=0.0, sigma=0.15, matters=0.1, unit="s"),
    ),
    explanation="the {about} has {time_constant:.3f| s more| s less} lag than the file says: "
    "look at servo, supply voltage and linkage",
    shown_by="multisine on that control to three times its corner frequency",
    about="control",
)
