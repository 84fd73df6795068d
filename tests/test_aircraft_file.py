from __future__ import annotations

import math
import tomllib
from pathlib import Path

import pytest

from gcs_sysid import aircraft_file, regressors
from gcs_sysid.aircraft import SensorError, StreamTiming, TableTerm, Value
from gcs_sysid.errors import AircraftFileError, InputError

DEG = math.pi / 180.0
FULL = (Path(__file__).parent / "reference" / "every_key.toml").read_text()


@pytest.mark.shared
@pytest.mark.parametrize(
    ("place", "name", "controls"),
    [
        ("cases/clean", "uav-a", ("elevator", "aileron", "rudder")),
        ("data/umn_thor", "UMN Thor (Ultra Stick 25e)", ("elevator", "aileron", "rudder")),
        ("data/arduplane_sitl", "ArduPlane SITL plane", ("aileron", "elevator", "rudder")),
    ],
)
def test_engineers_files_are_read_and_written_back(
    shared: Path, tmp_path: Path, place: str, name: str, controls: tuple[str, ...]
) -> None:
    aircraft = aircraft_file.load(shared / place / "aircraft.toml")
    assert aircraft.name == name
    assert aircraft.control_names == controls
    assert set(regressors.default_structure(aircraft)) == set(aircraft.aerodynamics)
    aircraft_file.save(aircraft, tmp_path / "again.toml")
    assert aircraft_file.load(tmp_path / "again.toml") == aircraft


def test_every_key_arrives_in_si_units() -> None:
    """Spot checks of each table against numbers converted by hand."""
    aircraft = aircraft_file.loads(FULL)
    assert aircraft.mass.Iyz == -0.02
    assert aircraft.mass.cg == (0.01, 0.0, 0.02)
    assert aircraft.imu.misalignment == (DEG, -2.0 * DEG, 0.5 * DEG)
    assert aircraft.imu.misalignment_sigma == DEG
    assert aircraft.imu.accelerometer == SensorError(
        bias=(0.1, 0.0, -0.1),
        scale=(0.01, 0.0, 0.0),
        lag=0.005,
        bias_sigma=0.2,
        scale_sigma=0.02,
        lag_sigma=0.001,
    )
    assert aircraft.imu.gyro.bias == (0.5 * DEG, 0.0, 0.0)
    assert aircraft.imu.gyro.bias_sigma == 0.3 * DEG
    assert aircraft.imu.gyro.scale_sigma is None
    assert aircraft.pitot.measures == "CAS"
    assert aircraft.pitot.error == SensorError((0.4,), (0.03,), 0.2, 0.5, 0.05, 0.1)
    assert aircraft.vanes is not None
    assert aircraft.vanes.upwash_sigma == 0.05
    assert aircraft.vanes.alpha == SensorError((1.5 * DEG,), (0.0,), 0.02, DEG, 0.05, 0.01)
    assert aircraft.vanes.beta == SensorError((-0.5 * DEG,), (0.1,), 0.03, None, 0.05, 0.01)
    assert aircraft.streams["SERVO_OUTPUT_RAW"] == StreamTiming(-0.04, 0.02)
    assert aircraft.streams["custom stream"] == StreamTiming(0.1)
    left = aircraft.servos[1]
    assert left.pwm == (1000.0, 1500.0, 2000.0)
    assert left.deflection == (30.0 * DEG, 0.0, -25.0 * DEG)
    assert left.rate_limit == 300.0 * DEG
    assert (left.delay, left.backlash, left.effectiveness) == (0.05, 1.5 * DEG, 0.9)
    assert aircraft.propulsion[0].axis == pytest.approx((0.6, 0.0, 0.8), abs=1e-15)
    assert aircraft.propulsion[0].torque == ((0.0, 0.0), (0.1, 0.05), (0.5, 0.2))
    assert (aircraft.propulsion[1].rpm, aircraft.propulsion[1].rpm_channel) == ((0.0, 8000.0), 2)
    assert aircraft.envelope is not None
    assert aircraft.envelope.alpha == (-6.0 * DEG, 14.0 * DEG)


def test_sigma_is_relative_absolute_or_a_floor() -> None:
    aerodynamics = aircraft_file.loads(FULL).aerodynamics
    assert aerodynamics["CX"].terms["1"] == Value(-0.043, 0.2 * 0.043)
    assert aerodynamics["CX"].terms["alpha^2"] == Value(5.2, 0.3 * 5.2)
    assert aerodynamics["CZ"].terms["alpha"] == Value(-5.65, 0.4)
    assert aerodynamics["CZ"].terms["alpha*elevator"] == Value(0.0, 0.2 * 0.01)
    assert aerodynamics["CX"].tables == (
        TableTerm(
            name="wash",
            regressors=("elevator", "Tc"),
            breakpoints=((-0.4, 0.0, 0.4), (0.0, 1.0)),
            values=((0.0, 0.1), (0.0, 0.0), (0.0, -0.1)),
            sigma=0.2,
        ),
    )
    assert aerodynamics["CZ"].tables[0].values == (0.0, 1.0)
    assert aerodynamics["CZ"].tables[0].sigma == 0.5


def test_only_mass_and_geometry_are_needed() -> None:
    start, end = FULL.index("[imu]"), len(FULL)
    aircraft = aircraft_file.loads(FULL[:start] + FULL[end:])
    assert aircraft.vanes is None
    assert aircraft.pitot.measures == "EAS"
    assert aircraft.controls == ()
    assert aircraft.aerodynamics == {}


def test_written_file_is_the_same_aircraft_and_stays_the_same_text() -> None:
    aircraft = aircraft_file.loads(FULL)
    text = aircraft_file.dumps(aircraft)
    assert aircraft_file.loads(text) == aircraft
    assert aircraft_file.dumps(aircraft_file.loads(text)) == text
    assert "deflection = [-25.0, 0.0, 25.0]" in text
    assert "alpha = { value = -5.65, sd = 0.4 }" in text


@pytest.mark.parametrize("angle", [-0.7, 0.1, 0.3, 1.1, 7.3, 16.4, 33.3, 57.29578, 123.4])
def test_written_file_keeps_its_degrees(angle: float) -> None:
    """A person who wrote 0.7 deg must not find 0.7000000000000001 in the file."""
    text = FULL.replace("offset = -0.7", f"offset = {angle}")
    data = tomllib.loads(aircraft_file.dumps(aircraft_file.loads(text)))
    assert data["servos"][1]["offset"] == angle


def test_save_leaves_nothing_behind_when_it_fails(tmp_path: Path) -> None:
    aircraft = aircraft_file.loads(FULL)
    target = tmp_path / "aircraft.toml"
    target.mkdir()
    (target / "in the way").touch()
    with pytest.raises(InputError, match=r"cannot be written .* choose a writable folder"):
        aircraft_file.save(aircraft, target)
    with pytest.raises(InputError, match="choose a writable folder"):
        aircraft_file.save(aircraft, tmp_path / "absent" / "aircraft.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["aircraft.toml"]


def test_missing_file_suggests_its_neighbour(tmp_path: Path) -> None:
    (tmp_path / "aircraft.toml").touch()
    with pytest.raises(InputError, match=r"no such file; did you mean .*aircraft\.toml\?"):
        aircraft_file.load(tmp_path / "aircarft.toml")
    with pytest.raises(InputError, match="gcs-sysid init LOG"):
        aircraft_file.load(tmp_path / "nowhere" / "x.toml")


def test_unreadable_files_say_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        aircraft_file.load(tmp_path)
    log = tmp_path / "flight.tlog"
    log.write_bytes(b"\xfe\x09\x00")
    with pytest.raises(InputError, match=r"byte 0 is no UTF-8 text; .* give a log as LOG"):
        aircraft_file.load(log)


def test_byte_order_mark_and_windows_line_ends_are_read(tmp_path: Path) -> None:
    path = tmp_path / "aircraft.toml"
    path.write_bytes(b"\xef\xbb\xbf" + FULL.replace("\n", "\r\n").encode())
    assert aircraft_file.load(path) == aircraft_file.loads(FULL)


@pytest.mark.parametrize(
    ("old", "new", "key", "fix"),
    [
        ('"alpha^2" =', "alpha^2 =", "line 135", 'put the key in quotes: "alpha^2" = ...'),
        ('"max(0, alpha - 0.12)" =', "max(0, alpha - 0.12) =", "line 145", "put the key in quotes"),
        ("mass = 11.0", "mass = 11.0\nmass = 12.0", "line 7", "twice; keep one"),
        ("[geometry]", "[mass]", "line 17", "`[mass]` stands in the file twice"),
        ("mass = 11.0", "mass = 11,0", "line 6", "correct the line `mass = 11,0`"),
        ("values = [0, 1], sigma = 0.5 }", "values = [0, 1", "end of document", "close the last"),
    ],
)
def test_syntax_errors_name_the_line(old: str, new: str, key: str, fix: str) -> None:
    assert old in FULL
    with pytest.raises(AircraftFileError) as caught:
        aircraft_file.loads(FULL.replace(old, new), name="my.toml")
    assert caught.value.key.startswith(key)
    assert fix in caught.value.fix
    assert caught.value.where.startswith("my.toml: ")
