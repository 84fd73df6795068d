"""A control cannot move as fast as it is told."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="actuator_rate_limit",
    parameters=(
        Parameter(
            "share",
            "rate_limit.{about}.{at}",
            nominal=0.0,
            sigma=0.15,
            matters=0.5,
            unit="1",
            expected=1.0,
        ),
    ),
    explanation="the {about} moves no faster than {rate_limit:.2f} rad/s, which the file does not "
    "say",
    shown_by="the same multisine at two amplitudes",
    about="control",
    where="rate_limit",
    places=(0.25, 0.35, 0.5, 0.7),
    where_unit="rad/s",
    where_per="rate of {about}",
)
