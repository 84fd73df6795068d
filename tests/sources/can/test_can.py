from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs_sysid.cli import entry
from gcs_sysid.errors import SourceError
from gcs_sysid.recording import Recording, Stream, Vehicle
from gcs_sysid.sources.can import dsdl, files, merge, streams, transfers
from gcs_sysid.sources.registry import open_recording
from tests.sources.can.made_can import Bus

RATE = 50.0
VEHICLE = Vehicle(1, 1, "MAV_AUTOPILOT_ARDUPILOTMEGA", "MAV_TYPE_FIXED_WING", 1)


def frames(bus: Bus) -> list[transfers.CanFrame]:
    return [transfers.CanFrame(round(1e6 * t), i, data) for t, i, data in bus.frames]


def one_of_each() -> Bus:
    bus = Bus()
    bus.send(1.0, "air_data.AngleOfAttack", sensor_id=254, aoa=0.125)
    bus.send(1.0, "air_data.Sideslip", sideslip_angle=-0.0625)
    bus.send(1.0, "air_data.IndicatedAirspeed", indicated_airspeed=21.5)
    bus.send(1.0, "air_data.TrueAirspeed", true_airspeed=22.25)
    bus.send(1.0, "air_data.RawAirData", static_pressure=95_000.0, differential_pressure=281.5)
    bus.send(1.0, "air_data.StaticTemperature", static_temperature=288.0)
    bus.send(1.0, "actuator.Status", actuator_id=2, position=-0.25)
    bus.send(
        1.0, "esc.Status", esc_index=3, rpm=-7350, voltage=16.0, current=12.5, power_rating_pct=55
    )
    bus.send(
        1.0, "ahrs.RawIMU", rate_gyro_latest=[0.5, -0.25, 0.125],
        accelerometer_latest=[1.0, 2.0, -9.75],
    )  # fmt: skip
    return bus


def test_messages_are_read_as_the_dronecan_package_writes_them() -> None:
    found, lost = transfers.transfers(frames(one_of_each()))
    assert len(found) == 9
    assert not any(lost.values())
    pieces, short = streams.pieces(found)
    values = {
        f"{piece.stream}.{name}": float(column[0])
        for piece in pieces
        for name, column in piece.channels.items()
    }
    assert short == 0
    assert values == {
        "AOA_SSA.alpha": 0.125, "AOA_SSA.beta": -0.0625, "AIRSPEED.airspeed": 21.5,
        "TRUE_AIRSPEED.true_airspeed": 22.25, "SCALED_PRESSURE.static_pressure": 95_000.0,
        "SCALED_PRESSURE.dynamic_pressure": 281.5, "SCALED_PRESSURE.temperature": 288.0,
        "ACTUATOR_STATUS.position_2": -0.25, "ESC_STATUS.rpm_4": -7350.0,
        "ESC_STATUS.power_4": 200.0,
        "CAN_IMU.p": 0.5, "CAN_IMU.q": -0.25, "CAN_IMU.r": 0.125,
        "CAN_IMU.acc_x": 1.0, "CAN_IMU.acc_y": 2.0, "CAN_IMU.acc_z": -9.75,
    }  # fmt: skip


def test_layouts_are_those_of_the_public_definitions() -> None:
    import dronecan

    for layout in dsdl.LAYOUTS.values():
        public = dronecan.TYPENAMES[layout.name]
        assert public.default_dtid == layout.id
        assert public.get_data_type_signature() == layout.signature
        assert public.get_max_bitlen() >= 8 * (layout.length - 1)


def test_losses_are_counted() -> None:
    whole = frames(one_of_each())
    long = [f for f in whole if not (f.data[-1] & 0x80 and f.data[-1] & 0x40)]
    broken = replace(long[1], data=b"\0" * 7 + long[1].data[-1:])
    found, lost = transfers.transfers([broken if f is long[1] else f for f in whole])
    assert (len(found), lost["can_bad_crc"]) == (8, 1)
    found, lost = transfers.transfers([f for f in whole if f is not long[1]])
    assert len(found) == 8
    assert lost["can_truncated"] >= 1
    other = transfers.CanFrame(0, 0x10 << 24 | 341 << 8 | 42, b"\0" * 7 + b"\xc0")
    assert transfers.transfers([other])[1]["can_unknown"] == 1


@pytest.mark.parametrize("suffix", [".asc", ".blf", ".log"])
def test_log_files_hold_the_frames(tmp_path: Path, suffix: str) -> None:
    bus = one_of_each()
    found = files.frames(bus.save(tmp_path / f"bus{suffix}"))
    assert [(f.id, f.data) for f in found] == [(i, data) for _, i, data in bus.frames]
    steps = np.diff([f.time_us for f in found])
    np.testing.assert_allclose(steps, 1e6 * np.diff([t for t, _, _ in bus.frames]), atol=2.0)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("bus.xyz", b"", "unknown kind of CAN log"),
        ("bus.blf", b"nonsense" * 9, "cannot be read"),
        ("bus.log", b"", "no CAN frame"),
        ("bus.mf4", b"MDF     4.10", "asammdf|cannot be read"),
    ],
)
def test_files_that_are_no_can_log(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(SourceError, match=words) as error:
        files.frames(path)
    assert "\n" not in str(error.value)


def motion(time: np.ndarray) -> np.ndarray:
    """A pitch rate with no period in it [rad/s]."""
    return 0.3 * np.sin(0.7 * time + 0.02 * time**2) + 0.1 * np.sin(2.3 * time)


def flight(seconds: float = 90.0) -> Recording:
    time = np.arange(0.0, seconds, 1.0 / RATE)
    noise = np.random.default_rng(7).normal(0.0, 0.01, time.size)
    rate = Stream("RAW_IMU", time, time, {"q": motion(time) + noise})
    estimate = Stream("AOA_SSA", time, time, {"alpha": 0.0 * time, "beta": 0.0 * time})
    return Recording("flight.tlog", "", VEHICLE, 10**15, {"RAW_IMU": rate, "AOA_SSA": estimate})


def bus_of_the_flight(begin: float, offset: float, seconds: float = 40.0) -> Bus:
    """Nodes whose clock is `offset` behind the flight's, from `begin` on."""
    bus = Bus()
    for time in np.arange(begin, begin + seconds, 0.02):
        at = float(time) - offset
        bus.send(
            at, "ahrs.RawIMU", rate_gyro_latest=[0.0, float(motion(time)), 0.0],
            accelerometer_latest=[0.0, 0.0, -9.75],
        )  # fmt: skip
        bus.send(at, "air_data.AngleOfAttack", sensor_id=254, aoa=0.1 + 0.01 * (time % 1.0))
        bus.send(at, "air_data.Sideslip", sideslip_angle=0.02)
    return bus


@pytest.mark.parametrize(("begin", "offset"), [(12.0, -987.654), (30.0, 5.4321), (-10.0, 0.003)])
def test_the_clock_of_the_bus_is_found_by_what_both_measured(
    tmp_path: Path, begin: float, offset: float
) -> None:
    """Within four of the deviations that it states, and these are some milliseconds."""
    path = bus_of_the_flight(begin, offset).save(tmp_path / "bus.blf")
    recording = merge.beside(flight(), path)
    vanes = recording.streams["AOA_SSA"]
    (note,) = [line for line in recording.clock_notes if "offset" in line]
    deviation = float(note.split("deviation of ")[1].split(" ms")[0]) * 1e-3
    assert 0.0 < deviation < 0.01
    assert vanes.time[0] == pytest.approx(begin, abs=4.0 * deviation + 2e-3)
    assert recording.streams["AOA_SSA[autopilot]"].channels["alpha"][0] == 0.0
    assert vanes.has("alpha", "beta")


def test_a_log_of_another_flight_is_refused(tmp_path: Path) -> None:
    bus = Bus()
    noise = np.random.default_rng(3).normal(0.0, 0.3, 2000)
    for index, value in enumerate(noise):
        bus.send(0.02 * index, "ahrs.RawIMU", rate_gyro_latest=[0.0, float(value), 0.0])
    with pytest.raises(SourceError, match="shares no signal with the flight"):
        merge.beside(flight(), bus.save(tmp_path / "bus.blf"))


def test_frames_that_the_autopilot_passed_on(writer: type, tmp_path: Path) -> None:
    log = writer().heartbeat(0)
    for i in range(50):
        log.add(20_000 * i, "ATTITUDE", time_boot_ms=500 + 20 * i, roll=0.1)
        bus = Bus()
        bus.send(0.0, "air_data.AngleOfAttack", sensor_id=254, aoa=0.01 * i)
        for _, identifier, data in bus.frames:
            log.add(
                20_000 * i + 5, "CAN_FRAME", id=identifier | 0x80000000, len=len(data),
                data=list(data) + [0] * (8 - len(data)),
            )  # fmt: skip
    path = tmp_path / "flight.tlog"
    path.write_bytes(log.data)
    vanes = open_recording(path).streams["AOA_SSA"]
    assert vanes.count == 50
    np.testing.assert_allclose(vanes.channels["alpha"], 0.01 * np.arange(50), atol=3e-4)
    np.testing.assert_allclose(np.diff(vanes.time), 0.02, atol=1e-3)


def test_as_a_user_would(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """The CAN log beside a telemetry log, in which the autopilot measured the same pitch rate."""
    from tests.sources.conftest import Writer

    monkeypatch.chdir(tmp_path)
    log = Writer().heartbeat(0)
    for i in range(3000):
        log.add(
            20_000 * i, "ATTITUDE", time_boot_ms=5000 + 20 * i, roll=0.1,
            pitchspeed=float(motion(np.array(0.02 * i))),
        )  # fmt: skip
    Path("flight.tlog").write_bytes(log.data)
    bus_of_the_flight(10.0, 100.0, 30.0).save(tmp_path / "bus.asc")
    assert entry.main(["inspect", "flight.tlog", "--can", "bus.asc"]) == 0
    shown = capsys.readouterr().out
    assert "AOA_SSA" in shown
    assert "CAN clock put on the flight's by CAN_IMU.q" in " ".join(shown.split())


DAMAGED = frames(one_of_each())


@settings(max_examples=100)
@given(
    flips=st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), max_size=20),
    seed=st.integers(0, 2**32),
)
def test_damage_never_breaks_the_reader(flips: list[tuple[int, int]], seed: int) -> None:
    chosen = Random(seed).choices(DAMAGED, k=40)
    for place, bits in flips:
        frame = chosen[place % 40]
        data = bytearray(frame.data)
        data[place % len(data)] ^= bits
        chosen[place % 40] = replace(
            frame, data=bytes(data), id=frame.id ^ (bits << 8) * (bits > 250)
        )
    found, lost = transfers.transfers(chosen)
    pieces, _ = streams.pieces(found)
    assert all(np.all(np.isfinite(piece.time_us)) for piece in pieces)
    assert set(lost) == {"can_unknown", "can_bad_crc", "can_truncated"}


def test_measurement_data_files_are_read(tmp_path: Path) -> None:
    """As python-can's own writer makes them."""
    pytest.importorskip("asammdf", reason="asammdf, which reads and writes .mf4, is not installed")
    bus, begun = Bus(), 1_790_000_000.0
    bus.send(begun, "air_data.AngleOfAttack", sensor_id=254, aoa=0.125)
    bus.send(begun + 1.0, "ahrs.RawIMU", rate_gyro_latest=[0.5, -0.25, 0.125])
    assert files.frames(bus.save(tmp_path / "bus.mf4")) == frames(bus)
