"""Sideslip pitches the aircraft, or angle of attack rolls it."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="cross_coupling",
    parameters=(
        Parameter(
            "Cm_beta",
            "term.Cm.beta",
            nominal=0.0,
            sigma=0.3,
            matters=0.2,
            unit="1/rad",
            per="Cm_alpha",
        ),
        Parameter(
            "Cl_alpha",
            "term.Cl.alpha",
            nominal=0.0,
            sigma=0.1,
            matters=0.05,
            unit="1/rad",
            per="Cm_alpha",
        ),
    ),
    explanation="sideslip pitches by Cm_beta {Cm_beta:+.3f} and angle of attack rolls by Cl_alpha "
    "{Cl_alpha:+.3f}, per rad",
    shown_by="steady sideslips to both sides, and pull-ups",
)
