"""How this program's processes compute: in float64, with compiled code kept from run to run."""

from __future__ import annotations

import ctypes
import logging
import os
import sys
from importlib.metadata import version
from pathlib import Path

CACHE = "GCS_SYSID_CACHE_DIR"
"""Environment variable: where compiled code, and flights of scenarios, are kept instead of the
platform's cache folder."""

_LOG = logging.getLogger(__name__)
_KEPT = {-3: 32 << 20, -1: 1 << 30}
"""Of glibc's mallopt: from which size on a block is mapped alone (the most that it takes), and how
much is kept at the end [bytes]."""
_FUSION, _TOGETHER = "xla_cpu_use_fusion_emitters", "xla_cpu_enable_concurrency_optimized_scheduler"
"""The compiler's flags for newer fusion, and for operations that may run beside each other."""
_TRIED = "0.10."
"""Versions of jaxlib that are known to have them."""
_WORTH_KEEPING = 0.1  # s of compilation; reading an entry back takes some milliseconds


def cache_folder() -> Path:
    """Where this user's things are kept: `$GCS_SYSID_CACHE_DIR`, or the platform's place."""
    if chosen := os.environ.get(CACHE):
        return Path(chosen)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "gcs-sysid"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "gcs-sysid" / "cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gcs-sysid"


def keep_linear_algebra_in_one_thread() -> None:
    """Tells the linear algebra library not to use threads; to be called before it is loaded.

    A filter solves thousands of small systems a second: on these, threads wait for each other and
    make them five times slower (36 unknowns, two cores). Who has set the variable knows better.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def compute_in_one_thread() -> None:
    """Tells JAX not to use threads; to be called before it computes anything.

    The live filter's programs are hundreds of operations that take a microsecond each: handing
    parts of one to another thread, or all of it, wakes that thread up, which takes longer. A row
    through the filter costs 0.8 ms of processor time instead of 1.6 (two threads of one core).
    """
    import jax

    os.environ.setdefault("NPROC", "1")
    _tell_compiler(_TOGETHER, "false")
    jax.config.update("jax_cpu_enable_async_dispatch", False)


def compile_quickly() -> None:
    """Tells JAX's compiler to fuse loops the older way; to be called before it compiles anything.

    The flight model's derivatives are thousands of small operations: they compile in half the time
    (`aided_linear._seen` 5.1 s instead of 9.4) and run as fast or faster.
    """
    _tell_compiler(_FUSION, "false")


def _tell_compiler(flag: str, value: str) -> None:
    """Sets a flag of JAX's compiler, unless it is set.

    An unknown flag would end the program, so that versions of jaxlib that it was not tried with go
    without.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if version("jaxlib").startswith(_TRIED) and flag not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{flag}={value}".strip()


def keep_freed_memory() -> None:
    """Tells the C library to keep large blocks that were freed, where it is glibc.

    A filter over a whole flight makes arrays of ten megabytes and drops them, hundreds of times;
    given back to the system, each comes anew page by page: sensitivities of 2000 rows took 57 ms
    instead of 20, changes of a filter 44 instead of 29.
    """
    try:
        library = ctypes.CDLL("libc.so.6")
        for option, size in _KEPT.items():
            library.mallopt(option, size)
    except (OSError, AttributeError) as error:
        # Results are the same without it.
        _LOG.info("freed memory is given back: %s", error)


def enable() -> None:
    """Switches JAX to float64 and to the cache; JAX's own variable for the cache goes first."""
    import jax

    compile_quickly()
    jax.config.update("jax_enable_x64", True)
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        _keep_compiled_code(cache_folder() / "jax")
    jax.config.update("jax_persistent_cache_min_compile_time_secs", _WORTH_KEEPING)


def _keep_compiled_code(folder: Path) -> None:
    import jax

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        # Results are the same without it; only the start takes longer.
        _LOG.info("compiled code is not kept: %s", error)
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
