"""Real clients on real sockets, in real time: pymavlink's own connection, and MAVSDK."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator

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


def test_mavsdk_finds_a_plane_and_reads_its_telemetry(flying):
    from mavsdk import ComponentType, Configuration
    from mavsdk.asyncio import Mavsdk
    from mavsdk.asyncio.plugins.telemetry import TelemetryAsync

    port = free_port(socket.SOCK_DGRAM)

    async def look() -> tuple[float, bool]:
        configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        async with Mavsdk(configuration) as sdk:
            await sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
            flying(f"udpout:127.0.0.1:{port}")
            system = await sdk.first_autopilot(10.0)
            assert system is not None
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


@pytest.mark.parametrize("more", [["--record", "x.tlog"], ["--truth", "x.npz"]])
def test_live_is_not_recorded_here(more, capsys):
    arguments = ["--aircraft", str(examples.ULTRA_STICK), "--link", "udpout:127.0.0.1:9"]
    assert entry.main(["sitl", *arguments, *more]) == 2
    assert "listen" in capsys.readouterr().err
