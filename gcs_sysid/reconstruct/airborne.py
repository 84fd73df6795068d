"""When the aircraft flew on its wing, from whatever speeds the log holds.

Arming is no evidence: a test may disarm in the air, and an armed aircraft may stand on the runway.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.reconstruct.measurements import AIRSPEED_STREAMS, VELOCITY_STREAMS
from gcs_sysid.recording import Recording, Stream

Interval = tuple[float, float]

CLOCK = 5.0
"""Rate of the clock on which speeds are looked at [Hz]."""
LIFT_OFF = 1.5
"""Flying speed must last this long to be a flight [s]: a sensor's start-up spike does not."""
LANDED = 3.0
"""So long below flying speed is a landing [s]; a push over the top of a loop is shorter."""
SHORTEST_FLIGHT = 5.0
SETTLING = 5.0
"""So long after lift-off [s] an autopilot's estimates are not yet to be relied on."""


def airborne(recording: Recording, aircraft: Aircraft | None = None) -> tuple[Interval, ...]:
    """Intervals of wing-borne flight [s after the epoch], in order.

    Flying begins above a speed that only a flying aircraft has and ends below a lower one. The
    aircraft file's slowest airspeed sets both; without a file they come from the speeds in the log.
    Where airspeed was not measured, speed over ground stands in for it. A log that begins or ends
    in the air is flown to its edge; hovering is not flight here.
    """
    over_ground = ground_speed(recording)
    through_air = recording.first(AIRSPEED_STREAMS, "airspeed")
    if through_air is not None:
        stream_time, speed = _valid(through_air, "airspeed")
    elif over_ground is not None:
        stream_time, speed = over_ground
    else:
        return ()
    if stream_time.size < 5:
        return ()
    time = np.arange(float(stream_time[0]), float(stream_time[-1]) + 1e-9, 1.0 / CLOCK)
    smooth = ndimage.median_filter(np.interp(time, stream_time, speed), int(CLOCK))
    moving = _moving(recording, time, over_ground)
    begin, end = _thresholds(smooth[moving & (smooth > 3.0)], aircraft)
    flying = _with_memory(moving & (smooth > begin), smooth > end)
    spans = [(float(time[first]), float(time[last])) for first, last in _runs(flying)]
    return tuple(span for span in spans if span[1] - span[0] >= SHORTEST_FLIGHT)


def settled(recording: Recording, aircraft: Aircraft | None = None) -> tuple[Interval, ...]:
    """Flight less the first `SETTLING` after each lift-off; a log that begins in the air has none.

    A launch is when an autopilot finds its heading: its attitude may be wrong by tens of degrees.
    """
    first = min(float(stream.time[0]) for stream in recording.streams.values() if stream.count)
    flights = airborne(recording, aircraft)
    begun = [(start if start < first + 1.0 else start + SETTLING, end) for start, end in flights]
    return tuple((start, end) for start, end in begun if end > start)


def ground_speed(
    recording: Recording,
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]] | None:
    """Times [s] and horizontal speed over ground [m/s], where velocity was measured."""
    stream = recording.first(VELOCITY_STREAMS, "v_north", "v_east")
    if stream is None:
        return None
    good = stream.valid("v_north") & stream.valid("v_east")
    speed = np.hypot(stream.channels["v_north"][good], stream.channels["v_east"][good])
    return stream.time[good], speed


def _valid(
    stream: Stream, channel: str
) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
    good = stream.valid(channel)
    return stream.time[good], np.asarray(stream.channels[channel])[good]


def _moving(
    recording: Recording,
    time: Float[np.ndarray, " tick"],
    over_ground: tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]] | None,
) -> Bool[np.ndarray, " tick"]:
    """Whether anything but the pitot tube says that the aircraft is under way."""
    if over_ground is None or over_ground[0].size < 2:
        return np.ones(time.size, dtype=bool)
    moving = np.interp(time, *over_ground) > 2.0
    heights = recording.first(("GLOBAL_POSITION_INT", "ALTITUDE"), "height")
    if heights is None:
        return moving
    return moving | (np.interp(time, *_valid(heights, "height")) > 10.0)


def _thresholds(
    speed: Float[np.ndarray, " tick"], aircraft: Aircraft | None
) -> tuple[float, float]:
    """Speeds [m/s] above which a flight begins and below which it ends."""
    if aircraft is not None and aircraft.envelope is not None:
        slowest = aircraft.envelope.airspeed[0]
        return 0.75 * slowest, 0.55 * slowest
    if speed.size < CLOCK * SHORTEST_FLIGHT:
        return np.inf, np.inf
    usual = float(np.percentile(speed, 75.0))
    return 0.6 * usual, 0.4 * usual


def _with_memory(
    begins: Bool[np.ndarray, " tick"], stays: Bool[np.ndarray, " tick"]
) -> Bool[np.ndarray, " tick"]:
    """Stretches of `stays`, short holes closed, in which `begins` held long enough."""
    hole = max(2, round(LANDED * CLOCK))
    closed = ~_longer(~stays, hole)
    labels, _ = ndimage.label(closed)
    flown = np.unique(labels[_longer(begins, round(LIFT_OFF * CLOCK)) & closed])
    return np.isin(labels, flown[flown > 0])


def _longer(mask: Bool[np.ndarray, " tick"], ticks: int) -> Bool[np.ndarray, " tick"]:
    """The runs of `mask` that last at least `ticks`; a run cut by the log's edge counts whole."""
    result = np.zeros_like(mask)
    for first, last in _runs(mask):
        if last - first + 1 >= ticks:
            result[first : last + 1] = True
    return result


def _runs(mask: Bool[np.ndarray, " tick"]) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    labels, count = ndimage.label(mask)
    return [(s[0].start, s[0].stop - 1) for s in ndimage.find_objects(labels, count)]
