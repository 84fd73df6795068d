"""Published flight-test records, read through the column maps in tests/data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.errors import RefusedError
from gcs_sysid.offline import identify, inspect
from gcs_sysid.reconstruct import compatibility, measurements
from gcs_sysid.reconstruct.reconstruction import reconstruct
from gcs_sysid.sources.registry import open_recording

DATA = Path(__file__).parents[1] / "data"
THOR = DATA / "thor_columns.toml"
INERTIALNAV = DATA / "inertialnav_columns.toml"

# Half a step of what each MAVLink field can hold, or float32's; RAW_IMU was truncated: a whole one.
QUANTISATION = {
    "RAW_IMU": {
        "acc_x": 1e-3 * 9.80665, "acc_y": 1e-3 * 9.80665, "acc_z": 1e-3 * 9.80665,
        "p": 1e-3, "q": 1e-3, "r": 1e-3, "mag_x": 1e-7, "mag_y": 1e-7, "mag_z": 1e-7,
    },
    "ATTITUDE": {"roll": 1e-6, "pitch": 1e-6, "yaw": 1e-6},
    "GLOBAL_POSITION_INT": {
        "v_north": 1e-2, "v_east": 1e-2, "v_down": 1e-2, "altitude": 1e-3,
        "latitude": 2e-9, "longitude": 2e-9,
    },
    "AOA_SSA": {"alpha": 1e-7, "beta": 1e-7},
    "VFR_HUD": {"airspeed": 1e-6},
    "SCALED_PRESSURE": {"static_pressure": 1e-2, "dynamic_pressure": 1e-4},
    "SERVO_OUTPUT_RAW": {f"pwm_{n}": 1.0 for n in range(1, 6)},
}  # fmt: skip
SAME_ROW_US = 3000


@pytest.fixture(scope="module")
def thor(shared):
    return open_recording(shared / "data/umn_thor/thor_flight75.mat", columns=THOR)


@pytest.fixture(scope="module")
def thor_telemetry(shared):
    return open_recording(shared / "data/umn_thor/thor_flight75.tlog")


@pytest.fixture(scope="module")
def aerobatic(shared):
    return open_recording(shared / "data/inertialnav/TestLog2.mat", columns=INERTIALNAV)


@pytest.mark.shared
@pytest.mark.parametrize("stream", QUANTISATION)
def test_the_original_of_a_tlog_holds_the_same_values(thor, thor_telemetry, stream):
    """At the telemetry's times, to its quantisation; surfaces where the autopilot moved them."""
    table, sent = thor.streams[stream], thor_telemetry.streams[stream]
    for channel, step in QUANTISATION[stream].items():
        known, asked = table.valid(channel), sent.valid(channel)
        time, wanted = thor.time_us(table.time[known]), thor_telemetry.time_us(sent.time[asked])
        row = np.clip(np.searchsorted(time, wanted - SAME_ROW_US), 0, time.size - 1)
        same = np.abs(time[row] - wanted) < SAME_ROW_US
        assert same.mean() > 0.95  # before its first fix the telemetry sent made-up positions
        found, sent_values = table.channels[channel][known][row], sent.channels[channel][asked]
        if channel == "airspeed":
            same &= found > 0.0  # telemetry sent no negative airspeed
        if stream == "SERVO_OUTPUT_RAW":
            same &= (row >= 11730) & (row <= 26650)  # before and after, the pilot's own commands
        assert np.max(np.abs(found - sent_values)[same]) <= step, channel


@pytest.mark.shared
def test_a_table_has_the_full_rate_on_the_telemetrys_clock(thor, thor_telemetry):
    assert thor.epoch_us == pytest.approx(thor_telemetry.epoch_us, abs=2000)
    for name in ("RAW_IMU", "ATTITUDE", "AOA_SSA", "SERVO_OUTPUT_RAW"):
        assert thor.streams[name].rate == pytest.approx(50.0, rel=0.01)
    assert thor_telemetry.streams["AOA_SSA"].rate == pytest.approx(10.0, rel=0.01)
    assert thor.streams["RAW_IMU"].time[-1] == pytest.approx(696.2, abs=0.1)


@pytest.mark.shared
def test_the_same_flight_is_found_in_the_table_and_in_the_telemetry(thor, thor_telemetry):
    table, telemetry = (inspect.inspected(flight, None) for flight in (thor, thor_telemetry))
    assert table["airborne_s"] == pytest.approx(telemetry["airborne_s"], abs=2.0)


@pytest.mark.shared
def test_a_fix_a_second_in_a_fast_table_is_a_fix_a_second(shared, tmp_path):
    """The receiver's own velocity is held for 50 rows and more; the navigation filter's is not."""
    text = THOR.read_text().replace("navv", "v")
    map_path = tmp_path / "map.toml"
    map_path.write_text(text)
    found = open_recording(shared / "data/umn_thor/thor_flight75.mat", columns=map_path)
    velocity = found.streams["GLOBAL_POSITION_INT"].valid("v_north")
    assert velocity.sum() == pytest.approx(696, rel=0.05)
    assert any(note.startswith("v_north, v_east, v_down: held") for note in found.clock_notes)


@pytest.mark.shared
def test_messages_of_a_log_in_matrices_keep_their_own_rates(aerobatic):
    rates = {name: stream.rate for name, stream in aerobatic.streams.items()}
    assert rates["RAW_IMU"] == pytest.approx(50.0)
    assert rates["ATTITUDE"] == pytest.approx(50.0)
    assert rates["VFR_HUD"] == pytest.approx(10.0)
    assert rates["GLOBAL_POSITION_INT"] == pytest.approx(5.0)
    document = inspect.inspected(aerobatic, None)
    assert document["duration_s"] == pytest.approx(613.1, abs=0.1)
    assert 250.0 < document["airborne_s"] < 400.0
    assert list(document["controls"]) == ["servo4", "throttle"]


@pytest.mark.shared
def test_attitude_that_wraps_around_turns_as_the_gyros_do(aerobatic):
    """Two rolls and many circles, heading given from 0 to 360°.

    From sample to sample attitude may differ from the gyros by what the autopilot's estimator
    corrects, not by a turn; 0.03 s leaves a pause in the log out.
    """
    attitude, gyro = aerobatic.streams["ATTITUDE"], aerobatic.streams["RAW_IMU"]
    known = gyro.valid("p")
    p, q, r = (
        np.interp(attitude.time, gyro.time[known], gyro.channels[name][known]) for name in "pqr"
    )
    roll, pitch, yaw = (attitude.channels[name] for name in ("roll", "pitch", "yaw"))
    across = q * np.sin(roll) + r * np.cos(roll)
    step = np.diff(attitude.time)
    usable = (np.abs(pitch[1:]) < 0.7) & (step < 0.03)
    for angle, rate in ((roll, p + np.tan(pitch) * across), (yaw, across / np.cos(pitch))):
        assert np.all(np.abs(angle) <= np.pi)
        assert np.any(np.abs(np.diff(angle)) > np.pi)
        turned = 0.5 * (rate[1:] + rate[:-1]) * step
        assert np.max(np.abs(np.diff(np.unwrap(angle)) - turned)[usable]) < np.radians(1.0)


@pytest.mark.shared
@pytest.mark.slow
def test_the_motion_is_reconstructed_although_no_surface_was_logged(aerobatic, shared):
    aircraft = aircraft_file.load(shared / "data/umn_thor/aircraft.toml")
    data = measurements.select(aerobatic, aircraft, (320.0, 380.0))
    states = reconstruct(data, aircraft)
    verdict = compatibility.check(states)
    assert set(verdict.channels) >= {"airspeed", "velocity_north", "roll"}
    assert verdict.verdict.startswith("The sensors")
    assert np.all(np.isfinite(states.airspeed))


@pytest.mark.shared
def test_without_surfaces_identification_is_refused_in_one_line(shared, tmp_path):
    kept = [line for line in INERTIALNAV.read_text().splitlines() if "pwm_" not in line]
    map_path = tmp_path / "map.toml"
    map_path.write_text("\n".join(kept))
    with pytest.raises(RefusedError) as caught:
        identify.run(
            [shared / "data/inertialnav/TestLog2.mat"],
            shared / "data/umn_thor/aircraft.toml",
            prior="none",
            segments=None,
            vehicle=None,
            stepwise=False,
            out=tmp_path,
            progress=lambda *_: None,
            columns=map_path,
        )
    message = str(caught.value)
    assert "no surface command was recorded in flight" in message
    assert "elevator, aileron, rudder" in message
    assert "log each servo's pulse or surface's deflection at" in message
    assert "\n" not in message


@pytest.mark.shared
def test_each_coefficient_without_its_surface_says_which_and_what_to_log(aerobatic, shared):
    aircraft = aircraft_file.load(shared / "data/umn_thor/aircraft.toml")
    judged = inspect.inspected(aerobatic, aircraft)["identifiable"]
    assert judged["Cm"]["verdict"] == judged["Cl"]["verdict"] == "no"
    assert "`elevator` is not in the table" in judged["Cm"]["reason"]
    assert "`pwm_1` and `pwm_5`" in judged["Cl"]["reason"]
