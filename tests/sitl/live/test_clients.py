"""Real clients on real sockets, in real time: pymavlink's own connection, and MAVSDK."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import threading
from collections.abc import AsyncIterator, Iterator
from typing import Any

import numpy as np
import pytest
from pymavlink import mavutil

from gcs_sysid.cli import entry
from gcs_sysid.sitl import live
from tests.sitl import examples
from tests.sitl.live.ground import usual

mavsdk = pytest.importorskip("mavsdk", reason="MAVSDK is not installed")


def free_port(kind: socket.SocketKind) -> int:
    with socket.socket(socket.AF_INET, kind) as opened:
        opened.bind(("127.0.0.1", 0))
        return opened.getsockname()[1]


@pytest.fixture
def flying() -> Iterator:
    """Start a vehicle on a link; it lands when the test is over."""
    stop = threading.Event()
    threads: list[threading.Thread] = []

    def start(address: str) -> None:
        def run() -> None:
            with live.Link(address) as wire:
                vehicle = live.LiveVehicle(usual(), wire)
                while not stop.is_set():
                    live.fly(vehicle, duration=vehicle.time + 0.1)

        threads.append(threading.Thread(target=run, daemon=True))
        threads[-1].start()

    yield start
    stop.set()
    for thread in threads:
        thread.join(10.0)
        assert not thread.is_alive()


def used(client) -> None:
    """What every ground station does first."""
    assert client.wait_heartbeat(timeout=10) is not None
    assert client.flightmode == "AUTO"
    client.mav.param_request_read_send(1, 1, b"WP_RADIUS", -1)
    assert client.recv_match(type="PARAM_VALUE", blocking=True, timeout=5).param_value >= 20.0
    client.set_mode("LOITER")
    deadline = 50
    while client.flightmode != "LOITER" and deadline:
        client.wait_heartbeat(timeout=2)
        deadline -= 1
    assert client.flightmode == "LOITER"


def test_pymavlink_over_udp(flying):
    port = free_port(socket.SOCK_DGRAM)
    client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")
    flying(f"udpout:127.0.0.1:{port}")
    used(client)
    client.close()


def test_pymavlink_over_tcp(flying):
    port = free_port(socket.SOCK_STREAM)
    flying(f"tcpin:127.0.0.1:{port}")
    client = mavutil.mavlink_connection(f"tcp:127.0.0.1:{port}", retries=20)
    used(client)
    client.close()


@contextlib.asynccontextmanager
async def mavsdk_system(flying) -> AsyncIterator[Any]:
    """The vehicle, as MAVSDK finds it."""
    from mavsdk import ComponentType, Configuration
    from mavsdk.asyncio import Mavsdk

    port = free_port(socket.SOCK_DGRAM)
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as sdk:
        await sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        flying(f"udpout:127.0.0.1:{port}")
        system = await sdk.first_autopilot(10.0)
        assert system is not None
        yield system


def test_mavsdk_finds_a_plane_and_reads_its_telemetry(flying):
    from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

    async def look() -> tuple[float, bool]:
        async with mavsdk_system(flying) as system:
            telemetry, armed = TelemetryAsync(system), False
            async with asyncio.timeout(15):
                async for value in telemetry.subscribe_armed():
                    armed = value
                    break
                async for position in telemetry.subscribe_position():
                    return position.relative_altitude_m, armed
        raise AssertionError("no telemetry")

    height, armed = asyncio.run(look())
    assert armed
    assert height == pytest.approx(usual().start.height, abs=5.0)


@pytest.mark.slow
def test_mavsdk_sets_parameters_loads_a_mission_and_changes_modes_and_rates(flying):
    from mavsdk.asyncio.plugins.action import ActionAsync
    from mavsdk.asyncio.plugins.mission_raw import MissionItem, MissionRawAsync
    from mavsdk.asyncio.plugins.param import ParamAsync
    from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
    from mavsdk.plugins.telemetry import FlightMode

    latitudes = [round(latitude * 1e7) for latitude in (47.3, 47.302, 47.304)]
    items = [
        MissionItem(i, 3, 16, int(i == 0), 1, 0.0, 0.0, 0.0, 0.0, x, round(8.5e7), 130.0, 0)
        for i, x in enumerate(latitudes)
    ]

    async def reached(telemetry, mode: FlightMode) -> None:
        async for found in telemetry.subscribe_flight_mode():
            if found == mode:
                return

    async def use() -> tuple[float, list[int]]:
        async with mavsdk_system(flying) as system, asyncio.timeout(60):
            mission, parameters = MissionRawAsync(system), ParamAsync(system)
            telemetry = TelemetryAsync(system)
            await parameters.set_param_float("WP_LOITER_RAD", 90.0)
            await mission.upload_mission(items)
            await telemetry.set_rate_attitude_euler(10.0)
            await ActionAsync(system).return_to_launch()
            await reached(telemetry, FlightMode.RETURN_TO_LAUNCH)
            await mission.start_mission()
            await reached(telemetry, FlightMode.MISSION)
            loaded = await mission.download_mission()
            return await parameters.get_param_float("WP_LOITER_RAD"), [item.x for item in loaded]

    radius, loaded = asyncio.run(use())
    assert radius == 90.0
    assert loaded == latitudes


def test_the_command_line_flies_live(capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.settimeout(10.0)
        link = f"udpout:127.0.0.1:{listener.getsockname()[1]}"
        arguments = ["--aircraft", str(examples.ULTRA_STICK), "--link", link]
        assert entry.main(["sitl", *arguments, "--duration", "0.5"]) == 0
        # MAVLink 2.
        assert listener.recv(2048)[0] == 0xFD
    assert link in capsys.readouterr().out


@pytest.mark.parametrize(
    ("link", "status"), [("carrier pigeon", 1), ("tcp:127.0.0.1:1", 1), ("udpout:nowhere", 1)]
)
def test_a_link_that_cannot_be_opened_is_told_in_one_line(link, status, capsys):
    arguments = ["--aircraft", str(examples.ULTRA_STICK), "--link", link]
    assert entry.main(["sitl", *arguments]) == status
    assert capsys.readouterr().err.count("\n") == 1


def test_what_a_link_carries_is_recorded_with_its_truth(tmp_path, capsys):
    effect = tmp_path / "effect.toml"
    effect.write_text('name = "mass"\nmass_ratio = 1.1\n', encoding="utf-8")
    record, truth = tmp_path / "live.tlog", tmp_path / "truth.npz"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setblocking(False)
        arguments = ["--aircraft", str(examples.ULTRA_STICK), "--effect", str(effect)]
        arguments += [
            "--link",
            f"udpout:127.0.0.1:{listener.getsockname()[1]}",
            "--duration",
            "0.5",
        ]
        arguments += ["--record", str(record), "--truth", str(truth), "--json"]
        assert entry.main(["sitl", *arguments]) == 0
        heard = bytearray()
        with contextlib.suppress(BlockingIOError):
            while True:
                heard += listener.recv(2048)
    kept, log = bytearray(), record.read_bytes()
    while log:
        # A time of arrival; a frame has twelve bytes more than its second one says.
        frame, log = log[8 : 20 + log[9]], log[20 + log[9] :]
        kept += frame
    assert kept == heard
    rows = np.load(truth)
    assert rows["rows"].shape == (25, len(rows["cols"]))
    told = json.loads(truth.with_suffix(".json").read_text())
    assert (told["cause"], told["epoch_us"]) == ("mass", int(rows["t0_us"]))
    document = json.loads(capsys.readouterr().out)
    assert (document["record"], document["duration_s"]) == (str(record), 0.5)


@pytest.mark.parametrize("more", [["--scenario", str(examples.ULTRA_STICK)], ["--seed", "-1"]])
def test_what_does_not_go_with_a_link_is_said(more, capsys):
    arguments = ["--aircraft", str(examples.ULTRA_STICK), "--link", "udpout:127.0.0.1:9"]
    assert entry.main(["sitl", *arguments, *more]) == 2
    assert capsys.readouterr().err.count("\n") == 1
