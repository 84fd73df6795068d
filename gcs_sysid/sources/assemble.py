"""From decoded messages to a Recording: one vehicle, one clock, SI units."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.errors import RefusedError, SourceError
from gcs_sysid.recording import Recording, Stream, Vehicle
from gcs_sysid.sources import clock, messages
from gcs_sysid.sources.can.tunnel import TUNNELS, tunnelled
from gcs_sysid.sources.sender import BUS_COMPONENT, SYSTEM
from gcs_sysid.sources.tables import LogTables, MessageTable, TableKey

_NOT_VEHICLES = {
    dialect.MAV_TYPE_GCS,
    dialect.MAV_TYPE_ONBOARD_CONTROLLER,
    dialect.MAV_TYPE_GIMBAL,
    dialect.MAV_TYPE_ADSB,
    dialect.MAV_TYPE_CAMERA,
    dialect.MAV_TYPE_ANTENNA_TRACKER,
}


def recording(log: LogTables, *, source: str, sha256: str, vehicle: int | None) -> Recording:
    """The Recording of one vehicle of a log.

    Args:
        log: all decoded messages.
        source: file name as the user gave it.
        sha256: digest of the file.
        vehicle: system id to use; None takes the only one there is.

    Raises:
        SourceError: there is no vehicle in the log.
        RefusedError: there are several, or not the one asked for.
    """
    chosen, others = choose(vehicles(log.tables), source=source, vehicle=vehicle)
    own = {
        key.name: table
        for key, table in log.tables.items()
        if (key.system, key.component) == (chosen.system, chosen.component)
    }
    parameters = told_parameters(own.get("PARAM_VALUE"), chosen)
    split = _instances(own)
    clocked = clock.align(split)
    epoch_us = int(min(time.min() for time in clocked.time_us.values()))
    streams = {
        name: _stream(name, table, clocked, epoch_us) for name, table in sorted(split.items())
    }
    streams, absent_notes = without_absent(streams)
    found = Recording(
        source=source,
        sha256=sha256,
        vehicle=chosen,
        epoch_us=epoch_us,
        streams=streams,
        parameters=parameters,
        texts=_texts(own.get("STATUSTEXT"), streams.get("STATUSTEXT")),
        lost=log.lost,
        clock_notes=(*clocked.notes, *absent_notes),
        others=others,
    )
    local = {
        key.name: table for key, table in log.tables.items() if key[:2] == (SYSTEM, BUS_COMPONENT)
    }
    return _with_can(found, split, clocked, local)


def _with_can(
    found: Recording,
    tables: Mapping[str, MessageTable],
    clocked: clock.Clocked,
    local: Mapping[str, MessageTable],
) -> Recording:
    """The recording with what came from CAN: through the autopilot, or from a bus beside it."""
    ours = [(tables[name], clocked.time_us[name]) for name in TUNNELS if name in tables]
    bus = [(table, table.link_us) for name, table in local.items() if name in TUNNELS]
    if not (ours or bus):
        return found
    merge = importlib.import_module("gcs_sysid.sources.can.merge")
    for sent, add in ((ours, merge.tunnelled), (bus, merge.alongside)):
        frames = [frame for table, time_us in sent for frame in tunnelled(table, time_us)]
        if frames:
            found = add(found, sorted(frames, key=lambda frame: frame.time_us))
    return found


def vehicles(tables: Mapping[TableKey, MessageTable]) -> list[Vehicle]:
    """Autopilots heard in a log, one a system, the one with most messages first."""
    found: dict[int, Vehicle] = {}
    for key, table in tables.items():
        count = sum(t.count for k, t in tables.items() if k[:2] == key[:2])
        heard = heard_vehicle(key, table, messages=count)
        seen = found.get(key.system)
        if heard is not None and (seen is None or count > seen.messages):
            found[key.system] = heard
    return sorted(found.values(), key=lambda v: -v.messages)


def heard_vehicle(key: TableKey, table: MessageTable, *, messages: int = 0) -> Vehicle | None:
    """The vehicle that a table of heartbeats tells of; None if it is no autopilot's."""
    if key.name != "HEARTBEAT":
        return None
    autopilot = int(table.fields["autopilot"][-1])
    kind = int(table.fields["type"][-1])
    if autopilot == dialect.MAV_AUTOPILOT_INVALID or kind in _NOT_VEHICLES:
        return None
    return Vehicle(
        key.system,
        key.component,
        _enum("MAV_AUTOPILOT", autopilot),
        _enum("MAV_TYPE", kind),
        messages,
    )


def choose(
    found: list[Vehicle], *, source: str, vehicle: int | None
) -> tuple[Vehicle, tuple[Vehicle, ...]]:
    """The vehicle to use, and the others.

    Raises:
        SourceError: no vehicle was heard.
        RefusedError: several were heard and none was asked for, or not the one asked for.
    """
    if not found:
        raise SourceError(
            source,
            "no autopilot's HEARTBEAT among the messages",
            fix="record the link between vehicle and ground station, both directions",
        )
    ids = ", ".join(f"{v.system} ({v.messages} messages)" for v in found)
    if vehicle is None and len(found) > 1:
        raise RefusedError(
            source, f"{len(found)} vehicles, system ids {ids}", fix="choose one with --vehicle N"
        )
    wanted = found[0].system if vehicle is None else vehicle
    chosen = [v for v in found if v.system == wanted]
    if not chosen:
        raise RefusedError(
            source,
            f"no vehicle with system id {wanted}; there is {ids}",
            fix=f"use --vehicle {found[0].system}",
        )
    return chosen[0], tuple(v for v in found if v.system != wanted)


def _enum(group: str, value: int) -> str:
    entry = dialect.enums[group].get(value)
    return entry.name if entry is not None else f"{group}_{value}"


def _instances(tables: Mapping[str, MessageTable]) -> dict[str, MessageTable]:
    """Tables with the messages of a second sensor, battery or output port under their own name."""
    result: dict[str, MessageTable] = {}
    for name, table in tables.items():
        field = messages.INSTANCE_FIELD.get(name)
        if field is None:
            result[name] = table
            continue
        numbers = table.fields[field]
        for number in np.unique(numbers).tolist():
            result[messages.stream_name(name, number)] = table.subset(numbers == number)
    return result


def _stream(name: str, table: MessageTable, clocked: clock.Clocked, epoch_us: int) -> Stream:
    time_us = clocked.time_us[name]
    sort = np.argsort(time_us, kind="stable")
    table = table.subset(sort)
    return Stream(
        name=name,
        time=(time_us[sort] - epoch_us) * 1e-6,
        link_time=(table.link_us - epoch_us) * 1e-6,
        channels=messages.channels(name.partition("[")[0], table.fields),
        stamped=clocked.stamped[name],
    )


def _absent(stream: Stream) -> list[str]:
    """Channels that are zero throughout and so belong to no sensor."""
    names: list[str] = []
    for group in messages.ABSENT_IF_ALWAYS_ZERO:
        present = [stream.channels[c] for c in group if c in stream.channels]
        if present and all(np.all(~(np.abs(v) > 0.0)) for v in present):
            names += [c for c in group if stream.has(c)]
    return names


def without_absent(
    streams: Mapping[str, Stream],
) -> tuple[dict[str, Stream], tuple[str, ...]]:
    """The streams with channels that belong to no sensor made NaN, and a note that names them."""
    absent = {name: _absent(stream) for name, stream in streams.items()}
    named = [f"{name}.{channel}" for name, channels in absent.items() for channel in channels]
    hidden = {name: _hidden(stream, absent[name]) for name, stream in streams.items()}
    if not named:
        return hidden, ()
    return hidden, (f"zero throughout, so taken as not measured: {', '.join(named)}",)


def _hidden(stream: Stream, absent: list[str]) -> Stream:
    if not absent:
        return stream
    channels = {
        name: np.full_like(values, np.nan) if name in absent else values
        for name, values in stream.channels.items()
    }
    return replace(stream, channels=channels)


_WHOLE = (
    dialect.MAV_PARAM_TYPE_UINT8,
    dialect.MAV_PARAM_TYPE_INT8,
    dialect.MAV_PARAM_TYPE_UINT16,
    dialect.MAV_PARAM_TYPE_INT16,
    dialect.MAV_PARAM_TYPE_UINT32,
    dialect.MAV_PARAM_TYPE_INT32,
)


def told_parameters(table: MessageTable | None, vehicle: Vehicle) -> dict[str, float]:
    """Last value of each parameter in a table of `PARAM_VALUE`."""
    if table is None:
        return {}
    names = messages.text(table.fields["param_id"])
    sent = table.fields["param_value"]
    values = sent.astype(np.float64)
    if vehicle.autopilot == "MAV_AUTOPILOT_PX4":
        # Whole numbers go byte by byte in the float's place (mavlink.io, "Parameter Encoding").
        whole = np.isin(table.fields["param_type"], _WHOLE)
        values = np.where(whole, np.ascontiguousarray(sent).view("<i4"), values)
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _texts(table: MessageTable | None, stream: Stream | None) -> tuple[tuple[float, str], ...]:
    if table is None or stream is None:
        return ()
    order = np.argsort(table.link_us, kind="stable")
    lines = messages.text(table.fields["text"][order])
    return tuple((float(t), line) for t, line in zip(stream.time, lines, strict=True))
