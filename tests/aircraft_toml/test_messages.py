"""Every mistake in an aircraft file is answered with key, found, allowed and fix."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.errors import AircraftFileError

FULL = (Path(__file__).parents[1] / "reference" / "every_key.toml").read_text()
LEFT = 'surface = "aileron_left"'

MISTAKES = [
    # Unknown keys, and where they belong.
    ("Ixx = 0.824", "ixx = 0.824", "mass.ixx", "an unknown key", "did you mean `Ixx`?"),
    ("wing_span", "span", "geometry.span", "an unknown key", "did you mean `wing_span`?"),
    (
        "mass = 11.0",
        "mass = 11.0\nrate_limit = 3",
        "mass.rate_limit",
        "an unknown key",
        "`rate_limit` belongs in [[servos]]",
    ),
    ("[envelope]", "[envelop]", "envelop", "an unknown key", "did you mean `envelope`?"),
    (
        'name = "full"',
        'name = "full"\nwing_area = 1',
        "wing_area",
        "an unknown key",
        "`wing_area` belongs in [geometry]",
    ),
    ("lag_sigma = 0.001", "colour = 1", "imu.accelerometer.colour", "unknown", "remove `colour`"),
    ("delay = -0.04", "latency = 1", "streams.SERVO_OUTPUT_RAW.latency", "unknown", "remove"),
    ("backlash = 1.5", "backlsh = 1.5", "servos[1].backlsh", "(aileron_left)", "`backlash`?"),
    # What must be there.
    ('name = "full"\n', "", "name", "nothing", "add `name = ...`"),
    ("Izz = 1.759\n", "", "mass.Izz", "nothing", "add `Izz = ...`"),
    ("channel = 5\n", "", "servos[1].channel", "nothing (aileron_left)", "add `channel"),
    ("height_min = 60.0\n", "", "envelope.height_min", "nothing", "add `height_min"),
    # Types.
    ("mass = 11.0", 'mass = "11.0"', "mass.mass", 'the text "11.0"', "remove the quotes"),
    ("mass = 11.0", "mass = true", "mass.mass", "true", "write a number"),
    ("mass = 11.0", "mass = nan", "mass.mass", "nan", "finite"),
    ("mass = 11.0", "mass = 1979-05-27", "mass.mass", "1979-05-27", "write a number"),
    ("mass = 11.0", "mass = [11.0]", "mass.mass", "[11.0]", "write a number"),
    ("mass = 11.0", f"mass = 1{'0' * 400}", "mass.mass", "1000", "finite"),
    ("channel = 5", "channel = 5.0", "servos[1].channel", "5.0", "channel = 1"),
    ("channel = 5", "channel = 0", "servos[1].channel", "0", "channel = 1"),
    ('name = "full"', 'name = " "', "name", 'the text " "', 'name = "my name"'),
    ("pwm = [1000, 2000]\ndef", "pwm = 1000\ndef", "servos[2].pwm", "1000", "write a list in [ ]"),
    ("[0.05, 0.0, -0.02]", "[0.05, 0.0]", "imu.position", "2 entries", "`position` 3 entries"),
    ("[0.05, 0.0, -0.02]", '[0.05, "0", 1]', "imu.position", 'the text "0"', "remove the quotes"),
    ('measures = "CAS"', 'measures = "IAS"', "pitot.measures", '"IAS"', 'measures = "EAS"'),
    ('measures = "CAS"', 'measures = "eas"', "pitot.measures", '"eas"', 'measures = "EAS"'),
    ("[[servos]]", "[servos]", "line", "overwrite", "begin each entry with `[[servos]]`"),
    (
        "[streams.SERVO_OUTPUT_RAW]\ndelay = -0.04\nsigma = 0.02",
        "[streams]\nSERVO_OUTPUT_RAW = 0.1",
        "streams.SERVO_OUTPUT_RAW",
        "0.1",
        "write a table [streams.SERVO_OUTPUT_RAW]",
    ),
    ("schema = 1", "schema = 2", "schema", "2", "update the program"),
    ("schema = 1", "schema = 1\nimu = 3", "line", "overwrite", "keep one"),
    # Ranges.
    ("mass = 11.0", "mass = -11.0", "mass.mass", "-11", "`mass` a value in that range"),
    ("delay = 0.05", "delay = -0.05", "servos[1].delay", "-0.05", "in that range"),
    ("effectiveness = 0.9", "effectiveness = 0", "servos[1].effectiveness", "0", "in that range"),
    ("bank = 60.0", "bank = 200", "envelope.bank", "200", "in that range"),
    (
        "scale_sigma = 0.05\nlag =",
        "scale_sigma = -1\nlag =",
        "pitot.scale_sigma",
        "-1",
        "in that range",
    ),
    ("lag = [0.02, 0.03]", "lag = [0.02, -0.03]", "vanes.lag", "-0.03", "minus sign"),
    # Inertia.
    ("Ixz = 0.12", "Ixz = 1.3", "mass.Ixz", "Ixz 1.3, Ixy 0.01", "∫xz dm"),
    ("Ixx = 0.824", "Ixx = 8240.0", "mass.Ixx", "radius of gyration of 27.4 m", "kg·m²"),
    ("mass = 11.0", "mass = 11000.0", "mass.Ixx", "gyration of 0.00866 m", "mass in kg"),
    # Wrong units.
    ("wing_area = 0.55", "wing_area = 5.92", "geometry.wing_area", "5.92 m²", "square metres"),
    ("mean_chord = 0.18994", "mean_chord = 189.94", "geometry.wing_area", "189.94", "metres"),
    ("[0.05, 0.0, -0.02]", "[50, 0, -20]", "imu.position", "[50, 0, -20]", "[0.05, 0.0, -0.02]"),
    (
        "deflection = [20.0, -30.0]",
        "deflection = [0.349, -0.5236]",
        "servos[2].deflection",
        "[0.349, -0.5236] deg (elevator)",
        "radians: deflection = [20.0, -30.0]",
    ),
    (
        "deflection = [20.0, -30.0]",
        "deflection = [1100, 1900]",
        "servos[2].deflection",
        "",
        "angle",
    ),
    ("pwm = [2000, 1500, 1000]", "pwm = [1, 0, -1]", "servos[1].pwm", "[1, 0, -1]", "autopilot"),
    ("time_constant = 0.15", "time_constant = 150", "propulsion[0].time_constant", "", "= 0.15"),
    ("delay = 0.05", "delay = 50", "servos[1].delay", "50 s", "for 50 ms write delay = 0.05"),
    ("lag = [0.02, 0.03]", "lag = [20, 30]", "vanes.lag", "20 s", "lag = 0.02"),
    ("mass_sigma = 0.03", "mass_sigma = 3", "mass.mass_sigma", "3", "mass_sigma = 0.03"),
    ("thrust_sigma = 0.2", "thrust_sigma = 20", "propulsion[0].thrust_sigma", "20", "= 0.2"),
    ("sigma = 0.2\n\n[aero", "sigma = 20\n\n[aero", "aerodynamics.sigma", "20", "sigma = 0.2"),
    ("scale = 0.03", "scale = 1.03", "pitot.scale", "1.03", "reads 3 % high"),
    ("alpha = [-6.0, 14.0]", "alpha = [-0.1, 0.244]", "envelope.alpha", "0.244", "[-5.73, 13.98]"),
    ("bank = 60.0", "bank = 1.05", "envelope.bank", "1.05 deg", "bank = 60.2"),
    ("throttle = [0.0, 0.5, 1.0]", "throttle = [0, 50, 100]", "propulsion[0].throttle", "", "0.5"),
    # Calibrations and tables.
    (
        "pwm = [2000, 1500, 1000]",
        "pwm = [2000, 1500]",
        "servos[1].deflection",
        "3 entries beside 2 of `pwm` (aileron_left)",
        "one deflection for each pulse",
    ),
    ("pwm = [2000, 1500, 1000]", "pwm = [2000, 1500, 1800]", "servos[1].pwm", "1800", "sort"),
    ("pwm = [2000, 1500, 1000]", "pwm = [1500, 1500, 1000]", "servos[1].pwm", "1500", "sort"),
    ("[-25.0, 0.0, 30.0]", "[-25.0, 5.0, 0.0]", "servos[1].deflection", "5.0", "turns back"),
    ("[-25.0, 0.0, 30.0]", "[5.0, 5.0, 5.0]", "servos[1].deflection", "5.0", "turns back"),
    (
        "airspeed = [10.0, 40.0]\nthrust = [[0.0, -1.0], [20",
        "airspeed = [40.0, 10.0]\nthrust = [[0.0, -1.0], [20",
        "propulsion[0].airspeed",
        "[40.0, 10.0]",
        "sort",
    ),
    (", [67.0, 7.0]]\ntorque", "]\ntorque", "propulsion[0].thrust", "2 rows of 2", "one row"),
    ("[20.0, 5.0]", "[20.0, 5.0, 3.0]", "propulsion[0].thrust", "3 rows of 2, 3", "one column"),
    ("torque = [[0.0, 0.0],", "torque = [", "propulsion[0].torque", "2 rows of 2", "one row"),
    ("throttle = [0.0, 0.5, 1.0]\n", "", "propulsion[0].throttle", "nothing", "add the one"),
    (
        "rpm = [0, 8000]",
        "throttle = [0, 1]",
        "propulsion[1].rpm_channel",
        "without `rpm`",
        "remove",
    ),
    ("rpm = [0, 8000]", "rpm = [0, 1]\nthrottle = [0, 1]", "propulsion[1].rpm", "beside", "keep"),
    (
        "throttle_channel = 4",
        "throttle_channel = 2",
        "propulsion[1].throttle_channel",
        "`elevator`",
        "correct the channel",
    ),
    ("axis = [3.0, 0.0, 4.0]", "axis = [0, 0, 0]", "propulsion[0].axis", "[0, 0, 0]", "ahead"),
    # Surfaces and controls.
    ("channel = 5", "channel = 1", "servos[1].channel", "moves `aileron_right`", "keep one entry"),
    (LEFT, 'surface = "aileron_right"', "servos[1].surface", "again", '"aileron_right_right"'),
    (
        "mix = { elevator = 1.0 }",
        "mix = { elevater = 1.0 }",
        "controls[0].mix",
        "no servo",
        "`elevator`?",
    ),
    (
        "mix = { elevator = 1.0 }",
        "mix = { flap = 1.0 }",
        "controls[0].mix",
        "`flap`",
        "add a [[servos]]",
    ),
    ("mix = { elevator = 1.0 }", "mix = { elevator = 0 }", "controls[0].mix", "all 0", "= 1.0 }"),
    ("mix = { elevator = 1.0 }", "mix = {}", "controls[0].mix", "no surface", "= 1.0 }"),
    (
        "mix = { elevator = 1.0 }",
        'mix = { elevator = "1" }',
        "controls[0].mix.elevator",
        '"1"',
        "quotes",
    ),
    (
        'name = "aileron"',
        'name = "alpha"',
        "controls[1].name",
        "already is a regressor",
        '"alpha_control"',
    ),
    (
        'name = "aileron"',
        'name = "left aileron"',
        "controls[1].name",
        '"left aileron"',
        '"left_aileron"',
    ),
    ('name = "aileron"', 'name = "2"', "controls[1].name", '"2"', "for instance"),
    ('name = "aileron"', 'name = "elevator"', "controls[1].name", "again", "rename one"),
    (
        "[[propulsion]]\nthrottle_channel = 3",
        '[[controls]]\nname = "roll"\nmix = { aileron_right = -2, aileron_left = 2 }\n\n'
        "[[propulsion]]\nthrottle_channel = 3",
        "controls[2].mix",
        "a combination of `aileron`",
        "remove `roll`",
    ),
    # Sensors.
    ("bias = [1.5, -0.5]", "bias = 1.5", "vanes.bias", "1.5", "bias = { alpha = 1.5 }"),
    (
        "bias_sigma = { alpha = 1.0 }",
        "bias_sigma = { a = 1 }",
        "vanes.bias_sigma.a",
        "unknown",
        "remove `a`",
    ),
    # Envelope.
    ("[16.5, 40.0]", "[40.0, 16.5]", "envelope.airspeed", "[40.0, 16.5]", "= [16.5, 40.0]"),
    ("[16.5, 40.0]", "[-16.5, 40.0]", "envelope.airspeed", "[-16.5", "lowest and highest"),
    # Aerodynamics.
    ("[aerodynamics.CZ]", "[aerodynamics.CL]", "aerodynamics.CL", "unknown", "CZ = -CL"),
    ("[aerodynamics.CZ]", "[aerodynamics.CM]", "aerodynamics.CM", "unknown", "did you mean `Cm`?"),
    (
        '"elevator * alpha"',
        '"elevatr * alpha"',
        'aerodynamics.CZ."elevatr * alpha"',
        "`elevatr` at character 1",
        "`elevator`?",
    ),
    (
        '"elevator * alpha"',
        '"alpha + beta"',
        'aerodynamics.CZ."alpha + beta"',
        "character 1",
        "sum",
    ),
    (
        '"elevator * alpha" = 0',
        '"elevator * alpha" = 0\n"alpha*elevator" = 1',
        'aerodynamics.CZ."alpha*elevator"',
        "the regressor `alpha*elevator` again",
        "keep one",
    ),
    (
        '"max(0, alpha - 0.12)"',
        '"max(0, alpha - 7)"',
        'aerodynamics.CZ."max(0, alpha - 7)"',
        "7 rad",
        "write 0.1222",
    ),
    ("sd = 0.4 }", "sd = 0.4, sigma = 0.1 }", "aerodynamics.CZ.alpha.sd", "beside", "keep one"),
    ("sd = 0.4 }", "sd = 0 }", "aerodynamics.CZ.alpha.sd", "0", "in that range"),
    (
        "{ value = -5.65, sd = 0.4 }",
        "{ sd = 0.4 }",
        "aerodynamics.CZ.alpha.value",
        "nothing",
        "add",
    ),
    ("{ value = -5.65, sd = 0.4 }", '"-5.65"', "aerodynamics.CZ.alpha", '"-5.65"', "quotes"),
    (
        '["elevator", "Tc"]',
        '["elevator", "TC"]',
        "aerodynamics.CX.wash.regressors",
        "`TC`",
        "`Tc`?",
    ),
    ('["elevator", "Tc"]', "[]", "aerodynamics.CX.wash.regressors", "[]", '["alpha", "elevator"]'),
    (
        "[[-0.4, 0.0, 0.4], [0.0, 1.0]]",
        "[[-0.4, 0.4]]",
        "aerodynamics.CX.wash.breakpoints",
        "",
        "for instance",
    ),
    (
        "[[-0.4, 0.0, 0.4], [0.0, 1.0]]",
        "[[-23, 0, 23], [0, 1]]",
        "aerodynamics.CX.wash.breakpoints",
        "-23",
        "write 7 deg as 0.1222",
    ),
    (
        "[[-0.4, 0.0, 0.4], [0.0, 1.0]]",
        "[[0.4, 0, -1], [0, 1]]",
        "aerodynamics.CX.wash.breakpoints",
        "0.4",
        "sort",
    ),
    (
        "[[0.0, 0.1], [0.0, 0.0], [0.0, -0.1]]",
        "[[0, 1]]",
        "aerodynamics.CX.wash.values",
        "1 rows",
        "one row",
    ),
    (
        "breakpoints = [0.1, 0.2], values",
        "values",
        "aerodynamics.CZ.stall.breakpoints",
        "nothing",
        "for instance",
    ),
]


@pytest.mark.parametrize(("old", "new", "key", "found", "fix"), MISTAKES)
def test_mistake_is_answered(old: str, new: str, key: str, found: str, fix: str) -> None:
    assert old in FULL, "the example no longer holds what this case changes"
    with pytest.raises(AircraftFileError) as caught:
        aircraft_file.loads(FULL.replace(old, new, 1), name="my.toml")
    error = caught.value
    assert error.key.startswith(key)
    assert found in error.found
    assert error.allowed
    assert fix in error.fix
    assert "\n" not in str(error)
    assert str(error).startswith(f"my.toml: {key}")


def test_unlabelled_file_is_called_aircraft_file() -> None:
    with pytest.raises(AircraftFileError, match=r"^aircraft file: name: found nothing"):
        aircraft_file.loads("")
