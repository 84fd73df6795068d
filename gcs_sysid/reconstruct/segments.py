"""A flight cut into maneuvers: deliberate inputs first, then turns, legs, climbs, decelerations.

Maneuvers never overlap and lie inside wing-borne flight. What is held out of a fit is always whole
maneuvers: neighbouring samples know too much of each other.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.reconstruct.airborne import Interval, ground_speed, settled
from gcs_sysid.reconstruct.control_history import ControlHistory, activity, control_history
from gcs_sysid.reconstruct.excitation import excitations
from gcs_sysid.reconstruct.measurements import (
    AIRSPEED_STREAMS,
    ATTITUDE_STREAMS,
    VELOCITY_STREAMS,
)
from gcs_sysid.recording import Recording

INPUTS = ("doublet", "multistep", "multisine", "sweep", "throttle")
"""Kinds of maneuver with a deliberate input."""
KINDS = (*INPUTS, "turn", "steady", "climb", "stall-approach", "other")

CLOCK = 10.0
"""Rate of the clock on which a flight is cut [Hz]."""
SHORTEST = 5.0
"""Shorter pieces of ordinary flight [s] go to a neighbour."""
SHORTEST_REST = 3.0
"""What is left between two deliberate inputs is a piece of its own from this length [s]."""
LONGEST = 30.0
"""Longer pieces of ordinary flight [s] are parted, so that some can be held out."""
BANK = (np.radians(15.0), np.radians(8.0))
"""A turn begins above the first bank angle and ends below the second [rad]."""
SLOPE = (0.10, 0.05)
"""The same for a climb or descent: climb rate over airspeed."""
NOTABLE_ACTIVITY = 0.02
"""Root mean square [half travels] from which a piece of ordinary flight lists a control."""


@dataclass(frozen=True)
class Segment:
    """One maneuver.

    Attributes:
        id: number, unique in its flight, in order of time.
        kind: one of `KINDS`.
        start: s after the recording's epoch.
        end: s after the recording's epoch.
        controls: names of the controls that move.
        airspeed: mean indicated airspeed [m/s]; speed over ground where none was measured.
        held_out: kept out of the fit, kept in it, or (None) left to `split`.
    """

    id: int
    kind: str
    start: float
    end: float
    controls: tuple[str, ...] = ()
    airspeed: float = float("nan")
    held_out: bool | None = None

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.end - self.start


def find(recording: Recording, aircraft: Aircraft | None = None) -> tuple[Segment, ...]:
    """All maneuvers of a flight, in order.

    With an aircraft file the controls are its controls; without one they are servo outputs.
    Deliberate inputs keep their lead and the aircraft's answer; the rest of the flight is cut where
    it changes between turning, climbing, slowing down and neither, in pieces of `SHORTEST` to
    `LONGEST` seconds.
    """
    flights = settled(recording, aircraft)
    if not flights:
        return ()
    history = control_history(recording, aircraft)
    inputs = excitations(history, flights) if history is not None else ()
    pieces = [Segment(0, item.kind, item.start, item.end, item.controls) for item in inputs]
    for start, end in _between(flights, pieces):
        if end - start >= SHORTEST_REST:
            pieces += _ordinary(recording, history, (start, end))
        else:
            _give_away(pieces, start, end)
    pieces = sorted((_no_landing(one, flights) for one in pieces), key=lambda one: one.start)
    numbered = [replace(piece, id=number) for number, piece in enumerate(pieces, start=1)]
    return with_airspeed(recording, numbered)


def with_airspeed(recording: Recording, segments: Iterable[Segment]) -> tuple[Segment, ...]:
    """The same maneuvers with their mean airspeed taken from the recording."""
    speeds = _speeds(recording)
    return tuple(replace(segment, airspeed=_mean(speeds, segment)) for segment in segments)


def _no_landing(piece: Segment, flights: tuple[Interval, ...]) -> Segment:
    """A flight's last deceleration is its landing, no approach to a stall."""
    landing = any(abs(piece.end - end) < 1e-6 for _, end in flights)
    return replace(piece, kind="other") if landing and piece.kind == "stall-approach" else piece


def _between(flights: tuple[Interval, ...], taken: list[Segment]) -> list[Interval]:
    """What of the flights no segment takes yet."""
    free = []
    for start, end in flights:
        cursor = start
        for piece in sorted(taken, key=lambda one: one.start):
            if start <= piece.start < end:
                free.append((cursor, piece.start))
                cursor = piece.end
        free.append((cursor, end))
    return [(start, end) for start, end in free if end - start > 1e-6]


def _give_away(pieces: list[Segment], start: float, end: float) -> None:
    """Adds a short rest to the maneuver before it, whose answer it still holds, or after it."""
    for index, piece in enumerate(pieces):
        if abs(piece.end - start) < 1e-6:
            pieces[index] = replace(piece, end=end)
            return
    for index, piece in enumerate(pieces):
        if abs(piece.start - end) < 1e-6:
            pieces[index] = replace(piece, start=start)
            return


def _ordinary(
    recording: Recording, history: ControlHistory | None, window: Interval
) -> list[Segment]:
    """Pieces of a stretch without deliberate inputs."""
    start, end = window
    time = np.arange(start, end, 1.0 / CLOCK)
    kinds = _kinds(recording, time)
    edges = np.flatnonzero(kinds[1:] != kinds[:-1]) + 1
    bounds = [start, *(float(time[edge]) for edge in edges), end]
    runs = [
        (str(kinds[first]), bounds[i], bounds[i + 1])
        for i, first in enumerate([0, *(int(edge) for edge in edges)])
    ]
    pieces = []
    for kind, first, last in _merged(runs):
        count = max(1, int(np.ceil((last - first) / LONGEST)))
        borders = np.linspace(first, last, count + 1)
        for a, b in itertools.pairwise(borders):
            controls = _moving(history, (float(a), float(b)))
            pieces.append(Segment(0, kind, float(a), float(b), controls))
    return pieces


def _merged(runs: list[tuple[str, float, float]]) -> list[tuple[str, float, float]]:
    """Gives runs shorter than `SHORTEST` to the longer neighbour, shortest first."""
    runs = list(runs)
    while len(runs) > 1:
        lengths = [end - start for _, start, end in runs]
        index = int(np.argmin(lengths))
        same = next((i for i in range(1, len(runs)) if runs[i][0] == runs[i - 1][0]), None)
        if same is not None:
            index, other = same, same - 1
        elif lengths[index] >= SHORTEST:
            break
        else:
            around = [i for i in (index - 1, index + 1) if 0 <= i < len(runs)]
            other = max(around, key=lambda i: lengths[i])
        low, high = min(index, other), max(index, other)
        kind = runs[low][0] if lengths[low] >= lengths[high] else runs[high][0]
        runs[low : high + 1] = [(kind, runs[low][1], runs[high][2])]
    return runs


def _kinds(recording: Recording, time: Float[np.ndarray, " tick"]) -> np.ndarray:
    """Kind of flight at each time."""
    kinds = np.full(time.size, "steady", dtype="<U14")
    speed = _channel(recording, AIRSPEED_STREAMS, "airspeed", time, 2.0)
    if speed is None and (over_ground := ground_speed(recording)) is not None:
        speed = np.interp(time, *over_ground)
    climb = _climb_rate(recording, time)
    if climb is not None and speed is not None:
        kinds[_hysteresis(np.abs(climb) / np.maximum(speed, 1.0), *SLOPE)] = "climb"
    if speed is not None:
        kinds[_slowing(speed)] = "stall-approach"
    bank = _channel(recording, ATTITUDE_STREAMS, "roll", time, 1.0)
    if bank is not None:
        kinds[_hysteresis(np.abs(bank), *BANK)] = "turn"
    return kinds


def _climb_rate(
    recording: Recording, time: Float[np.ndarray, " tick"]
) -> Float[np.ndarray, " tick"] | None:
    down = _channel(recording, VELOCITY_STREAMS, "v_down", time, 2.0)
    return -down if down is not None else _channel(recording, ("VFR_HUD",), "climb", time, 2.0)


def _channel(
    recording: Recording,
    names: tuple[str, ...],
    channel: str,
    time: Float[np.ndarray, " tick"],
    window: float,
) -> Float[np.ndarray, " tick"] | None:
    """A channel at `time`, averaged over `window` [s]; None where it was not measured."""
    stream = recording.first(names, channel)
    if stream is None:
        return None
    good = stream.valid(channel)
    values = np.interp(time, stream.time[good], stream.channels[channel][good])
    return ndimage.uniform_filter1d(values, max(1, round(window * CLOCK)))


def _hysteresis(
    values: Float[np.ndarray, " tick"], begin: float, end: float
) -> Bool[np.ndarray, " tick"]:
    """Stretches above `end` that somewhere rise above `begin`."""
    labels, _ = ndimage.label(values > end)
    strong = np.unique(labels[values > begin])
    return np.isin(labels, strong[strong > 0])


def _slowing(speed: Float[np.ndarray, " tick"]) -> Bool[np.ndarray, " tick"]:
    """Slow decelerations: 0.2 to 1.5 m/s² for six seconds or more, by a seventh of the speed."""
    trend = np.gradient(ndimage.uniform_filter1d(speed, round(3.0 * CLOCK))) * CLOCK
    labels, count = ndimage.label((trend < -0.2) & (trend > -1.5))
    result = np.zeros(speed.size, dtype=bool)
    for piece in ndimage.find_objects(labels, count):
        values = speed[piece[0]]
        if values.size >= 6.0 * CLOCK and values[0] - values[-1] > values[0] / 7.0:
            result[piece[0]] = True
    return result


def _moving(history: ControlHistory | None, window: Interval) -> tuple[str, ...]:
    """Controls that notably move in a window."""
    if history is None:
        return ()
    span = history.span(*window)
    return tuple(
        signal.name
        for signal in history.surfaces
        if signal.values[span].size
        and np.sqrt(np.mean(activity(signal.values[span], history.step) ** 2)) > NOTABLE_ACTIVITY
    )


def _speeds(
    recording: Recording,
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]] | None:
    stream = recording.first(AIRSPEED_STREAMS, "airspeed")
    if stream is None:
        return ground_speed(recording)
    good = stream.valid("airspeed")
    return stream.time[good], stream.channels["airspeed"][good]


def _mean(
    speeds: tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]] | None,
    piece: Segment,
) -> float:
    if speeds is None:
        return float("nan")
    inside = (speeds[0] >= piece.start) & (speeds[0] <= piece.end)
    return float(np.mean(speeds[1][inside])) if inside.any() else float("nan")


def split(
    segments: Iterable[Segment], *, held_out: float = 1.0 / 3.0
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Which maneuvers to fit and which to judge the fit by: ids, each in order.

    Within each kind, maneuvers are lined up by control and airspeed and every so many is held out,
    so both parts cover the same. The last input left on a control stays in the fit; otherwise a
    kind flown twice or more is in both parts. A maneuver whose `held_out` is set stays where it is
    set.

    Args:
        segments: maneuvers of one or more flights, ids unique.
        held_out: share to hold out.
    """
    everything = sorted(segments, key=lambda item: (item.start, item.id))
    chosen = {item.id for item in everything if item.held_out}
    free = [item for item in everything if item.held_out is None]
    if held_out > 0.0:
        for kind in sorted({item.kind for item in free}):
            chosen |= _held(
                [item for item in free if item.kind == kind], everything, chosen, held_out
            )
    fit = tuple(item.id for item in everything if item.id not in chosen)
    return fit, tuple(item.id for item in everything if item.id in chosen)


def _held(
    candidates: list[Segment], everything: list[Segment], chosen: set[int], share: float
) -> set[int]:
    """Ids to hold out of one kind: evenly along (controls, airspeed), and none the fit needs."""
    lined = sorted(
        candidates, key=lambda item: (item.controls, np.nan_to_num(item.airspeed), item.start)
    )
    # Half a step ahead, so that the middle airspeed of three is the one held out.
    steps = np.floor(0.5 + share * np.arange(len(lined) + 1) + 1e-9)
    wanted = [item for item, step in zip(lined, np.diff(steps), strict=True) if step > 0]
    held: set[int] = set()
    for item in wanted[: len(lined) - 1]:
        if not _only_one(item, everything, chosen | held):
            held.add(item.id)
    middle = sorted(lined, key=lambda item: abs(lined.index(item) - len(lined) // 2))
    spare = [item for item in middle if not _only_one(item, everything, chosen)]
    return held or ({spare[0].id} if len(lined) > 1 and spare else set())


def _only_one(item: Segment, everything: list[Segment], gone: set[int]) -> bool:
    """Whether `item` holds the last deliberate input left on one of its controls."""
    if item.kind not in INPUTS:
        return False
    left = Counter(
        control
        for other in everything
        if other.kind in INPUTS and other.id not in gone and other.id != item.id
        for control in other.controls
    )
    return any(not left[control] for control in item.controls)
