"""A CAN log beside a flight: its clock found by signals that both measured, its streams added."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.signal import correlate

from gcs_sysid.errors import SourceError
from gcs_sysid.recording import Recording, Stream
from gcs_sysid.sources import joined
from gcs_sysid.sources.can import files, streams, transfers

STEP = 0.02
"""Step of the grid on which signals are compared [s]; finer differences come from the fit."""
SHORTEST = 20.0
"""Two signals must overlap for so long [s]."""
ALIKE = 0.7
"""Correlation from which two signals are one quantity seen twice."""
_ROUNDS = 8

_PAIRS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    (streams.UNIT, "q", ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "ATTITUDE")),
    (streams.UNIT, "p", ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "ATTITUDE")),
    ("AOA_SSA", "alpha", ("AOA_SSA",)),
    ("AOA_SSA", "beta", ("AOA_SSA",)),
    ("AIRSPEED", "airspeed", ("AIRSPEED", "VFR_HUD")),
    ("SCALED_PRESSURE", "dynamic_pressure", ("SCALED_PRESSURE", "HIGHRES_IMU")),
    ("SCALED_PRESSURE", "static_pressure", ("SCALED_PRESSURE", "HIGHRES_IMU")),
    *(
        ("ESC_STATUS", f"rpm_{n}", ("ESC_STATUS", "RPM", "ESC_TELEMETRY_1_TO_4"))
        for n in range(1, 5)
    ),
)
"""Stream on the bus, channel, streams of the flight in which the same is measured."""


@dataclass(frozen=True)
class Offset:
    """Shift of the bus' streams to the flight's [s], its deviation, and by which signal."""

    value: float
    deviation: float
    signal: str


def beside(recording: Recording, path: Path) -> Recording:
    """The recording with what a CAN log measured, on the flight's clock.

    Args:
        recording: the flight.
        path: the CAN log.

    Raises:
        SourceError: the log cannot be read, or shares no signal with the flight.
    """
    found, lost = transfers.transfers(files.frames(path))
    pieces, short = streams.pieces(found)
    if not pieces:
        raise SourceError(
            str(path),
            "holds no DroneCAN message that tells of the flight",
            fix="record air data, actuator or ESC status",
        )
    start_us = min(float(piece.time_us.min()) for piece in pieces)
    own = joined.streams(pieces, start_us, beside_us=joined.BESIDE_US)
    offset = _offset(recording, own)
    if offset is None:
        asked = sorted({f"{name}.{channel}" for name, channel, _ in _PAIRS if name in own})
        raise SourceError(
            str(path),
            "shares no signal with the flight that tells its clock"
            + (f" (looked at {', '.join(asked)})" if asked else ""),
            fix="record an inertial unit, airspeed or pressure on the bus, or ask the autopilot to "
            "tunnel it (CAN_FRAME)",
        )
    ahead = offset.value + 1e-6 * (recording.epoch_us - start_us)
    note = (
        f"{path.name}: CAN clock put on the flight's by {offset.signal}, offset {ahead:.4f} s with "
        f"a deviation of {1e3 * offset.deviation:.2g} ms"
    )
    counts = {**lost, "can_truncated": lost["can_truncated"] + short}
    return _added(recording, _moved(own, offset.value), counts, note)


def tunnelled(recording: Recording, frames: Sequence[transfers.CanFrame]) -> Recording:
    """The recording with what frames carried that came through the autopilot, on its clock."""
    found, lost = transfers.transfers(frames)
    pieces, short = streams.pieces(found)
    if not pieces:
        return recording
    own = joined.streams(pieces, float(recording.epoch_us), beside_us=joined.BESIDE_US)
    counts = {**lost, "can_truncated": lost["can_truncated"] + short}
    note = f"{len(found)} CAN messages came through the autopilot, at the times of their frames"
    return _added(recording, own, counts, note)


def alongside(recording: Recording, frames: Sequence[transfers.CanFrame]) -> Recording:
    """The recording with what a bus at the ground station brought, stamped by its clock.

    Shared signals put it on the flight's clock; without any it counts as promptly as the typical
    message came from the vehicle.
    """
    found, lost = transfers.transfers(frames)
    pieces, short = streams.pieces(found)
    if not pieces:
        return recording
    own = joined.streams(pieces, float(recording.epoch_us), beside_us=joined.BESIDE_US)
    offset = _offset(recording, own)
    if offset is None:
        late = [s.link_time - s.time for s in recording.streams.values() if s.stamped]
        shift = -float(np.median(np.concatenate(late))) if late else 0.0
        note = "CAN bus: no shared signal tells its clock; taken as prompt as the telemetry"
    else:
        shift = offset.value
        note = (
            f"CAN bus: put on the flight's clock by {offset.signal}, {1e3 * shift:.1f} ms with a "
            f"deviation of {1e3 * offset.deviation:.2g} ms"
        )
    counts = {**lost, "can_truncated": lost["can_truncated"] + short}
    return _added(recording, _moved(own, shift), counts, note)


def _moved(own: dict[str, Stream], shift: float) -> dict[str, Stream]:
    return {
        name: replace(stream, time=stream.time + shift, link_time=stream.time + shift)
        for name, stream in own.items()
    }


def _added(
    recording: Recording, own: dict[str, Stream], lost: dict[str, int], note: str
) -> Recording:
    """What was measured on the bus takes the place of estimates, and of streams that hold less."""
    result = dict(recording.streams)
    notes = [note]
    for name, stream in own.items():
        before = result.get(name)
        if before is not None:
            known = {channel for channel in before.channels if before.has(channel)}
            if name not in streams.ESTIMATES and not known <= set(stream.channels):
                beside = f"{name}[{streams.BUS}]"
                result[beside] = replace(stream, name=beside)
                continue
            kept = f"{name}[{streams.AUTOPILOT}]"
            result[kept] = replace(before, name=kept)
            notes.append(f"{name} is that of the CAN bus; the autopilot's is {kept}")
        result[name] = stream
    return replace(
        recording,
        streams=dict(sorted(result.items())),
        lost={**recording.lost, **{k: v for k, v in lost.items() if v}},
        clock_notes=(*recording.clock_notes, *notes),
    )


def _offset(recording: Recording, own: dict[str, Stream]) -> Offset | None:
    """The most certain of the offsets that shared signals tell."""
    found = [*_offsets(recording, own)]
    return min(found, key=lambda one: one.deviation) if found else None


def _offsets(recording: Recording, own: dict[str, Stream]) -> Iterator[Offset]:
    for name, channel, names in _PAIRS:
        stream = own.get(name)
        flight = recording.first(names, channel)
        if stream is None or flight is None or not stream.has(channel):
            continue
        offset = shared_signal(_series(stream, channel), _series(flight, channel))
        if offset is not None:
            yield Offset(*offset, f"{name}.{channel}")


Series = tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]


def _series(stream: Stream, channel: str) -> Series:
    good = stream.valid(channel)
    time, first = np.unique(stream.time[good], return_index=True)
    return time, stream.channels[channel][good][first]


Reference = tuple[Float[np.ndarray, " other"], Float[np.ndarray, " other"]]


def shared_signal(own: Series, flight: Reference) -> tuple[float, float] | None:
    """By how much [s] the clock of `own` must be put forward, and one standard deviation.

    The best place of the normalised correlation over all shifts, then least squares in shift, scale
    and bias; coloured residuals count as fewer samples. None where the two are not alike.
    """
    if own[0].size < 10 or flight[0].size < 10:
        return None
    x, y = _gridded(own), _gridded(flight)
    if min(x.size, y.size) * STEP < SHORTEST:
        return None
    lag = _best_lag(x, y)
    if lag is None:
        return None
    return _fitted(own, flight, flight[0][0] - own[0][0] + lag * STEP)


def _gridded(series: Series) -> Float[np.ndarray, " tick"]:
    time, values = series
    grid = np.arange(time[0], time[-1], STEP)
    return np.interp(grid, time, values)


def _best_lag(x: Float[np.ndarray, " tick"], y: Float[np.ndarray, " tock"]) -> int | None:
    """Ticks by which `x` begins after `y` where they are most alike; None where nowhere."""
    x, y = x - x.mean(), y - y.mean()
    ones_x, ones_y = np.ones_like(x), np.ones_like(y)
    overlap = correlate(ones_y, ones_x, method="fft")
    product = correlate(y, x, method="fft")
    sums = correlate(ones_y, x, method="fft"), correlate(y, ones_x, method="fft")
    squares = correlate(ones_y, x * x, method="fft"), correlate(y * y, ones_x, method="fft")
    enough = overlap * STEP >= min(SHORTEST, 0.5 * min(x.size, y.size) * STEP)
    count = np.maximum(overlap, 1.0)
    spread = (squares[0] - sums[0] ** 2 / count) * (squares[1] - sums[1] ** 2 / count)
    floor = 1e-6 * float(np.sum(x * x)) * float(np.sum(y * y))
    usable = enough & (spread > floor)
    if not usable.any():
        return None
    likeness = np.where(
        usable, (product - sums[0] * sums[1] / count) / np.sqrt(np.where(usable, spread, 1.0)), -1.0
    )
    best = int(np.argmax(likeness))
    return best - (x.size - 1) if likeness[best] >= ALIKE else None


def _fitted(own: Series, flight: Reference, start: float) -> tuple[float, float]:
    """Shift and its deviation by Gauss–Newton on the flight's samples."""
    shift = start
    time, values = flight
    deviation = STEP
    for _ in range(_ROUNDS):
        inside = (time >= own[0][0] + shift) & (time <= own[0][-1] + shift)
        seen = np.interp(time[inside] - shift, *own)
        ahead = np.interp(time[inside] - shift + 0.5 * STEP, *own)
        slope = (ahead - np.interp(time[inside] - shift - 0.5 * STEP, *own)) / STEP
        scale = float(np.std(values[inside]) / max(np.std(seen), 1e-12))
        design = np.stack([-scale * slope, seen, np.ones_like(seen)], axis=1)
        solution, *_ = np.linalg.lstsq(design, values[inside] - scale * seen, rcond=None)
        residual = values[inside] - scale * seen - design @ solution
        shift += float(np.clip(solution[0], -STEP, STEP))
        deviation = _deviation(design, residual)
    return shift, deviation


def _deviation(
    design: Float[np.ndarray, "sample unknown"], residual: Float[np.ndarray, " sample"]
) -> float:
    """Of the first unknown, with residuals that follow each other as a first-order process."""
    centred = residual - residual.mean()
    power = float(centred @ centred)
    alike = float(centred[1:] @ centred[:-1]) / power if power > 0.0 else 0.0
    fewer = (1.0 + max(alike, 0.0)) / max(1.0 - max(alike, 0.0), 1e-3)
    variance = power / max(residual.size - 3, 1) * fewer
    return float(np.sqrt(variance * np.linalg.pinv(design.T @ design)[0, 0]))
