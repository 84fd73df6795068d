from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.recording import CHANNELS
from gcs_sysid.sources.column_map import COURSE, SENSORS
from gcs_sysid.sources.units import UNITS, to_si, unit_of, units_of

PRINTED = {
    "kt": (600.0, 308.6666667),  # NIST SP 811: 5.144444 E-01
    "ft": (1000.0, 304.8),
    "psi": (14.695948775, 101325.0),
    "C": (15.0, 288.15),
    "deg": (180.0, np.pi),
    "g": (1.0, 9.80665),
    "km/h": (36.0, 10.0),
    "mgauss": (500.0, 5e-5),
    "percent": (50.0, 0.5),
    "hPa": (1013.25, 101325.0),
}


@pytest.mark.parametrize("name", PRINTED)
def test_units_are_those_of_the_standards(name):
    value, si = PRINTED[name]
    assert to_si(np.array([value]), UNITS[name]) == pytest.approx(si, rel=1e-9)


@given(st.sampled_from(sorted(UNITS)), st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_every_unit_is_linear_and_goes_up(name, first, second):
    unit = UNITS[name]
    a, b = to_si(np.array([first, second]), unit)
    assert unit.factor > 0.0
    assert a - b == pytest.approx(unit.factor * (first - second), rel=1e-9, abs=1e-6 * unit.factor)


def test_a_unit_of_another_quantity_is_none():
    assert unit_of("deg", "speed") is None
    assert unit_of("parsec", "length") is None
    assert unit_of("us", "time") != unit_of("us", "pulse")


def test_channels_of_tables_are_those_of_recordings_in_their_si_units():
    si = {
        "acceleration": "m/s²",
        "angular rate": "rad/s",
        "magnetic flux density": "T",
        "angle": "rad",
        "speed": "m/s",
        "length": "m",
        "pressure": "Pa",
        "temperature": "K",
        "pulse": "µs",
        "rotation speed": "rpm",
        "voltage": "V",
        "current": "A",
    }
    for sensor in SENSORS:
        assert units_of(sensor.quantity)
        for channel in set(sensor.channels) - {COURSE}:
            known = CHANNELS[channel if not channel[-1].isdigit() else f"{channel.split('_')[0]}_N"]
            if sensor.quantity in si:
                assert known.endswith(f"[{si[sensor.quantity]}]")
            else:
                assert not known.endswith("]")
