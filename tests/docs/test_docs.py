"""The documentation builds without a warning and says what the program does."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from itertools import product
from pathlib import Path

import pytest

from docs import live_pictures
from gcs_sysid import aircraft_file, regressors
from gcs_sysid.cli import entry

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def load_generator():
    spec = importlib.util.spec_from_file_location("cli_reference", DOCS / "cli_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_command_reference_is_the_programs_own_help(monkeypatch):
    monkeypatch.setenv("COLUMNS", "40")
    generator = load_generator()
    assert generator.PAGE.read_text(encoding="utf-8") == generator.page(), (
        "run `python docs/cli_reference.py`"
    )


def test_the_aircraft_file_of_the_documentation_is_valid():
    page = (DOCS / "aircraft-file.md").read_text(encoding="utf-8")
    example = "\n".join(re.findall(r"```toml\n(.*?)```", page, flags=re.DOTALL))
    aircraft = aircraft_file.loads(example, name="aircraft-file.md")
    assert aircraft.control_names == ("aileron", "elevator")


def test_every_variable_of_a_regressor_is_explained():
    page = (DOCS / "aircraft-file.md").read_text(encoding="utf-8")
    table = page.split("## Aerodynamic terms")[1]
    assert all(f"`{name}`" in table for name in regressors.VARIABLES if name != "1")


@pytest.mark.parametrize("file", ["README.md", "docs/first-report.md"])
def test_commands_shown_are_commands_there_are(file):
    text = (ROOT / file).read_text(encoding="utf-8")
    shown = set(re.findall(r"gcs-sysid ([a-z]+)", text))
    assert shown
    assert shown <= set(entry.COMMANDS)


def test_the_pictures_of_the_page_are_those_that_are_taken():
    page = (DOCS / "live.md").read_text(encoding="utf-8")
    taken = [
        live_pictures.picture(*one).name
        for one in product(live_pictures.SIZES, live_pictures.THEMES)
    ]
    assert re.findall(r"\((live-[a-z-]+\.png)\)", page) == taken
    for name in taken:
        assert 10_000 < (DOCS / name).stat().st_size < 200_000, name


def test_the_documentation_builds_without_a_warning(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html",
         "-d", tmp_path / "doctrees", DOCS, tmp_path / "html"],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "html" / "index.html").exists()
