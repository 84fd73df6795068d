"""The layers of the design hold: imports point down, and each library has its few importers."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def test_every_import_contract_is_kept():
    linter = Path(sys.executable).parent / "lint-imports"
    done = subprocess.run(
        [linter, "--no-cache"], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"Contracts: [1-9]\d* kept, 0 broken", done.stdout)


def test_package_files_import_and_list_names_and_do_nothing_else():
    """An `__init__.py` that works at import time would make `--help` slow for everyone."""
    allowed = re.compile(
        r'"""|from __future__ |from gcs_sysid[\w.]* import |import |    \w+ as \w+,|\)|__all__'
    )
    for path in (ROOT / "gcs_sysid").rglob("__init__.py"):
        text = re.sub(r'""".*?"""', "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
        odd = [line for line in text.splitlines() if line.strip() and not allowed.match(line)]
        assert not odd, f"{path.relative_to(ROOT)}: {odd}"


def test_no_file_is_too_long_to_read():
    long = {
        str(path.relative_to(ROOT)): lines
        for folder in ("gcs_sysid", "tests")
        for path in (ROOT / folder).rglob("*.py")
        if (lines := len(path.read_text(encoding="utf-8").splitlines())) > 600
    }
    assert not long
