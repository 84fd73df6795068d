"""The file that knows everything says what flies, or that no file can."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.sitl.terms import slope
from tests.blind import fly
from tests.blind.draw import Fixed, draw, load
from tests.blind.informed import informed


@pytest.fixture
def told(tmp_path):
    def informed_of(**effect: Any):
        name = effect["name"]
        one = draw(1, fixed=Fixed(name, "aerosonde", "five_percent", effects=(effect,)))
        true, generator = fly.equipped(one), np.random.default_rng(0)
        file = fly.believed(true, one.file, generator)
        aircraft_file.save(file, tmp_path / "aircraft.toml")
        path = tmp_path / "scenario.toml"
        path.write_text(fly.scenario(one, true, generator), encoding="utf-8")
        return informed(path)

    return informed_of


def test_what_is_wrong_in_the_file_is_right_in_it(told):
    aircraft = told(name="mass", mass_ratio=1.1)
    assert aircraft.mass.mass == pytest.approx(1.1 * 11.0)
    assert slope(aircraft, "Cm", "alpha") == slope(load("aerosonde"), "Cm", "alpha")
    assert max(map(abs, aircraft.imu.gyro.bias)) > 0.0


def test_a_weak_surface_is_weak_in_all_its_terms_and_a_late_stream_is_late(told):
    weak = told(name="surface_effectiveness", control="elevator", ratio=0.7)
    for name in ("CX", "CZ", "Cm"):
        believed = slope(load("aerosonde"), name, "elevator")
        assert slope(weak, name, "elevator") == pytest.approx(0.7 * believed)
    assert slope(weak, "Cl", "aileron") == slope(load("aerosonde"), "Cl", "aileron")
    late = told(name="time_skew", stream="SERVO_OUTPUT_RAW", delay=0.1)
    assert late.streams["SERVO_OUTPUT_RAW"].delay == 0.1


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "wind_shear", "gradient": 0.05},
        {"name": "heading_bias", "heading_bias": 0.1},
        {"name": "propwash", "gain": 0.5},
        {"name": "aeroelastic", "control": "elevator", "loss": -0.3},
    ],
    ids=lambda effect: effect["name"],
)
def test_what_no_file_has_words_for(told, effect):
    assert told(**effect) is None
