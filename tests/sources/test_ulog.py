from __future__ import annotations

from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.errors import InputError, RefusedError, SourceError
from gcs_sysid.sources.registry import open_recording
from tests.sources.made_ulog import Ulog, flight


@pytest.fixture
def save(tmp_path: Path):
    def to_file(data: bytes) -> Path:
        path = tmp_path / "flight.ulg"
        path.write_bytes(data)
        return path

    return to_file


def test_streams_have_the_names_and_units_of_telemetry(save) -> None:
    found = open_recording(save(flight().data))
    assert found.vehicle.system == 3
    assert found.vehicle.autopilot == "MAV_AUTOPILOT_PX4"
    assert found.vehicle.kind == "MAV_TYPE_FIXED_WING"
    assert found.parameters["FW_AIRSPD_TRIM"] == 15.5
    assert found.texts == ((0.0, "[commander] Takeoff detected"),)
    streams = found.streams
    inertial = streams["HIGHRES_IMU"]
    assert inertial.count == 400
    assert inertial.rate == pytest.approx(200.0)
    assert inertial.channels["p"][100] == pytest.approx(1.0)
    assert inertial.channels["acc_z"][0] == pytest.approx(-9.75)
    attitude = streams["ATTITUDE"]
    assert np.degrees(attitude.channels["roll"][0]) == pytest.approx(30.0, abs=1e-4)
    assert attitude.channels["q"][0] == pytest.approx(0.25)
    assert streams["GLOBAL_POSITION_INT"].channels["v_north"][0] == pytest.approx(15.0)
    assert np.degrees(streams["GLOBAL_POSITION_INT"].channels["latitude"][0]) == 47.5
    assert streams["LOCAL_POSITION_NED"].channels["height"][0] == pytest.approx(50.0)
    assert streams["AIRSPEED"].channels["airspeed"][0] == pytest.approx(15.25)
    assert streams["SCALED_PRESSURE"].channels["static_pressure"][0] == pytest.approx(95_000.0)
    assert streams["SCALED_PRESSURE"].channels["temperature"][0] == pytest.approx(288.15)
    assert streams["AOA_SSA"].valid("alpha").tolist() == [False] * 2 + [True] * 18
    assert streams["ESC_STATUS"].channels["rpm_2"][0] == 6500.0
    assert streams["HEARTBEAT"].channels["armed"][0] == 1.0
    assert set(found.lost.values()) == {0}


def test_attitude_counts_from_when_it_was_sampled(save) -> None:
    """It is published 300 µs after the sample of the gyro that it belongs to."""
    streams = open_recording(save(flight().data)).streams
    np.testing.assert_allclose(
        streams["ATTITUDE"].time, streams["HIGHRES_IMU"].time[::2], atol=1e-9
    )


def test_outputs_of_the_second_driver_follow_those_of_the_first(save) -> None:
    servos = open_recording(save(flight().data)).streams["SERVO_OUTPUT_RAW"]
    assert servos.count == 100
    assert servos.channels["pwm_1"][1] == 1504.0
    assert servos.channels["pwm_17"][1] == 1750.0
    assert not servos.has("pwm_3")


def test_pulses_follow_from_demands_where_they_were_not_logged(save) -> None:
    """Servo 1 is on output 2, which goes from 1100 to 1900 µs: a demand of -0.5 is 1300 µs."""
    servos = open_recording(save(flight(outputs=False).data)).streams["SERVO_OUTPUT_RAW"]
    assert [name for name in servos.channels if servos.has(name)] == ["pwm_2"]
    np.testing.assert_allclose(servos.channels["pwm_2"][:2], [1300.0, 1316.0], atol=1e-3)


def test_wall_time_comes_from_the_receiver(save) -> None:
    found = open_recording(save(flight().data))
    assert found.epoch_us == 1_790_000_001_000_000
    fixes = found.streams["GPS_RAW_INT"]
    assert not fixes.valid("latitude")[0]
    assert fixes.valid("latitude")[1:].all()


def test_pauses_of_the_logger_are_counted(save) -> None:
    found = open_recording(save(flight(0.2).dropout(120).dropout(30).data))
    assert found.lost["dropouts"] == 2
    assert any("0.150 s in 2 pauses" in note for note in found.clock_notes)


def test_another_vehicle_is_refused(save) -> None:
    with pytest.raises(RefusedError, match=r"system id is 3; .*--vehicle 3"):
        open_recording(save(flight(0.1).data), vehicle=1)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\0" * 300, "is no ULog"),
        (flight(0.0).data[:20], "cannot be read as ULog|none of the topics"),
        (Ulog().add("cpuload", 1_000_000, 0.5).data, "none of the topics"),
    ],
)
def test_files_that_hold_no_flight(save, content: bytes, words: str) -> None:
    with pytest.raises(SourceError, match=words) as error:
        open_recording(save(content))
    assert "\n" not in str(error.value)


def test_progress_is_told(save) -> None:
    told: list[float] = []
    open_recording(save(flight(20.0).data), progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


@settings(max_examples=40)
@given(
    flips=st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), max_size=20),
    cuts=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 200)), max_size=4),
    seed=st.integers(0, 2**32),
)
def test_damage_never_breaks_the_reader(
    tmp_path_factory: pytest.TempPathFactory,
    flips: list[tuple[int, int]],
    cuts: list[tuple[int, int]],
    seed: int,
) -> None:
    """Flipped bytes, cuts, repeated and reordered messages: a Recording, or a reason why not."""
    log = DAMAGED
    data = bytearray(log.head + b"".join(Random(seed).choices(log.messages, k=len(log.messages))))
    for place, bits in flips:
        data[place % len(data)] ^= bits
    for place, width in cuts:
        at = place % len(data)
        data = data[:at] + data[at + width :]
    path = tmp_path_factory.getbasetemp() / "damaged.ulg"
    path.write_bytes(data)
    try:
        found = open_recording(path)
    except InputError:
        return
    for stream in found.streams.values():
        assert np.all(np.isfinite(stream.time))
        assert np.all(np.diff(stream.time) >= 0.0)


DAMAGED = flight(0.2)
