"""Messages from a link as SI samples on the vehicle's clock, one by one.

Units come from the same table as for logs. The clock is the same too, as far as it can be known
without the future: a message without a stamp has the time of the stamped one before it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from gcs_sysid.recording import Vehicle
from gcs_sysid.sources import messages
from gcs_sysid.sources.assemble import heard_vehicle, told_parameters
from gcs_sysid.sources.can.live import CanSamples
from gcs_sysid.sources.can.streams import AUTOPILOT, BUS, ESTIMATES
from gcs_sysid.sources.can.tunnel import TUNNELS, tunnelled
from gcs_sysid.sources.clock import FRESH, PLAUSIBLE_US, REBOOT_US, UNIX_US, WRAP_US
from gcs_sysid.sources.sender import BUS_COMPONENT, SYSTEM
from gcs_sysid.sources.stream import Batch
from gcs_sysid.sources.tables import MessageTable, TableKey

_WAITING = 4096
"""Messages kept until the vehicle is known: those of several seconds."""


@dataclass(frozen=True)
class Sample:
    """One message of the vehicle.

    Attributes:
        stream: name as in a Recording, for instance `RAW_IMU` or `SERVO_OUTPUT_RAW[1]`.
        time_us: when it was sampled [µs since 1970 on the log clock].
        link_us: when it arrived.
        stamped: whether `time_us` is the vehicle's own stamp.
        channels: values in SI units and radians; NaN where not measured.
    """

    stream: str
    time_us: int
    link_us: int
    stamped: bool
    channels: Mapping[str, float]


class LiveClock:
    """The log clock of a vehicle while it flies: boot time plus a constant.

    The constant is set by the first stamped message after boot and kept, so that the clock never
    jumps; it is therefore late by the delay of that message on the link.
    """

    def __init__(self) -> None:
        self._boot_us: int | None = None
        self._offset_us = 0
        self._behind = 0
        self._last_time_us = 0
        self._last_link_us = 0
        self.reboots = 0

    def time_us(
        self, name: str, fields: Mapping[str, np.ndarray], link_us: int
    ) -> tuple[int, bool]:
        """Sampling time of a message on the log clock, and whether it is the vehicle's own stamp.

        Args:
            name: message type.
            fields: raw values of this message, shape (1,) each.
            link_us: when it arrived [µs since 1970].
        """
        boot = self._boot(name, fields, link_us)
        if boot is None:
            return self._travelled(link_us), False
        time = boot + self._offset_us
        if name in FRESH and "time_boot_ms" in fields and time >= self._last_time_us:
            self._last_time_us, self._last_link_us = time, link_us
        return time, True

    def _travelled(self, link_us: int) -> int:
        if self._boot_us is None:
            return link_us
        return self._last_time_us + max(link_us - self._last_link_us, 0)

    def _boot(self, name: str, fields: Mapping[str, np.ndarray], link_us: int) -> int | None:
        """Boot time of a stamp [µs], continued past the end of its counter; None without one."""
        if "time_boot_ms" in fields:
            stamp, period = int(fields["time_boot_ms"][0]) * 1000, WRAP_US["time_boot_ms"]
        elif "time_usec" in fields:
            stamp, period = int(fields["time_usec"][0]), WRAP_US["time_usec"]
        else:
            return None
        if stamp == 0:
            return None
        if stamp > UNIX_US:
            stamp -= self._offset_us
        if self._boot_us is None or name in FRESH:
            return self._follow(stamp, period, link_us, defining="time_boot_ms" in fields)
        stamp += round((self._boot_us - stamp) / period) * period
        return stamp if abs(stamp - self._boot_us) < PLAUSIBLE_US else None

    def _follow(self, stamp: int, period: int, link_us: int, *, defining: bool) -> int | None:
        """Lets the clock follow a fresh stamp, and notices when the autopilot restarted."""
        if self._boot_us is None:
            if not defining:
                return None
            self._start(stamp, link_us)
            return stamp
        continued = stamp + round((self._boot_us - stamp) / period) * period
        if not defining and continued > self._boot_us + PLAUSIBLE_US:
            return None
        if continued < self._boot_us - REBOOT_US:
            self._behind += defining
            # As in a log: one late message is no reboot.
            if self._behind < 5:
                return None
            self.reboots += 1
            self._start(stamp, link_us)
            return stamp
        if defining:
            self._behind = 0
            self._boot_us = max(self._boot_us, continued)
        return continued

    def _start(self, stamp: int, link_us: int) -> None:
        self._boot_us = stamp
        self._behind = 0
        # Never before what was already given out: time does not run backwards at a reboot.
        self._offset_us = max(link_us, self._last_time_us) - stamp


class SampleDecoder:
    """Turns batches of frames into samples of one vehicle.

    Args:
        vehicle: system id to use; None takes the first autopilot that is heard, and keeps it.
        watched: names of parameters to take note of.

    Attributes:
        parameters: newest values of those that were told; nobody asks the autopilot for them.
    """

    def __init__(
        self, *, vehicle: int | None = None, watched: Collection[str] = frozenset()
    ) -> None:
        self._wanted = vehicle
        self._watched = watched
        self.parameters: dict[str, float] = {}
        self._waiting: list[tuple[TableKey, MessageTable, int]] = []
        self.clock = LiveClock()
        self.vehicle: Vehicle | None = None
        self.others: dict[int, Vehicle] = {}
        self.received = 0
        self.can = CanSamples()
        self._streams: set[str] = set()

    def remember(self, parameters: Mapping[str, float]) -> None:
        """Takes note of parameters that were told before; of those that are wanted."""
        # Whoever sends thousands of names must not fill the memory.
        self.parameters |= {n: value for n, value in parameters.items() if n in self._watched}

    def samples(self, batch: Batch) -> list[Sample]:
        """The vehicle's samples in a batch, in the order of arrival; none before it is known."""
        arrived = self._arrived(batch)
        self.received += len(arrived)
        for key, table, row in arrived:
            if key.name == "HEARTBEAT":
                self._heard(heard_vehicle(key, table.subset(np.array([row]))))
        if self.vehicle is None:
            self._waiting = [*self._waiting, *arrived][-_WAITING:]
            return []
        queue, self._waiting = [*self._waiting, *arrived], []
        return [
            sample
            for key, table, row in queue
            for sample in (
                self._from_bus(table, row) if self._tunnelled(key) else self._own(key, table, row)
            )
        ]

    def _arrived(self, batch: Batch) -> list[tuple[TableKey, MessageTable, int]]:
        """(who and what, table, row) of each message, in the order of arrival."""
        tables = batch.tables()
        rows = [
            (int(order), key, row)
            for key, table in tables.items()
            for row, order in enumerate(table.order)
        ]
        return [(key, tables[key], row) for _, key, row in sorted(rows)]

    def _heard(self, vehicle: Vehicle | None) -> None:
        if vehicle is None:
            return
        wanted = self._wanted is None or vehicle.system == self._wanted
        if self.vehicle is None and wanted:
            self.vehicle = vehicle
        elif self.vehicle is None or vehicle.system != self.vehicle.system:
            self.others[vehicle.system] = vehicle

    def _tunnelled(self, key: TableKey) -> bool:
        """Whether it is a frame of the CAN bus at this computer, or of the autopilot's."""
        return key.name in TUNNELS and (key[:2] == (SYSTEM, BUS_COMPONENT) or self._ours(key))

    def _own(self, key: TableKey, table: MessageTable, row: int) -> list[Sample]:
        if self.vehicle is None or not self._ours(key):
            return []
        if key.name == "PARAM_VALUE":
            self.remember(told_parameters(table.subset(np.array([row])), self.vehicle))
        return [self._sample(key, table, row)]

    def _from_bus(self, table: MessageTable, row: int) -> list[Sample]:
        one = table.subset(np.array([row]))
        link_us = int(one.link_us[0])
        time_us, _ = self.clock.time_us(TUNNELS[0], one.fields, link_us)
        found = self.can.feed(tunnelled(one, np.array([time_us])))
        return [
            Sample(self._name(item.stream), item.time_us, link_us, False, item.channels)
            for item in found
        ]

    def _name(self, stream: str) -> str:
        """As in a log, what is measured on the bus takes the place of estimates only."""
        heard = stream in self._streams and stream not in ESTIMATES
        return f"{stream}[{BUS}]" if heard else stream

    def _ours(self, key: TableKey) -> bool:
        chosen = self.vehicle
        return chosen is not None and key[:2] == (chosen.system, chosen.component)

    def _sample(self, key: TableKey, table: MessageTable, row: int) -> Sample:
        one = table if table.count == 1 else table.subset(np.array([row]))
        link_us = int(one.link_us[0])
        time_us, stamped = self.clock.time_us(key.name, one.fields, link_us)
        values = messages.channels(key.name, one.fields)
        channels = {name: float(value[0]) for name, value in values.items()}
        stream = messages.stream_name(key.name, messages.instance(key.name, one.fields, 0))
        self._streams.add(stream)
        if stream in ESTIMATES and stream in self.can.streams:
            stream = f"{stream}[{AUTOPILOT}]"
        return Sample(stream, time_us, link_us, stamped, channels)
