"""Every maneuver that is considered at one flight condition: inputs of full size, not yet tried."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.atmosphere import GRAVITY
from gcs_sysid.maneuvers import axes, sizes
from gcs_sysid.maneuvers.axes import THROTTLE, Axes
from gcs_sysid.maneuvers.flown import STEP
from gcs_sysid.maneuvers.holding import SIZE, Frequencies, Linear
from gcs_sysid.maneuvers.signals import multisine, smooth, steps, sweep
from gcs_sysid.model.trim import Trim

Kind = Literal[
    "multisine",
    "multistep",
    "two-one-one",
    "doublet",
    "sweep",
    "push-over pull-up",
    "roller-coaster",
    "wind-up turn",
    "steady-heading sideslip",
    "throttle steps",
    "glide",
    "deceleration",
    "coupled rolls",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
TURNS: tuple[Kind, ...] = ("wind-up turn", "coupled rolls")
"""Flown with the attitude held and no heading."""

PERIOD = 15.0
"""Length of a multisine [s]."""
SWEEP = 20.0
"""Length of a sweep [s]."""
SLOW = 0.2
"""First line of a multisine and first frequency of a sweep [Hz]."""
BEYOND = 1.5
"""Their last, over the motion's natural frequency."""
SAMPLED = 2.0
"""And never faster [Hz]: an inertial unit at 50 Hz gives 25 samples a period there (Klein &
Morelli, *Aircraft System Identification*, 2006, section 9.1)."""
SLOWEST = 2
"""Lines of a multisine on an input that is slower than those beside it."""
PULSE = 1.6
"""Length of the shortest step of a 3-2-1-1 or 2-1-1, over 1/ω (Hamel & Jategaonkar 1996)."""
HALF = 2.3
"""Length of each half of a doublet, over 1/ω."""
WAIT = 2.0
"""Between pulses on one control and on the next [s]."""
SLOWLY = 10.0
"""Length of each half of a push-over and pull-up, over 1/ω: slow enough to be a steady state."""
BANK = 0.6
"""Bank of turns and rolls, over the largest allowed."""
TURNING = 3.0
"""Pull of a turn over that of level flight: banked, most of it turns and little of it climbs."""
FIRST_RISE = np.radians(5.0)
"""Size of plateau for which a rate-limited servo's edges are planned [rad]."""

ALONG = ("CX", "CZ", "Cm")
ACROSS = ("CY", "Cl", "Cn")


@dataclass(frozen=True)
class Recipe:
    """One input of full size: what is flown is a share of it.

    Attributes:
        name: unique at one condition.
        kind: of shape.
        coefficients: that it excites.
        moved: inputs that it moves.
        duration: of the input [s].
        added: to each control [rad] and last to the throttle, every `STEP`.
        how: in words, for the card.
        fastest: highest frequency of a sweep [Hz]; 0 for others.
    """

    name: str
    kind: Kind
    coefficients: tuple[str, ...]
    moved: tuple[str, ...]
    duration: float
    added: Float[np.ndarray, "sample input"]
    how: str
    fastest: float = 0.0


@dataclass(frozen=True)
class Place:
    """What recipes at one flight condition are made from."""

    aircraft: Aircraft
    allowed: Envelope
    axes: Axes
    trim: Trim
    linear: Linear
    frequencies: Frequencies

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of every input: controls, then the throttle."""
        return (*self.aircraft.control_names, THROTTLE)

    def columns(
        self, duration: float, shapes: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Float[np.ndarray, "sample input"]:
        """Shapes by input as one array."""
        found = np.zeros((_time(duration).size, len(self.names)))
        for name, shape in shapes.items():
            found[:, self.names.index(name)] = shape
        return found

    def sized(self, added: Float[np.ndarray, "sample input"]) -> Float[np.ndarray, "sample input"]:
        """Unit shapes, each so large that alone it would reach a limit."""
        return added * sizes.limiting(
            self.aircraft, self.allowed, self.trim, self.linear, added, self.names
        )

    def frequency(self, name: str) -> float:
        """Natural frequency of the motion that an input excites [rad/s]."""
        if name == self.axes.pitch:
            return self.frequencies.pitch
        return self.frequencies.yaw

    def last(self, name: str) -> float:
        """Fastest frequency that is worth putting on an input [Hz]."""
        if name == THROTTLE:
            return 0.6
        wanted = BEYOND * self.frequency(name)
        if name == self.axes.roll:
            wanted = BEYOND * max(self.frequencies.yaw, 0.5 * self.frequencies.roll)
        servo = axes.time_constant(self.aircraft, name)
        followed = 1.0 / servo if servo else np.inf
        band = np.clip(wanted / (2.0 * np.pi), 4.0 * SLOW, SAMPLED)
        return float(min(band, followed / (2.0 * np.pi)))

    def rise(self, name: str) -> float:
        """Time that its servos need for an edge [s]."""
        servo = axes.time_constant(self.aircraft, name)
        limit = axes.rate_limit(self.aircraft, name)
        return max(steps.rise_time(FIRST_RISE, servo, limit), 2.0 * STEP)


def every(at: Place) -> Iterator[Recipe]:
    """All recipes of one flight condition."""
    pitch, lateral = at.axes.pitch, at.axes.lateral
    groups = [((pitch,) if pitch else (), ALONG), (lateral, ACROSS)]
    for controls, coefficients in groups:
        if controls:
            yield from _multisines(at, controls, coefficients)
            yield from _pulses(at, controls, coefficients)
            yield from _sweeps(at, controls, coefficients)
    if len(at.axes.every) > 1:
        yield from _together(at)
    if pitch:
        yield from _pulls(at, pitch)
    if at.axes.roll and at.axes.yaw and at.axes.roll != at.axes.yaw:
        yield _sideslip(at, at.axes.roll, at.axes.yaw)
    if pitch and at.axes.roll:
        yield from _turns(at, pitch, at.axes.roll)
    if axes.throttled(at.aircraft):
        yield from _powers(at)


def _time(duration: float) -> Float[np.ndarray, " sample"]:
    """To the first sample at which the input is over: one before may stand on its last edge."""
    return STEP * np.arange(math.ceil(duration / STEP - 1e-6) + 1)


def _multisine(
    at: Place, inputs: tuple[str, ...], *, lowest: float
) -> Float[np.ndarray, "sample input"]:
    """Interleaved lines, those of each input up to its own last frequency.

    An input whose servos follow none of these has slower ones of its own.
    """
    first = max(2, round(lowest * PERIOD))
    last = max(round(at.last(name) * PERIOD) for name in inputs)
    dealt = multisine.interleaved(first, max(last, first + 2 * len(inputs)), len(inputs))
    time, shapes, taken = _time(PERIOD), {}, set[int]()
    for name, lines in zip(inputs, dealt, strict=True):
        most = math.floor(at.last(name) * PERIOD)
        kept = [line for line in lines if line <= most]
        kept = kept or [line for line in range(1, most + 1) if line not in taken][-SLOWEST:]
        taken |= set(kept)
        shapes[name] = multisine.multisine(kept or (1,), PERIOD, time)
    return at.sized(at.columns(PERIOD, shapes))


def _multisines(
    at: Place, inputs: tuple[str, ...], coefficients: tuple[str, ...]
) -> Iterator[Recipe]:
    fastest = max(at.last(name) for name in inputs)
    slow = min(SLOW, 0.5 * fastest)
    for label, lowest in (("multisine", slow), ("fast_multisine", 0.45 * fastest)):
        yield Recipe(
            f"{'_'.join(inputs)}_{label}",
            "multisine",
            coefficients,
            inputs,
            PERIOD,
            _multisine(at, inputs, lowest=lowest),
            f"sines from {lowest:.1f} to {fastest:.1f} Hz on {in_words(inputs)} at once, by script",
        )


def _together(at: Place) -> Iterator[Recipe]:
    engines = (THROTTLE,) if axes.throttled(at.aircraft) else ()
    for label, inputs in (("all", at.axes.every), ("all_and_throttle", (*at.axes.every, *engines))):
        if label == "all" or engines:
            yield Recipe(
                f"{label}_multisine",
                "multisine",
                (*ALONG, *ACROSS),
                inputs,
                PERIOD,
                _multisine(at, inputs, lowest=SLOW),
                f"sines on {in_words(inputs)} at once, each on frequencies of its own, by script",
            )


def _pulses(at: Place, inputs: tuple[str, ...], coefficients: tuple[str, ...]) -> Iterator[Recipe]:
    made: tuple[tuple[str, Kind, tuple[float, ...], float], ...] = (
        ("multistep", "multistep", steps.THREE_TWO_ONE_ONE, 7.0 * PULSE),
        ("two-one-one", "two-one-one", steps.TWO_ONE_ONE, 4.0 * PULSE),
        ("doublet", "doublet", steps.DOUBLET, 2.0 * HALF),
    )
    for label, kind, shares, length in made:
        lengths = {name: _pulse_length(at, name, length, len(shares)) for name in inputs}
        starts = np.cumsum([0.0, *(lengths[name] + WAIT for name in inputs)])
        duration = float(starts[-1] - WAIT)
        time = _time(duration)
        shapes = {
            name: steps.steps(shares, lengths[name], time - start, rise=at.rise(name))
            for name, start in zip(inputs, starts, strict=False)
        }
        yield Recipe(
            f"{'_'.join(inputs)}_{label}",
            kind,
            coefficients,
            inputs,
            duration,
            at.sized(at.columns(duration, shapes)),
            f"{label} on {in_words(inputs, ', then ')}; can be flown by hand",
        )


def _pulse_length(at: Place, name: str, length: float, count: int) -> float:
    """Length of a pulse train [s]: its edges must leave room for plateaus."""
    wanted = length / at.frequency(name)
    return float(np.clip(wanted, 2.0 * (count + 1) * at.rise(name), 0.5 * PERIOD))


def _sweeps(at: Place, inputs: tuple[str, ...], coefficients: tuple[str, ...]) -> Iterator[Recipe]:
    time = _time(SWEEP)
    for name in inputs:
        last = at.last(name)
        first = min(SLOW, 0.5 * last)
        shape = sweep.sweep(first, last, SWEEP, time)
        yield Recipe(
            f"{name}_sweep",
            "sweep",
            coefficients,
            (name,),
            SWEEP,
            at.sized(at.columns(SWEEP, {name: shape})),
            f"{name} from {first:.1f} to {last:.1f} Hz in {SWEEP:.0f} s",
            fastest=last,
        )


def _pulls(at: Place, pitch: str) -> Iterator[Recipe]:
    half = float(np.clip(SLOWLY / at.frequencies.pitch, 1.5, 4.0))
    for name, kind, count in (
        ("push_over_pull_up", "push-over pull-up", 1),
        ("roller_coaster", "roller-coaster", 3),
    ):
        duration = 2.0 * half * count
        shape = smooth.cycles(count, duration, _time(duration))
        yield Recipe(
            name,
            kind,
            ALONG,
            (pitch,),
            duration,
            at.sized(at.columns(duration, {pitch: shape})),
            f"nose down and up again {count} times, {half:.1f} s each way, wings level",
        )


def _sideslip(at: Place, roll: str, yaw: str) -> Recipe:
    """Both directions in turn, held by crossed controls; from the lateral equations at rest."""
    speed = at.trim.airspeed
    dynamics, effect = at.linear.dynamics, at.linear.inputs
    beta = 0.7 * min(-at.allowed.beta[0], at.allowed.beta[1])
    places = [at.names.index(roll), at.names.index(yaw)]
    rows = [1, 3, 5]
    unknown = np.column_stack([dynamics[rows, 6], effect[np.ix_(rows, places)]])
    bank, *moved = np.linalg.lstsq(unknown, -dynamics[rows, 1] * speed * beta, rcond=None)[0]
    target = np.zeros(SIZE)
    target[1], target[6] = speed * beta, bank
    steady = at.linear.gain @ target
    steady[places] += moved
    duration, hold = 16.0, 8.0
    time = _time(duration)
    shape = smooth.plateau(hold, 2.0, time) - smooth.plateau(hold, 2.0, time - hold)
    added = np.zeros((time.size, len(at.names)))
    added[:, :-1] = shape[:, None] * steady
    return Recipe(
        "steady_heading_sideslip",
        "steady-heading sideslip",
        ACROSS,
        (roll, yaw),
        duration,
        added,
        f"{yaw} to one side against {roll}, heading held, {hold:.0f} s; then to the other",
    )


def _turns(at: Place, pitch: str, roll: str) -> Iterator[Recipe]:
    bank = BANK * at.allowed.bank
    target = np.zeros(SIZE)
    target[6] = bank
    hold = at.linear.gain @ target
    index = at.names.index(pitch)
    duration = 16.0
    time = _time(duration)
    pull = at.sized(at.columns(duration, {pitch: smooth.winding(duration, 3.0, time)}))
    added = TURNING * _up(at, index) * pull
    added[:, :-1] += smooth.plateau(duration, 3.0, time)[:, None] * hold
    yield Recipe(
        "wind_up_turn",
        "wind-up turn",
        (*ALONG, *ACROSS),
        (pitch, roll),
        duration,
        added,
        f"bank to {np.degrees(bank):.0f}°, then pull slowly more and more for 13 s, release",
    )
    duration = 9.0
    time = _time(duration)
    rolling = np.zeros((time.size, len(at.names)))
    rolling[:, :-1] = smooth.cycles(2, duration, time)[:, None] * hold
    pull = at.sized(at.columns(duration, {pitch: smooth.plateau(duration, 1.5, time)}))
    yield Recipe(
        "coupled_rolls",
        "coupled rolls",
        (*ALONG, *ACROSS),
        (pitch, roll),
        duration,
        rolling + _up(at, index) * pull,
        f"bank to {np.degrees(bank):.0f}° right, left, right, left without a stop, pulling",
    )


def _up(at: Place, index: int) -> float:
    """Sign of the deflection that raises the nose."""
    return float(np.sign(at.linear.inputs[4, index]))


def _powers(at: Place) -> Iterator[Recipe]:
    duration = 10.5
    time = _time(duration)
    shape = steps.steps(steps.THREE_TWO_ONE_ONE, duration, time, rise=0.3)
    yield Recipe(
        "throttle_steps",
        "throttle steps",
        ALONG,
        (THROTTLE,),
        duration,
        at.sized(at.columns(duration, {THROTTLE: shape})),
        "throttle up and down in steps of 4.5, 3, 1.5 and 1.5 s, attitude held",
    )
    open_now = max((setting for setting in at.trim.settings if setting <= 1.0), default=0.0)
    duration = 14.0
    time = _time(duration)
    shut = -float(open_now) * smooth.plateau(duration, 1.5, time)
    yield Recipe(
        "deceleration",
        "deceleration",
        ALONG,
        (THROTTLE,),
        duration,
        at.columns(duration, {THROTTLE: shut}),
        "throttle closed, attitude held: slower and slower toward the stall; open again",
    )
    if at.axes.pitch:
        yield _glide(at, at.axes.pitch, shut, duration)


def _glide(at: Place, pitch: str, shut: Float[np.ndarray, " sample"], duration: float) -> Recipe:
    """Throttle closed, and the nose down by the angle at which drag is carried by weight."""
    lost = float(at.linear.inputs[0, -1] * np.abs(shut).max())
    target = np.zeros(SIZE)
    target[7] = -lost / GRAVITY
    steady = at.linear.gain @ target
    added = at.columns(duration, {THROTTLE: shut})
    held = smooth.plateau(duration, 1.5, _time(duration))
    added[:, :-1] += held[:, None] * steady
    return Recipe(
        "glide",
        "glide",
        ALONG,
        (pitch, THROTTLE),
        duration,
        added,
        f"throttle closed, nose {np.degrees(lost / GRAVITY):.0f}° down to keep the airspeed",
    )


def in_words(names: tuple[str, ...], joint: str = ", ") -> str:
    """Inputs as people list them."""
    return names[0] if len(names) == 1 else joint.join(names[:-1]) + " and " + names[-1]
