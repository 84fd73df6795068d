"""Compiles everything that listening needs while the recording already runs.

A station of its own flies a made-up flight of some seconds through all functions; what is compiled
is shared with the real one.
"""

from __future__ import annotations

import gc
import math
import threading
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live import heap
from gcs_sysid.live.filter import START_S
from gcs_sysid.live.flying import slowest
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.model.kinematics import GRAVITY
from gcs_sysid.reconstruct import rates
from gcs_sysid.reconstruct.airborne import LIFT_OFF
from gcs_sysid.sources.samples import Sample

_STEP_S = 0.02
_FAST = ("SERVO_OUTPUT_RAW", "ATTITUDE", "RAW_IMU")


@contextmanager
def started(
    aircraft: Aircraft,
    compiled: Compiled,
    prior: Mapping[str, Prior] | None,
    ready: threading.Event,
) -> Generator[threading.Thread, None, None]:
    """Compiles in a thread of its own and then sets `ready`; leaving waits for its end.

    Args:
        aircraft: its file.
        compiled: functions of the same aircraft.
        prior: derivatives believed before.
        ready: set when that is done, or has failed.
    """

    def compile_all() -> None:
        try:
            warm(aircraft, compiled, prior)
        finally:
            ready.set()
        # What was compiled stays: to look through it for garbage stops a flight for 0.1 s.
        gc.collect()
        gc.freeze()
        heap.give_back()

    thread = threading.Thread(target=compile_all, name="compile", daemon=True)
    thread.start()
    try:
        yield thread
    finally:
        thread.join()


def warm(aircraft: Aircraft, compiled: Compiled, prior: Mapping[str, Prior] | None = None) -> None:
    """Runs every function once that a flight of this aircraft will need."""
    station = Station(aircraft, compiled, prior=prior, vehicle=None, clock_us=lambda: 0)
    station.take(_flight(aircraft))
    station.work(1)


def _flight(aircraft: Aircraft) -> Iterator[Sample]:
    """Straight flight with a little wobble, so that no noise is found to be zero."""
    speed = 1.5 * slowest(aircraft)
    channels = sorted({servo.channel for servo in aircraft.servos})
    throttles = [engine.throttle_channel for engine in aircraft.propulsion]
    pulses = {f"pwm_{channel}": 1500.0 for channel in (*channels, *throttles)}
    motors = [engine.rpm_channel for engine in aircraft.propulsion if engine.rpm is not None]
    speeds = {f"rpm_{motor}": 5000.0 for motor in motors}
    count = int((START_S + LIFT_OFF + 1.5) / _STEP_S) + rates.WINDOW
    for index in range(count):
        time_us = round(1e6 * index * _STEP_S)
        wobble = 0.01 * math.sin(1.7 * index) + 0.01 * math.sin(0.3 * index)
        turning = {"p": wobble, "q": -wobble, "r": 0.5 * wobble}
        force = {"acc_x": wobble, "acc_y": wobble, "acc_z": wobble - GRAVITY}
        values = {
            "SERVO_OUTPUT_RAW": pulses,
            "RPM": speeds,
            "VFR_HUD": {"airspeed": speed + wobble},
            "GLOBAL_POSITION_INT": {
                "v_north": speed + wobble,
                "v_east": wobble,
                "v_down": -wobble,
                "altitude": 100.0,
            },
            "ATTITUDE": {"roll": wobble, "pitch": 0.05 + wobble, "yaw": wobble},
            "AOA_SSA": {"alpha": 0.05 + wobble, "beta": wobble},
            "RAW_IMU": {**turning, **force},
        }
        for stream, measured in values.items():
            # Rows of the attitude alone go through a program of their own.
            if index % 2 == 0 or stream in _FAST:
                yield Sample(stream, time_us, 0, True, measured)
