"""The patch that turns one aircraft file into another."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace

import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.offline import file_changes
from tests.offline.made_aircraft import small


def test_files_that_say_the_same_have_no_patch() -> None:
    assert file_changes.lines(small(), small(), source="a.toml", to="b.toml") == []


def test_only_what_changed_is_there() -> None:
    file = small()
    heavy = replace(file, mass=replace(file.mass, mass=1.5 * file.mass.mass))
    found = file_changes.lines(file, heavy, source="some/where/a.toml", to="b.toml")
    assert found[:2] == ["--- a.toml", "+++ b.toml"]
    changed = [line for line in found[2:] if line[0] in "+-"]
    assert [line.split(" = ")[0] for line in changed] == ["-mass", "+mass"]


@pytest.mark.skipif(shutil.which("patch") is None, reason="needs the program patch")
def test_the_patch_makes_the_one_file_of_the_other(tmp_path) -> None:
    file = small()
    turned = replace(file, mass=replace(file.mass, Izz=1.1 * file.mass.Izz, cg=(0.01, 0.0, 0.0)))
    found = file_changes.lines(file, turned, source="a.toml", to="a.toml")
    aircraft_file.save(file, tmp_path / "a.toml")
    given = "".join(f"{line}\n" for line in found)
    subprocess.run(["patch", "a.toml"], cwd=tmp_path, input=given, text=True, check=True)
    assert (tmp_path / "a.toml").read_text(encoding="utf-8") == aircraft_file.dumps(turned)
