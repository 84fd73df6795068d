"""What is ordinarily wrong, and what is a finding however unsure its file is of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, StreamTiming
from gcs_sysid.diagnose.aided import beliefs
from gcs_sysid.diagnose.catalogue import CAUSES

BRUMBY = Path(__file__).resolve().parents[3] / "data" / "aircraft" / "brumby_mk3.toml"
NAMES = ("departures.mass", "departures.inertia.0", "departures.thrust", "departures.cg")


def unsure(aircraft: Aircraft, share: float) -> Aircraft:
    body = replace(aircraft.mass, mass_sigma=share, inertia_sigma=share)
    engines = tuple(replace(one, thrust_sigma=share) for one in aircraft.propulsion)
    return replace(aircraft, mass=body, propulsion=engines)


def test_a_file_that_is_unsure_of_its_body_is_not_excused_by_that() -> None:
    """Thrust of 0.7 passed for right where a file said 15 %: nothing that matters is ordinary."""
    found = beliefs.ordinary(NAMES, unsure(aircraft_file.load(BRUMBY), 0.3), vanes=False)
    for name, sigma in zip(("mass", "inertia", "thrust_scale"), found, strict=False):
        matters = CAUSES[name].parameters[0].matters
        assert sigma == pytest.approx(matters / 3.0)


def test_sensors_have_the_ordinary_biases_of_sensors() -> None:
    """0.1 m/s² and 0.3 °/s on every axis, whatever the file says of its body."""
    axes = [f"sensors.{kind}.{axis}" for kind in ("accelerometer_bias", "gyro_bias")
            for axis in range(3)]  # fmt: skip
    for file in (aircraft_file.load(BRUMBY), unsure(aircraft_file.load(BRUMBY), 0.3)):
        found = beliefs.ordinary(axes, file, vanes=False)
        np.testing.assert_allclose(found, [0.1] * 3 + [np.pi / 180.0 * 0.3] * 3, rtol=1e-12)


def test_a_file_that_is_sure_is_believed() -> None:
    found = beliefs.ordinary(NAMES, unsure(aircraft_file.load(BRUMBY), 0.01), vanes=False)
    np.testing.assert_allclose(found[:3], 0.01)


@pytest.mark.parametrize(("stated", "believed"), [(None, 0.01), (0.004, 0.004), (0.0, 0.0)])
def test_a_servo_delay_is_believed_as_the_file_says(stated: float | None, believed: float) -> None:
    """A stated deviation of 0 had counted as none stated."""
    streams = {"SERVO_OUTPUT_RAW": StreamTiming(0.02, stated)}
    file = replace(aircraft_file.load(BRUMBY), streams=streams)
    assert beliefs.ordinary(["sensors.surface_delay"], file, vanes=False) == [believed]
