"""The processes on public sets, beside other libraries: diabetes, and a flight of UMN's Thor.

Diabetes, which scikit-learn ships: 442 patients, ten inputs, one output (Efron et al., "Least angle
regression", Annals of Statistics 32, 2004). Nearly linear and very noisy, as flights are not: it
shows that the learning of hyper-parameters and the approximation give nothing away, and not what
processes are good for. The flight: six measured coefficients at the states that `identify` knows,
whole maneuvers left out. Libraries that are not installed have no row.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax  # noqa: E402 - after the number of threads

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
import pyarrow.parquet as pq  # noqa: E402
from sklearn.datasets import load_diabetes  # noqa: E402
from sklearn.gaussian_process import GaussianProcessRegressor, kernels  # noqa: E402

from gcs_sysid import aircraft_file  # noqa: E402
from gcs_sysid.aircraft import COEFFICIENTS  # noqa: E402
from gcs_sysid.gp import exact, fitting, inducing, learning, posterior, refresh  # noqa: E402
from gcs_sysid.gp.fitting import Data, Effort  # noqa: E402
from gcs_sysid.gp.learning import Structure  # noqa: E402
from gcs_sysid.gp.posterior import Posterior  # noqa: E402
from gcs_sysid.gp.refresh import Settings  # noqa: E402
from gcs_sysid.gp.samples import Rows  # noqa: E402
from tests.benchmarks import bench_thor as thor  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.benchmarks import thesis_data as flights  # noqa: E402

FOLDS, SEED = 10, 0
POINTS = 100
GROUPS, SAMPLES = 5, 400
"""Of maneuvers that are left out in turn, and samples of the flight that are kept, evenly."""
STEPS = 100
"""Of the libraries' searches, at most."""
EFFORT = Effort(
    settings=Settings(structure=Structure(latents=2), points=200, rows=600, scaffold=25, starts=2)
)
SCORES = ("SMSE", "NLPD [nat]", "in 95 %", "s a fold")
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
        **LIBRARIES,
        "least squares": line,
    }
    table.show(
        "gp_public",
        f"Diabetes (442 samples, 10 inputs, shipped with scikit-learn), {FOLDS} folds",
        ("method", *SCORES),
        _rows_of(methods, lambda method: scored(method, data.data, data.target)),
    )
    if thor.THOR.is_dir():
        flown()
    else:
        print("Thor: the flight is not beside the checkout")


def _rows_of(
    methods: Mapping[str, Any], score: Callable[[Any], tuple[str, ...]]
) -> list[tuple[str, ...]]:
    """A row for each of the methods whose library is installed."""
    rows = []
    for name, method in methods.items():
        try:
            rows.append((name, *score(method)))
        except ImportError as error:
            print(f"{name}: not installed here ({error.name})")
    return rows


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
    return _told(errors, densities, held, taken)


def _told(
    errors: list[np.ndarray],
    densities: list[np.ndarray],
    held: list[np.ndarray],
    taken: list[float],
) -> tuple[str, ...]:
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


def tiny(inputs: np.ndarray, values: np.ndarray, where: np.ndarray) -> Answer:
    """The same covariance in tinygp, from one start."""
    import tinygp
    from scipy import optimize

    def process(vector: jax.Array) -> Any:
        kernel = jax.numpy.exp(vector[1]) * tinygp.transforms.Linear(
            jax.numpy.exp(-vector[2:]), tinygp.kernels.ExpSquared()
        )
        return tinygp.GaussianProcess(kernel, inputs, diag=jax.numpy.exp(vector[0]))

    cost = jax.jit(jax.value_and_grad(lambda vector: -process(vector).log_probability(values)))
    first = np.concatenate([[-0.7, 0.0], np.full(inputs.shape[1], np.log(3.0))])
    best = optimize.minimize(
        lambda vector: [np.asarray(one, dtype=float) for one in cost(vector)],
        first, jac=True, method="L-BFGS-B", options={"maxiter": STEPS},
    ).x  # fmt: skip
    known = process(jax.numpy.asarray(best)).condition(values, where).gp
    return np.asarray(known.loc), np.sqrt(np.asarray(known.variance) + np.exp(best[0]))


def torch(inputs: np.ndarray, values: np.ndarray, where: np.ndarray) -> Answer:
    """The same covariance in GPyTorch, exact, by Adam."""
    import gpytorch
    import torch

    class Process(gpytorch.models.ExactGP):
        def __init__(self, where, what, likelihood):
            super().__init__(where, what, likelihood)
            self.mean_module = gpytorch.means.ZeroMean()
            self.covar_module = gpytorch.kernels.ScaleKernel(
                gpytorch.kernels.RBFKernel(ard_num_dims=inputs.shape[1])
            )

        def forward(self, where):
            return gpytorch.distributions.MultivariateNormal(
                self.mean_module(where), self.covar_module(where)
            )

    likelihood = gpytorch.likelihoods.GaussianLikelihood().double()
    given, wanted = torch.tensor(inputs), torch.tensor(values)
    model = Process(given, wanted, likelihood).double()
    model.train()
    optimizer = torch.optim.Adam(model.parameters(), lr=0.1)
    marginal = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, model)
    for _ in range(STEPS):
        optimizer.zero_grad()
        loss = -marginal(model(given), wanted)
        loss.backward()
        optimizer.step()
    model.eval()
    likelihood.eval()
    with torch.no_grad():
        found = likelihood(model(torch.tensor(where)))
    return found.mean.numpy(), np.sqrt(found.variance.numpy())


LIBRARIES: dict[str, Method] = {
    "scikit-learn, exact": scikit,
    "tinygp, exact": tiny,
    "GPyTorch, exact": torch,
}


@dataclass(frozen=True)
class Set:
    """Samples of a flight; what to learn from, scaled, and the inputs asked about.

    Attributes:
        inputs: regressors.
        values: coefficients.
        piece: maneuver of each.
        step: sample interval [s].
        where: regressors of those that are left out.
    """

    inputs: np.ndarray
    values: np.ndarray
    piece: np.ndarray
    step: float
    where: np.ndarray


Many = Callable[[Set], Answer]


def flown() -> None:
    """Thor's flight, groups of whole maneuvers left out in turn."""
    with tempfile.TemporaryDirectory(prefix="gcs-sysid-thor-") as folder:
        words = ["identify", thor.THOR / "thor_flight75.tlog", "--aircraft"]
        words += [thor.THOR / "aircraft.toml", "--prior", "none", "--method", "equation-error"]
        flights.run(*words, "--out", Path(folder))
        read = pq.read_table(Path(folder) / "samples.parquet")
    columns = {name: read[name].to_numpy() for name in read.column_names}
    used = np.flatnonzero(columns["maneuver"] >= 0)
    every = -(-used.size // SAMPLES)
    step = every * float(np.median(np.diff(columns["t"])))
    columns = {name: column[used[::every]] for name, column in columns.items()}
    names = flights.names(aircraft_file.load(thor.THOR / "aircraft.toml"))
    whole = Set(
        inputs=np.stack([columns[name] for name in names], axis=1),
        values=np.stack([columns[f"{name}_measured"] for name in COEFFICIENTS], axis=1),
        piece=columns["maneuver"],
        step=step,
        where=np.zeros((0, len(names))),
    )
    methods: dict[str, Many] = {
        "gcs_sysid, zero mean": combined,
        "gcs_sysid, beside the line": beside,
        **{name: _each(method) for name, method in LIBRARIES.items()},
        "least squares, a line": _each(line),
    }
    count, maneuvers = whole.piece.size, np.unique(whole.piece).size
    table.show(
        "gp_public_flight",
        f"Thor, flight 75 (public, UMN): six measured coefficients, {count} samples of {maneuvers} "
        f"maneuvers, of which {GROUPS} groups are left out in turn; means over the coefficients",
        ("method", *SCORES),
        _rows_of(methods, lambda method: _scored_flight(method, whole)),
    )


def _scored_flight(method: Many, whole: Set) -> tuple[str, ...]:
    """As `scored`, with whole maneuvers left out."""
    ids = np.random.default_rng(SEED).permutation(np.unique(whole.piece))
    errors, densities, held, taken = [], [], [], []
    for group in np.array_split(ids, GROUPS):
        out = np.isin(whole.piece, group)
        middle, unit = whole.values[~out].mean(axis=0), whole.values[~out].std(axis=0)
        scaled = (whole.values - middle) / unit
        inputs = (whole.inputs - whole.inputs[~out].mean(axis=0)) / whole.inputs[~out].std(axis=0)
        begun = time.perf_counter()
        kept = Set(inputs[~out], scaled[~out], whole.piece[~out], whole.step, inputs[out])
        mean, deviation = method(kept)
        taken.append(time.perf_counter() - begun)
        error = scaled[out] - mean
        errors.append(error**2)
        densities.append(0.5 * (np.log(2.0 * np.pi * deviation**2) + (error / deviation) ** 2))
        held.append(np.abs(error) < 1.959964 * deviation)
    return _told(errors, densities, held, taken)


def _each(method: Method) -> Many:
    """A method of one output for every coefficient."""

    def ask(given: Set) -> Answer:
        found = [method(given.inputs, column, given.where) for column in given.values.T]
        mean, deviation = zip(*found, strict=True)
        return np.stack(mean, axis=1), np.stack(deviation, axis=1)

    return ask


def combined(given: Set) -> Answer:
    """Dependent, with both parts as far as these earn their place."""
    inputs, values = given.inputs, given.values
    data = Data(
        inputs=inputs,
        values=values,
        variance=np.full(values.shape, OWN),
        input_variance=np.zeros(inputs.shape),
        slopes=np.zeros((*values.shape, inputs.shape[1])),
        piece=given.piece,
        step=given.step,
    )
    found = fitting.fit(data, EFFORT)
    belief = fitting.predict(found, given.where)
    return belief.mean, np.sqrt(belief.variance + found.discrepancy + OWN)


def beside(given: Set) -> Answer:
    """The same on what a straight line leaves, as a run of the program learns."""
    straight = _each(line)
    left = given.values - straight(replace(given, where=given.inputs))[0]
    mean, deviation = combined(replace(given, values=left))
    return mean + straight(given)[0], deviation


if __name__ == "__main__":
    main()
