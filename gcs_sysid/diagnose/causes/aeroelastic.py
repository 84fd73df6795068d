"""A control loses its effect with dynamic pressure."""

from gcs_sysid.diagnose.cause import Cause, Parameter

CAUSE = Cause(
    name="aeroelastic",
    parameters=(
        Parameter("loss", "aeroelastic.{about}", nominal=0.0, sigma=0.25, matters=0.2, unit="1"),
        # At which dynamic pressure the file is right, nobody says.
        Parameter("level", "effectiveness.{about}", nominal=1.0, sigma=0.2, matters=0.2, unit="1"),
    ),
    explanation="with each doubling of the dynamic pressure the {about} {loss:|gains|loses} "
    "{loss:.2f||} of its effect, and has {level:.2f} of the file's at the usual one: it bends",
    shown_by="multisine on that control at three airspeeds",
    about="control",
)
