"""The flow vanes read a constant too much or too little."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="vane_bias",
    parameters=(
        Parameter("alpha_bias", "vane_bias.0", nominal=0.0, sigma=0.025, matters=0.017, unit="rad"),
        Parameter("beta_bias", "vane_bias.1", nominal=0.0, sigma=0.025, matters=0.017, unit="rad"),
    ),
    explanation="the vanes are off by {alpha_bias:+.3f} rad in angle of attack and {beta_bias:+.3f}"
    " rad in sideslip",
    shown_by="the same leg both ways in steady wind, and sideslips to both sides",
    needs="vanes",
)
