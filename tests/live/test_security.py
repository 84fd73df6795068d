"""What listening sends to a vehicle, and what it opens of strangers."""

from __future__ import annotations

import ast
import socket
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import all as dialect

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.cli.commands import listen as command
from gcs_sysid.errors import InputError
from gcs_sysid.live import listen, snapshot, warming
from gcs_sysid.live.commands import Commands
from gcs_sysid.live.inside_feed import InsideFeed
from gcs_sysid.live.listen import Options
from gcs_sysid.live.processes import Processes
from gcs_sysid.live.regression import RunningModel
from gcs_sysid.live.station import Compiled
from tests.live.test_listen import Ticking

ROOT = Path(__file__).resolve().parents[2]
SET_MESSAGE_INTERVAL = 511
LOOKS = 120


def sent(
    aircraft: Aircraft,
    played: list,
    out: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    silent: bool = False,
) -> list:
    """What reaches a vehicle that sends a little, and never answers a request."""
    monkeypatch.setattr(warming, "warm", lambda *_: None)
    time, parser, found = Ticking(played[0][0]), dialect.MAVLink(None), []
    looked = [0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.setblocking(False)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]

        def stopped() -> bool:
            looked[0] += 1
            for _, frame in played[5 * looked[0] : 5 * looked[0] + 5]:
                vehicle.sendto(frame, ("127.0.0.1", port))
            try:
                while True:
                    found.extend(parser.parse_buffer(vehicle.recv(65535)) or ())
            except BlockingIOError:
                return looked[0] >= LOOKS

        vehicle.sendto(played[0][1], ("127.0.0.1", port))
        listen.run(
            f"udpin:127.0.0.1:{port}",
            aircraft,
            Options(prior="none", quiet_after=1e6, silent=silent),
            out=out,
            show=lambda _document: None,
            stopped=stopped,
            clock=time.clock,
        )
    return found


def test_a_vehicle_gets_heartbeats_and_rate_requests_and_nothing_else(
    aircraft, played, tmp_path, monkeypatch
) -> None:
    """Neither a mode nor a mission nor a stick: whatever the vehicle does or leaves undone."""
    found = sent(aircraft, played, tmp_path, monkeypatch)
    kinds = {message.get_type() for message in found}
    assert kinds <= {"HEARTBEAT", "COMMAND_LONG", "REQUEST_DATA_STREAM"}
    assert {"HEARTBEAT", "COMMAND_LONG"} <= kinds
    for message in found:
        if message.get_type() == "COMMAND_LONG":
            assert message.command == SET_MESSAGE_INTERVAL
        if message.get_type() == "HEARTBEAT":
            assert message.type != dialect.MAV_TYPE_GCS, "a failsafe would wait for it"


def test_who_only_listens_sends_nothing(aircraft, played, tmp_path, monkeypatch) -> None:
    assert sent(aircraft, played, tmp_path, monkeypatch, silent=True) == []


def test_nothing_that_is_read_can_run() -> None:
    """No module unpickles, evaluates or imports what a file or a link says."""
    banned = {"pickle", "marshal", "shelve", "dill", "joblib", "yaml"}
    for path in sorted((ROOT / "gcs_sysid").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [one.name for one in node.names]
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                assert not banned & {name.split(".")[0] for name in names}, path
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            assert called not in ("eval", "exec", "compile", "__import__"), path
            if called == "np.load":
                allowed = {one.arg: ast.unparse(one.value) for one in node.keywords}
                assert allowed.get("allow_pickle") == "False", path


class Hostile:
    def __reduce__(self) -> tuple:
        return pytest.fail, ("a pickle was opened",)


def test_a_snapshot_with_a_pickle_inside_is_not_opened(
    aircraft: Aircraft, compiled: Compiled, tmp_path: Path
) -> None:
    model = RunningModel(aircraft, compiled.regressors, None)
    inside = InsideFeed(aircraft, Commands(aircraft, compiled.maps), None, None)
    path = tmp_path / snapshot.NAME
    hostile = np.empty(1, dtype=object)
    hostile[0] = Hostile()
    np.savez(path, allow_pickle=True, structure=hostile, schema=np.array(1))
    with pytest.raises(pytest.fail.Exception, match="a pickle was opened"):
        np.load(path, allow_pickle=True)["structure"]
    with pytest.raises(InputError, match="cannot be read as a snapshot"):
        snapshot.restore(path, model, Processes(aircraft, believing=False), inside)


def test_a_page_that_is_killed_does_not_end_the_listening(tmp_path, monkeypatch) -> None:
    begun: list[subprocess.Popen] = []
    real = subprocess.Popen

    def popen(*arguments: Any, **named: Any) -> subprocess.Popen:
        begun.append(real(*arguments, **named))
        return begun[-1]

    monkeypatch.setattr(command.subprocess, "Popen", popen)
    with command._dashboard(tmp_path, wanted=True):
        (page,) = begun
        page.kill()
        page.wait()
    assert page.returncode == -9
