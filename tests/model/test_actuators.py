from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from scipy.integrate import solve_ivp

from gcs_sysid.aircraft import Aircraft, Control, Geometry, Mass, Servo
from gcs_sysid.errors import UsageError
from gcs_sysid.model import actuators

RATE = 2.0
BACKLASH = 0.08


def random_commands(seed: int, count: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Commands [rad] at uneven times [s], steps of up to 0.5 rad every 5 to 60 ms."""
    rng = np.random.default_rng(seed)
    time = 100.0 + np.cumsum(rng.uniform(0.005, 0.06, count))
    return rng.uniform(-0.5, 0.5, count), time


def integrate(
    command: np.ndarray,
    time: np.ndarray,
    at: np.ndarray,
    slope: Callable[[float, float], float],
    delay: float,
) -> np.ndarray:
    """Second implementation: an adaptive integrator, restarted at every change of the command."""
    instants = np.unique(np.concatenate([time + delay, at]))
    deflection = command[0]
    found = {}
    for start, end in zip(instants, np.append(instants[1:], instants[-1]), strict=True):
        found[start] = deflection
        held = command[max(np.searchsorted(time + delay, start, side="right") - 1, 0)]
        if start >= time[0] + delay and end > start:
            solved = solve_ivp(
                lambda _, x, held=held: [slope(x[0], held)],
                (start, end),
                [deflection],
                rtol=1e-10,
                atol=1e-12,
                max_step=0.002,
            )
            deflection = solved.y[0, -1]
    return np.array([found[instant] for instant in at])


@pytest.mark.parametrize("delay", [0.0, 0.0123, -0.007])
def test_step_follows_the_closed_form(delay: float) -> None:
    time = np.array([0.0, 1.0, 1.02])
    command = np.array([0.1, 0.5, 0.5])
    at = np.linspace(0.5, 2.0, 301)
    found = actuators.response(command, time, at, time_constant=0.05, delay=delay)
    since = np.maximum(at - 1.0 - delay, 0.0)
    expected = 0.5 - 0.4 * np.exp(-since / 0.05)
    # Rounding of float64 alone: nothing is integrated.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-14)


def test_linear_lag_equals_scipy_with_zero_order_hold() -> None:
    step, time_constant = 0.02, 0.045
    command, _ = random_commands(1, 200)
    time = step * np.arange(200)
    _, expected, _ = signal.lsim(
        ([1.0], [time_constant, 1.0]), command - command[0], time, interp=False
    )
    found = actuators.response(command, time, time, time_constant=time_constant)
    np.testing.assert_allclose(found, expected + command[0], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("delay", [0.0, 0.0371])
@pytest.mark.parametrize("time_constant", [0.0, 0.05])
def test_rate_limit_equals_an_integrator(seed: int, delay: float, time_constant: float) -> None:
    command, time = random_commands(seed)
    at = np.sort(np.random.default_rng(seed).uniform(time[0], time[-1], 25))

    def slope(deflection: float, held: float) -> float:
        return float(np.clip((held - deflection) / time_constant, -RATE, RATE))

    if time_constant:
        expected = integrate(command, time, at, slope, delay)
    else:
        expected = walk(command, time, at, delay)
    found = actuators.response(
        command, time, at, time_constant=time_constant, delay=delay, rate_limit=RATE
    )
    # The integrator's step of 2 ms across the corner of the limit.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7)


def walk(command: np.ndarray, time: np.ndarray, at: np.ndarray, delay: float) -> np.ndarray:
    """A servo without lag moves at full rate until it has arrived."""
    found = []
    for instant in at:
        deflection = command[0]
        for start, end, held in zip(
            time + delay, np.append(time[1:] + delay, np.inf), command, strict=True
        ):
            reach = RATE * max(min(end, instant) - start, 0.0)
            deflection += np.clip(held - deflection, -reach, reach)
        found.append(deflection)
    return np.array(found)


def test_backlash_equals_a_fine_simulation() -> None:
    command, time = random_commands(4)
    at = time[0] + 1e-4 * np.arange(int((time[-1] - time[0]) / 1e-4))
    servo = np.asarray(actuators.response(command, time, at, time_constant=0.03))
    output, expected = servo[0], []
    for position in servo:
        if position - output > BACKLASH / 2:
            output = position - BACKLASH / 2
        elif output - position > BACKLASH / 2:
            output = position + BACKLASH / 2
        expected.append(output)
    found = actuators.response(command, time, at, time_constant=0.03, backlash=BACKLASH)
    # The simulation sees the turning points to a step of 0.1 ms: 1.0 rad / 0.03 s · 0.1 ms.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=4e-3)
    assert np.max(np.abs(np.asarray(found) - servo)) == pytest.approx(BACKLASH / 2, rel=1e-12)


def test_backlash_is_exact_where_the_servo_turns_at_a_command() -> None:
    """Without a lag the play's state is known at each command by hand."""
    command = np.array([0.0, 0.10, 0.07, 0.20, 0.20, 0.05])
    time = np.arange(6.0)
    found = actuators.response(command, time, time + 0.5, time_constant=0.0, backlash=BACKLASH)
    np.testing.assert_allclose(found, [0.0, 0.06, 0.06, 0.16, 0.16, 0.09], atol=1e-15)


@given(st.integers(0, 2**31), st.floats(-0.2, 0.2), st.sampled_from([None, RATE]))
@settings(deadline=None, max_examples=25)
def test_a_delay_is_a_shift_of_the_commands(seed: int, delay: float, rate: float | None) -> None:
    command, time = random_commands(seed)
    at = np.linspace(time[0] - 0.3, time[-1] + 0.3, 50)
    kind = {"time_constant": 0.04, "rate_limit": rate, "backlash": 0.01}
    found = actuators.response(command, time, at, delay=delay, **kind)
    shifted = actuators.response(command, time + delay, at, **kind)
    # Times near 100 s carry 1.4e-14 s, and the servo moves at up to 25 rad/s.
    np.testing.assert_allclose(found, shifted, rtol=0.0, atol=1e-12)


@given(st.integers(0, 2**31), st.floats(0.0, 0.2), st.floats(0.5, 20.0), st.floats(1e-3, 0.1))
@settings(deadline=None, max_examples=25)
def test_answers_stay_within_commands_and_rate(
    seed: int, time_constant: float, rate: float, backlash: float
) -> None:
    command, time = random_commands(seed)
    at = np.linspace(time[0], time[-1], 400)
    found = np.asarray(
        actuators.response(
            command, time, at, time_constant=time_constant, rate_limit=rate, backlash=backlash
        )
    )
    assert found.min() >= command.min() - 1e-12
    assert found.max() <= command.max() + 1e-12
    assert np.max(np.abs(np.diff(found))) <= rate * (at[1] - at[0]) * (1 + 1e-9) + 1e-12


@pytest.mark.parametrize("argument", ["time_constant", "delay", "rate_limit", "backlash"])
def test_gradients_equal_finite_differences(argument: str) -> None:
    command, time = random_commands(5)
    # Away from the instants of the commands, where the derivative jumps.
    at = 0.5 * (time[1:] + time[:-1]) + 0.0131
    point = {"time_constant": 0.05, "delay": 0.0131, "rate_limit": 3.0, "backlash": 0.02}

    def answer(value: jax.Array) -> jax.Array:
        return actuators.response(command, time, at, **(point | {argument: value}))

    step = 1e-7
    forward = jax.jvp(answer, (jnp.asarray(point[argument]),), (jnp.asarray(1.0),))[1]
    numeric = (answer(point[argument] + step) - answer(point[argument] - step)) / (2.0 * step)
    assert np.max(np.abs(forward)) > 1e-3
    # Central differences: rounding 1e-16 / 1e-7 and the step squared times 1/τ³.
    np.testing.assert_allclose(forward, numeric, rtol=1e-6, atol=1e-7)
    weight = jnp.linspace(-1.0, 1.0, at.size)
    backward = jax.grad(lambda v: jnp.sum(weight * answer(v)))(jnp.asarray(point[argument]))
    assert backward == pytest.approx(float(jnp.sum(weight * forward)), rel=1e-10)


@pytest.mark.parametrize("rate", [None, RATE])
def test_gradients_are_finite_without_a_lag(rate: float | None) -> None:
    command, time = random_commands(6)

    def total(time_constant: jax.Array, delay: jax.Array) -> jax.Array:
        return jnp.sum(
            actuators.response(
                command, time, time, time_constant=time_constant, delay=delay, rate_limit=rate
            )
        )

    slopes = jax.grad(total, argnums=(0, 1))(jnp.asarray(0.0), jnp.asarray(0.01))
    assert np.all(np.isfinite(slopes))


def test_one_compilation_serves_every_delay() -> None:
    command, time = random_commands(7)
    traces = []

    @jax.jit
    def answer(delay: jax.Array) -> jax.Array:
        traces.append(delay)
        return actuators.surface(SERVO, 1500.0 + 500.0 * command, time, extra_delay=delay)

    late = [answer(jnp.asarray(delay)) for delay in (-0.03, 0.0, 0.017)]
    assert len(traces) == 1
    assert late[0].dtype == jnp.float64
    assert not np.allclose(late[0], late[2])


SERVO = Servo(
    channel=2,
    surface="elevator",
    pwm=(1000.0, 1400.0, 2000.0),
    deflection=(0.4, 0.0, -0.3),
    time_constant=0.05,
    delay=0.02,
    effectiveness=0.8,
    offset=0.05,
)


def test_surface_is_calibrated_and_rests_at_its_first_command() -> None:
    pwm = np.array([900.0, 900.0, 1200.0, 1200.0, 2100.0])
    time = np.array([0.0, 10.0, 20.0, 30.0, 40.0])
    at = np.array([-5.0, 9.0, 29.0, 49.0])
    found = actuators.surface(SERVO, pwm, time, at=at)
    calibrated = np.interp([900.0, 900.0, 1200.0, 2100.0], SERVO.pwm, SERVO.deflection)
    # Nine seconds after a step, e⁻¹⁸⁰ of it is left.
    np.testing.assert_allclose(found, 0.8 * calibrated + 0.05, rtol=1e-14)


def test_surface_passes_on_every_property_of_the_servo() -> None:
    command, time = random_commands(8)
    servo = Servo(
        **(vars(SERVO) | {"rate_limit": 1.5, "backlash": 0.03, "effectiveness": 1.0, "offset": 0.0})
    )
    found = actuators.surface(servo, 1500.0 + 400.0 * command, time, extra_delay=0.011)
    asked = np.interp(1500.0 + 400.0 * command, servo.pwm, servo.deflection)
    expected = actuators.response(
        asked, time, time, time_constant=0.05, delay=0.031, rate_limit=1.5, backlash=0.03
    )
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


def split_aileron(**changes: Servo) -> Aircraft:
    servos = {
        "right": Servo(1, "right", (1000.0, 2000.0), (-0.4, 0.4), time_constant=0.03),
        "left": Servo(5, "left", (1000.0, 2000.0), (-0.3, 0.3), time_constant=0.06),
        "spare": Servo(9, "spare", (1000.0, 2000.0), (-0.3, 0.3)),
    }
    return Aircraft(
        name="test",
        mass=Mass(1.0, 1.0, 1.0, 1.0),
        geometry=Geometry(1.0, 1.0, 1.0),
        servos=tuple((servos | changes).values()),
        controls=(
            Control("aileron", {"left": 0.5, "right": -0.5}),
            Control("flap", {"left": 1.0, "right": 1.0}),
        ),
    )


def test_controls_mix_the_surfaces() -> None:
    aircraft = split_aileron()
    command, time = random_commands(9)
    pwm = {1: 1500.0 + 300.0 * command, 5: 1500.0 - 500.0 * command}
    at = np.linspace(time[0], time[-1], 33)
    right, left = (
        np.asarray(actuators.surface(aircraft.servos[i], pwm[c], time, at=at, extra_delay=0.01))
        for i, c in ((0, 1), (1, 5))
    )
    found = actuators.controls(aircraft, pwm, time, at=at, extra_delay=0.01)
    assert list(found) == ["aileron", "flap"]
    np.testing.assert_allclose(found["aileron"], 0.5 * (left - right), atol=1e-16)
    np.testing.assert_allclose(found["flap"], left + right, atol=1e-16)


def test_missing_channel_is_named() -> None:
    with pytest.raises(UsageError, match="channels 5, given: 1; log SERVO_OUTPUT_RAW"):
        actuators.controls(split_aileron(), {1: np.array([1500.0])}, np.array([0.0]))
