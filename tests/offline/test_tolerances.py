"""Tolerances of a simulation: the regulation's numbers, and those of an engineer's own file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.errors import InputError
from gcs_sysid.offline import tolerances

DATA = Path(__file__).resolve().parents[2] / "data" / "aircraft"


@pytest.fixture(scope="module")
def aircraft():
    return aircraft_file.load(DATA / "aerosonde.toml")


def test_a_transport_has_those_of_the_regulation_and_a_model_faster_rates(aircraft) -> None:
    large = replace(aircraft, geometry=replace(aircraft.geometry, wing_span=30.0))
    small = replace(aircraft, geometry=replace(aircraft.geometry, wing_span=11.0 / 9.0))
    assert tolerances.usual(large).channels["V"] == pytest.approx(3.0 * 0.5144, abs=0.01)
    assert tolerances.usual(large).channels["alpha"] == math.radians(1.5)
    assert tolerances.usual(large).channels["q"] == math.radians(2.0)
    assert tolerances.usual(small).channels["q"] == pytest.approx(3.0 * math.radians(2.0))


def test_a_file_changes_what_it_names(tmp_path: Path, aircraft) -> None:
    own = tmp_path / "own.toml"
    own.write_text("theil = 0.2\nalpha = 0.5\nq = 3.0\nV = 1\n", encoding="utf-8")
    found, usual = tolerances.read(own, aircraft), tolerances.usual(aircraft)
    assert found.theil == 0.2
    changed = {"alpha": math.radians(0.5), "q": math.radians(3.0), "V": 1.0}
    assert found.channels == pytest.approx({**usual.channels, **changed})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("alhpa = 1.0", "alpha"),
        ("alpha = -1.0", "alpha"),
        ("alpha = 'small'", "alpha"),
        ("theil = 3.0", "theil"),
        ("alpha 1", "no tolerances"),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path: Path, aircraft, text: str, says: str) -> None:
    own = tmp_path / "own.toml"
    own.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as told:
        tolerances.read(own, aircraft)
    assert says in str(told.value)
    assert "\n" not in str(told.value)
