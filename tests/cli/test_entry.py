"""The program's door: quick help, one line for every failure, exit status 0, 1, 2."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

import gcs_sysid.cli.commands
from gcs_sysid.cli import entry, failures
from gcs_sysid.errors import (
    AircraftFileError,
    InputError,
    RefusedError,
    StoppedError,
    UsageError,
)

PROGRAM = [sys.executable, "-m", "gcs_sysid"]
HEAVY = {"jax", "numpy", "scipy", "pymavlink", "plotly", "pyarrow", "rich", "jinja2", "filterpy"}


def run(*arguments: str, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, *arguments], capture_output=True, text=True, timeout=120, check=False, **options
    )


def fail_with(error: BaseException, monkeypatch, capsys) -> tuple[int, str]:
    """Exit status and stderr of a program whose only command raises `error`."""

    @click.command()
    def command() -> None:
        raise error

    monkeypatch.setattr(entry, "program", command)
    status = entry.main([])
    captured = capsys.readouterr()
    assert captured.out == ""
    return status, captured.err


def test_every_command_file_is_offered_and_nothing_else():
    folder = Path(gcs_sysid.cli.commands.__file__).parent
    files = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    assert set(entry.COMMANDS) == files


@pytest.mark.parametrize("name", entry.COMMANDS)
def test_each_command_explains_itself(name, capsys):
    assert entry.main([name, "--help"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"Usage: gcs-sysid {name}")


def test_help_lists_every_command_in_full(capsys):
    assert entry.main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in entry.COMMANDS)
    assert "..." not in out.split("Commands:")[1], "a one-line help is cut off"


def test_help_answers_in_half_a_second():
    """The best of five, since other jobs share the machine; bare click tells how busy it is."""

    def best(command: list[str]) -> float:
        times = []
        for _ in range(5):
            start = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True, timeout=60)
            times.append(time.perf_counter() - start)
        return min(times)

    bare = best([sys.executable, "-c", "import click"])
    assert best([*PROGRAM, "--help"]) < max(0.5, 5.0 * bare)


def test_help_needs_click_and_nothing_heavy():
    code = (
        "import sys; from gcs_sysid.cli import main; main(['--help']); "
        "main(['identify', '--help']); print(*sorted({n.split('.')[0] for n in sys.modules}))"
    )
    shown = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert not HEAVY & set(shown.stdout.splitlines()[-1].split())


def test_version_is_the_installed_one():
    done = run("--version")
    assert done.returncode == 0
    assert done.stdout.startswith("gcs-sysid 0.")


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["identify"],
        ["identify", "--no-such-option"],
        ["identify", "flight.tlog", "--prior", "maybe"],
        ["inspect", "flight.tlog", "--vehicle", "0"],
    ],
)
def test_wrong_usage_is_one_line_and_status_2(arguments, tmp_path, monkeypatch, capsys):
    (tmp_path / "flight.tlog").touch()
    monkeypatch.chdir(tmp_path)
    assert entry.main(arguments) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert err.startswith("gcs-sysid: ")
    assert "--help'" in err


def test_no_arguments_shows_the_help_and_status_2(capsys):
    assert entry.main([]) == 2
    assert "Commands:" in capsys.readouterr().err


def test_missing_input_is_unusable_input_not_wrong_usage(tmp_path, capsys):
    missing = tmp_path / "none.tlog"
    assert entry.main(["inspect", str(missing)]) == 1
    assert capsys.readouterr().err == f"gcs-sysid: {missing}: no such log; check the path\n"


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (InputError("a.tlog", "is empty", fix="record again"), 1),
        (RefusedError("a.tlog", "no airspeed", fix="stream VFR_HUD at 10 Hz"), 1),
        (AircraftFileError("a.toml", key="mass", found="-1", allowed="> 0", fix="weigh it"), 1),
        (UsageError("no maneuver of that kind"), 2),
    ],
)
def test_own_errors_speak_for_themselves(error, status, monkeypatch, capsys):
    assert fail_with(error, monkeypatch, capsys) == (status, f"gcs-sysid: {error}\n")


def test_errors_of_several_lines_become_one(monkeypatch, capsys):
    error = InputError("a.tlog", "first\nsecond", fix="third")
    assert fail_with(error, monkeypatch, capsys) == (1, "gcs-sysid: a.tlog: first second; third\n")


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EACCES])
def test_what_the_system_refuses_names_the_file(code, monkeypatch, capsys):
    error = OSError(code, os.strerror(code), "out/samples.parquet")
    status, err = fail_with(error, monkeypatch, capsys)
    assert status == 1
    assert err == f"gcs-sysid: out/samples.parquet: {os.strerror(code)}\n"


def test_the_keyboard_stops_the_program_quietly(monkeypatch, capsys):
    status, err = fail_with(KeyboardInterrupt(), monkeypatch, capsys)
    assert status == 130
    assert err.strip() == "gcs-sysid: stopped"


def test_what_a_stopped_run_kept_is_said(monkeypatch, capsys):
    error = StoppedError("stopped; what was known by then is in out/diagnosis.json")
    assert fail_with(error, monkeypatch, capsys) == (130, f"gcs-sysid: {error}\n")


def test_a_fault_of_the_program_files_its_traceback(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    status, err = fail_with(ZeroDivisionError("division by zero"), monkeypatch, capsys)
    assert status == 1
    assert err.count("\n") == 1
    assert "Traceback" not in err
    [report] = tmp_path.iterdir()
    assert str(report) in err
    assert "ZeroDivisionError" in report.read_text(encoding="utf-8")


def test_a_fault_is_told_even_where_no_file_can_be_written(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    status, err = fail_with(ZeroDivisionError("division by zero"), monkeypatch, capsys)
    assert status == 1
    assert "ZeroDivisionError: division by zero" in err
    assert failures.DEBUG in err


def test_debug_shows_the_traceback(monkeypatch, capsys):
    monkeypatch.setenv(failures.DEBUG, "1")
    _, err = fail_with(InputError("a.tlog", "is empty", fix="record again"), monkeypatch, capsys)
    assert "Traceback" in err


def test_a_closed_pipe_is_no_reason_to_complain():
    with subprocess.Popen(
        [*PROGRAM, "--help"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        err = process.stderr.read()
    assert err == ""
