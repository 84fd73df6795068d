"""Brings all messages of one vehicle onto one clock.

The vehicle's boot clock is the truth about when a sample was taken; the ground station's arrival
times are late, jittered and, on a busy computer or in a simulation, uneven. Boot times are
unwrapped, separated at reboots and shifted to wall time by SYSTEM_TIME, or, without it, by the
earliest arrivals. Messages without a stamp get the time of the stamped messages that they travelled
with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.sources.tables import MessageTable

Microseconds = Int[np.ndarray, " message"]
Reference = Int[np.ndarray, " stamp"]

FRESH = (
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "RAW_IMU",
    "SCALED_IMU",
    "SCALED_IMU2",
    "SCALED_IMU3",
    "HIGHRES_IMU",
    "SERVO_OUTPUT_RAW",
    "RC_CHANNELS",
    "SCALED_PRESSURE",
    "GLOBAL_POSITION_INT",
    "LOCAL_POSITION_NED",
    "AOA_SSA",
    "SYSTEM_TIME",
)
"""Types whose stamp is the moment of sending, as far as autopilots are known; a GPS_RAW_INT, for
instance, may repeat a fix that is a second old."""

WRAP_US: Mapping[str, int] = {"time_boot_ms": 2**32 * 1000, "time_usec": 2**32}
"""After how long a stamp starts again: 32 bits of milliseconds, and of microseconds where the field
or the autopilot's timer has no more (SERVO_OUTPUT_RAW; ArduPilot before 64-bit timers)."""

UNIX_US = 10**15
"""A `time_usec` above this counts from 1970, below from boot (the definition: "the receiving end
can infer timestamp format by checking for the magnitude of the number")."""

REBOOT_US = 2_000_000
"""A boot clock that falls back by more than this, and stays back, has restarted."""

PLAUSIBLE_US = 10_000_000
"""A stamp further than this from those around it is not the time of sampling."""

BELONGS = 0.03
"""A stream whose messages sit within this fraction of the pause beside a stamped neighbour was sent
together with it."""


@dataclass(frozen=True)
class Clocked:
    """When the messages of each type were sampled.

    Attributes:
        time_us: by stream name [µs since 1970 on the log clock], one entry a message.
        stamped: by stream name, whether these are the vehicle's own stamps.
        notes: what was done, one sentence each.
    """

    time_us: Mapping[str, Microseconds]
    stamped: Mapping[str, bool]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Pool:
    """Reference stamps of all fresh streams in the order of the log; log clock = boot + offset."""

    order: Reference
    link_us: Reference
    boot_us: Reference
    session: Reference
    offset_us: Int[np.ndarray, " session"]

    @property
    def time_us(self) -> Reference:
        return self.boot_us + self.offset_us[self.session]

    def session_at(self, order: Microseconds) -> Microseconds:
        at = np.searchsorted(self.order, order, side="right") - 1
        return self.session[np.clip(at, 0, None)]


def align(tables: Mapping[str, MessageTable]) -> Clocked:
    """Times of all messages of one vehicle on one clock.

    Args:
        tables: the vehicle's messages by stream name.
    """
    stamps = {name: stamp for name, table in tables.items() if (stamp := _stamp(table)) is not None}
    fresh = [n for n in stamps if n in FRESH] or list(stamps)
    if not fresh:
        return Clocked(
            {name: table.link_us for name, table in tables.items()},
            dict.fromkeys(tables, False),
            ("no message carries the vehicle's own time: arrival times are used as they are",),
        )
    pool, notes = _reference(tables, stamps, fresh)
    time_us: dict[str, Microseconds] = {}
    stamped: dict[str, bool] = {}
    for name, table in tables.items():
        own, note = _own_time(name, table, stamps.get(name), pool)
        stamped[name] = own is not None
        if own is None:
            own, note = _travelled_with(name, table, pool)
        time_us[name] = own
        notes.extend(note)
    return Clocked(time_us, stamped, tuple(notes))


def _stamp(table: MessageTable) -> Microseconds | None:
    """The messages' own stamps [µs, as sent], or None if they have none worth the name."""
    if "time_boot_ms" in table.fields:
        stamp = table.fields["time_boot_ms"].astype(np.int64) * 1000
    elif "time_usec" in table.fields:
        stamp = np.minimum(table.fields["time_usec"].astype(np.uint64), 2**62).astype(np.int64)
    else:
        return None
    constant = stamp.size > 2 and np.all(stamp == stamp[0])
    return None if constant or not np.any(stamp) else stamp


def _wrap(table: MessageTable) -> int:
    return WRAP_US["time_boot_ms" if "time_boot_ms" in table.fields else "time_usec"]


def _reference(
    tables: Mapping[str, MessageTable], stamps: Mapping[str, Microseconds], fresh: list[str]
) -> tuple[_Pool, list[str]]:
    """Pool of stamps that defines the vehicle's clock, and what was noticed in it."""
    milliseconds = [name for name in fresh if "time_boot_ms" in tables[name].fields]
    names = milliseconds or [fresh[0]]
    order = np.concatenate([tables[name].order for name in names])
    sort = np.argsort(order)
    link = np.concatenate([tables[name].link_us for name in names])[sort]
    raw = np.concatenate([stamps[name] for name in names])[sort]
    boot, wraps = _unwrapped(raw, _wrap(tables[names[0]]))
    session = _sessions(boot)
    order = order[sort]
    bare = _Pool(order, link, boot, session, np.zeros(session[-1] + 1, dtype=np.int64))
    offset, notes = _offsets(bare, tables.get("SYSTEM_TIME"))
    if wraps:
        notes.append(f"the boot clock wrapped {wraps} time(s) and was continued")
    return _Pool(order, link, boot, session, offset), notes


def _unwrapped(stamp: Reference, period: int) -> tuple[Reference, int]:
    """Stamps continued past the end of their counter, and how often it ended."""
    turns = -np.cumsum(np.round(np.diff(stamp, prepend=stamp[:1]) / period)).astype(np.int64)
    return stamp + turns * period, int(turns[-1])


def _sessions(boot_us: Reference) -> Reference:
    """Which run of the autopilot each stamp belongs to, counted from zero."""
    session = np.zeros(boot_us.size, dtype=np.int64)
    start = 0
    while True:
        latest = np.maximum.accumulate(boot_us[start:])
        back = np.flatnonzero(boot_us[start:] < latest - REBOOT_US)
        # A single late message is not a reboot: the clock must stay back.
        restart = next(
            (b for b in back if np.median(boot_us[start + b :][:9]) < latest[b] - REBOOT_US), None
        )
        if restart is None:
            return session
        start += int(restart)
        session[start:] += 1


def _offsets(
    pool: _Pool, system_time: MessageTable | None
) -> tuple[Int[np.ndarray, " session"], list[str]]:
    """Log clock minus boot clock of each session [µs]."""
    count = int(pool.session[-1]) + 1
    arrival = np.array([_earliest(pool, i) for i in range(count)])
    wall = np.full(count, np.nan)
    notes = []
    for i in range(count):
        differences = _wall_minus_boot(pool, system_time, i)
        if differences.size:
            wall[i] = np.median(differences)
            notes.append(
                f"wall time from {differences.size} SYSTEM_TIME messages, boot at "
                f"{wall[i] / 1e6:.6f} s since 1970, spread {np.ptp(differences) / 1e6:.6f} s"
            )
    known = np.isfinite(wall)
    shift = np.median((wall - arrival)[known]) if known.any() else 0.0
    offset = np.where(known, wall, arrival + shift)
    if not known.all():
        notes.append(
            f"no wall time from the vehicle in {np.sum(~known)} of {count} run(s) of the "
            "autopilot: its clock was set by the earliest arrivals"
        )
    if count > 1:
        notes.append(f"the autopilot restarted {count - 1} time(s) in this log")
    late = pool.link_us - pool.boot_us - arrival[pool.session]
    notes.append(
        f"arrivals are {np.median(late) / 1e3:.1f} ms (median) and {np.max(late) / 1e3:.1f} ms "
        "(most) later than the earliest ones; the vehicle's own stamps are used"
    )
    return np.round(offset).astype(np.int64), notes


def _earliest(pool: _Pool, session: int) -> int:
    """Arrival minus boot clock of the promptest messages: one in a thousand may be wrong."""
    late = (pool.link_us - pool.boot_us)[pool.session == session]
    few = late.size // 1000
    return int(np.partition(late, few)[few])


def _wall_minus_boot(pool: _Pool, table: MessageTable | None, session: int) -> Microseconds:
    if table is None:
        return np.zeros(0, dtype=np.int64)
    unix = table.fields["time_unix_usec"].astype(np.int64)
    ours = (unix > UNIX_US) & (pool.session_at(table.order) == session)
    boot = table.fields["time_boot_ms"].astype(np.int64) * 1000
    boot = _nearest_turn(boot, pool, table, WRAP_US["time_boot_ms"])
    return (unix - boot)[ours]


def _nearest_turn(
    stamp: Microseconds, pool: _Pool, table: MessageTable, period: int
) -> Microseconds:
    """Stamps continued by whole turns of their counter to agree with those received around them."""
    near = np.clip(np.searchsorted(pool.order, table.order), 0, pool.order.size - 1)
    turns = np.round((pool.boot_us[near] - stamp) / period).astype(np.int64)
    return stamp + turns * period


def _own_time(
    name: str, table: MessageTable, stamp: Microseconds | None, pool: _Pool
) -> tuple[Microseconds | None, list[str]]:
    """Log-clock times from the messages' own stamps, or None if these are no sampling times."""
    if stamp is None:
        return None, []
    offset = pool.offset_us[pool.session_at(table.order)]
    boot = np.where(stamp > UNIX_US, stamp - offset, stamp)
    boot = _nearest_turn(boot, pool, table, _wrap(table))
    near = np.clip(np.searchsorted(pool.order, table.order), 0, pool.order.size - 1)
    sane = np.abs(boot - pool.boot_us[near]) < PLAUSIBLE_US
    if np.mean(sane) < 0.9:
        return None, []
    time = boot + offset
    if np.all(sane):
        return time, []
    inferred, _ = _travelled_with(name, table, pool)
    note = f"{name}: {np.sum(~sane)} stamps are far from the clock and were replaced by arrival"
    return np.where(sane, time, inferred), [note]


def _travelled_with(name: str, table: MessageTable, pool: _Pool) -> tuple[Microseconds, list[str]]:
    """Log-clock times of messages without a stamp, from the stamped ones received around them.

    Autopilots send in bursts: a message that always arrives right behind (or right before) a
    stamped one was taken with it. Otherwise the arrival is placed linearly between its two
    neighbours, and a stream that proves periodic is put on its period.
    """
    fraction, before, after = _between(table, pool)
    apart = np.abs(after - before) > 2000
    typical = float(np.median(fraction[apart])) if apart.any() else 0.0
    if typical < BELONGS:
        return before, []
    if typical > 1.0 - BELONGS:
        return after, []
    time = before + (after - before) * fraction
    periodic, spread = _on_period(time)
    if periodic is None:
        return np.round(time).astype(np.int64), []
    note = (
        f"{name}: carries no stamp; {table.count} arrivals, {spread / 1e3:.1f} ms rms about an "
        "even period, were put on that period"
    )
    return np.round(periodic).astype(np.int64), [note]


def _between(
    table: MessageTable, pool: _Pool
) -> tuple[Float[np.ndarray, " message"], Microseconds, Microseconds]:
    """Where each message arrived between its stamped neighbours (0 to 1), and their times."""
    clock = pool.time_us
    after = np.searchsorted(pool.order, table.order)
    left = np.clip(after - 1, 0, pool.order.size - 1)
    right = np.clip(after, 0, pool.order.size - 1)
    pause = pool.link_us[right] - pool.link_us[left]
    ahead = table.link_us - pool.link_us[left]
    # Before the first and after the last stamped message only the distance in arrival is known.
    first, last = after == 0, after == pool.order.size
    fraction = np.where(pause > 0, ahead / np.maximum(pause, 1), 0.5)
    fraction = np.where(first, 0.0, np.where(last, 1.0, np.clip(fraction, 0.0, 1.0)))
    before = clock[left] + np.where(first, ahead, 0)
    return fraction, before, clock[right] + np.where(last, ahead, 0)


def _on_period(
    time: Float[np.ndarray, " message"],
) -> tuple[Float[np.ndarray, " message"] | None, float]:
    """Times on an even period, if they are clearly periodic, and their rms distance to it [µs]."""
    if time.size < 50:
        return None, 0.0
    steps = np.diff(time)
    period = float(np.median(steps))
    if period <= 0.0:
        return None, 0.0
    number = np.concatenate([[0.0], np.cumsum(np.round(steps / period))])
    for _ in range(2):
        period, start = np.polyfit(number, time - time[0], 1)
        number = np.round((time - time[0] - start) / period)
    even = time[0] + start + period * number
    spread = float(np.sqrt(np.mean((time - even) ** 2)))
    clear = spread < 0.15 * period and np.all(np.diff(number) > 0)
    return (even if clear else None), spread
