"""Rows of the aided filter: how long their steps are, holes; and what is believed of sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, Imu, Pitot, SensorError, StreamTiming, Vanes
from gcs_sysid.estimate import inside_filter, plausible
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.result import Prior
from gcs_sysid.model import aided, aided_linear, aided_step
from gcs_sysid.model.aided import Row, State
from gcs_sysid.model.kinematics import SIZE, Measurements
from gcs_sysid.offline import aided_flight, modes
from gcs_sysid.reconstruct.measurements import FlightData
from gcs_sysid.reconstruct.reconstruction import Reconstruction
from gcs_sysid.reconstruct.smoother import Smoothed
from gcs_sysid.recording import Recording, Stream, Vehicle
from tests.estimate import made_motion
from tests.model.made_aided import FLYING, NOISE, means, row, state
from tests.offline.conftest import ROOT
from tests.offline.made_aircraft import small

AIRCRAFT = ROOT / "data" / "aircraft"
HOLED = np.array([0.0, 0.02, 0.04, 0.34, 0.36])
SEA_LEVEL = 1.225


def longest(aircraft: Aircraft, states: Reconstruction) -> float:
    return aided_flight.longest_step(aircraft, states.airspeed, states.density)


def straight(time: np.ndarray, speed: float = 20.0) -> Reconstruction:
    """Straight flight north at a speed, wings level."""
    count = time.size
    still = np.zeros((count, 3))
    flow = {"V": np.full(count, speed), "alpha": 0.0 * time, "beta": 0.0 * time}
    flown = replace(
        made_motion.states(time, still, still, flow, lever=np.zeros(3)),
        density=np.full(count, SEA_LEVEL),
    )
    level = np.tile(np.array([1.0, 0.0, 0.0, 0.0]), (count, 1))
    ahead = np.tile(np.array([speed, 0.0, 0.0]), (count, 1))
    force = np.tile(np.array([0.0, 0.0, -9.8]), (count, 1))
    measured = Measurements(
        airspeed=ahead[:, :1],
        velocity=ahead,
        attitude=level,
        vanes=np.zeros((count, 2)),
        valid=np.tile(np.array([True, True, True, False]), (count, 1)),
        age=np.zeros((count, 4)),
    )
    data = FlightData(
        time=time,
        gyro=still + 0.1,
        accelerometer=force,
        has_accelerometer=True,
        measured=measured,
        density=flown.density,
        height=100.0 + 0.0 * time,
        above_home=True,
        used={"airspeed": "VFR_HUD", "velocity": "GLOBAL_POSITION_INT", "attitude": "ATTITUDE"},
        rates={},
    )
    rest = np.zeros((count, SIZE))
    rest[:, 3:6] = ahead
    rows, three = np.zeros((count, 9)), np.zeros((count, 3, 3))
    smoothed = Smoothed(level, rest, rest, still, three, rows, rows, still, rows, rows)
    return Reconstruction(**vars(flown), data=data, smoothed=smoothed, euler=still, wind=still)


def recording(time: np.ndarray, **pulses: np.ndarray) -> Recording:
    """Servo outputs at these times, of a log that begins in the air."""
    streams: dict[str, tuple[np.ndarray, Mapping[str, np.ndarray]]] = {
        "SERVO_OUTPUT_RAW": (time, pulses),
        "VFR_HUD": (time, {"airspeed": np.full(time.size, 20.0)}),
    }
    return Recording(
        "made.tlog", "", Vehicle(1, 1, "MAV_AUTOPILOT_GENERIC", "MAV_TYPE_FIXED_WING", 1), 0,
        {name: Stream(name, at, at, channels) for name, (at, channels) in streams.items()},
    )  # fmt: skip


def rolling(time_constant: float, speed: float = 20.0) -> Aircraft:
    """An aircraft whose roll mode has that time constant [s], with the usual damping."""
    one = small()
    wing = one.geometry
    damping = 0.45 * 0.25 * SEA_LEVEL * speed * wing.wing_area * wing.wing_span**2
    return replace(one, mass=replace(one.mass, Ixx=damping * time_constant))


def test_the_fastest_mode_is_that_of_an_ordinary_aircraft() -> None:
    """Roll mode, or the quicker root of a short period that has two real ones."""
    assert modes.fastest(rolling(0.04), 20.0) == pytest.approx(25.0, rel=1e-9)
    assert modes.fastest(rolling(0.04), 30.0) == pytest.approx(37.5, rel=1e-9)
    # Pitch rate and angle of attack, with so little inertia that the pitch rate follows at once.
    one = rolling(2.0)
    stub = replace(one, mass=replace(one.mass, Iyy=0.01))
    aspect = 2.9**2 / 0.55
    pressed = 0.5 * SEA_LEVEL * 20.0**2 * 0.55
    lift = 2.0 * np.pi * aspect / (aspect + 2.0) * pressed / (11.0 * 20.0)
    damping = 12.0 * pressed * 0.19**2 / (2.0 * 20.0) / 0.01
    stiffness = 0.7 * pressed * 0.19 / 0.01
    roots = np.linalg.eigvals(np.array([[-lift, 1.0], [-stiffness, -damping]]))
    assert modes.fastest(stub, 20.0) == pytest.approx(np.abs(roots).max(), rel=1e-9)
    # Not of the derivatives of the file: without a prior nobody looks at them.
    wild = {name: replace(model, terms={}) for name, model in stub.aerodynamics.items()}
    assert modes.fastest(replace(stub, aerodynamics=wild), 20.0) == modes.fastest(stub, 20.0)


@pytest.mark.parametrize(
    ("rate", "time_constant", "rows"),
    [
        (50.0, 0.04, 1), (50.0, 0.2, 1), (50.0, 0.02, 2),
        (30.0, 0.04, 2), (30.0, 0.2, 1),
        (20.0, 0.04, 2), (20.0, 0.03, 3), (20.0, 0.2, 2),
        (10.0, 0.04, 4), (10.0, 0.2, 3),
    ],
)  # fmt: skip
def test_slow_telemetry_is_stepped_through_as_the_fastest_mode_asks(
    rate: float, time_constant: float, rows: int
) -> None:
    time = np.arange(200) / rate
    step = longest(rolling(time_constant), straight(time))
    kept, every = aided_flight._without_holes(time, step)
    np.testing.assert_array_equal(kept, rows * np.arange(200))
    np.testing.assert_allclose(np.diff(every), 1.0 / (rows * rate), rtol=1e-9)


@pytest.mark.parametrize("file", sorted(path.name for path in AIRCRAFT.glob("*.toml")))
def test_at_50_hz_every_sample_of_the_aircraft_described_here_is_a_row(file: str) -> None:
    """Up to the fastest that they may fly."""
    described = aircraft_file.load(AIRCRAFT / file)
    assert described.envelope is not None
    time = np.arange(100) / 50.0
    states = straight(time, described.envelope.airspeed[1])
    kept, _ = aided_flight._without_holes(time, longest(described, states))
    np.testing.assert_array_equal(kept, np.arange(100))


def test_no_step_is_shorter_than_any_aircraft_asks_for() -> None:
    time = np.arange(50) / 50.0
    assert longest(rolling(1e-4), straight(time)) == aided_flight.SHORTEST_STEP


def test_steps_are_as_short_as_a_fast_mode_asks() -> None:
    """A roll mode of 40 ms at 20 Hz: right to a few thousandths in two steps, not at all in one."""
    time = np.arange(100) / 20.0
    damped = rolling(0.04)
    aerodynamics = {
        name: replace(model, terms={"phat": replace(model.terms["phat"], value=-0.45)})
        for name, model in damped.aerodynamics.items()
        if name == "Cl"
    }
    aircraft = replace(damped, aerodynamics=aerodynamics, propulsion=())
    known = means(aircraft)
    kept, _ = aided_flight._without_holes(time, longest(aircraft, straight(time)))
    begin = state()._replace(
        velocity=jnp.array([20.0, 0.0, 0.0]),
        rate=jnp.array([1.0, 0.0, 0.0]),
        air=jax.tree.map(jnp.zeros_like, state().air),
    )

    @jax.jit
    def ahead(now: State, length: jax.Array) -> State:
        sample = row(0.0)._replace(
            step=length, controls=jnp.zeros((3, 3)), control_slopes=jnp.zeros((3, 3)),
            control_changes=jnp.zeros((3, 3, 0)), density=jnp.asarray(SEA_LEVEL),
        )  # fmt: skip
        return aided.advance(aircraft, known, NOISE, now, sample)

    def left(parts: int) -> float:
        now = begin
        for _ in range(parts):
            now = ahead(now, jnp.asarray(0.05 / parts))
        return float(now.rate[0])

    exact = left(64)
    assert abs(left(int(kept[1])) / exact - 1.0) < 5e-3
    assert abs(left(1) / exact - 1.0) > 0.05


def test_a_hole_is_filled_with_rows_of_the_usual_step() -> None:
    kept, time = aided_flight._without_holes(HOLED, 0.034)
    np.testing.assert_array_equal(kept, [0, 1, 2, 17, 18])
    np.testing.assert_allclose(time[kept], HOLED, atol=1e-15)
    steps = np.diff(time, prepend=time[:1])
    assert steps.sum() == pytest.approx(0.36, abs=1e-15)
    np.testing.assert_allclose(steps[1:], 0.02, atol=1e-15)


def test_the_transition_over_a_hole_is_that_of_the_flight_through_it() -> None:
    """Fifteen rows of 20 ms, one after the other, against differences of the whole way."""
    _, time = aided_flight._without_holes(HOLED, 0.034)
    steps = jnp.asarray(np.diff(time)[2:17])
    known = means(FLYING)

    @jax.jit
    def through(before: State) -> tuple[State, jax.Array]:
        def move(at: tuple[State, jax.Array], length: jax.Array) -> tuple[tuple, None]:
            now, whole = at
            sample = row(0.0)._replace(step=length)
            after = aided.advance(FLYING, known, NOISE, now, sample)
            inner = aided_linear.mechanics(FLYING, known, now, after, sample)
            half = aided_step.half(inner, aided_linear.decay(NOISE), sample)
            return (after, aided_step.whole(half) @ whole), None

        return jax.lax.scan(move, (before, jnp.eye(aided.SIZE)), steps)[0]

    end, found = through(state())

    @jax.jit
    def ends(error: jax.Array) -> jax.Array:
        return aided.difference(through(aided.compose(state(), error))[0], end)

    expected = np.stack(
        [np.asarray(ends(1e-5 * way) - ends(-1e-5 * way)) / 2e-5 for way in jnp.eye(aided.SIZE)],
        axis=1,
    )
    # Each step is right to third order: 2e-3 of the largest entries.
    assert np.abs(np.asarray(found) - expected).max() < 5e-3 * np.abs(expected).max()


TIME = np.concatenate([np.arange(500) / 50.0, 10.3 + np.arange(500) / 50.0])
"""Twenty seconds of telemetry with a hole of 0.3 s."""


def in_hole(pulses: np.ndarray, servo_time: np.ndarray) -> tuple[Row, np.ndarray]:
    """Rows of a flight with a hole, and which of them are in it."""
    held = np.full(servo_time.size, 1500.0)
    record = recording(servo_time, pwm_1=pulses, pwm_2=held, pwm_3=held, pwm_4=held)
    rows = aided_flight.prepare(record, small(), straight(TIME)).rows
    time = TIME[0] + np.cumsum(rows.step)
    return rows, (time > TIME[499] + 1e-6) & (time < TIME[500] - 1e-6)


def test_in_a_hole_nothing_was_measured_and_known_surfaces_are_believed() -> None:
    steady = np.arange(-50, 1100) / 50.0
    rows, inside = in_hole(np.where(steady < 10.1, 1500.0, 1600.0), steady)
    assert np.count_nonzero(inside) == 15
    assert not np.any(rows.inertial[inside])
    assert not np.any(rows.measured.valid[inside])
    np.testing.assert_array_equal(rows.inertial, ~inside)
    np.testing.assert_array_equal(aided_flight.kept_rows(rows), np.flatnonzero(~inside))
    # The servo stream went on: the aileron that moved in the hole is where it was told to be.
    assert np.all(rows.modelled)
    moved = np.asarray(rows.controls)[inside, 2, 0]
    assert moved[0] == pytest.approx(0.0, abs=1e-12)
    assert moved[-1] == pytest.approx(0.1, abs=1e-12)
    absent = np.asarray(aided_linear.present_rows(jax.tree.map(lambda part: part[505], rows)))
    assert not absent.any()


def test_in_a_hole_surfaces_that_moved_unseen_are_not_believed() -> None:
    silent = np.arange(-50, 1100) / 50.0
    silent = silent[(silent <= TIME[499]) | (silent >= TIME[500])]
    rows, inside = in_hole(np.where(silent < 10.1, 1500.0, 1600.0), silent)
    assert not np.any(rows.modelled[inside])
    assert np.all(rows.modelled[:500])
    assert np.all(rows.modelled[-400:])
    # Where the command is the same afterwards, it was the same all along.
    rows, _ = in_hole(np.full(silent.size, 1500.0), silent)
    assert np.all(rows.modelled)


USED = {
    "airspeed": "VFR_HUD", "velocity": "GLOBAL_POSITION_INT", "attitude": "ATTITUDE",
    "vanes": "AOA_SSA",
}  # fmt: skip
STATED = replace(
    FLYING,
    imu=Imu(accelerometer=SensorError(bias_sigma=0.02), gyro=SensorError(bias_sigma=0.003)),
    pitot=Pitot(error=SensorError(lag=0.1, lag_sigma=0.04, scale_sigma=0.005)),
    vanes=Vanes(
        alpha=SensorError(bias_sigma=0.01, scale_sigma=0.02),
        beta=SensorError(bias_sigma=0.015, scale_sigma=0.04),
    ),
    streams={
        "SERVO_OUTPUT_RAW": StreamTiming(0.02, 0.011),
        "VFR_HUD": StreamTiming(0.1, 0.07),
        "GLOBAL_POSITION_INT": StreamTiming(0.2, 0.03),
        "ATTITUDE": StreamTiming(0.0, 0.006),
        "AOA_SSA": StreamTiming(0.0, 0.002),
    },
)
START = Unknowns(means(FLYING), jax.tree.map(jnp.log, NOISE))
KNOWN = {name: {key: 0.5 for key in terms} for name, terms in START.means.aerodynamics.items()}


def deviations(aircraft: Aircraft, *, vanes: bool = True) -> Unknowns:
    return aided_flight.beliefs(START, aircraft, used=USED, vanes=vanes, known=KNOWN)[1]


def test_sensors_are_believed_as_the_file_says() -> None:
    """What the kinematic reconstruction took from the file was replaced by the usual inside."""
    sensors = deviations(STATED).means.sensors
    stated = {
        "gyro_bias": [0.003] * 3,
        "accelerometer_bias": [0.02] * 3,
        "airspeed_scale": 0.005,
        "airspeed_lag": 0.04,
        "vane_bias": [0.01, 0.015],
        "vane_scale": [0.02, 0.04],
        "surface_delay": 0.011,
        "airspeed_delay": 0.07,
        "velocity_delay": 0.03,
        "attitude_delay": 0.006,
        "vane_delay": 0.002,
    }
    for name, value in stated.items():
        np.testing.assert_allclose(getattr(sensors, name), value, err_msg=name)
    assert set(sensors._fields) - set(stated) == {"moment_lag", "attitude_tilt"}


def test_sensors_of_which_the_file_says_nothing_are_believed_as_usual() -> None:
    sensors = deviations(replace(FLYING, vanes=Vanes())).means.sensors
    assert all(np.all(part > 0.0) for part in sensors)
    assert sensors.airspeed_scale == 0.03
    assert sensors.airspeed_lag == aided_flight.AIRSPEED_LAG
    assert sensors.surface_delay == 0.1


def test_what_the_file_knows_exactly_is_held() -> None:
    """A stated deviation of 0 had counted as none stated."""
    exact = replace(
        STATED,
        pitot=Pitot(error=SensorError(lag_sigma=0.0, scale_sigma=0.0)),
        streams={"SERVO_OUTPUT_RAW": StreamTiming(0.02, 0.0)},
    )
    sensors = deviations(exact).means.sensors
    assert sensors.airspeed_scale == sensors.airspeed_lag == sensors.surface_delay == 0.0


def test_absent_vanes_are_held() -> None:
    found = deviations(STATED, vanes=False)
    sensors = found.means.sensors
    for name in ("vane_bias", "vane_scale", "vane_delay"):
        np.testing.assert_array_equal(getattr(sensors, name), 0.0)
    assert found.log_noise.vanes == 0.0
    assert deviations(STATED).log_noise.vanes > 0.0
    others = [name for name in sensors._fields if not name.startswith("vane")]
    assert all(np.all(getattr(sensors, name) > 0.0) for name in others)


def test_derivatives_are_believed_as_the_prior_says_and_else_as_is_plausible() -> None:
    structure = {name: tuple(model.terms) for name, model in FLYING.aerodynamics.items()}
    file = {
        name: Prior(
            {key: term.value for key, term in model.terms.items()},
            {key: term.sigma for key, term in model.terms.items()},
        )
        for name, model in FLYING.aerodynamics.items()
    }
    mean, sigma = inside_filter.beliefs(structure, file, FLYING)
    for name, model in FLYING.aerodynamics.items():
        assert mean[name] == {key: term.value for key, term in model.terms.items()}
        assert sigma[name] == {key: term.sigma for key, term in model.terms.items()}
    without, wide = inside_filter.beliefs(structure, None, FLYING)
    assert all(value == 0.0 for terms in without.values() for value in terms.values())
    assert wide["Cm"]["elevator"] == plausible.sizes("Cm", ["elevator"], ["elevator"])[0]
    assert wide["CZ"]["1"] == inside_filter.CONSTANT_SIZE
