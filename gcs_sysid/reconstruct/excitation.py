"""Deliberate test inputs in the control commands: doublets, multisteps, multisines, sweeps.

A stepped input is a row of jumps of alternating sign that ends where it began. A smooth input is a
stretch in which surfaces move far more than they usually do and as much at its end as at its
beginning, or in which one surface moves while every other command, the throttle too, stands still:
nothing but an open-loop input looks like that.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from gcs_sysid.reconstruct.control_history import (
    SMALLEST_STEP,
    ControlHistory,
    ControlSignal,
    Jump,
    activity,
    frozen,
    jumps,
    pace,
)

LONGEST_HOLD = 2.5
"""Longest time [s] a surface is held at one step of a test input."""
LONGEST_THROTTLE_HOLD = 10.0
SHORTEST_THROTTLE_HOLD = 0.8
SHORTEST_SMOOTH = 8.0
"""A shorter stretch [s] of activity is no multisine or sweep."""
SMALLEST_ACTIVITY = 0.01
"""Root mean square [half travels] below which a surface counts as quiet."""
SETTLING = 3.0
"""The aircraft's answer to the last step belongs to the maneuver [s]."""
LEAD = 1.0
"""Trimmed flight before an input belongs to it [s]."""


@dataclass(frozen=True)
class Excitation:
    """A deliberate input: what, when [s after the epoch, lead and answer included], on what."""

    kind: str
    start: float
    end: float
    controls: tuple[str, ...]


def excitations(
    history: ControlHistory, airborne: tuple[tuple[float, float], ...]
) -> tuple[Excitation, ...]:
    """All deliberate inputs while airborne, in order, not overlapping."""
    inside = np.zeros(history.time.size, dtype=bool)
    for start, end in airborne:
        inside[history.span(start, end)] = True
    if inside.sum() * history.step < SHORTEST_SMOOTH:
        return ()
    alone = _alone(history, inside)
    stepped = [
        Excitation(kind, first - LEAD, last + SETTLING, (signal.name,))
        for signal in history.signals
        for kind, first, last in _stepped(signal, history, alone[signal.name])
    ]
    smooth = _smooth(history, inside, alone)
    stepped = [item for item in stepped if not _swallowed(item, smooth)]
    smooth = [item for item in smooth if _covered(item, stepped) < 0.5]
    clipped = [part for item in (*stepped, *smooth) if (part := _clip(item, airborne)) is not None]
    return _apart(sorted(clipped, key=lambda item: item.start))


def _swallowed(item: Excitation, smooth: list[Excitation]) -> bool:
    """Whether a stepped input is only a few steps of a much longer smooth one."""
    middle = 0.5 * (item.start + item.end)
    return any(
        other.start < middle < other.end and other.end - other.start > 1.5 * (item.end - item.start)
        for other in smooth
    )


def _covered(item: Excitation, others: list[Excitation]) -> float:
    shared = sum(
        max(0.0, min(item.end, other.end) - max(item.start, other.start)) for other in others
    )
    return shared / (item.end - item.start)


def _clip(item: Excitation, airborne: tuple[tuple[float, float], ...]) -> Excitation | None:
    middle = 0.5 * (item.start + item.end)
    for start, end in airborne:
        if start <= middle <= end:
            return Excitation(item.kind, max(item.start, start), min(item.end, end), item.controls)
    return None


def _apart(items: list[Excitation]) -> tuple[Excitation, ...]:
    """Joins inputs given together on several controls; parts those that only touch."""
    result: list[Excitation] = []
    for item in items:
        if not result or item.start >= result[-1].end:
            result.append(item)
            continue
        last = result[-1]
        shared = min(last.end, item.end) - item.start
        if shared > 0.5 * min(last.end - last.start, item.end - item.start):
            longer = max(last, item, key=lambda one: one.end - one.start)
            controls = (*last.controls, *(c for c in item.controls if c not in last.controls))
            joined = Excitation(longer.kind, last.start, max(last.end, item.end), controls)
            result[-1] = joined
        else:
            # The answer to the first input lasts until the second one's lead is over.
            border = min(last.end, item.start + LEAD)
            result[-1] = Excitation(last.kind, last.start, border, last.controls)
            result.append(Excitation(item.kind, border, item.end, item.controls))
    return tuple(result)


def _alone(
    history: ControlHistory, inside: Bool[np.ndarray, " tick"]
) -> dict[str, Bool[np.ndarray, " tick"]]:
    """By control, where all others that usually move (two at least) stand still."""
    still = {s.name: frozen(s.values, history.step) for s in history.signals}
    moving = [name for name, ticks in still.items() if ticks[inside].mean() < 0.98]
    result = {}
    for signal in history.signals:
        others = [still[name] for name in moving if name != signal.name]
        quiet = np.all(others, axis=0) if len(others) >= 2 else np.zeros_like(inside)
        result[signal.name] = inside & quiet
    return result


def _stepped(
    signal: ControlSignal, history: ControlHistory, alone: Bool[np.ndarray, " tick"]
) -> list[tuple[str, float, float]]:
    """Stepped inputs of one control: kind, first and last jump [s]."""
    longest = LONGEST_THROTTLE_HOLD if signal.throttle else LONGEST_HOLD
    group: list[Jump] = []
    groups = [group]
    for jump in jumps(signal, history, alone):
        if group and jump.time - group[-1].time > longest:
            group = []
            groups.append(group)
        group.append(jump)
    found = []
    for group in groups:
        for first, last in _runs(group, signal, history):
            kind = "doublet" if last - first == 2 else "multistep"
            if signal.throttle:
                kind = "throttle"
            found.append((kind, group[first].time, group[last].time))
    return found


def _runs(
    group: list[Jump], signal: ControlSignal, history: ControlHistory
) -> list[tuple[int, int]]:
    """First and last index of the runs that look like a test input, longest first, disjoint."""
    taken = np.zeros(len(group), dtype=bool)
    runs = []
    for length in range(min(len(group), 24), 2, -1):
        for first in range(len(group) - length + 1):
            run = slice(first, first + length)
            if not taken[run].any() and _is_input(group[run], signal, history):
                taken[run] = True
                runs.append((first, first + length - 1))
    return runs


def _is_input(run: list[Jump], signal: ControlSignal, history: ControlHistory) -> bool:
    sizes = np.array([jump.size for jump in run])
    times = np.array([jump.time for jump in run])
    holds = np.diff(times)
    largest = np.abs(sizes).max()
    outer = max(abs(sizes[0]), abs(sizes[-1]))
    return bool(
        (sizes[1:] * sizes[:-1] < 0.0).all()
        and abs(sizes.sum()) <= 0.4 * largest
        and outer <= 0.85 * largest
        and np.abs(sizes).min() >= 0.25 * largest
        and holds.min() >= (SHORTEST_THROTTLE_HOLD if signal.throttle else 3.0 * history.step)
        # 3-2-1-1 holds its longest step three times its shortest; only a doublet may be lopsided.
        # The second shortest, because lost samples make one hold seem short.
        and (len(run) == 3 or holds.max() <= 4.5 * np.sort(holds)[1])
        and _held(times, largest, signal, history)
    )


def _held(
    times: Float[np.ndarray, " jump"],
    largest: float,
    signal: ControlSignal,
    history: ControlHistory,
) -> bool:
    """Whether the command stays near each level.

    Feedback may pull a surface away; a throttle stands still, before the first jump too.
    """
    edges = [times[0] - 0.8, *times, times[-1] + 0.3] if signal.throttle else list(times)
    spans = [
        history.span(start + 2.0 * history.step, end - 2.0 * history.step)
        for start, end in itertools.pairwise(edges)
    ]
    drifts = [float(np.ptp(signal.values[s])) / largest if s.stop > s.start else 0.0 for s in spans]
    if signal.throttle:
        return bool(max(drifts) < 0.05)
    return bool(max(drifts) < 0.8 and np.median(drifts) < 0.45)


def _smooth(
    history: ControlHistory,
    inside: Bool[np.ndarray, " tick"],
    alone: dict[str, Bool[np.ndarray, " tick"]],
) -> list[Excitation]:
    """Multisines and sweeps."""
    levels = {s.name: activity(s.values, history.step) for s in history.surfaces}
    spans: list[tuple[float, float, float]] = []
    for signal in history.surfaces:
        level = levels[signal.name]
        usual = max(float(np.percentile(level[inside], 20.0)), SMALLEST_ACTIVITY / 3.0)
        unaided = alone[signal.name] & (level > SMALLEST_ACTIVITY)
        spans += _even(signal, unaided, level, usual, history, alone=True)
        spans += _even(signal, inside & (level > 3.0 * usual), level, usual, history, alone=False)
    return [_described(span, levels, history) for span in _clearest(spans)]


def _even(
    signal: ControlSignal,
    mask: Bool[np.ndarray, " tick"],
    level: Float[np.ndarray, " tick"],
    usual: float,
    history: ControlHistory,
    *,
    alone: bool,
) -> list[tuple[float, float, float]]:
    """Stretches of `mask` in which the activity neither grows, fades nor comes in bursts.

    Each with its mean activity over the usual one.
    """
    still = frozen(signal.values, history.step)

    def switched(start: float, end: float) -> bool:
        """Whether it comes and goes at once, over feedback that does not."""
        inner = float(np.mean(level[history.span(start, end)]))
        sides = (history.span(start - 3.0, start - 1.0), history.span(end + 1.0, end + 3.0))
        return all(
            level[side].size > 0
            and np.mean(level[side]) < 0.25 * inner
            and still[side].mean() < 0.5
            for side in sides
        )

    found = []
    for start, end in _stretches(mask, history):
        inner = level[history.span(start, end)]
        values = signal.values[history.span(start, end)]
        over = float(np.mean(inner)) / usual
        spread, peak = _spread(inner), _peak_factor(values, history.step)
        if np.mean(pace(signal.values, history)[history.span(start, end)] > 0.0) < 0.5:
            continue  # steps with holds between them
        # The less feedback can be at work, the less even it must be.
        lone = alone and spread < 0.55 and peak < 2.8
        large = over > 10.0 and spread < 0.36 and peak < 2.2
        if lone or large or (over > 5.0 and spread < 0.45 and peak < 2.8 and switched(start, end)):
            found.append((start, end, over))
    return found


def _described(
    span: tuple[float, float],
    levels: dict[str, Float[np.ndarray, " tick"]],
    history: ControlHistory,
) -> Excitation:
    ticks = history.span(*span)
    active = [
        signal
        for signal in history.surfaces
        if np.median(levels[signal.name][ticks]) > SMALLEST_ACTIVITY
        and _spread(levels[signal.name][ticks]) < 0.7
    ]
    kind = "sweep" if _is_sweep(active, ticks, history.step) else "multisine"
    names = tuple(signal.name for signal in active)
    return Excitation(kind, span[0] - LEAD, span[1] + LEAD, names)


def _spread(level: Float[np.ndarray, " tick"]) -> float:
    """Relative spread of the activity: 0.15 to 0.36 in multisines, 0.4 to 1 in gust response."""
    return float(np.std(level) / max(float(np.mean(level)), 1e-9))


def _peak_factor(values: Float[np.ndarray, " tick"], step: float) -> float:
    """98 % of the fast part stay below this many root mean squares.

    Sums of sines reach 1.4 to 2.2, with feedback on top 2.5; a feedback law's answer to gusts
    alone 2.3 to 4. (Both ranges, and those of `_spread`, from simulated and real flights.)
    """
    fast = values - ndimage.uniform_filter1d(values, max(3, round(2.0 / step) | 1))
    return float(np.percentile(np.abs(fast), 98.0) / max(float(np.std(fast)), 1e-9))


def _stretches(
    mask: Bool[np.ndarray, " tick"], history: ControlHistory
) -> list[tuple[float, float]]:
    """Times of stretches of `mask`, holes up to a second closed, soft edges taken off."""
    wide = max(2, round(1.0 / history.step))
    closed = ndimage.binary_closing(np.pad(mask, 2 * wide), structure=np.ones(wide, dtype=bool))
    labels, count = ndimage.label(closed[2 * wide : -2 * wide])
    spans = [piece[0] for piece in ndimage.find_objects(labels, count)]
    # The level is a mean over a second, so a stretch begins up to half a second early.
    times = [(history.time[s.start] + 0.5, history.time[s.stop - 1] - 0.5) for s in spans]
    return [(float(a), float(b)) for a, b in times if b - a >= SHORTEST_SMOOTH]


def _clearest(spans: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
    """Of stretches that overlap the one that stands out most: it knows the edges best."""
    kept: list[tuple[float, float]] = []
    for start, end, _ in sorted(spans, key=lambda item: -item[2]):
        if all(end <= other[0] or start >= other[1] for other in kept):
            kept.append((start, end))
    return sorted(kept)


def _is_sweep(active: list[ControlSignal], span: slice, step: float) -> bool:
    """Whether the frequency of the largest signal runs one way by a factor of 2.5 or more."""
    largest = max(active, key=lambda signal: float(np.std(signal.values[span])))
    parts = np.array_split(largest.values[span], 4)
    if parts[0].size * step < 1.0:
        return False
    rates = np.array([_crossings(part) / (part.size * step) for part in parts])
    growth = rates[1:] / np.maximum(rates[:-1], 1e-3)
    monotone = (growth > 1.05).all() or (growth < 0.95).all()
    return bool(monotone and not 0.4 < rates[-1] / max(rates[0], 1e-3) < 2.5)


def _crossings(values: Float[np.ndarray, " tick"]) -> int:
    """Crossings of the middle, noise of less than a tenth of the amplitude ignored."""
    centred = values - 0.5 * (values.max() + values.min())
    band = max(0.1 * float(np.abs(centred).max()), 0.1 * SMALLEST_STEP)
    signs = np.sign(centred[np.abs(centred) > band])
    return int(np.count_nonzero(np.diff(signs)))
