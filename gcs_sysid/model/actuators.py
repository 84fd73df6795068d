"""From the pulses an autopilot sends to the deflections the air sees.

A reported command holds until the next one. Between two commands a first-order lag, a rate limit
and backlash all have closed solutions, and none of them cares when it happens, so that the
deflection is exact at any time and for any delay, not only multiples of the sample interval:

    δ̇ = clip((c(t - delay) - δ)/τ, ±rate_limit)        backlash follows δ at half its width

Before the first command the surface rests where that command puts it.
"""

from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from gcs_sysid.aircraft import Aircraft, Servo
from gcs_sysid.errors import UsageError
from gcs_sysid.model import tables


@jax.jit
def response(
    command: Float[ArrayLike, " sample"],
    time: Float[ArrayLike, " sample"],
    at: Float[ArrayLike, " grid"],
    *,
    time_constant: Float[ArrayLike, ""],
    delay: Float[ArrayLike, ""] = 0.0,
    rate_limit: Float[ArrayLike, ""] | None = None,
    backlash: Float[ArrayLike, ""] | None = None,
) -> Float[Array, " grid"]:
    """Answer of a servo to commands that hold until the next one.

    Differentiable in every argument but at the instants of the commands, where it has kinks.

    Args:
        command: what is asked for, finite [rad, or any unit].
        time: when each command is given, not decreasing [s].
        at: when the answer is wanted, in any order [s].
        time_constant: of the first-order lag; 0 follows at once [s].
        delay: after which a command acts; negative looks ahead [s].
        rate_limit: fastest motion [command's unit per s]; None for no limit.
        backlash: full width of the play behind the servo [command's unit]; None for no play.

    Returns:
        Deflection at each of `at`, in the command's unit.
    """
    command, time, at = jnp.asarray(command), jnp.asarray(time), jnp.asarray(at)

    def hold(
        state: tuple[Float[Array, ""], Float[Array, ""]],
        held: tuple[Float[Array, ""], Float[Array, ""]],
    ) -> tuple[
        tuple[Float[Array, ""], Float[Array, ""]], tuple[Float[Array, ""], Float[Array, ""]]
    ]:
        servo, output = state
        servo = _advance(servo, *held, time_constant, rate_limit)
        return (servo, _play(output, servo, backlash)), state

    start = (command[0], command[0])
    _, (servo, output) = jax.lax.scan(hold, start, (command, jnp.diff(time, append=time[-1:])))
    asked = at - delay
    last = jnp.maximum(jnp.searchsorted(time, asked, side="right") - 1, 0)
    since = jnp.maximum(asked - time[last], 0.0)
    moved = _advance(servo[last], command[last], since, time_constant, rate_limit)
    return _play(output[last], moved, backlash)


def surface(
    servo: Servo,
    pwm: Float[ArrayLike, " sample"],
    time: Float[ArrayLike, " sample"],
    *,
    at: Float[ArrayLike, " grid"] | None = None,
    extra_delay: Float[ArrayLike, ""] = 0.0,
) -> Float[Array, " grid"]:
    """Deflection of one surface as the air sees it.

    Args:
        servo: calibration, effectiveness, offset and dynamics.
        pwm: pulses, finite [µs].
        time: of the pulses, not decreasing [s].
        at: when the deflection is wanted [s]; by default at `time`.
        extra_delay: beside the servo's own, for instance of the telemetry stream; may be negative
            and may be traced [s].

    Returns:
        Deflection [rad] at each of `at`.
    """
    calibrated = tables.linear(pwm, jnp.asarray(servo.pwm), jnp.asarray(servo.deflection))
    return response(
        servo.effectiveness * calibrated + servo.offset,
        time,
        time if at is None else at,
        time_constant=servo.time_constant,
        delay=servo.delay + extra_delay,
        rate_limit=servo.rate_limit,
        backlash=servo.backlash or None,
    )


def controls(
    aircraft: Aircraft,
    pwm: Mapping[int, Float[ArrayLike, " sample"]],
    time: Float[ArrayLike, " sample"],
    *,
    at: Float[ArrayLike, " grid"] | None = None,
    extra_delay: Float[ArrayLike, ""] = 0.0,
) -> dict[str, Float[Array, " grid"]]:
    """What the aerodynamics are a function of: the surfaces' deflections, mixed.

    Args:
        aircraft: its servos and controls.
        pwm: pulses by output channel, finite [µs].
        time: of the pulses, not decreasing [s].
        at: when the controls are wanted [s]; by default at `time`.
        extra_delay: see `surface` [s].

    Returns:
        Each control [rad] at each of `at`, in the aircraft's order.

    Raises:
        UsageError: a channel that a control needs is not in `pwm`.
    """
    used = {name for control in aircraft.controls for name in control.mix}
    servos = [servo for servo in aircraft.servos if servo.surface in used]
    missing = [servo.channel for servo in servos if servo.channel not in pwm]
    if missing:
        raise UsageError(
            f"the controls need the output channels {', '.join(map(str, missing))}, given: "
            f"{', '.join(map(str, pwm)) or 'none'}; log SERVO_OUTPUT_RAW with all channels, "
            "or correct `channel` in [[servos]]"
        )
    deflections = {
        servo.surface: surface(servo, pwm[servo.channel], time, at=at, extra_delay=extra_delay)
        for servo in servos
    }
    return {
        control.name: sum(
            (gain * deflections[name] for name, gain in control.mix.items()),
            start=jnp.zeros(()),
        )
        for control in aircraft.controls
    }


def _advance(
    deflection: Float[Array, "*sample"],
    command: Float[Array, "*sample"],
    duration: Float[Array, "*sample"],
    time_constant: Float[ArrayLike, ""],
    rate_limit: Float[ArrayLike, ""] | None,
) -> Float[Array, "*sample"]:
    """The servo `duration` after `deflection`, while `command` holds.

    Without a limit the error decays exponentially. With one it shrinks linearly until it is
    rate_limit·time_constant, then exponentially.
    """
    error = deflection - command
    if rate_limit is None:
        return command + error * _decay(duration, time_constant, instantly=0.0)
    excess = jnp.abs(error) - rate_limit * time_constant
    limited = jnp.minimum(duration, jnp.maximum(excess, 0.0) / rate_limit)
    left = jnp.sign(error) * (jnp.abs(error) - rate_limit * limited)
    # Without a lag the linear part alone brings the error to zero.
    return command + left * _decay(duration - limited, time_constant, instantly=1.0)


def _decay(
    duration: Float[Array, "*sample"], time_constant: Float[ArrayLike, ""], *, instantly: float
) -> Float[Array, "*sample"]:
    """What the lag leaves of an error; `instantly` where there is no lag."""
    lagging = jnp.asarray(time_constant) > 0.0
    # The inner choice keeps 0/0 out of the gradient of the branch that is not taken.
    return jnp.where(
        lagging, jnp.exp(-duration / jnp.where(lagging, time_constant, 1.0)), instantly
    )


def _play(
    output: Float[Array, "*sample"],
    servo: Float[Array, "*sample"],
    backlash: Float[ArrayLike, ""] | None,
) -> Float[Array, "*sample"]:
    """The surface stays until the servo takes it along at either end of the play."""
    if backlash is None:
        return servo
    half = 0.5 * backlash
    return jnp.clip(output, servo - half, servo + half)
