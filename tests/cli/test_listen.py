"""`listen` as a user calls it: what it says and how it ends."""

from __future__ import annotations

import os
import signal
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gcs_sysid.cli import entry
from gcs_sysid.cli.commands import listen as command
from gcs_sysid.errors import RefusedError
from gcs_sysid.live import listen, warming
from gcs_sysid.live.listen import Ending

ROOT = Path(__file__).resolve().parents[2]
AIRCRAFT = str(ROOT / "data/aircraft/ultra_stick_25e.toml")


def test_a_link_that_cannot_be_opened_is_one_line_and_leaves_no_folder(tmp_path, capsys):
    out = tmp_path / "out"
    assert (
        entry.main(
            [
                "listen",
                "carrier-pigeon",
                "--aircraft",
                AIRCRAFT,
                "--no-dashboard",
                "--out",
                str(out),
            ]
        )
        == 1
    )
    err = capsys.readouterr().err
    assert err.startswith("gcs-sysid: carrier-pigeon: is neither a link nor a serial device")
    assert err.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("option", [["--quiet-after", "0"], ["--prior", "mine"]])
def test_wrong_options_are_wrong_usage(option, capsys):
    arguments = ["listen", "udp:127.0.0.1:1", "--aircraft", AIRCRAFT, *option]
    assert entry.main(arguments) == 2
    assert option[0] in capsys.readouterr().err


@pytest.fixture
def ended(monkeypatch) -> Iterator[None]:
    """A flight of no length: listening has just ended."""

    def run(_link, _aircraft, _options, *, out: Path, **_rest) -> Ending:
        recording = out / "recording.tlog"
        recording.write_bytes(b"frames")
        return Ending("quiet", {"vehicle": 1}, recording)

    monkeypatch.setattr(listen, "run", run)
    return


def test_a_flight_that_cannot_be_identified_is_kept_and_says_why(
    ended, tmp_path, capsys, monkeypatch
):
    def refuse(*_arguments, **_options):
        raise RefusedError("recording.tlog", "the aircraft never flew", fix="record a flight")

    monkeypatch.setattr(listen, "identified", refuse)
    out = tmp_path / "out"
    arguments = [
        "listen",
        "udp:127.0.0.1:1",
        "--aircraft",
        AIRCRAFT,
        "--no-dashboard",
        "--out",
        str(out),
    ]
    assert entry.main(arguments) == 1
    said = capsys.readouterr()
    assert said.out == f"The link fell quiet; recorded to {out / 'recording.tlog'}\n"
    assert said.err == (
        "gcs-sysid: recording.tlog: recorded, but not identified: the aircraft never flew; "
        "record a flight\n"
    )
    assert (out / "recording.tlog").is_file()


@pytest.mark.parametrize("what", ["edited", "vanished"])
def test_an_aircraft_file_that_changes_meanwhile_changes_nothing(
    what, tmp_path, capsys, monkeypatch
):
    mine, out = tmp_path / "mine.toml", tmp_path / "out"
    mine.write_bytes(Path(AIRCRAFT).read_bytes())

    def run(_link, _aircraft, _options, *, out: Path, **_rest) -> Ending:
        mine.unlink() if what == "vanished" else mine.write_text("mass = 'heavy'")
        (out / "recording.tlog").write_bytes(b"frames")
        return Ending("quiet", {"vehicle": 1}, out / "recording.tlog")

    used: list[Path] = []

    def identified(_ending, aircraft: Path, **_rest) -> dict:
        used.append(aircraft)
        raise RefusedError("recording.tlog", "never flew", fix="fly")

    monkeypatch.setattr(listen, "run", run)
    monkeypatch.setattr(listen, "identified", identified)
    arguments = ["listen", "udp:127.0.0.1:1", "--aircraft", str(mine), "--no-dashboard"]
    assert entry.main([*arguments, "--out", str(out)]) == 1
    assert "never flew" in capsys.readouterr().err
    assert used == [out / "aircraft-flown.toml"]
    assert used[0].read_bytes() == Path(AIRCRAFT).read_bytes()


def test_a_flight_goes_on_with_the_aircraft_file_that_it_began_with(tmp_path, capsys, monkeypatch):
    """`--resume` took the file as it had been edited meanwhile, and overwrote what was kept."""
    mine, out = tmp_path / "mine.toml", tmp_path / "out"
    mine.write_bytes(Path(AIRCRAFT).read_bytes())
    names: list[str] = []

    def run(_link, aircraft, _options, *, out: Path, **_rest) -> Ending:
        names.append(aircraft.name)
        # As a kill between two parts leaves it.
        (out / "recording-001.tlog").write_bytes(b"frames")
        (out / "live.json").write_text('{"program": "gcs-sysid 0"}')
        return Ending("quiet", {"vehicle": 1}, out / "recording.tlog")

    def identified(_ending, aircraft: Path, **_rest) -> dict:
        names.append(listen.load(aircraft).name)
        raise RefusedError("recording.tlog", "never flew", fix="fly")

    monkeypatch.setattr(listen, "run", run)
    monkeypatch.setattr(listen, "identified", identified)
    arguments = ["listen", "udp:127.0.0.1:1", "--aircraft", str(mine), "--no-dashboard"]
    assert entry.main([*arguments, "--out", str(out)]) == 1
    assert "goes on with" not in capsys.readouterr().out
    first = listen.load(mine).name
    mine.write_text(mine.read_text().replace(f'name = "{first}"', 'name = "another"'))
    assert entry.main([*arguments, "--out", str(out), "--resume"]) == 1
    assert names == [first] * 4
    assert listen.load(mine).name == "another"
    assert (out / "aircraft-flown.toml").read_bytes() == Path(AIRCRAFT).read_bytes()
    said = capsys.readouterr().out
    assert f"it goes on with {out / 'aircraft-flown.toml'}; move that away" in said
    assert entry.main([*arguments, "--out", str(tmp_path / "new"), "--resume"]) == 1
    assert names[4:] == ["another"] * 2


def test_signals_ask_to_stop_and_are_put_back():
    before = signal.getsignal(signal.SIGTERM)
    with command._stopping() as stopped:
        assert not stopped()
        os.kill(os.getpid(), signal.SIGTERM)
        assert stopped()
    assert signal.getsignal(signal.SIGTERM) is before


def test_ctrl_c_ends_the_recording_and_nothing_heard_is_said(tmp_path, capsys, monkeypatch):
    """The program is interrupted as a terminal does it, while it waits on a real link."""
    monkeypatch.setattr(warming, "warm", lambda *_: None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{free.getsockname()[1]}"
    interrupt = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    shown = threading.Event()
    real = listen._listen

    def interrupted(session, stopped, quiet_after):
        interrupt.start()
        shown.set()
        return real(session, stopped, quiet_after)

    monkeypatch.setattr(listen, "_listen", interrupted)
    out = tmp_path / "out"
    assert (
        entry.main(["listen", link, "--aircraft", AIRCRAFT, "--no-dashboard", "--out", str(out)])
        == 1
    )
    assert shown.is_set()
    err = capsys.readouterr().err
    assert f"{link}: nothing was received in" in err
    assert not (out / "recording.tlog").exists()
