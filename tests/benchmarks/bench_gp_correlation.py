"""Matérn's correlation beside the Gaussian one: streams that come to a stall, one run.

What intervals hold, how far the mean is off, what the likelihood prefers, and what a refresh loses.
The learner is that of `bench_gp.py`; for the second row its correlation is put in place of the
first.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import jax  # noqa: E402 - found from ROOT

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from gcs_sysid.frames import Array  # noqa: E402
from gcs_sysid.gp import dependent, refresh  # noqa: E402
from tests.benchmarks import bench_gp, table  # noqa: E402

SEEDS = (1, 11, 21, 31, 41, 51)
STORED = 0.1
"""Of the samples, at the refresh."""


def gaussian(square: Array) -> Array:
    """The correlation by the squared distance."""
    return jnp.exp(-0.5 * square)


def row(words: str) -> tuple[str, ...]:
    """Means over the streams."""
    runs = [bench_gp.one_stream(bench_gp.ours, seed) for seed in SEEDS]
    error, held, density = (np.mean(part, axis=0) for part in list(zip(*runs, strict=True))[2:])
    whole, below, past = (f"{100 * one:.0f} %" for one in held)
    likely = [
        refresh.learned(
            bench_gp.stalling(seed, bench_gp.STREAM)[0], np.ones(3), bench_gp.STALLING
        ).log_posterior
        for seed in SEEDS
    ]
    lost = [bench_gp.lost(seed, STORED) for seed in SEEDS]
    return (
        words,
        " / ".join(f"{one:.1f}" for one in error),
        f"{whole} ({100 * min(run[3][0] for run in runs):.0f} to "
        f"{100 * max(run[3][0] for run in runs):.0f})",
        f"{below} / {past}",
        f"{density:.3f}",
        f"{np.mean(likely):.0f}",
        f"{np.mean(lost):.2f} ({min(lost):.2f} to {max(lost):.2f})",
    )


def main() -> None:
    rows = [row("Matérn, two derivatives")]
    dependent._matern = gaussian
    jax.clear_caches()
    rows.append(row("Gaussian"))
    table.show(
        "gp_correlation",
        f"{len(SEEDS)} streams with a stall in the second half, as in gp_libraries: means, and the "
        f"least and the most; a refresh with {STORED:.0%} of the samples in the store, the stall "
        "learned of after the points were chosen",
        (
            *("correlation", "error CL / CD / Cm [%]", "in 95 %", "below / past the break"),
            *("NLPD", "log posterior [nat]", "a refresh loses [nat a sample]"),
        ),
        rows,
    )


if __name__ == "__main__":
    main()
