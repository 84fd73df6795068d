"""Multisines whose lines are as strong as they are worth, for what is not known yet.

In small motions about level flight a line of amplitude a on one input adds a² M to what is known of
all coefficients together (`information.by_line`), and moves every limited quantity by a|r|, counted
in the room that it has. Lines do not meet in either, so that the best powers p = a² are those of

    max Σ worth(Σ p M) / draws    subject to    Σ p |r|² ≤ 1 for every limited quantity,

the mean over aircraft drawn from what is believed (input design in the frequency domain: Mehra,
IEEE Trans. Automatic Control 19 (1974) 753; Goodwin & Payne, *Dynamic System Identification*, 1977,
chapter 6). Phases are free: they are those at which the largest of all limited quantities together
stays lowest, where those of an ordinary multisine keep the input low, which is not what limits it.
Of large motions small ones tell too little: a first design is flown by all aircraft in gusts, the
room of each limit that it breaks is made smaller, and the design is made anew, for the better of
both. How large all of it may be is tried afterwards, as for any recipe (`design`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy import optimize

from gcs_sysid.maneuvers import axes, envelope, flown, information, sizes
from gcs_sysid.maneuvers.axes import THROTTLE
from gcs_sysid.maneuvers.design import AFTER, AROUND, CALM, Condition
from gcs_sysid.maneuvers.flown import LANES, LEAD, STEP, Flown
from gcs_sysid.maneuvers.knowledge import Added, Knowledge
from gcs_sysid.maneuvers.recipes import ACROSS, ALONG, PERIOD, Recipe, in_words
from gcs_sysid.maneuvers.signals import multisine, smooth
from gcs_sysid.maneuvers.target import Target

NAME = "tuned_multisine"
SLOWEST = 2
"""First line, harmonic of 1/`PERIOD`: the first one is hardly a steady answer after one period."""
LAPS = 2
"""Periods that a probe is flown; the last one is looked at, when the answer has settled."""
PROBE = 0.1
"""Size of a probe over that which alone would reach a limit: answers are of small motions."""
NORM = 16
"""The p-norm that stands for the largest mean square while powers are chosen."""
LEAST = 0.01
"""Lines that bring less than this part of what all bring are left out."""
TRIED = np.geomspace(0.3, 1.0, 12)
"""Shares of a first design at which each limit is looked at, to correct the room that it has."""
RAMP = 0.6
"""Time in which it fades in and out [s]."""


class Lines(NamedTuple):
    """What may be flown, at an amplitude of one.

    Attributes:
        inputs: that each line is on.
        harmonics: of 1/`PERIOD`.
        told: what each adds to what is known, in one period, for some drawn aircraft.
        answers: of each limited quantity for the same aircraft, in the order of `_room`.
    """

    inputs: tuple[str, ...]
    harmonics: Int[np.ndarray, " line"]
    told: Float[np.ndarray, "draw line unknown unknown"]
    answers: Complex[np.ndarray, "draw limit line"]

    def on(self, inputs: Collection[str]) -> Lines:
        """Those on some inputs alone."""
        kept = np.flatnonzero([name in inputs for name in self.inputs])
        return Lines(
            tuple(self.inputs[line] for line in kept),
            self.harmonics[kept],
            self.told[:, kept],
            self.answers[:, :, kept],
        )


def recipe(
    at: Condition, lines: Lines, target: Target, known: Knowledge, budget: float
) -> Recipe | None:
    """The multisine for a target at one condition; None where no input tells anything of it.

    Args:
        at: where it begins.
        lines: that may be flown there, `probed`.
        target: what is to be known better.
        known: what is known so far.
        budget: flight time that there is [s].
    """
    room, runs = _room(at), max(budget / (PERIOD + AFTER + AROUND), 1.0)
    first = designed(at, _over(lines, room), target, known, runs)
    if first is None:
        return None
    allowed = inside(at, first.recipe)
    corrected = {**room, **{name: share * room[name] for name, share in allowed.items()}}
    again = designed(at, _over(lines, corrected), target, known, runs)
    if again is None:
        return first.recipe

    def worth(design: Design, share: float) -> float:
        return _worth(lines, target, at, known, runs, share**2 * design.powers)[0]

    # Phases are not a concave problem: what is made anew can also be worse.
    smaller = min(inside(at, again.recipe).values())
    if worth(again, smaller) > worth(first, min(allowed.values())):
        return again.recipe
    return first.recipe


class Design(NamedTuple):
    """A recipe, and the powers of all lines at its full size."""

    recipe: Recipe
    powers: Float[np.ndarray, " line"]


def designed(
    at: Condition, lines: Lines, target: Target, known: Knowledge, runs: float
) -> Design | None:
    """The best lines as one input, so large that in small motions a limit is just reached."""
    powers = best(lines, target, at, known, runs)
    kept = np.flatnonzero(powers)
    if kept.size == 0:
        return None
    harmonics, amplitudes = lines.harmonics[kept], np.sqrt(powers[kept])
    phases, peak = multisine.phased(harmonics.astype(float), lines.answers[0][:, kept] * amplitudes)
    names = at.place().names
    time = STEP * np.arange(round(PERIOD / STEP) + 1)
    added = np.zeros((time.size, len(names)))
    for line, harmonic, amplitude, phase in zip(kept, harmonics, amplitudes, phases, strict=True):
        wave = np.sin(2.0 * np.pi * harmonic * time / PERIOD + phase)
        added[:, names.index(lines.inputs[line])] += amplitude / peak * wave
    added *= smooth.plateau(PERIOD, RAMP, time)[:, None]
    moved = tuple(name for name in _inputs(at) if any(lines.inputs[line] == name for line in kept))
    lateral = bool(set(moved) & set(at.axes.lateral))
    along = bool(set(moved) - set(at.axes.lateral))
    recipe = Recipe(
        NAME,
        "multisine",
        (*(ALONG if along else ()), *(ACROSS if lateral else ())),
        moved,
        PERIOD,
        added,
        f"sines from {harmonics.min() / PERIOD:.1f} to {harmonics.max() / PERIOD:.1f} Hz on "
        f"{in_words(moved)}, as strong as they tell, by script",
    )
    return Design(recipe, powers / peak**2)


def inside(at: Condition, recipe: Recipe) -> dict[str, float]:
    """How much of it each limit allows by itself, flown at full size by all aircraft in gusts."""
    moved = at.fly(at.fleet, recipe, 1.0, at.air)
    still = Flown(*(values[:, : moved.alpha.shape[1]] for values in at.still))
    found = envelope.each_inside(still, moved, at.allowed, at.aircraft, TRIED)
    return {name: share for name, share in found.items() if name != "height"}


def _inputs(at: Condition) -> tuple[str, ...]:
    return (*at.axes.every, *((THROTTLE,) if axes.throttled(at.aircraft) else ()))


def probed(at: Condition) -> Lines:
    """Every line of every input, from flights of all lines of one input each in calm air."""
    place, count = at.place(), round(PERIOD / STEP)
    time = STEP * np.arange(count)
    inputs, harmonics, told, answers = [], [], [], []
    for name in _inputs(at):
        lines = np.arange(SLOWEST, max(int(place.last(name) * PERIOD), SLOWEST) + 1)
        shape = multisine.multisine(tuple(lines.tolist()), PERIOD, time)
        probe = PROBE * place.sized(place.columns(PERIOD, {name: np.append(shape, 0.0)}))[:count]
        flight = at.simulator.fly(
            at.fleet,
            at.linear,
            at.trim.density,
            np.tile(probe, (LAPS, 1)),
            np.zeros((LANES, LEAD + LAPS * count, 6)),
        )
        last = Flown(*(values[:CALM, -count:] for values in flight))
        sent = probe[:, place.names.index(name)]
        unit = _waves(sent[None], lines)[0]
        each = [
            information.by_line(
                at.model,
                flown.regressor_values(at.aircraft, at.trim.density, last, draw),
                STEP,
                at.heard,
                lines,
            )
            for draw in range(CALM)
        ]
        told.append(np.stack(each) / np.abs(unit[:, None, None]) ** 2)
        seen = {**_limited(at, last), **_asked(at, name, sent)}
        answers.append(np.stack([_waves(values, lines) / unit for values in seen.values()], axis=1))
        inputs += [name] * lines.size
        harmonics.append(lines)
    return Lines(
        tuple(inputs),
        np.concatenate(harmonics),
        np.concatenate(told, axis=1),
        np.concatenate(answers, axis=2),
    )


def _over(lines: Lines, room: Mapping[str, float]) -> Lines:
    """With answers over the room that each limited quantity has."""
    return lines._replace(answers=lines.answers / np.array(list(room.values()))[:, None])


def _waves(
    values: Float[np.ndarray, "draw sample"], lines: Int[np.ndarray, " line"]
) -> Complex[np.ndarray, "draw line"]:
    """Amplitudes of harmonics of one period."""
    return 2.0 / values.shape[1] * np.fft.rfft(values, axis=1)[:, lines]


def _limited(at: Condition, flight: Flown) -> dict[str, Float[np.ndarray, "draw sample"]]:
    """Every limited quantity of a motion but the height, and of the surfaces."""
    names = [name for name in envelope.limits(at.allowed) if name != "height"]
    found = {name: getattr(flight, name) for name in names}
    for index, servo in enumerate(at.aircraft.servos):
        asked = flight.commanded[:, :, index]
        found[f"travel of {servo.surface}"] = asked
        if servo.rate_limit is not None:
            found[f"rate of {servo.surface}"] = np.gradient(asked, STEP, axis=1)
    return found


def _asked(
    at: Condition, moved: str, sent: Float[np.ndarray, " sample"]
) -> dict[str, Float[np.ndarray, "draw sample"]]:
    """What is added to each input, the same for all aircraft."""
    return {name: np.tile(sent * (name == moved), (CALM, 1)) for name in _inputs(at)}


def _room(at: Condition) -> dict[str, float]:
    """How far each limited quantity may go beside what gusts make of it."""
    found = {}
    still, limits = _limited(at, at.still), envelope.limits(at.allowed)
    for name, values in still.items():
        if name in limits:
            limit = limits[name]
            low, high = limit.low + limit.room, limit.high - limit.room
        else:
            servo = next(one for one in at.aircraft.servos if name.endswith(f" {one.surface}"))
            low, high = min(servo.deflection), max(servo.deflection)
            if name.startswith("rate") and servo.rate_limit is not None:
                low, high = -servo.rate_limit, servo.rate_limit
        found[name] = float(min((high - values).min(), (values - low).min()))
    for name in _inputs(at):
        throttle = name == THROTTLE
        found[name] = sizes.POWER if throttle else sizes.TRAVEL * axes.travel(at.aircraft, name)
    return {name: max(room, 1e-9) for name, room in found.items()}


def best(
    lines: Lines, target: Target, at: Condition, known: Knowledge, runs: float
) -> Float[np.ndarray, " line"]:
    """Powers of the lines, see the module; zero for those that bring next to nothing.

    Args:
        lines: to choose from, answers over their room.
        target: what is to be known better.
        at: the condition.
        known: what is known so far.
        runs: how often all of it is flown.
    """
    taken = (np.abs(lines.answers) ** 2).max(axis=0).T

    def powers(logarithms: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        raw = np.exp(logarithms - logarithms.max())
        used = raw @ taken
        most = float(np.sum(used**NORM) ** (1.0 / NORM))
        return raw / most, raw, used, most

    def worth(power: np.ndarray) -> tuple[float, np.ndarray]:
        return _worth(lines, target, at, known, runs, power)

    def cost(logarithms: np.ndarray) -> tuple[float, np.ndarray]:
        power, raw, used, most = powers(logarithms)
        value, slope = worth(power)
        # Power is raw/most, and most grows with raw by the p-norm's own slope.
        grown = taken @ (used ** (NORM - 1)) * most ** (1 - NORM)
        return -value, -(slope - (slope @ power) * grown) / most * raw

    start = -np.log(np.maximum(taken.max(axis=1), 1e-300))
    found = optimize.minimize(cost, start, jac=True, method="L-BFGS-B").x
    power = powers(found)[0]
    brought = worth(power)[1] * power
    return np.where(brought > LEAST * brought.sum(), power, 0.0)


def _worth(
    lines: Lines,
    target: Target,
    at: Condition,
    known: Knowledge,
    runs: float,
    power: Float[np.ndarray, " line"],
) -> tuple[float, Float[np.ndarray, " line"]]:
    """What is known once lines of these powers were flown, but for a constant, and its slope."""
    total, slope = 0.0, np.zeros(power.size)
    for told in lines.told:
        more = Added(runs * np.einsum("l,lij->ij", power, told), 0.0)
        value, grown = target.slope(at.model, known.with_more(more))
        total += value
        slope += runs * np.einsum("ij,lij->l", grown, told)
    return total / len(lines.told), slope / len(lines.told)
