"""Serves the page: on this computer only, or with a token on others too."""

from __future__ import annotations

import asyncio
import os
import secrets
import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import uvicorn

from gcs_sysid.dashboard.app import build
from gcs_sysid.dashboard.watch import Watch
from gcs_sysid.errors import InputError

HOST, PORT = "127.0.0.1", 8642
LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
TRIED = 20
"""A port that is taken makes room for the next; so many are tried."""
_LOOK_S = 0.2


@dataclass(frozen=True)
class Address:
    """Where the page is, and the secret that it asks for; empty where it asks for none."""

    socket: socket.socket
    host: str
    port: int
    token: str

    @property
    def url(self) -> str:
        """What to open in a browser."""
        shown = socket.gethostname() if self.host in ("0.0.0.0", "::") else self.host  # noqa: S104 - compared, not bound
        host = f"[{shown}]" if ":" in shown else shown
        return f"http://{host}:{self.port}/" + (f"?token={self.token}" if self.token else "")


def bind(host: str = HOST, port: int = PORT) -> Address:
    """Takes a port, the next free one where `port` is in use; beyond loopback makes a token.

    Raises:
        InputError: the address cannot be served.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    problem: OSError | None = None
    for candidate in range(port, port + TRIED if port else 1):
        opened = socket.socket(family, socket.SOCK_STREAM)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            opened.bind((host, candidate))
        except OSError as error:
            opened.close()
            problem = error
            continue
        token = "" if host in LOOPBACK else secrets.token_urlsafe(24)
        return Address(opened, host, int(opened.getsockname()[1]), token)
    raise InputError(
        f"{host}:{port}",
        f"cannot be served ({problem.strerror if problem else 'no port'})",
        fix="give another address with --host and --port",
    )


def serve(folder: Path, address: Address, *, still: Callable[[], bool] = lambda: True) -> None:
    """Serves until interrupted, or until `still` says no."""
    hosts = LOOPBACK if address.host in LOOPBACK else frozenset()
    watch = Watch(folder)
    server = uvicorn.Server(
        uvicorn.Config(
            build(watch, hosts=hosts, token=address.token),
            # A page that hangs on at the end is cut off; that is nobody's error.
            log_level="critical",
            access_log=False,
            server_header=False,
            limit_concurrency=64,
            timeout_keep_alive=5,
            timeout_graceful_shutdown=1,
        )
    )

    async def run() -> None:
        serving = asyncio.create_task(server.serve(sockets=[address.socket]))
        while not (serving.done() or server.should_exit) and still():
            await asyncio.wait({serving}, timeout=_LOOK_S)
        # Pages that follow would hold the server back.
        watch.ended = server.should_exit = True
        await serving

    asyncio.run(run())


def parent_lives(parent: int) -> Callable[[], bool]:
    """Whether the process that started this one still does."""
    return lambda: os.getppid() == parent
