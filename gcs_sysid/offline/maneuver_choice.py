"""Which maneuvers of a recording a run uses, and which of them are fitted and which judge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import InputError
from gcs_sysid.offline.flight import Flight
from gcs_sysid.reconstruct import segment_file, segments
from gcs_sysid.reconstruct.segments import Segment, split
from gcs_sysid.recording import Recording


def chooser(
    path: Path | None, aircraft: Aircraft | None
) -> Callable[[Recording], tuple[Segment, ...]]:
    """Finds the maneuvers of a recording; from the segments file `path` where one is given.

    Raises:
        InputError: (by the function returned) the file cannot be read or is not such a list.
    """

    def choose(recording: Recording) -> tuple[Segment, ...]:
        if path is None:
            return segments.find(recording, aircraft)
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(
                str(path), f"cannot be read ({error})", fix="give the file that `inspect` wrote"
            ) from error
        last = max(float(stream.time[-1]) for stream in recording.streams.values() if stream.count)
        listed = segment_file.parse(text, name=str(path), epoch_us=recording.epoch_us, last=last)
        return segments.with_airspeed(recording, listed)

    return choose


def shared_out(
    flights: Sequence[Flight], *, apart: bool
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Maneuvers that are fitted, and those that judge: the last flight's if it is `apart`, or some.

    Ids must be unique over the flights.
    """
    if apart:
        fitted = tuple(item.id for one in flights[:-1] for item in one.segments)
        return fitted, tuple(item.id for item in flights[-1].segments)
    return split([item for one in flights for item in one.segments])
