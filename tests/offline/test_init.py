from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.cli import entry
from gcs_sysid.errors import AircraftFileError
from gcs_sysid.offline import first_file, init, outputs
from gcs_sysid.recording import Recording, Vehicle
from tests.sources.made_dataflash import flight

ARDUPLANE = {
    "SERVO1_FUNCTION": 4.0, "SERVO1_MIN": 1000.0, "SERVO1_TRIM": 1480.0, "SERVO1_MAX": 2000.0,
    "SERVO1_REVERSED": 1.0,
    "SERVO2_FUNCTION": 19.0, "SERVO2_MIN": 1100.0, "SERVO2_TRIM": 1500.0, "SERVO2_MAX": 1900.0,
    "SERVO3_FUNCTION": 70.0, "SERVO3_MIN": 1000.0, "SERVO3_TRIM": 1000.0, "SERVO3_MAX": 2000.0,
    "SERVO4_FUNCTION": 21.0, "SERVO4_MIN": 1100.0, "SERVO4_TRIM": 1500.0, "SERVO4_MAX": 1900.0,
    "SERVO5_FUNCTION": 4.0, "SERVO5_MIN": 1000.0, "SERVO5_TRIM": 1500.0, "SERVO5_MAX": 2000.0,
    "SERVO6_FUNCTION": 33.0, "SERVO7_FUNCTION": 3.0,
    "INS_POS1_X": 0.12, "INS_POS1_Y": 0.0, "INS_POS1_Z": -0.03,
    "AIRSPEED_MIN": 11.0, "AIRSPEED_MAX": 27.0, "ROLL_LIMIT_DEG": 55.0, "KFF_RDDRMIX": 0.5,
}  # fmt: skip


def recorded(parameters: dict[str, float], autopilot: str = "ARDUPILOTMEGA") -> Recording:
    vehicle = Vehicle(1, 1, f"MAV_AUTOPILOT_{autopilot}", "MAV_TYPE_FIXED_WING", 1)
    return Recording("flight.bin", "", vehicle, 0, {}, parameters=parameters)


def filled(text: str) -> aircraft_file.Aircraft:
    return aircraft_file.loads(text.replace('"?"', "1.5"))


def test_a_file_is_refused_until_it_is_filled_in() -> None:
    text = first_file.draft(recorded(ARDUPLANE)).text
    with pytest.raises(AircraftFileError, match=r"mass\.mass, .*, geometry\.mean_chord") as error:
        aircraft_file.loads(text)
    assert "still to be filled in" in str(error.value)
    assert "\n" not in str(error.value)
    assert filled(text).mass.mass == 1.5


def test_everything_to_fill_in_is_listed() -> None:
    first = first_file.draft(recorded(ARDUPLANE))
    assert first.text.count(' = "?"') == len(first.missing)


def test_parameters_become_the_file() -> None:
    aircraft = filled(first_file.draft(recorded(ARDUPLANE)).text)
    assert aircraft.control_names == ("aileron", "elevator", "flap", "rudder")
    by_channel = {servo.channel: servo for servo in aircraft.servos}
    assert sorted(by_channel) == [1, 2, 4, 5, 7]
    assert by_channel[1].pwm == (1000.0, 1480.0, 2000.0)
    assert aircraft.imu.position == (0.12, 0.0, -0.03)
    assert aircraft.envelope is not None
    assert aircraft.envelope.airspeed == (11.0, 27.0)
    assert np.degrees(aircraft.envelope.bank) == pytest.approx(55.0)


def test_signs_are_those_of_the_convention() -> None:
    """ArduPilot: a longer pulse, not reversed, rolls right, pitches up, yaws right."""
    servos = {s.channel: s for s in filled(first_file.draft(recorded(ARDUPLANE)).text).servos}
    assert servos[5].deflection[-1] > 0.0  # aileron: positive rolls right
    assert servos[1].deflection[-1] < 0.0  # reversed
    assert servos[2].deflection[-1] < 0.0  # elevator: trailing edge up is negative
    assert servos[4].deflection[-1] < 0.0  # rudder: trailing edge right is negative


def demand(mixes: dict[str, dict[str, float]], name: str, deflections: dict[str, float]) -> float:
    return sum(gain * deflections[surface] for surface, gain in mixes[name].items())


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_mixed_surfaces_answer_the_demands_they_were_mixed_from(autopilot: str) -> None:
    """Roll right lowers the left elevon and raises the right one; pitch up raises both."""
    if autopilot == "ardupilot":
        parameters = {"SERVO1_FUNCTION": 77.0, "SERVO2_FUNCTION": 78.0}
    else:
        parameters = {
            "PWM_MAIN_FUNC1": 201.0, "PWM_MAIN_FUNC2": 202.0, "PWM_MAIN_MIN1": 1100.0,
            "PWM_MAIN_MAX1": 1900.0, "PWM_MAIN_MIN2": 1100.0, "PWM_MAIN_MAX2": 1900.0,
            "CA_SV_CS0_TYPE": 5.0, "CA_SV_CS1_TYPE": 6.0,
        }  # fmt: skip
    left, right = outputs.outputs(parameters).surfaces
    mixes = outputs.controls((left, right))

    def moved(pulse: float, surface: outputs.Surface) -> float:
        return float(np.interp(pulse, surface.pwm, surface.deflection))

    roll = {left.name: moved(1400.0, left), right.name: moved(1600.0, right)}
    assert demand(mixes, "aileron", roll) == pytest.approx(6.25)
    assert demand(mixes, "elevator", roll) == pytest.approx(0.0)
    pitch = {left.name: moved(1600.0, left), right.name: moved(1600.0, right)}
    assert demand(mixes, "elevator", pitch) == pytest.approx(-6.25)
    assert demand(mixes, "aileron", pitch) == pytest.approx(0.0)


def test_a_v_tail_is_elevator_and_rudder() -> None:
    parameters = {"SERVO1_FUNCTION": 79.0, "SERVO2_FUNCTION": 80.0}
    mixes = outputs.controls(outputs.outputs(parameters).surfaces)
    assert mixes == {
        "elevator": {"vtail_left": 0.5, "vtail_right": 0.5},
        "rudder": {"vtail_left": 0.5, "vtail_right": -0.5},
    }


def test_reversed_outputs_of_a_px4_are_turned_around() -> None:
    parameters = {
        "PWM_MAIN_FUNC1": 101.0, "PWM_MAIN_FUNC3": 201.0, "PWM_MAIN_REV": 4.0,
        "PWM_MAIN_MIN3": 1000.0, "PWM_MAIN_MAX3": 2000.0, "CA_SV_CS0_TYPE": 3.0,
        "PWM_AUX_FUNC1": 202.0, "CA_SV_CS1_TYPE": 4.0,
    }  # fmt: skip
    found = outputs.outputs(parameters)
    elevator, rudder = found.surfaces
    assert (elevator.channel, rudder.channel) == (3, 17)
    assert elevator.deflection == (-25.0, 0.0, 25.0)
    assert rudder.deflection == (25.0, 0.0, -25.0)
    assert found.motors[0].channel == 1


def test_a_trim_at_the_end_of_the_travel_leaves_two_points() -> None:
    parameters = {"SERVO1_FUNCTION": 19.0, "SERVO1_MIN": 1000.0, "SERVO1_TRIM": 1000.0,
                  "SERVO1_MAX": 2000.0}  # fmt: skip
    (elevator,) = outputs.outputs(parameters).surfaces
    assert elevator.pwm == (1000.0, 2000.0)
    assert "servos" in first_file.draft(recorded(parameters)).text
    filled(first_file.draft(recorded(parameters)).text)


def test_what_is_left_out_is_said() -> None:
    first = first_file.draft(recorded(ARDUPLANE))
    assert any("output 6 (SERVO6_FUNCTION 33): lifting motor" in note for note in first.notes)
    assert any("KFF_RDDRMIX is 0.5" in note for note in first.notes)


def test_a_log_without_parameters_says_so() -> None:
    first = first_file.draft(recorded({}))
    assert any("no parameters" in note for note in first.notes)
    assert filled(first.text).servos == ()


def test_as_a_user_would(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("flight.bin").write_bytes(flight(0.2, parameters=list(ARDUPLANE.items())).binary)
    assert entry.main(["init", "flight.bin"]) == 0
    shown = capsys.readouterr().out
    assert "aileron_1 (output 1)" in shown
    assert "Fill in" in shown
    filled(Path("flight-init/aircraft.toml").read_text())
    assert entry.main(["init", "flight.bin", "--out", "again", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["file"].endswith(init.FILE)
    assert entry.main(["inspect", "flight.bin", "--aircraft", "again/aircraft.toml"]) == 1
    assert "still to be filled in" in capsys.readouterr().err


@pytest.mark.shared
@pytest.mark.parametrize(
    ("log", "surfaces"),
    [
        ("data/arduplane_sitl/B_first_part.BIN", ["aileron", "elevator", "rudder"]),
        ("data/quadplane_sitl/vtol.tlog", ["aileron", "elevator"]),
        ("data/umn_thor/thor_flight75.tlog", []),
    ],
)
def test_real_logs(shared: Path, tmp_path: Path, log: str, surfaces: list[str]) -> None:
    init.run(shared / log, out=tmp_path)
    aircraft = filled((tmp_path / init.FILE).read_text())
    assert [servo.surface for servo in aircraft.servos] == surfaces
