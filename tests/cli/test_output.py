"""Where results go: folders that are ours, progress only where someone watches, clean JSON."""

from __future__ import annotations

import importlib
import io
import json
import sys

import pytest

from gcs_sysid.cli import entry, output
from gcs_sysid.errors import InputError

WRITES = ["model", "summary.json", "samples.parquet"]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path / "logs" / "morning.tlog"


def test_the_folder_is_named_for_log_and_command(log, tmp_path):
    with output.folder(None, log, "identify", WRITES) as out:
        assert out.resolve() == tmp_path / "morning-identify"
        assert out.is_dir()


def test_the_folder_asked_for_is_made_with_its_parents(log, tmp_path):
    with output.folder(tmp_path / "a" / "b", log, "identify", WRITES) as out:
        assert out == tmp_path / "a" / "b"
        assert out.is_dir()


def test_a_folder_is_kept_when_something_was_written(log, tmp_path):
    with output.folder(tmp_path / "a", log, "identify", WRITES) as out:
        (out / "summary.json").touch()
    assert out.is_dir()


def test_a_folder_that_was_there_is_kept_even_if_empty(log, tmp_path):
    with output.folder(tmp_path, log, "identify", WRITES):
        pass
    assert tmp_path.is_dir()


def test_files_beside_ours_do_not_matter(log, tmp_path):
    (tmp_path / "notes.txt").write_text("calm morning", encoding="utf-8")
    with output.folder(tmp_path, log, "identify", WRITES) as out:
        assert out == tmp_path


def test_somebody_elses_file_is_not_overwritten(log, tmp_path):
    (tmp_path / "samples.parquet").write_text("mine", encoding="utf-8")
    with (
        pytest.raises(InputError, match=r"samples\.parquet: exists.*--out"),
        output.folder(tmp_path, log, "identify", WRITES),
    ):
        pass


@pytest.mark.parametrize("content", ["", "[]", "not JSON", '{"program": "other 1.0"}', "\xff"])
def test_a_foreign_summary_vouches_for_nothing(content, log, tmp_path):
    (tmp_path / "summary.json").write_text(content, encoding="latin-1")
    with pytest.raises(InputError), output.folder(tmp_path, log, "identify", WRITES):
        pass


def test_our_own_results_are_replaced(log, tmp_path):
    (tmp_path / "samples.parquet").touch()
    document = {"program": "gcs-sysid 0.1.0"}
    (tmp_path / "summary.json").write_text(json.dumps(document), encoding="utf-8")
    with output.folder(tmp_path, log, "identify", WRITES) as out:
        assert out == tmp_path


def test_progress_is_silent_without_a_terminal(monkeypatch):
    stderr = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stderr)
    with output.progress("identify") as report:
        report("reconstruct", 0.5)
    assert stderr.getvalue() == ""


def test_progress_shows_the_stage_on_a_terminal(monkeypatch):
    stderr = Terminal()
    monkeypatch.setattr(sys, "stderr", stderr)
    monkeypatch.setenv("TERM", "xterm")
    with output.progress("identify") as report:
        report("reconstruct", 0.5)
    assert "reconstruct" in stderr.getvalue()


def test_json_goes_to_stdout_alone(capsys):
    output.show({"a": 1.5, "b": float("nan")}, "words", as_json=True)
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"a": 1.5, "b": None}
    assert captured.err == ""


def test_words_otherwise(capsys):
    output.show({"a": 1.5}, "words", as_json=False)
    assert capsys.readouterr().out == "words\n"


@pytest.mark.parametrize("name", entry.COMMANDS)
def test_what_a_command_leaves_can_be_renewed(name):
    """`suggest` and `diagnose` once refused the folder that they had written themselves."""
    module = importlib.import_module(f"gcs_sysid.cli.commands.{name}")
    writes = getattr(module, "WRITES", None)
    assert writes is None or set(writes) & set(output.DOCUMENTS)
