"""Recorded flights: read by pymavlink, true to what happened, the same for the same seed."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from scipy.optimize import fsolve

from gcs_sysid.errors import UsageError
from gcs_sysid.sitl import record, scenario, truth
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.inputs import THROTTLE, TestInput
from gcs_sysid.sitl.jsbsim_aircraft import Start, Wind
from gcs_sysid.sitl.jsbsim_xml import Fuel
from gcs_sysid.sitl.link import Link, tlog
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.record import Flown
from gcs_sysid.sitl.sensors import Noise
from gcs_sysid.sitl.telemetry import RATES
from tests.sitl import examples

DEMO = examples.ROOT / "replay" / "demo" / "scenario.toml"
FLIGHTS = examples.ROOT / "data" / "flights"
SILENT = Noise(**{field.name: 0.0 for field in dataclasses.fields(Noise)})
SURE = Link(loss=0.0)


def inputs(duration: float) -> tuple[TestInput, ...]:
    tests = [
        TestInput(name, "multisine", 1.0, duration - 2.0, 0.06, tuple(range(3 + i, 40, 3)))
        for i, name in enumerate(("elevator", "aileron", "rudder"))
    ]
    return (*tests, TestInput(THROTTLE, "doublet", 3.0, 6.0, 0.2))


@pytest.fixture(scope="module")
def flight() -> Flight:
    believed = examples.ultra_stick()
    leg = Leg("test", 16.0, 17.0, 120.0, 0.3, inputs=inputs(16.0))
    turn = Leg("turn", 4.0, 17.0, 120.0, 2.5)
    return Flight(
        believed=believed,
        flown=believed,
        legs=(leg, turn),
        wind=Wind((2.0, 1.0, 0.0), gust=0.5),
        start=Start(airspeed=17.0),
        seed=7,
    )


@pytest.fixture(scope="module")
def flown(flight) -> Flown:
    return record.fly(flight)


def messages(contents: bytes, folder: Path) -> list:
    path = folder / "flight.tlog"
    path.write_bytes(contents)
    connection = mavutil.mavlink_connection(str(path))
    found = list(iter(connection.recv_msg, None))
    connection.close()
    return found


@pytest.fixture(scope="module")
def received(flown, tmp_path_factory) -> list:
    return messages(tlog(flown.frames), tmp_path_factory.mktemp("tlog"))


def test_messages_come_at_their_rates_less_the_lost(flown, received):
    counts = Counter(message.get_type() for message in received)
    # Its motor does not tell its speed.
    assert "ESC_TELEMETRY_1_TO_4" not in counts
    for name, rate in RATES.items() - {("ESC_TELEMETRY_1_TO_4", 10)}:
        sent = 20.0 * rate
        # Four standard deviations of a binomial loss of 1 %.
        assert abs(counts[name] - 0.99 * sent) <= 1.0 + 4.0 * math.sqrt(0.01 * sent), name
    assert counts["STATUSTEXT"] <= 2
    assert counts["PARAM_VALUE"] == 2 + 5 * 5
    assert "BAD_DATA" not in counts
    assert len(received) == len(flown.frames) < flown.sent


def test_lost_frames_leave_gaps_in_the_sequence(flown, received):
    number, seen = 0, set()
    for message in received:
        # Jitter swaps neighbours only, so the nearest number of that remainder is meant.
        number += (message.get_seq() - number + 128) % 256 - 128
        seen.add(number)
    assert len(seen) == len(received)
    assert set(range(flown.sent)) >= seen


def test_frames_arrive_in_order_late_and_unevenly(flown):
    arrivals = np.array([frame.arrival_us for frame in flown.frames])
    assert np.all(np.diff(arrivals) >= 0)
    # Sent at multiples of 20 ms, 4 ms late and then an exponential of 2 ms.
    late = (arrivals - flown.truth.t0_us - 4000) % 20_000
    assert late.mean() == pytest.approx(2000.0, rel=0.1)
    assert late.std() == pytest.approx(2000.0, rel=0.1)


def test_telemetry_is_the_truth_through_the_sensors(flight, flown, received):
    imu = [m for m in received if m.get_type() == "RAW_IMU"]
    ticks = np.array([round((m.time_usec / 1e6 - 93.0) * 50) for m in imu])
    rates = np.array([(m.xgyro, m.ygyro, m.zgyro) for m in imu]) / 1e3
    true = np.column_stack([flown.truth.column(name)[ticks] for name in ("p", "q", "r")])
    # Noise, and a millirad of rounding.
    spread = math.hypot(Noise().gyro, 1e-3 / math.sqrt(12.0))
    assert (rates - true).std(axis=0) == pytest.approx(spread, rel=0.1)
    assert (rates - true).mean(axis=0) == pytest.approx(0.0, abs=4.0 * spread / math.sqrt(len(imu)))
    hud = [m.airspeed for m in received if m.get_type() == "VFR_HUD"]
    equivalent = np.sqrt(2.0 * flown.truth.column("qbar") / 1.225)
    assert np.mean(hud) == pytest.approx(equivalent.mean(), abs=0.05)
    assert {m.get_srcSystem() for m in received} == {1}


def test_servo_outputs_lead_to_where_the_surfaces_stood(flown, received):
    outputs = [m for m in received if m.get_type() == "SERVO_OUTPUT_RAW"]
    ticks = np.array([round((m.time_usec / 1e6 - 93.0) * 50) for m in outputs])
    commanded = np.radians((np.array([m.servo2_raw for m in outputs]) - 1500) * 0.05)
    # 50 ms of delay and 26 ms of lag: four ticks later the surface is nearest to the command.
    known = ticks < flown.truth.rows.shape[0] - 10
    elevator = flown.truth.column("elevator")
    error = [np.std(commanded[known] - elevator[ticks[known] + n]) for n in range(9)]
    assert np.argmin(error) == 4
    assert error[4] < 0.4 * error[0]


def test_truth_at_true_regressors_is_the_flown_model(flight, flown):
    """Least squares on the truth gives every derivative back: no turbulence, lag or lever left."""
    truth, aircraft = flown.truth, flight.flown
    speed = truth.column("V")
    values = {
        "1": np.ones_like(speed),
        **{name: truth.column(name) for name in ("alpha", "beta", *aircraft.control_names)},
        "alpha^2": truth.column("alpha") ** 2,
        "phat": truth.column("p_air") * 1.27 / (2.0 * speed),
        "qhat": truth.column("q_air") * 0.25 / (2.0 * speed),
        "rhat": truth.column("r_air") * 1.27 / (2.0 * speed),
    }
    for name, model in aircraft.aerodynamics.items():
        regressors = np.column_stack([values[key] for key in model.terms])
        found, *_ = np.linalg.lstsq(regressors, truth.column(name), rcond=None)
        assert found == pytest.approx([v.value for v in model.terms.values()], rel=1e-6, abs=1e-9)


def test_the_same_seed_gives_the_same_file_and_another_does_not(flight, flown):
    short = dataclasses.replace(flight, legs=(dataclasses.replace(flight.legs[0], duration=3.0),))
    end = flight.epoch_us + 2_900_000
    first = [tlog(f for f in flown.frames if f.arrival_us < end)]
    again = [tlog(f for f in record.fly(short).frames if f.arrival_us < end)]
    assert first == again
    other = record.fly(dataclasses.replace(short, seed=8))
    assert tlog(f for f in other.frames if f.arrival_us < end) != first
    assert np.std(other.truth.column("wind_down") - flown.truth.column("wind_down")[:150]) > 0.05


def test_a_restart_in_flight_starts_time_and_numbers_anew(flight, tmp_path):
    legs = (dataclasses.replace(flight.legs[0], duration=6.0, inputs=()),)
    calm = dataclasses.replace(flight, legs=legs, wind=Wind(), link=SURE)
    flown = record.fly(dataclasses.replace(calm, reboot=2.0))
    found = messages(tlog(flown.frames), tmp_path)
    imu = [m for m in found if m.get_type() == "RAW_IMU"]
    assert len(imu) == 50 * 4
    # 93 s after it was switched on the recording begins; the restart takes two seconds.
    assert [m.time_usec for m in imu[:2]] == [93_000_000, 93_020_000]
    assert [m.time_usec for m in imu[99:102]] == [94_980_000, 2_000_000, 2_020_000]
    after = [m for m in found if m._timestamp > imu[100]._timestamp - 0.005]
    assert min(m.get_seq() for m in after[:12]) == 0
    stamps = [m for m in found if m.get_type() == "SYSTEM_TIME"]
    assert stamps[-1].time_unix_usec - stamps[0].time_unix_usec == 5_000_000
    assert stamps[-1].time_boot_ms == 3_000
    # The outputs stay as they are, and the aircraft flies on.
    truth = flown.truth
    assert len(truth.rows) == 300
    # 50 ms of delay and twelve time constants of the servo.
    assert np.ptp(truth.column("elevator")[118:200]) < 1e-6
    assert abs(truth.column("V")[-1] - 17.0) < 1.0


def test_messages_are_those_asked_for(flight, tmp_path):
    legs = (dataclasses.replace(flight.legs[0], duration=3.0),)
    rates = {"HIGHRES_IMU": 25, "ATTITUDE": 5}
    flown = record.fly(dataclasses.replace(flight, legs=legs, link=SURE, rates=rates))
    counts = Counter(m.get_type() for m in messages(tlog(flown.frames), tmp_path))
    assert counts.keys() == {*rates, "PARAM_VALUE", "STATUSTEXT"}
    assert (counts["HIGHRES_IMU"], counts["ATTITUDE"]) == (75, 15)


def test_motors_tell_their_speed(flight, tmp_path):
    [thruster] = flight.believed.propulsion
    speeds = tuple(10_000.0 * throttle for throttle in thruster.throttle)
    turning = dataclasses.replace(thruster, throttle=(), rpm=speeds, rpm_channel=1)
    aircraft = dataclasses.replace(flight.believed, propulsion=(turning,))
    legs = (dataclasses.replace(flight.legs[0], duration=8.0),)
    flown = record.fly(
        dataclasses.replace(flight, believed=aircraft, flown=aircraft, legs=legs, link=SURE)
    )
    found = messages(tlog(flown.frames), tmp_path)
    told = [m for m in found if m.get_type() == "ESC_TELEMETRY_1_TO_4"]
    assert len(told) == 80
    assert all(m.count[0] > 0 and m.count[1:] == [0, 0, 0] for m in told)
    # The throttle's pulse through a first-order lag of 80 ms, every tenth of a second.
    speed, expected = 5000.0, []
    for number, output in enumerate(m for m in found if m.get_type() == "SERVO_OUTPUT_RAW"):
        if number % 5 == 0:
            expected.append(speed)
        commanded = 10.0 * (output.servo3_raw - 1000)
        speed = commanded + (speed - commanded) * math.exp(-0.02 / 0.08)
    # After a second nothing is left of where it began.
    assert [m.rpm[0] for m in told[10:]] == pytest.approx(expected[10:], abs=1.0)
    assert np.ptp(expected[10:]) > 2000.0


def test_what_is_burnt_is_in_the_truth(flight):
    legs = (dataclasses.replace(flight.legs[0], duration=2.0, inputs=()),)
    calm = dataclasses.replace(flight, legs=legs, wind=Wind(), fuel=Fuel(mass=0.2, burn=0.01))
    mass = record.fly(calm).truth.column("mass")
    # Ten seconds at about a third of full throttle: eight settling, two recorded.
    assert 1.90 < mass[-1] < mass[0] - 0.002 < 1.959


def test_level_flight_is_the_trim_of_the_derivatives():
    """In calm air alpha, elevator and thrust solve the equilibrium of the file's polynomials."""
    aircraft = dataclasses.replace(examples.ultra_stick(), vanes=None)
    legs = (Leg("steady", 4.0, 17.0, 120.0, 0.0),)
    flight = Flight(aircraft, aircraft, legs, start=Start(airspeed=17.0), noise=SILENT, link=SURE)
    truth = record.fly(flight).truth
    qbar = 0.5 * 1.225 * 17.0**2
    weight = 1.959 * 9.807

    def imbalance(unknown):
        alpha, elevator, thrust = unknown
        CX = -0.0446 + 0.199 * alpha + 2.89 * alpha**2 - 0.0135 * elevator
        CZ = -0.1086 - 4.625 * alpha - 0.0983 * elevator
        Cm = -0.0278 - 0.723 * alpha - 0.8488 * elevator
        force = qbar * 0.3097
        return [
            force * CX + thrust - weight * math.sin(alpha),
            force * CZ + weight * math.cos(alpha),
            Cm,
        ]

    alpha, elevator, thrust = fsolve(imbalance, [0.05, -0.05, 2.0])
    # What is left of settling in, and pulses of a whole microsecond.
    assert truth.column("alpha").mean() == pytest.approx(alpha, abs=5e-4)
    assert truth.column("elevator").mean() == pytest.approx(elevator, abs=5e-4)
    assert truth.column("thrust").mean() == pytest.approx(thrust, abs=0.05)
    assert truth.column("theta").mean() == pytest.approx(alpha, abs=1e-3)
    assert np.ptp(truth.column("qbar")) < 0.01 * qbar


def test_the_standard_flight_stays_in_the_envelope():
    """Of the bundled flight, so that the test costs nothing."""
    envelope = examples.ultra_stick().envelope
    assert envelope is not None
    truth = load_truth("demo")
    speed = np.sqrt(2.0 * truth["qbar"] / 1.225)
    for found, (low, high) in (
        (speed, envelope.airspeed),
        (truth["alpha"], envelope.alpha),
        (truth["beta"], envelope.beta),
    ):
        assert low < found.min() < found.max() < high
    assert np.abs(truth["phi"]).max() < envelope.bank
    assert np.ptp(truth["V"]) > 6.0
    assert truth["alpha"].std() > math.radians(1.0)


def load_truth(name: str) -> dict[str, np.ndarray]:
    file = np.load(FLIGHTS / f"{name}_truth.npz")
    return dict(zip(file["cols"].tolist(), file["rows"].T, strict=True))


@pytest.mark.parametrize("index", [0, 1])
def test_the_bundled_flights_are_what_their_scenario_flies(index, tmp_path):
    """The first ten seconds, to one unit of each field: other machines round otherwise."""
    planned = scenario.load(DEMO).flights[index]
    first = dataclasses.replace(planned.flight.legs[0], duration=10.0)
    if planned.flight.legs[0].duration < 10.0:
        first = planned.flight.legs[0]
    again = record.fly(dataclasses.replace(planned.flight, legs=(first,)))
    contents = tlog(again.frames)
    end = planned.flight.epoch_us + round((first.duration - 0.1) * 1e6)
    found = [m for m in messages(contents, tmp_path) if m._timestamp * 1e6 < end]
    bundled = messages(planned.record.read_bytes()[: len(contents) + 100], tmp_path)
    assert len(found) > 1500
    for new, old in zip(found, bundled, strict=False):
        assert new.get_type() == old.get_type()
        assert new._timestamp == old._timestamp
        for field in new.get_fieldnames():
            one, other = getattr(new, field), getattr(old, field)
            tolerance = 1e-4 if isinstance(other, float) else 1.0
            assert one == other or one == pytest.approx(other, abs=tolerance), (new, old)


def test_bundled_files_are_small():
    sizes = {path.name: path.stat().st_size for path in FLIGHTS.iterdir()}
    assert set(sizes) == {
        f"{flight}{ending}"
        for flight in ("demo", "demo_second")
        for ending in (".tlog", "_truth.npz", "_truth.json")
    }
    assert all(size < (3e6 if name.endswith(".tlog") else 1e6) for name, size in sizes.items())


def test_truth_is_written_at_the_rate_asked_for(flown, tmp_path):
    path = tmp_path / "truth.npz"
    truth.save(flown.truth, path, rate=10)
    file = np.load(path)
    assert file["rows"].shape == (200, flown.truth.rows.shape[1])
    assert file["rows"].dtype == np.float32
    assert int(file["t0_us"]) == flown.truth.t0_us
    truth.save(flown.truth, path)
    assert np.array_equal(np.load(path)["rows"], flown.truth.rows)
    with pytest.raises(UsageError, match="divide"):
        truth.save(flown.truth, path, rate=15)


@pytest.mark.shared
def test_truth_and_messages_are_those_of_the_example_case(shared, flown, received, tmp_path):
    case = np.load(shared / "cases" / "clean" / "truth.npz")
    assert flown.truth.columns == tuple(case["cols"].tolist())
    example = messages(
        (shared / "cases" / "clean" / "flight.tlog").read_bytes()[:200_000], tmp_path
    )
    types = {message.get_type() for message in received}
    assert {message.get_type() for message in example} <= types


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"legs": ()}, "no leg"),
        ({"legs": (Leg("x", 1.0, 17.0, 400.0),), "wind": Wind(gust=1.0)}, "fly lower"),
        (
            {
                "legs": (
                    Leg("x", 1.0, 17.0, 90.0, inputs=(TestInput("flap", "step", 0.0, 1.0, 0.1),)),
                )
            },
            "no control `flap`",
        ),
    ],
)
def test_a_flight_that_cannot_be_flown_says_why(flight, change, words):
    with pytest.raises(UsageError, match=words):
        record.fly(dataclasses.replace(flight, **change))
