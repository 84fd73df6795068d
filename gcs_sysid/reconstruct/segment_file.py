"""The editable list of maneuvers: JSON as `inspect` writes it, as a person may change it.

An entry may be deleted, shifted, given another kind, or told `"use": false` (left out altogether)
or `"held_out": true` or `false`. Times may be given on the log's clock (`start_us`, `end_us`) or
from its start (`start_s`, `duration_s`); where both stand they must agree.
"""

from __future__ import annotations

import difflib
import itertools
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from gcs_sysid.errors import InputError
from gcs_sysid.reconstruct.segments import KINDS, Segment

_KEYS = ("id kind start_us end_us start_s duration_s controls airspeed_mean held_out use").split()
_SAME_TIME = 1e-3
"""Times that differ by less [s] are the same: files hold milliseconds."""
_OTHER_LOG = 600.0
"""Nobody shifts a maneuver by more [s]: the list belongs to another log."""


def entries(segments: Iterable[Segment], *, epoch_us: int) -> list[dict[str, Any]]:
    """Maneuvers as plain dictionaries for a document; times to the microsecond."""
    return [
        {
            "id": segment.id,
            "kind": segment.kind,
            "start_us": epoch_us + round(segment.start * 1e6),
            "end_us": epoch_us + round(segment.end * 1e6),
            "start_s": round(segment.start, 3),
            "duration_s": round(segment.duration, 3),
            "controls": list(segment.controls),
            "airspeed_mean": None if math.isnan(segment.airspeed) else round(segment.airspeed, 3),
            **({} if segment.held_out is None else {"held_out": segment.held_out}),
        }
        for segment in segments
    ]


def parse(text: str, *, name: str, epoch_us: int, last: float = math.inf) -> tuple[Segment, ...]:
    """Maneuvers from the text of a segments file, in order of time.

    Args:
        text: JSON: `inspect.json`, or an object with only its `maneuvers`, or that list itself.
        name: file name for messages.
        epoch_us: log clock at the recording's time zero [µs since 1970].
        last: end of the recording [s after the epoch].

    Returns:
        The maneuvers to use; ids as given, numbered by time where an entry has none.

    Raises:
        InputError: the text is not such a list; the message names the entry.
    """
    found = [
        _segment(entry, f"maneuvers[{index}]", name, epoch_us)
        for index, entry in enumerate(_list(text, name))
        if _used(entry, f"maneuvers[{index}]", name)
    ]
    if not found:
        raise InputError(name, "no maneuver is left", fix="keep at least one in `maneuvers`")
    found.sort(key=lambda item: item[1].start)
    _check_apart(found, name, last)
    return _numbered(found, name)


def _list(text: str, name: str) -> list[Any]:
    try:
        document = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(
            f"{name}, line {error.lineno}", f"not JSON ({error.msg})", fix="repair that line"
        ) from error
    listed = document.get("maneuvers") if isinstance(document, dict) else document
    if not isinstance(listed, list):
        raise InputError(
            name,
            "holds no list `maneuvers`",
            fix="start from the inspect.json that `gcs-sysid inspect LOG` writes",
        )
    return listed


def _used(entry: Any, where: str, name: str) -> bool:
    if not isinstance(entry, dict):
        raise InputError(f"{name}: {where}", "is no object", fix="write {...} as inspect does")
    for key in entry:
        if key not in _KEYS:
            near = difflib.get_close_matches(key, _KEYS, n=1)
            raise InputError(
                f"{name}: {where}.{key}",
                "unknown key",
                fix=f"did you mean `{near[0]}`?" if near else f"allowed: {', '.join(_KEYS)}",
            )
    use = entry.get("use", True)
    if not isinstance(use, bool):
        raise InputError(f"{name}: {where}.use", f"found {use!r}", fix="write true or false")
    return use


def _segment(entry: Mapping[str, Any], where: str, name: str, epoch_us: int) -> tuple[str, Segment]:
    kind = entry.get("kind")
    if kind not in KINDS:
        raise InputError(
            f"{name}: {where}.kind", f"found {kind!r}", fix=f"write one of {', '.join(KINDS)}"
        )
    held_out = entry.get("held_out")
    if held_out is not None and not isinstance(held_out, bool):
        raise InputError(
            f"{name}: {where}.held_out", f"found {held_out!r}", fix="write true or false"
        )
    controls = entry.get("controls", [])
    if not isinstance(controls, list) or not all(isinstance(item, str) for item in controls):
        raise InputError(
            f"{name}: {where}.controls", f"found {controls!r}", fix="write a list of names"
        )
    number = entry.get("id")
    if number is not None and (isinstance(number, bool) or not isinstance(number, int)):
        raise InputError(f"{name}: {where}.id", f"found {number!r}", fix="write a whole number")
    start = _time(entry, "start_us", "start_s", where, name, epoch_us)
    if start is None:
        raise InputError(f"{name}: {where}", "no start", fix="give `start_s` or `start_us`")
    end = _time(entry, "end_us", "duration_s", where, name, epoch_us, after=start)
    if end is None:
        raise InputError(f"{name}: {where}", "no end", fix="give `duration_s` or `end_us`")
    if end <= start:
        raise InputError(
            f"{name}: {where}", f"ends {start - end:g} s before it starts", fix="mend its times"
        )
    identifier = -1 if number is None else number
    speed = _number(entry, "airspeed_mean", where, name)
    return where, Segment(
        identifier,
        str(kind),
        start,
        end,
        tuple(controls),
        math.nan if speed is None else speed,
        held_out,
    )


def _time(
    entry: Mapping[str, Any],
    clock_key: str,
    plain_key: str,
    where: str,
    name: str,
    epoch_us: int,
    *,
    after: float = 0.0,
) -> float | None:
    """A time [s after the epoch] given on the log's clock, or in s after `after`, or both."""
    on_clock = _number(entry, clock_key, where, name)
    plain = _number(entry, plain_key, where, name)
    if on_clock is not None:
        on_clock = (on_clock - epoch_us) * 1e-6
    if plain is not None:
        plain += after
    apart = 0.0 if on_clock is None or plain is None else abs(on_clock - plain)
    if apart > _OTHER_LOG:
        raise InputError(
            f"{name}: {where}.{clock_key}",
            "is not on the clock of this log",
            fix="give the log that this list was made for, or delete `start_us` and `end_us`",
        )
    if apart > 2.0 * _SAME_TIME:
        raise InputError(
            f"{name}: {where}",
            f"`{clock_key}` and `{plain_key}` differ by {apart:.3f} s",
            fix="delete the one that is not meant",
        )
    return plain if on_clock is None else on_clock


def _number(entry: Mapping[str, Any], key: str, where: str, name: str) -> int | float | None:
    value = entry.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{name}: {where}.{key}", f"found {value!r}", fix="write a number")
    return value


def _check_apart(found: list[tuple[str, Segment]], name: str, last: float) -> None:
    for where, segment in found:
        if segment.start < -_SAME_TIME or segment.end > last + _SAME_TIME:
            raise InputError(
                f"{name}: {where}",
                f"{segment.start:.1f} to {segment.end:.1f} s is not within 0 to {last:.1f} s",
                fix="mend its times, or give the log that this list was made for",
            )
    for (first_where, first), (where, segment) in itertools.pairwise(found):
        if segment.start < first.end - _SAME_TIME:
            raise InputError(
                f"{name}: {where}",
                f"overlaps {first_where} by {first.end - segment.start:.3f} s",
                fix="end one before the other starts",
            )


def _numbered(found: list[tuple[str, Segment]], name: str) -> tuple[Segment, ...]:
    taken = {segment.id for _, segment in found if segment.id >= 0}
    if len(taken) < sum(segment.id >= 0 for _, segment in found):
        raise InputError(name, "two maneuvers have the same `id`", fix="make ids unique")
    free = (number for number in itertools.count(1) if number not in taken)
    return tuple(
        segment if segment.id >= 0 else replace(segment, id=next(free)) for _, segment in found
    )
