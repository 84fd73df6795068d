"""A worker's programs have one core, and those that run as a user's do have them all."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests import cores

pytestmark = pytest.mark.skipif(not cores.EVERY, reason="no choice of cores on this system")


def had() -> set[int]:
    """Cores of a program that is started here."""
    told = "import os; print(*os.sched_getaffinity(0))"
    return set(map(int, subprocess.check_output([sys.executable, "-c", told]).split()))


def test_a_worker_has_one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    before = os.sched_getaffinity(0)
    with cores.every_one():
        for worker in ("gw0", "gw1"):
            monkeypatch.setenv(cores.WORKER, worker)
            with cores.every_one():
                cores.one_each()
                assert len(had()) == 1
    assert os.sched_getaffinity(0) == before


def test_who_is_not_a_worker_keeps_its_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(cores.WORKER, raising=False)
    before = os.sched_getaffinity(0)
    cores.one_each()
    assert os.sched_getaffinity(0) == before


def test_what_runs_as_a_users_has_all_cores() -> None:
    before = os.sched_getaffinity(0)
    with cores.every_one():
        assert had() == cores.EVERY
    assert os.sched_getaffinity(0) == before
