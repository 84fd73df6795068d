"""Common test settings: float64, strict promotion, and the folder of measured flights."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

# As the program does; see gcs_sysid/cli/numerics.py.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

from gcs_sysid.cli import numerics
from tests import cores

MAPS, MOST_MAPS = Path("/proc/self/maps"), 30_000
SHARED = Path(__file__).resolve().parents[1].parent / "shared"

cores.one_each()
numerics.compile_quickly()
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# Compilation takes longer than any deadline, and a failure must be repeatable.
settings.register_profile("gcs-sysid", deadline=None, derandomize=True)
settings.load_profile("gcs-sysid")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--require-shared",
        action="store_true",
        help="fail if a test of ../shared was skipped although the folder is there",
    )


def pytest_configure(config: pytest.Config) -> None:
    skips = SharedSkips(required=config.getoption("--require-shared") and SHARED.is_dir())
    config.pluginmanager.register(skips)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first, so that no worker is left alone with one at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


class SharedSkips:
    """Keeps count of tests of ../shared that were skipped although the folder is there."""

    def __init__(self, *, required: bool) -> None:
        self.required = required
        self.skipped: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        expected = hasattr(report, "wasxfail")
        if self.required and report.skipped and not expected and "shared" in report.keywords:
            self.skipped.append(report.nodeid)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.skipped and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        for nodeid in self.skipped:
            terminalreporter.write_line(f"SKIPPED beside ../shared: {nodeid}", red=True)


@pytest.fixture(scope="session", autouse=True)
def compilation_cache() -> Path:
    """Compiled code, shared by all processes of a run, the commands they start, and the next run.

    It is found by the code that was compiled and the versions of everything: a third of a first
    run's time is compilation.
    """
    folder = numerics.cache_folder() / "tests"
    folder.mkdir(parents=True, exist_ok=True)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
    return folder


@pytest.fixture(scope="module", autouse=True)
def code_let_go() -> Iterator[None]:
    """Compiled code is let go before there is too much of it.

    A program is some thirty pieces of mapped memory, of which Linux lets a process have 65 530: the
    suite compiles thousands, and a worker crashed in the compiler when it was nearly done.
    """
    yield
    if MAPS.is_file() and MAPS.read_bytes().count(b"\n") > MOST_MAPS:
        jax.clear_caches()


@pytest.fixture(autouse=True)
def computing_already(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that runs in the tests' own process finds JAX computing.

    Settings that `listen` makes before anything is computed come too late here, and those that JAX
    still takes would make it compile everything once more for the tests that follow.
    """
    monkeypatch.setattr(numerics, "compute_in_one_thread", lambda: None)


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of measured flights and truth cases beside the checkout."""
    if not SHARED.is_dir():
        pytest.skip("no ../shared beside the checkout")
    return SHARED
