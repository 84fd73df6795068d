"""What the compiler makes of the package's programs is what was written."""

from __future__ import annotations

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import compiler


@pytest.mark.parametrize("rows", [300, 1000, 20_000])
def test_sums_of_products_are_right_however_many(rows: int) -> None:
    """A program that jaxlib 0.10.2 computes wrongly from 700 rows on, by half of the result."""
    random = np.random.default_rng(0)
    square = random.normal(size=(250, 250))
    left, right = random.normal(size=(2, rows, 250))
    pick = np.eye(6)[random.integers(0, 6, 250)]

    def program(left, right, pick, square):
        half = left @ square
        own = ((right @ (square * (pick @ pick.T))) * right) @ pick
        return own + (half * right) @ pick + (half * left).sum(axis=1)[:, None]

    wanted = program(left, right, pick, square)
    found = jax.jit(program)(*map(jnp.asarray, (left, right, pick, square)))
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_rows_that_are_mapped_and_summed_are_right() -> None:
    """The program of jax-ml/jax issue 39103."""
    rows = np.arange(20_000.0)
    vectors = jnp.asarray(np.stack([rows, 0.0 * rows, 0.0 * rows], axis=1))
    found = jax.jit(jax.vmap(lambda row: jnp.sum((jnp.eye(3) @ row) ** 2)))(vectors)
    np.testing.assert_array_equal(found, rows**2)


@pytest.mark.parametrize("set_before", ["", "--xla_cpu_experimental_ynn_fusion_type=dot"])
def test_the_flag_is_set_by_importing_the_package_unless_the_user_has_set_it(
    set_before: str,
) -> None:
    """One import is enough, and what stands there stays."""
    code = "import os, gcs_sysid; print(os.environ['XLA_FLAGS'])"
    environment = {**os.environ, "XLA_FLAGS": set_before}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    wanted = set_before or "--xla_cpu_experimental_ynn_fusion_type="
    assert done.stdout.strip() == wanted


def test_a_version_that_may_not_know_the_flag_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that it does not know would end the program."""
    monkeypatch.setattr(compiler, "version", lambda name: "0.13.0")
    monkeypatch.setenv("XLA_FLAGS", "--xla_of_mine")
    compiler.compute_rightly()
    assert os.environ["XLA_FLAGS"] == "--xla_of_mine"
