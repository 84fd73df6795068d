"""The processes on a public regression set, beside scikit-learn's: diabetes, which it ships.

442 patients, ten inputs, one output (Efron et al., "Least angle regression", Annals of Statistics
32, 2004). Nearly linear and very noisy, as flights are not: it shows that the learning of
hyper-parameters and the approximation give nothing away, and not what processes are good for.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax  # noqa: E402 - after the number of threads

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
from sklearn.datasets import load_diabetes  # noqa: E402
from sklearn.gaussian_process import GaussianProcessRegressor, kernels  # noqa: E402

from gcs_sysid.gp import exact, inducing, learning, posterior, refresh  # noqa: E402
from gcs_sysid.gp.learning import Structure  # noqa: E402
from gcs_sysid.gp.posterior import Posterior  # noqa: E402
from gcs_sysid.gp.refresh import Settings  # noqa: E402
from gcs_sysid.gp.samples import Rows  # noqa: E402
from tests.benchmarks import table  # noqa: E402

FOLDS, SEED = 10, 0
POINTS = 100
OWN = 1e-6
"""Variance that is told of each value, over the output's: all noise is learned."""
Answer = tuple[np.ndarray, np.ndarray]
Method = Callable[[np.ndarray, np.ndarray, np.ndarray], Answer]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    parser.parse_args()
    data = load_diabetes()
    methods: dict[str, Method] = {
        f"gcs_sysid, {POINTS} inducing points": approximate,
        "gcs_sysid, exact": whole,
        "scikit-learn, exact": scikit,
        "least squares": line,
    }
    rows = [(name, *scored(method, data.data, data.target)) for name, method in methods.items()]
    table.show(
        "gp_public",
        f"Diabetes (442 samples, 10 inputs, shipped with scikit-learn), {FOLDS} folds",
        ("method", "SMSE", "NLPD [nat]", "in 95 %", "s a fold"),
        rows,
    )


def scored(method: Method, inputs: np.ndarray, values: np.ndarray) -> tuple[str, ...]:
    """Squared error over the training values' variance, density in their units, coverage, time."""
    order = np.random.default_rng(SEED).permutation(values.size)
    errors, densities, held, taken = [], [], [], []
    for fold in np.array_split(order, FOLDS):
        kept = np.setdiff1d(order, fold)
        middle, unit = values[kept].mean(), values[kept].std()
        spread = inputs[kept].std(axis=0)
        begun = time.perf_counter()
        mean, deviation = method(
            inputs[kept] / spread, (values[kept] - middle) / unit, inputs[fold] / spread
        )
        taken.append(time.perf_counter() - begun)
        error = (values[fold] - middle) / unit - mean
        errors.append(error**2)
        densities.append(0.5 * (np.log(2.0 * np.pi * deviation**2) + (error / deviation) ** 2))
        held.append(np.abs(error) < 1.959964 * deviation)
    smse, nlpd, inside = (np.concatenate(each).mean() for each in (errors, densities, held))
    return f"{smse:.3f}", f"{nlpd:.3f}", f"{100.0 * inside:.0f} %", f"{np.median(taken):.1f}"


def _rows(inputs: np.ndarray, values: np.ndarray) -> Rows:
    return Rows(inputs, values[:, None], np.full((values.size, 1), 1.0 / OWN))


def _asked(known: Posterior, noise: np.ndarray, where: np.ndarray) -> Answer:
    belief = posterior.predict(known, where)
    total = np.asarray(belief.variance)[:, 0] + float(noise[0]) + OWN
    return np.asarray(belief.mean)[:, 0], np.sqrt(total)


def approximate(inputs: np.ndarray, values: np.ndarray, where: np.ndarray) -> Answer:
    """As a run of the program learns."""
    rows = _rows(inputs, values)
    settings = Settings(structure=Structure(latents=1), points=POINTS, scaffold=40, starts=2)
    base = refresh.based_on(rows, np.ones(1), settings)
    known = inducing.posterior(base, inducing.told(base, rows))
    return _asked(known, np.asarray(base.noise), where)


def whole(inputs: np.ndarray, values: np.ndarray, where: np.ndarray) -> Answer:
    """Without approximation."""
    rows = _rows(inputs, values)
    found = learning.fit_exact(rows, Structure(latents=1), starts=2, seed=SEED, steps=60)
    points, seen, own = exact.observed(rows)
    noise = np.asarray(found.noise)
    known = exact.condition(found.kernel, points, seen, own + noise[points.output])
    return _asked(known, noise, where)


def scikit(inputs: np.ndarray, values: np.ndarray, where: np.ndarray) -> Answer:
    """One length-scale an input, noise learned, from two starts."""
    shape = kernels.ConstantKernel() * kernels.RBF(3.0 * np.ones(inputs.shape[1]))
    process = GaussianProcessRegressor(
        shape + kernels.WhiteKernel(0.5), n_restarts_optimizer=1, random_state=SEED
    ).fit(inputs, values)
    return process.predict(where, return_std=True)


def line(inputs: np.ndarray, values: np.ndarray, where: np.ndarray) -> Answer:
    """A straight line in all inputs."""
    columns, asked = (np.column_stack([np.ones(len(each)), each]) for each in (inputs, where))
    slope, left = np.linalg.lstsq(columns, values, rcond=None)[:2]
    noise = np.sqrt(left[0] / (values.size - slope.size))
    return asked @ slope, np.full(len(where), noise)


if __name__ == "__main__":
    main()
