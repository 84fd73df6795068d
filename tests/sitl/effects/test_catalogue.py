"""Effect files, and what hiding may and may not touch."""

from __future__ import annotations

import dataclasses
import json
import math
import re

import pytest

from gcs_sysid.errors import InputError
from gcs_sysid.sitl import record, scenario
from gcs_sysid.sitl.effects import catalogue
from tests.sitl import examples
from tests.sitl.effects import hidden


@pytest.mark.shared
def test_every_cause_of_the_catalogue_can_be_hidden(shared):
    table = (shared / "interfaces.md").read_text(encoding="utf-8").split("## 4. Causes")[1]
    causes = re.findall(r"^\| ([a-z_]+) \|", table.split("## 5.")[0], flags=re.MULTILINE)
    assert set(causes) - {"identifier"} == set(catalogue.EFFECTS)


@pytest.mark.parametrize("name", catalogue.EFFECTS)
def test_an_effect_changes_what_happens_and_not_what_is_believed(name):
    base = hidden.flight()
    changed = hidden.hide(name, base)
    assert changed.believed == base.believed
    assert changed != base
    same = {"believed", "flown", "wind", "hidden"}
    for field in dataclasses.fields(base):
        if field.name not in same:
            assert getattr(changed, field.name) == getattr(base, field.name)


@pytest.mark.parametrize("name", catalogue.EFFECTS)
def test_a_misspelled_parameter_is_named(name):
    sizes = dict(hidden.SIZES[name])
    key = list(sizes)[-1]
    sizes[key + "_"] = sizes.pop(key)
    with pytest.raises(InputError, match=f"did you mean `{key}`"):
        hidden.hide(name, **sizes)


def test_effects_of_a_file_act_together(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(
        'name = "mass"\nmass_ratio = 1.1\n[[effects]]\nname = "cg_shift"\ncg_x_chord = -0.1\n'
        '[truth]\nscenario = "two"\n'
    )
    loaded = catalogue.load(path)
    made = catalogue.hide(hidden.flight(), loaded.effects)
    assert made.flown.mass.mass == pytest.approx(1.1 * 1.959)
    assert made.flown.mass.cg[0] == pytest.approx(-0.1 * 0.25)
    told = catalogue.truth(made, loaded.effects, loaded.truth)
    assert told == json.loads(json.dumps(told))
    assert told["cause"] == "several"
    assert told["scenario"] == "two"
    assert told["effects"][1] == {"name": "cg_shift", "parameters": {"cg_x_chord": -0.1}}
    assert catalogue.truth(made, loaded.effects[:1], {})["cause"] == "mass"
    assert catalogue.truth(hidden.flight(), (), {})["cause"] == "none"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "start with"),
        ('name = "mas"\nmass_ratio = 1', 'found the text "mas"'),
        ('name = "mass"', "mass_ratio: found nothing"),
        ('name = "mass"\nmass_ratio = 0', "above 0"),
        ('name = "asymmetry"', "Cl0, Cn0"),
        ('name = "surface_offset"\ncontrol = "flap"\noffset = 0.1', "elevator"),
        ('name = "time_skew"\nstream = "ATTITUDE"\ndelay = -0.1', "from 0"),
        ('name = "unlisted"\n[terms.Cn]\n"aplha" = 1', "aplha"),
        ('name = "aero_derivative"\nderivative = "Cm.beta"\nratio = 1', "Cm.alpha"),
        ("name = ", "no TOML"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(text, words, tmp_path):
    path = tmp_path / "effect.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(words)):
        catalogue.hide(hidden.flight(), catalogue.load(path).effects)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        catalogue.load(tmp_path / "none.toml")


def test_what_an_aircraft_does_not_have_cannot_be_wrong():
    plain = hidden.flight(examples.plain({"CX": examples.terms(one=-0.04)}))
    with pytest.raises(InputError, match="without vanes"):
        hidden.hide("vane_bias", plain)
    with pytest.raises(InputError, match="without engine"):
        hidden.hide("thrust_scale", plain)


def test_a_scenario_hides_effects_in_all_its_flights(tmp_path):
    path = tmp_path / "scenario.toml"
    path.write_text(f"""
schema = 1
name = "hidden"
aircraft = "{examples.ULTRA_STICK}"
[[effects]]
name = "thrust_scale"
ratio = 0.8
[[flights]]
name = "one"
record = "one.tlog"
truth = "one.npz"
seed = 3
begins = 2026-10-03T09:12:00Z
[[flights.legs]]
name = "out"
duration = 1
airspeed = 17
height = 100
heading = 90
""")
    loaded = scenario.load(path)
    [planned] = loaded.flights
    full = planned.flight.believed.propulsion[0].thrust[-1][0]
    assert planned.flight.flown.propulsion[0].thrust[-1][0] == pytest.approx(0.8 * full)
    assert planned.told["cause"] == "thrust_scale"
    assert planned.truth is not None
    record.run(planned.flight, record=planned.record, truth=planned.truth, told=planned.told)
    told = json.loads((tmp_path / "one.json").read_text())
    assert told["effects"][0]["parameters"] == {"ratio": 0.8}
    assert math.isclose(told["duration_s"], 1.0)
