"""Scenarios: what flies is the aircraft file with a few entries of its own."""

from __future__ import annotations

import math
import tomllib

import pytest

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import AircraftFileError, InputError
from gcs_sysid.sitl import scenario
from gcs_sysid.sitl.jsbsim_xml import Fuel
from gcs_sysid.sitl.link import Link
from gcs_sysid.sitl.sensors import Noise
from gcs_sysid.sitl.telemetry import RATES
from tests.sitl import examples

DEMO = examples.ROOT / "replay" / "demo"

TEXT = f"""
schema = 1
name = "short"
aircraft = "{examples.ULTRA_STICK}"
[flown.aerodynamics.Cm]
alpha = -0.5
[flown.imu.gyro]
bias = [1.0, 0.0, 0.0]
[[flights]]
name = "one"
record = "one.tlog"
seed = 3
begins = 2026-10-03T09:12:00Z
wind = {{ from = 270, speed = 4, gust = 0.3 }}
[[flights.legs]]
name = "out"
duration = 2
airspeed = 17
height = 100
heading = 90
[[flights.legs.inputs]]
control = "elevator"
kind = "doublet"
start = 0.5
duration = 1
amplitude_deg = 3
"""


def written(folder, text):
    path = folder / "scenario.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_flies_differs_only_where_it_says(tmp_path):
    found = scenario.load(written(tmp_path, TEXT))
    assert found.believed == examples.ultra_stick()
    assert differences(found.believed, found.flown) == {"Cm alpha"}
    assert found.flown.aerodynamics["Cm"].terms["alpha"].value == -0.5
    assert found.flown.imu.gyro.bias == pytest.approx((math.radians(1.0), 0.0, 0.0))
    assert found.flown.imu.position == found.believed.imu.position
    assert found.flown.servos == found.believed.servos


def differences(one: Aircraft, other: Aircraft) -> set[str]:
    return {
        f"{name} {key}"
        for name, model in one.aerodynamics.items()
        for key, value in model.terms.items()
        if other.aerodynamics[name].terms[key].value != value.value
    }


def test_a_flight_is_read_in_si(tmp_path):
    [planned] = scenario.load(written(tmp_path, TEXT)).flights
    assert planned.record == tmp_path / "one.tlog"
    assert planned.truth is None
    assert planned.flight.epoch_us == 1_791_018_720_000_000
    assert planned.flight.wind.steady == pytest.approx((0.0, 4.0, 0.0)), (
        "from the west, to the east"
    )
    [leg] = planned.flight.legs
    assert leg.heading == pytest.approx(math.pi / 2.0)
    assert leg.inputs[0].amplitude == pytest.approx(math.radians(3.0))
    assert planned.flight.start.airspeed == leg.airspeed


def test_without_legs_it_is_the_standard_flight(tmp_path):
    text = TEXT.split("[[flights.legs]]")[0]
    [planned] = scenario.load(written(tmp_path, text)).flights
    assert planned.flight.duration > 240.0


def test_radio_rates_noise_and_a_restart_are_read(tmp_path):
    more = """
link = { loss = 0.1 }
rates = { RAW_IMU = 0, HIGHRES_IMU = 25 }
noise = { gyro = 0.01 }
fuel = { mass = 0.2, burn = 0.001 }
reboot = 1.5
begins ="""
    [planned] = scenario.load(written(tmp_path, TEXT.replace("\nbegins =", more))).flights
    flight = planned.flight
    assert flight.link == Link(loss=0.1)
    assert flight.noise == Noise(gyro=0.01)
    assert flight.reboot == 1.5
    assert flight.fuel == Fuel(0.2, 0.001)
    assert flight.rates == {
        **{name: rate for name, rate in RATES.items() if name != "RAW_IMU"},
        "HIGHRES_IMU": 25,
    }


def test_a_recorded_flight_is_named(tmp_path):
    text = TEXT + '\n[[flights]]\nname = "two"\nlog = "two.tlog"\n'
    found = scenario.load(written(tmp_path, text))
    assert found.logs == {"two": tmp_path / "two.tlog"}
    assert [planned.name for planned in found.flights] == ["one"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("seed = 3", "seed = 3\nrates = { ATTITUDE = 4 }", "a divisor of 50 Hz"),
        ("seed = 3", "seed = 3\nrates = { ATTITUD = 5 }", "did you mean `ATTITUDE`"),
        ("seed = 3", "seed = 3\nnoise = { gryo = 1 }", "did you mean `gyro`"),
        ("seed = 3", "seed = 3\nlink = { loss = -0.1 }", "from 0"),
        ("seed = 3", "sede = 3", r"flights\[0\].sede.*did you mean `seed`"),
        ("alpha = -0.5", "alhpa = -0.5", "alhpa"),
        ('kind = "doublet"', 'kind = "triplet"', "multistep"),
        ("2026-10-03T09:12:00Z", "2026-10-03T09:12:00", "with its zone"),
        ("duration = 2\n", "duration = 0\n", "above 0"),
        ("schema = 1", "schema = ", "no TOML"),
        (str(examples.ULTRA_STICK), "none.toml", "no such file"),
    ],
)
def test_mistakes_are_named(old, new, words, tmp_path):
    with pytest.raises((InputError, AircraftFileError), match=words):
        scenario.load(written(tmp_path, TEXT.replace(old, new)))


def test_what_the_demo_expects_is_what_flies():
    flown = scenario.load(DEMO / "scenario.toml")
    expected = tomllib.loads((DEMO / "expected.toml").read_text(encoding="utf-8"))["identify"]
    changed = {f"{name} {key}" for name, keys in expected["derivatives"].items() for key in keys}
    assert changed == differences(flown.believed, flown.flown)
    for name, keys in expected["derivatives"].items():
        for key, entry in keys.items():
            assert flown.flown.aerodynamics[name].terms[key].value == entry["value"]
            assert entry["within"] < 0.12 * abs(entry["value"]) + 0.002
    wind = flown.flights[0].flight.wind.steady
    found = expected["reconstruction"]
    assert found["wind_ned"]["value"] == pytest.approx(wind, abs=1e-3)
    for sensor in ("accelerometer", "gyro"):
        bias = getattr(flown.flown.imu, sensor).bias
        wanted = [found["sensor"][f"{sensor}_{axis}_bias"]["value"] for axis in "xyz"]
        assert wanted == pytest.approx(bias, abs=1e-6)


def test_every_bundled_file_has_its_origin_written_down():
    data = examples.ROOT / "data"
    manifest = (data / "MANIFEST.md").read_text(encoding="utf-8")
    files = [path for path in data.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    # Scripts are code, with their own documentation.
    names = {path.name for path in files if path.parent.name != "scripts"} - {"MANIFEST.md"}
    assert names
    assert all(name in manifest for name in names)
    assert "Licence: MIT" in manifest
