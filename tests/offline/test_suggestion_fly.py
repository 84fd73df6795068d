"""A maneuver flown through the sticks of the simulated vehicle, on its own clock."""

from __future__ import annotations

import socket
import threading
import time

import numpy as np
import pytest

from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.maneuvers import holding
from gcs_sysid.maneuvers.axes import Axes
from gcs_sysid.maneuvers.flown import STEP
from gcs_sysid.maneuvers.signals import steps
from gcs_sysid.model import trim
from gcs_sysid.offline import suggestion_fly
from gcs_sysid.offline.suggestion_fly import Flight
from gcs_sysid.sitl import live
from gcs_sysid.sitl.modes import Mode
from gcs_sysid.sources.cockpit import Cockpit
from tests.sitl import examples
from tests.sitl.live.ground import Wire, usual

AIRSPEED = 17.0
STOP = {
    "airspeed": [12.0, 25.0], "alpha": [-0.1, 0.2], "beta": [-0.2, 0.2],
    "load_factor": [-1.0, 3.0], "bank": [-0.8, 0.8], "height_min": [45.0],
}  # fmt: skip


class Simulated:
    """A link to a vehicle that flies on whenever somebody waits; and the clock."""

    def __init__(self) -> None:
        self._wire = Wire()
        self.vehicle = live.LiveVehicle(usual(), self._wire)
        self.silent = False

    def now(self) -> float:
        return self.vehicle.time

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.vehicle.tick()

    def read(self, timeout_s: float) -> bytes:
        if timeout_s and not self._wire.down:
            self.wait(timeout_s)
        data = b"" if self.silent else bytes(self._wire.down)
        self._wire.down.clear()
        return data

    def write(self, data: bytes) -> None:
        self._wire.up += data

    def close(self) -> None:
        pass

    def __enter__(self) -> Simulated:
        return self

    def __exit__(self, *_: object) -> None:
        pass


class Flown(Cockpit):
    """A cockpit whose link takes bytes although it is no socket."""

    def _send(self, message) -> None:
        self._link.write(bytes(message.pack(self._packer)))


@pytest.fixture(scope="module")
def flight() -> Flight:
    aircraft = examples.ultra_stick()
    level = trim.find(aircraft, AIRSPEED, 120.0, 1.21)
    time = STEP * np.arange(151)
    added = np.zeros((time.size, len(aircraft.controls) + 1))
    index = aircraft.control_names.index("elevator")
    added[:, index] = 0.06 * steps.steps(steps.DOUBLET, 2.0, time, rise=0.1)
    linear = holding.linearised(aircraft, level)
    moved_by = Axes("elevator", "aileron", "rudder")
    return Flight(aircraft, moved_by, level, linear, "doublet", added, STOP, 1.0)


def flown(simulated: Simulated, flight: Flight) -> dict:
    cockpit = Flown("made up", opener=lambda _: simulated, now=simulated.now)
    simulated.vehicle.computer.change_mode(Mode.CRUISE)
    return suggestion_fly.fly(
        cockpit, flight, progress=lambda *_: None, now=simulated.now, wait=simulated.wait
    )


def test_the_input_reaches_the_surface_and_the_mode_before_flies_on(flight) -> None:
    simulated = Simulated()
    simulated.wait(2.0)
    computer, elevator = simulated.vehicle.computer, []
    original = simulated.vehicle._vehicle.controls

    def wait(seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            simulated.vehicle.tick()
            elevator.append((computer.mode, original()["elevator"]))

    simulated.wait = wait
    found = flown(simulated, flight)
    assert found["outcome"] == "flown"
    assert found["flown_s"] == pytest.approx(3.0 + 3.0, abs=0.2)
    simulated.vehicle.tick()
    assert computer.mode == Mode.CRUISE
    moved = np.array([value for mode, value in elevator if mode == Mode.MANUAL])
    # The doublet's 0.12 rad from end to end, less what the attitude hold takes away.
    assert np.ptp(moved) > 0.09
    simulated.wait(5.0)
    place = computer.sticks.pulse(2, simulated.now())
    assert place == 1500, "the sticks are the pilot's again"


def test_a_limit_gives_the_aircraft_back(flight) -> None:
    from dataclasses import replace

    tight = replace(flight, stop=STOP | {"airspeed": [AIRSPEED - 0.4, AIRSPEED + 0.4]})
    simulated = Simulated()
    found = flown(simulated, tight)
    assert found["outcome"].startswith("stopped: airspeed")
    simulated.wait(0.2)
    assert simulated.vehicle.computer.mode == Mode.CRUISE


def test_a_lost_link_gives_the_aircraft_back(flight) -> None:
    simulated = Simulated()

    def wait(seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            simulated.vehicle.tick()
        simulated.silent = simulated.vehicle.computer.mode == Mode.MANUAL

    simulated.wait = wait
    found = flown(simulated, flight)
    assert found["outcome"].startswith("stopped: no telemetry")


def test_it_begins_at_its_airspeed_only(flight, monkeypatch) -> None:
    from dataclasses import replace

    monkeypatch.setattr(suggestion_fly, "WAIT", 2.0)
    fast = replace(flight, stop=STOP | {"height_min": [500.0]})
    with pytest.raises(RefusedError, match=r"did not fly level at 17\.0 m/s, above 500 m"):
        flown(Simulated(), fast)


@pytest.mark.parametrize(
    "address",
    ["udpin:127.0.0.1:14550", "tcp:localhost:5760", "mavsdk:udpin://127.0.0.1:14540",
     "udpout:[::1]:14550"],
)  # fmt: skip
def test_this_machine_may_be_flown(address: str) -> None:
    suggestion_fly.check(address, beyond=False)


@pytest.mark.parametrize(
    "address",
    ["udpin:0.0.0.0:14550", "udpout:192.168.1.7:14550", "/dev/ttyUSB0,57600", "tcp:uav.local:5760",
     "mavsdk:serial:///dev/ttyUSB0:57600", "udpin:127.0.0.1.example.org:14550"],
)  # fmt: skip
def test_what_may_be_an_aircraft_needs_a_second_word(address: str) -> None:
    with pytest.raises(UsageError, match="--fly-aircraft"):
        suggestion_fly.check(address, beyond=False)
    suggestion_fly.check(address, beyond=True)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["udpin:127.0.0.1:", "mavsdk:udpin://127.0.0.1:"])
def test_on_a_real_socket_in_real_time(flight, scheme: str, monkeypatch) -> None:
    """By pymavlink, and by MAVSDK; a machine busy with other tests may be slow."""
    monkeypatch.setattr(suggestion_fly, "LOST", 20.0)
    monkeypatch.setattr(suggestion_fly, "TRIMMED", 0.3)
    monkeypatch.setattr(suggestion_fly, "AFTER", 0.3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind(("127.0.0.1", 0))
        port = opened.getsockname()[1]
    stop = threading.Event()

    def run() -> None:
        with live.Link(f"udpout:127.0.0.1:{port}") as wire:
            vehicle = live.LiveVehicle(usual(), wire)
            vehicle.computer.change_mode(Mode.CRUISE)
            while not stop.is_set():
                live.fly(vehicle, duration=vehicle.time + 0.1)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    time.sleep(0.2)
    try:
        found = suggestion_fly.on(f"{scheme}{port}", flight, progress=lambda *_: None)
    finally:
        stop.set()
        thread.join(10.0)
    assert found["outcome"] == "flown"
    assert found["ranges"]["airspeed"][0] > 12.0
