"""The hold of an autopilot as a flight shows it: what its commands answered to.

    δ(t) = δ₀ − K·x(t)        x: rate and attitude, late as the servos are

For a few seconds of straight flight targets and trim go along lines, which are taken out. Test
inputs are added to what a hold commands: where they are flown nothing like this holds, so that K is
what two fifths of a flight's windows agree on best (Fischler & Bolles, *Random sample consensus*,
1981), and what does not agree with these does not count. Deflections go by 1/q̄, as autopilots
scale them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import signal

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.maneuvers.axes import Axes
from gcs_sysid.maneuvers.holding import PERIOD, Linear
from gcs_sysid.model.trim import Trim

TURNED = ("p", "q", "r", "phi", "theta", "psi")
"""What a hold answers to: rates, roll, pitch and heading, the last six of `Linear`'s deviations."""
LONGITUDINAL, LATERAL = ("q", "theta"), ("p", "r", "phi", "psi")
"""Of these, what controls of pitch and of roll and yaw answer to."""
HELD = {"pitch": ("q", "theta"), "roll": ("p", "phi"), "yaw": ("r",)}
"""What the control of an axis holds: what pushes away from that is no hold. Under test inputs all
through a flight controls and motion go together as well, by what the aircraft answers: an aileron
with the roll rate that it makes."""
WINDOW = 2.5
"""Length of a window [s]: some periods of what is held, and short beside an autopilot's targets."""
STRAIGHT, TURNING = 0.25, 0.5
"""Bank, and change of heading within a window, up to which a flight is straight [rad]."""
DRAWS, OF = 300, 3
"""Sets of windows that are tried, and windows of each."""
AGREEING = 0.4
"""Share of the windows that should agree. The rest may have test inputs in them."""
FAR = 4.0
"""Squared error of a window over that of those which agree, from which on it does not."""
LEAST = 8
"""Windows that must agree."""
EXPLAINED = 0.8
"""Share of a control's variance that its hold must explain: what else moves it, targets of height
and speed above all, nobody tells."""


class Flight(NamedTuple):
    """One flight's motion as it was reconstructed, at even steps but for gaps.

    Attributes:
        time: [s].
        pressure: dynamic [Pa].
        controls: deflections as the air feels them, by name [rad].
        turned: rates and attitude, in the order of `TURNED`.
    """

    time: Float[np.ndarray, " sample"]
    pressure: Float[np.ndarray, " sample"]
    controls: Mapping[str, Float[np.ndarray, " sample"]]
    turned: Float[np.ndarray, "sample six"]


class Answer(NamedTuple):
    """What a control answered to.

    Attributes:
        axis: that it holds.
        gain: deflection less, by what is `TURNED`, at `FlownHold.pressure`.
        deviation: one standard deviation of each; those that are no part of it have none.
        explained: share of the control's variance in the windows that agree.
        windows: how many these are.
    """

    axis: str
    gain: Float[np.ndarray, " six"]
    deviation: Float[np.ndarray, " six"]
    explained: float
    windows: int

    @property
    def told(self) -> bool:
        """Whether it is known what the control answers to."""
        return self.windows >= LEAST and self.explained >= EXPLAINED


@dataclass(frozen=True)
class FlownHold:
    """The hold that an autopilot flew with.

    Attributes:
        pressure: dynamic pressure for which the gains are told [Pa].
        answers: by control, of those that hold an axis and were moved in straight flight.
    """

    pressure: float
    answers: Mapping[str, Answer]

    def on(self, linear: Linear, trim: Trim, controls: Sequence[str]) -> Linear:
        """Small motions with this hold, where it is known, in place of the one that is assumed.

        An autopilot that integrates the error of the pitch rate is known with it: over seconds that
        integral is the pitch angle, to which the elevator then answered so much more.

        Args:
            linear: with the hold that is assumed.
            trim: about which it is linear.
            controls: of the aircraft, in file order.
        """
        gain, unwinding = linear.gain.copy(), linear.unwinding
        pressure = 0.5 * trim.density * trim.airspeed**2
        for name, one in self.flies(linear, controls).items():
            gain[controls.index(name), 3:] = self.pressure / pressure * one.gain
            if one.axis == "pitch":
                unwinding = np.zeros_like(unwinding)
        return replace(linear, gain=gain, unwinding=unwinding)

    def flies(self, linear: Linear, controls: Sequence[str]) -> dict[str, Answer]:
        """Controls whose hold is known, and pushes back what it holds as the assumed one does."""
        found = {}
        for name, one in self.answers.items():
            held = [TURNED.index(which) for which in HELD[one.axis]]
            assumed = linear.gain[controls.index(name)][3:][held]
            pushes = np.sign(assumed) * one.gain[held]
            # Of rates, as far as is known: next to none is common.
            if one.told and pushes[-1] > 0.0 and np.all(pushes > -2.0 * one.deviation[held]):
                found[name] = one
        return found


def found(aircraft: Aircraft, axes: Axes, flights: Sequence[Flight]) -> FlownHold | None:
    """What the controls of an aircraft answered to; None where no straight flight tells.

    Args:
        aircraft: its servos.
        axes: which control holds which.
        flights: reconstructed.
    """
    pressure = float(np.median(np.concatenate([one.pressure for one in flights])))
    answers = {}
    for axis, names in (("pitch", LONGITUDINAL), ("roll", LATERAL), ("yaw", LATERAL)):
        control = getattr(axes, axis)
        if control is None or control in answers:
            continue
        pieces = [
            piece for one in flights for piece in _windows(aircraft, control, names, one, pressure)
        ]
        if len(pieces) >= LEAST and any(moved.any() for _, moved in pieces):
            answers[control] = _agreed(axis, names, pieces)
    return FlownHold(pressure, answers) if answers else None


def _windows(
    aircraft: Aircraft, control: str, names: Sequence[str], one: Flight, pressure: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """What a control should answer to, and the control, in windows of straight flight."""
    if one.time.size < 2:
        return []
    step = float(np.median(np.diff(one.time)))
    count = round(WINDOW / step)
    turned = one.turned.copy()
    turned[:, 5] = np.unwrap(turned[:, 5])
    places = [TURNED.index(name) for name in names]
    felt = _late(aircraft, control, one.time, turned[:, places])
    moved = one.controls[control] * one.pressure / pressure
    # A mean and a line: trim and targets.
    lines, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), 2))
    out = []
    for first in range(0, one.time.size - count, count // 2):
        rows = slice(first, first + count)
        gapless = one.time[rows][-1] - one.time[first] < WINDOW + step
        bank, heading = turned[rows, 3], turned[rows, 5]
        if gapless and np.abs(bank).max() < STRAIGHT and np.ptp(heading) < TURNING:
            parts = felt[rows], moved[rows]
            out.append(tuple(part - lines @ (lines.T @ part) for part in parts))
    return out


def _late(
    aircraft: Aircraft, control: str, time: Float[np.ndarray, " sample"], values: np.ndarray
) -> np.ndarray:
    """Values as a control's servos follow them: mean delay and lag of those that move it.

    And half a period of the autopilot's loop later, for which a command is held on average.
    """
    mix = next(item.mix for item in aircraft.controls if item.name == control)
    servos = [servo for servo in aircraft.servos if mix.get(servo.surface)]
    delay = float(np.mean([servo.delay for servo in servos])) + 0.5 * PERIOD
    lag = float(np.mean([servo.time_constant for servo in servos]))
    asked = np.stack([np.interp(time - delay, time, column) for column in values.T], axis=1)
    if lag == 0.0:
        return asked
    share = 1.0 - np.exp(-float(np.median(np.diff(time))) / lag)
    first = asked[:1]
    return signal.lfilter([0.5 * share, 0.5 * share], [1.0, share - 1.0], asked - first, 0) + first


def _agreed(
    axis: str, names: Sequence[str], pieces: Sequence[tuple[np.ndarray, np.ndarray]]
) -> Answer:
    """The gains on which `AGREEING` of the windows agree best, by least squares over all such."""
    squares = np.stack([felt.T @ felt for felt, _ in pieces])
    products = np.stack([felt.T @ moved for felt, moved in pieces])
    powers = np.array([moved @ moved for _, moved in pieces])

    def errors(slope: Float[np.ndarray, " name"]) -> Float[np.ndarray, " window"]:
        return powers - 2.0 * products @ slope + np.einsum("i,wij,j->w", slope, squares, slope)

    def fitted(chosen: np.ndarray) -> Float[np.ndarray, " name"]:
        return np.linalg.lstsq(squares[chosen].sum(axis=0), products[chosen].sum(axis=0))[0]

    # Always the same draws: a suggestion can be repeated.
    generator = np.random.default_rng(0)
    drawn = (generator.choice(len(pieces), OF, replace=False) for _ in range(DRAWS))
    slope = min(map(fitted, drawn), key=lambda one: np.quantile(errors(one), AGREEING))
    for _ in range(20):
        each = errors(slope)
        agreeing = each <= FAR * np.quantile(each, AGREEING)
        slope = fitted(agreeing)
    each = errors(slope)[agreeing]
    gain, deviation = np.zeros(len(TURNED)), np.zeros(len(TURNED))
    places = [TURNED.index(name) for name in names]
    gain[places] = -slope
    # Of windows, each as a whole: what is left goes on within one. Half of each lies in the next.
    left = products[agreeing] - squares[agreeing] @ slope
    inverse = np.linalg.pinv(squares[agreeing].sum(axis=0))
    variance = np.diagonal(inverse @ (left.T @ left) @ inverse)
    deviation[places] = np.sqrt(2.0 * np.maximum(variance, 0.0))
    explained = 1.0 - float(each.sum() / powers[agreeing].sum())
    return Answer(axis, gain, deviation, explained, int(agreeing.sum()))
