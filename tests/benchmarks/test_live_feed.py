"""The busy link of the benchmarks after hours."""

from __future__ import annotations

from itertools import islice

from pymavlink.dialects.v20 import all as dialect

from tests.benchmarks.live_feed import HOLE_S, Feed


def test_it_flies_on_when_the_servos_counter_is_full() -> None:
    """Of 32 bits and microseconds: full after 71 minutes, where a soak of hours begins to count."""
    feed = Feed()
    lap = 1 + int(2**32 * 1e-6 // (feed.lap_s + HOLE_S))
    begun = lap * (feed.lap_s + HOLE_S)
    parser = dialect.MAVLink(None)
    heard = {
        message.get_type(): message
        for _, frame in islice(feed.frames(lap=lap), 8)
        for message in parser.parse_buffer(frame) or ()
    }
    boot_us = round(1e6 * (begun + 1.0))
    assert heard["RAW_IMU"].time_usec == boot_us
    assert heard["SERVO_OUTPUT_RAW"].time_usec == boot_us - 2**32
    assert heard["ATTITUDE"].time_boot_ms == round(boot_us / 1000)
