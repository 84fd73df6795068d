"""Compiled code is kept in the place the platform has for it, and used again."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gcs_sysid.cli import numerics

COMPILE = """
from gcs_sysid.cli import numerics
numerics._WORTH_KEEPING = 0.0  # however quickly this machine compiles
numerics.enable()
import jax, jax.numpy as jnp
def step(carry, x):
    return jnp.linalg.solve(carry @ carry.T + 9 * jnp.eye(6), carry) + x, jnp.tanh(carry)
run = jax.jit(jax.jacfwd(lambda a: jax.lax.scan(step, a, jnp.ones((9, 6, 6)))[0].sum()))
assert run(jnp.eye(6)).dtype == jnp.float64
"""


@pytest.fixture
def bare(monkeypatch, tmp_path):
    for name in (numerics.CACHE, "XDG_CACHE_HOME", "LOCALAPPDATA", "JAX_COMPILATION_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    return monkeypatch


@pytest.mark.parametrize(
    ("platform", "place"),
    [
        ("linux", ".cache/gcs-sysid"),
        ("darwin", "Library/Caches/gcs-sysid"),
        ("win32", "gcs-sysid/cache"),
    ],
)
def test_each_platform_has_its_place(platform, place, bare, tmp_path):
    bare.setattr(sys, "platform", platform)
    assert numerics.cache_folder() == tmp_path / place


def test_the_environment_chooses_first(bare, tmp_path):
    bare.setattr(sys, "platform", "linux")
    bare.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert numerics.cache_folder() == tmp_path / "xdg" / "gcs-sysid"
    bare.setenv(numerics.CACHE, str(tmp_path / "mine"))
    assert numerics.cache_folder() == tmp_path / "mine"


def test_compiled_code_is_kept_and_float64_is_on(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    environment[numerics.CACHE] = str(tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", COMPILE],
        env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert list((tmp_path / "jax").iterdir())


def test_an_unwritable_cache_does_not_stop_the_work(tmp_path):
    """A home without write access is common on ground stations; work must go on without a cache."""
    blocked = tmp_path / "file"
    blocked.touch()
    environment = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    environment[numerics.CACHE] = str(blocked)
    done = subprocess.run(
        [sys.executable, "-c", COMPILE],
        env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def test_linear_algebra_runs_in_one_thread_unless_told_otherwise(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    numerics.keep_linear_algebra_in_one_thread()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "4")
    numerics.keep_linear_algebra_in_one_thread()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "4"


def test_the_choice_is_made_before_linear_algebra_is_loaded():
    """Loaded first, the library keeps its threads, and smoothing takes five times longer."""
    code = (
        "import sys; from gcs_sysid.cli import main; main(['--version']); "
        "import os; assert os.environ['OPENBLAS_NUM_THREADS'] == '1'; "
        "assert not {'numpy', 'scipy', 'jax'} & set(sys.modules)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True, timeout=60)


COMPILED = """
import jax
from gcs_sysid.cli import numerics
numerics.compile_quickly()
print(float(jax.jit(lambda x: x + 1.0)(1.0)))
"""


def test_the_compiler_knows_the_flag():
    """One that it does not know would end the program."""
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    done = subprocess.run(
        [sys.executable, "-c", COMPILED],
        env=environment, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "2.0"


def test_a_version_that_may_not_know_the_flag_is_not_told(monkeypatch):
    monkeypatch.setattr(numerics, "version", lambda name: "0.11.0")
    monkeypatch.setenv("XLA_FLAGS", "--xla_of_mine")
    numerics.compile_quickly()
    assert os.environ["XLA_FLAGS"] == "--xla_of_mine"
    monkeypatch.setattr(numerics, "version", lambda name: "0.10.2")
    numerics.compile_quickly()
    assert os.environ["XLA_FLAGS"] == "--xla_of_mine --xla_cpu_use_fusion_emitters=false"
    numerics.compile_quickly()
    assert os.environ["XLA_FLAGS"].count("fusion") == 1


FAULTS = """
import resource
import numpy as np
from gcs_sysid.cli import numerics
if KEPT:
    numerics.keep_freed_memory()
def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        [np.ones(1 << 20) for _ in range(8)]  # of eight megabytes each, dropped
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
faults()
print(faults())
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of glibc")
def test_freed_memory_is_kept():
    """Pages of blocks of megabytes come once and not every time."""
    found = [
        subprocess.run(
            [sys.executable, "-c", FAULTS.replace("KEPT", kept)],
            capture_output=True, text=True, timeout=60, check=True,
        ).stdout
        for kept in ("True", "False")
    ]  # fmt: skip
    assert int(found[0]) < 0.1 * int(found[1])


def test_without_that_library_nothing_changes(monkeypatch):
    def absent(name):
        raise OSError(name)

    monkeypatch.setattr(numerics.ctypes, "CDLL", absent)
    numerics.keep_freed_memory()


@pytest.mark.parametrize("told", [None, "--xla_cpu_enable_concurrency_optimized_scheduler=true"])
def test_listening_computes_in_one_thread_unless_told_otherwise(told):
    """What stands in the environment stays."""
    environment = {k: v for k, v in os.environ.items() if k not in ("NPROC", "XLA_FLAGS")}
    if told is not None:
        environment["XLA_FLAGS"] = told
    look = """
from gcs_sysid.cli import numerics
numerics.compute_in_one_thread()
import os, jax, jax.numpy as jnp
assert float(jnp.ones(3).sum()) == 3.0
beside = jax.config.read("jax_cpu_enable_async_dispatch")
print(os.environ["NPROC"], beside, os.environ["XLA_FLAGS"])
"""
    done = subprocess.run(
        [sys.executable, "-c", look],
        env=environment, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    threads, beside, flags = done.stdout.split(maxsplit=2)
    assert (threads, beside) == ("1", "False")
    wanted = told or "--xla_cpu_enable_concurrency_optimized_scheduler=false"
    assert flags.split().count(wanted) == 1
    assert flags.count("concurrency_optimized") == 1
