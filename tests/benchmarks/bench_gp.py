"""What learning by Gaussian processes costs, sample by sample; other libraries on one stream."""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax  # noqa: E402 - after the number of threads

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

from gcs_sysid.gp import (  # noqa: E402
    exact,
    inducing,
    learner,
    local,
    posterior,
    refresh,
    samples,
)
from gcs_sysid.gp.learner import Learner  # noqa: E402
from gcs_sysid.gp.learning import Structure  # noqa: E402
from gcs_sysid.gp.local import Shape  # noqa: E402
from gcs_sysid.gp.refresh import Settings  # noqa: E402
from gcs_sysid.gp.samples import Rows, Scaling  # noqa: E402
from tests.benchmarks import table  # noqa: E402

INPUTS, OUTPUTS, POINTS = 8, 6, 250
SINGLES = 3000
BLOCK = 20 * learner.BATCH
MILLION = 1_000_000
CHUNK, FIRST, STREAM = 50, 200, 1000
QUERIES = 128
"""Samples that the local part is learned from, as a run of the program does."""
STREAMS = (1, 11, 21)
"""Seeds, of the unseen samples one more."""
STALLING = Settings(structure=Structure(latents=2), points=200, rows=500, scaffold=30, starts=2)
"""Of the streams."""
MORE_POINTS = (400, 600)
SHARES = (0.1, 0.3, 1.0)
"""Of the samples that a store holds at a refresh."""
Row = tuple[object, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    parser.add_argument("--samples", type=int, default=MILLION, help="0: only the libraries")
    given = parser.parse_args()
    if given.samples:
        costs(given.samples)
    libraries()


def flown(seed: int, count: int) -> Rows:
    """Six outputs of eight inputs, smooth, with noise."""
    random = np.random.default_rng(seed)
    inputs = random.normal(size=(count, INPUTS))
    mix = np.random.default_rng(0).normal(size=(INPUTS, OUTPUTS))
    values = np.tanh(0.5 * inputs @ mix) + 0.1 * random.normal(size=(count, OUTPUTS))
    return Rows(inputs, values, np.full((count, OUTPUTS), 100.0))


def costs(count: int) -> None:
    """Latency and memory of `observe` from the first sample to the last, and of asking."""
    begun = time.perf_counter()
    rows = flown(1, 2000)
    settings = Settings(structure=Structure(latents=2), points=POINTS, starts=1, steps=30)
    base = refresh.based_on(rows, np.ones(OUTPUTS), settings)
    learned = time.perf_counter() - begun
    known = learner.start(base, capacity=4096)
    known = learner.observe(known, flown(2, learner.BATCH), 0)
    known, _ = _singles(known, 50)
    known, early = _singles(known, SINGLES)
    # The store is full after the first block.
    known, _ = _blocks(known, BLOCK)
    memory = _peak()
    known, batch = _blocks(known, count)
    grown = _peak() - memory
    known, late = _singles(known, SINGLES)
    asked = posterior.predict(learner.posterior(known), flown(4, 10_000).inputs)
    jax.block_until_ready(asked)
    whole = learner.posterior(known)
    grid, one = flown(5, 10_000).inputs, flown(6, 1).inputs
    posterior.mean(whole, one)
    slower = 100.0 * (np.median(late) / np.median(early) - 1.0)
    rows_out: list[Row] = [
        ("hyper-parameters and points, 2000 samples, with compilation", "–", f"{learned:.1f} s"),
        ("observe one sample, six outputs, p50 / p99", "p99 5 ms", _percentiles(early)),
        (f"the same after {count:,} samples", "same within 5 %", _percentiles(late)),
        ("  median against the first", "5 %", f"{slower:+.1f} %"),
        ("  the posterior of it, factorised when next asked", "–",
         _best(lambda: learner.posterior(known))),
        ("observe in batches, a sample", "–", f"{1e6 * batch:.0f} µs"),
        ("memory, from a full store to the end", "flat", f"{grown / 1024:+.0f} MB"),
        ("mean at one place", "1 ms", _best(lambda: posterior.mean(whole, one))),
        ("mean and sd at 10 000 places", "0.2 s", _best(lambda: posterior.predict(whole, grid))),
        ("mean alone, 10 000 places", "–", _best(lambda: posterior.mean(whole, grid))),
    ]  # fmt: skip
    rows_out += _against_exact()
    table.show(
        "gp_cost",
        f"Learning with {POINTS} inducing points, {INPUTS} inputs, {OUTPUTS} outputs",
        ("what", "wanted", "found"),
        rows_out,
    )


def _singles(known: Learner, count: int) -> tuple[Learner, np.ndarray]:
    rows = flown(known.count, count)
    taken = np.zeros(count)
    for index in range(count):
        one = samples.some_of(rows, np.array([index]))
        begun = time.perf_counter()
        known = learner.observe(known, one, 0)
        jax.block_until_ready(known.total)
        taken[index] = time.perf_counter() - begun
    return known, taken


def _blocks(known: Learner, count: int) -> tuple[Learner, float]:
    """After so many samples, no two of them the same, and the time of `observe` a sample."""
    begun_at, taken = known.count, 0.0
    while known.count < count:
        block = flown(known.count, BLOCK)
        begun = time.perf_counter()
        known = learner.observe(known, block, 0)
        jax.block_until_ready(known.total)
        taken += time.perf_counter() - begun
    return known, taken / max(known.count - begun_at, 1)


def _percentiles(taken: np.ndarray) -> str:
    low, high = 1e3 * np.percentile(taken, (50, 99))
    return f"{low:.2f} / {high:.2f} ms"


def _best(ask: Callable[[], object]) -> str:
    taken = []
    for _ in range(7):
        begun = time.perf_counter()
        jax.block_until_ready(ask())
        taken.append(time.perf_counter() - begun)
    return f"{1e3 * min(taken):.1f} ms (median {1e3 * np.median(taken):.1f})"


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _against_exact() -> list[Row]:
    """NLPD of unseen samples, exact process against inducing points with its hyper-parameters.

    On a function that bends in all of eight inputs, and on one of three inputs that breaks at a
    stall, as coefficients do.
    """
    curved = Settings(structure=Structure(latents=2), points=POINTS, starts=1, steps=40)
    rows, unseen, own = flown(7, 400), flown(8, 1000), np.full(OUTPUTS, 0.01)
    given = [
        _given_away(rows, unseen, own, replace(curved, points=points))
        for points in (POINTS, *MORE_POINTS)
    ]
    known, scale, middle = stalling(STREAMS[0], 600)
    asked = _scaled(scale, middle, *stream(STREAMS[0] + 1, 1000))
    breaking = _given_away(known, asked, (SPREAD / scale.unit) ** 2, STALLING)
    most = " / ".join(str(points) for points in (POINTS, *MORE_POINTS))
    return [
        ("NLPD given away against the exact process, a value: eight inputs, 2400 values, "
         f"{most} points", "0.02 nat", " / ".join(f"{one:+.3f}" for one in given) + " nat"),
        (f"  a stall over three inputs, 1800 values, {STALLING.points} points",
         "0.02 nat", f"{breaking:+.3f} nat"),
        *((f"lost by a refresh, a sample, stall learned of after the points were chosen, "
           f"{share:.0%} of the samples in the store", "0.02 nat",
           " / ".join(f"{lost(seed, share):+.3f}" for seed in STREAMS) + " nat")
          for share in SHARES),
    ]  # fmt: skip


def _given_away(rows: Rows, unseen: Rows, own: np.ndarray, settings: Settings) -> float:
    base = refresh.based_on(rows, np.ones(rows.values.shape[1]), settings)
    points, values, noise = exact.observed(rows)
    total = noise + np.asarray(base.noise)[points.output]
    whole = exact.condition(base.kernel, points, values, total)
    sparse = inducing.posterior(base, inducing.told(base, rows))
    found = [_nlpd(one, unseen, own + np.asarray(base.noise)) for one in (whole, sparse)]
    return found[1] - found[0]


def lost(seed: int, share: float) -> float:
    """Against all samples told to the refreshed basis: what left the store was carried over."""
    rows, scale, middle = stalling(seed, 2 * STREAM)
    early = samples.some_of(rows, np.arange(0, STREAM, 5))
    base = refresh.based_on(early, np.ones(3), STALLING)
    known = learner.start(base, capacity=round(share * 2 * STREAM))
    fresh = refresh.refreshed(learner.observe(known, rows, 0), STALLING)
    batch = learner.observe(learner.start(fresh.base, capacity=1), rows, 0)
    unseen = _scaled(scale, middle, *stream(seed + 1, 400))
    own = (SPREAD / scale.unit) ** 2
    found = [_nlpd(learner.posterior(one), unseen, own) for one in (fresh, batch)]
    return 3.0 * (found[0] - found[1])


def stalling(seed: int, count: int) -> tuple[Rows, Scaling, np.ndarray]:
    """A stream, with its scaling and its means."""
    inputs, values = stream(seed, count)
    scale, middle = samples.scaling(inputs, values), values.mean(axis=0)
    return _scaled(scale, middle, inputs, values), scale, middle


def _scaled(scale: Scaling, middle: np.ndarray, where: np.ndarray, what: np.ndarray) -> Rows:
    return samples.rows(scale, where, what - middle, np.broadcast_to(SPREAD**2, what.shape))


def _nlpd(known: posterior.Posterior, rows: Rows, noise: np.ndarray) -> float:
    belief = posterior.predict(known, rows.inputs)
    total = np.asarray(belief.variance) + noise
    error = rows.values - np.asarray(belief.mean)
    return float(np.mean(0.5 * (np.log(2.0 * np.pi * total) + error**2 / total)))


BREAK = 0.2
"""Angle of attack of the stall [rad]."""


def truth(inputs: np.ndarray) -> np.ndarray:
    """CL, CD and Cm of angle of attack, elevator and pitch rate, with a break at the stall."""
    alpha, elevator, rate = inputs.T
    beyond = np.maximum(alpha - BREAK, 0.0)
    lift = 0.3 + 5.0 * alpha - 6.0 * beyond + 0.4 * elevator + 4.0 * rate
    drag = 0.03 + 0.06 * lift**2 + 2.0 * beyond**2
    pitch = 0.05 - 0.8 * alpha - 1.5 * beyond - 1.2 * elevator - 12.0 * rate
    return np.stack([lift, drag, pitch], axis=1)


SPREAD = np.array([0.02, 0.005, 0.01])
"""Noise of the three measured coefficients, one standard deviation."""


def stream(seed: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Samples of a flight that comes to the stall only in its second half."""
    random = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, count)
    inputs = np.stack(
        [
            0.08 + 0.12 * share + (0.05 + 0.05 * share) * random.standard_normal(count),
            0.1 * random.standard_normal(count),
            0.005 * random.standard_normal(count),
        ],
        axis=1,
    )
    return inputs, truth(inputs) + SPREAD * random.standard_normal((count, 3))


def libraries() -> None:
    """The same stream in chunks of 50 through each library: time a chunk, error, coverage."""
    rows, missing = [], []
    for name, make in (
        ("gcs_sysid", ours),
        ("gcs_sysid, local part beside", with_local_part),
        ("scikit-learn, refit", scikit),
        ("tinygp, conditioned anew", tiny),
        ("GPyTorch, get_fantasy_model", torch),
    ):
        try:
            rows.append((name, *_streamed(make)))
        except ImportError as error:
            missing.append(f"{name}: not installed here ({error.name})")
    print(*missing, sep="\n")
    table.show(
        # What is kept is a run with all of them.
        "gp_libraries" if not missing else "gp_libraries_here",
        f"{len(STREAMS)} streams of {STREAM} samples, three outputs, stall in the second half; "
        f"hyper-parameters from the first {FIRST}, ours anew at 400 and 800; 400 unseen after "
        f"every chunk; {os.cpu_count()} cores",
        (
            "library",
            "first chunk",
            "last chunk",
            "error CL / CD / Cm [%]",
            "in 95 %",
            "below / past the break",
            "NLPD",
        ),
        rows,
    )


Step = Callable[[np.ndarray, np.ndarray], None]
Ask = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def _streamed(make: Callable[[np.ndarray, np.ndarray], tuple[Step, Ask]]) -> Row:
    """Of several streams: time of a chunk, and means of error, coverage and NLPD at the end."""
    runs = [one_stream(make, seed) for seed in STREAMS]
    second, last, error, held, density = (np.mean(part, axis=0) for part in zip(*runs, strict=True))
    whole, below, past = (f"{100 * one:.0f} %" for one in held)
    return (f"{second:.3f} s", f"{last:.3f} s", " / ".join(f"{one:.1f}" for one in error),
            whole, f"{below} / {past}", f"{density:.2f}")  # fmt: skip


def one_stream(
    make: Callable[[np.ndarray, np.ndarray], tuple[Step, Ask]], seed: int
) -> tuple[float, float, np.ndarray, np.ndarray, float]:
    inputs, values = stream(seed, STREAM)
    unseen, noisy = stream(seed + 1, 400)
    wanted = truth(unseen)
    step, ask = make(inputs[:FIRST], values[:FIRST])
    taken = []
    for start in range(FIRST, STREAM, CHUNK):
        begun = time.perf_counter()
        step(inputs[start : start + CHUNK], values[start : start + CHUNK])
        mean, deviation = ask(unseen)
        taken.append(time.perf_counter() - begun)
    error = 100.0 * np.sqrt(np.mean((mean - wanted) ** 2, axis=0)) / np.std(wanted, axis=0)
    inside, past = np.abs(mean - wanted) < 1.959964 * deviation, unseen[:, 0] > BREAK
    held = np.array([inside.mean(), inside[~past].mean(), inside[past].mean()])
    total = deviation**2 + SPREAD**2
    density = np.mean(0.5 * (np.log(2.0 * np.pi * total) + (noisy - mean) ** 2 / total))
    # The first chunk compiles; the second is what a chunk costs.
    return taken[1], float(np.median(taken[-3:])), error, held, float(density)


def ours(inputs: np.ndarray, values: np.ndarray) -> tuple[Step, Ask]:
    """The learner, refreshed as `listen` does: whenever the samples have doubled."""
    return _learning(inputs, values, local_part=False)


def with_local_part(inputs: np.ndarray, values: np.ndarray) -> tuple[Step, Ask]:
    """The same, and neighbours in its store for what the inducing points leave."""
    return _learning(inputs, values, local_part=True)


def _learning(inputs: np.ndarray, values: np.ndarray, *, local_part: bool) -> tuple[Step, Ask]:
    middle = values.mean(axis=0)
    scale = samples.scaling(inputs, values)

    def rows(where: np.ndarray, what: np.ndarray) -> Rows:
        return _scaled(scale, middle, where, what)

    first = rows(inputs, values)
    base = refresh.based_on(first, np.ones(3), STALLING)
    known = learner.observe(learner.start(base, capacity=4096), first, 0)
    refreshed_at = known.count

    def beside(known: Learner) -> Shape | None:
        if not local_part:
            return None
        return local.learned(learner.residuals(known), queries=QUERIES, seed=0).shape

    shape = beside(known)

    def step(where: np.ndarray, what: np.ndarray) -> None:
        nonlocal known, refreshed_at, shape
        known = learner.observe(known, rows(where, what), 0)
        if known.count >= 2 * refreshed_at:
            known, refreshed_at = refresh.refreshed(known, STALLING), known.count
            shape = beside(known)

    def ask(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        scaled = (where - scale.centre) / scale.spread
        belief = posterior.predict(learner.posterior(known), scaled)
        mean, variance = np.asarray(belief.mean), np.asarray(belief.variance)
        if shape is not None:
            near = local.predict(learner.local_part(known, shape), scaled)
            mean, variance = mean + near.mean, variance + near.variance
        return middle + mean * scale.unit, np.sqrt(variance) * scale.unit

    return step, ask


def scikit(inputs: np.ndarray, values: np.ndarray) -> tuple[Step, Ask]:
    """One kernel for all outputs, as it offers; kept from the first samples, refitted data."""
    from sklearn.gaussian_process import GaussianProcessRegressor, kernels

    middle, unit, spread = values.mean(axis=0), values.std(axis=0), inputs.std(axis=0)
    shape = kernels.ConstantKernel() * kernels.RBF(np.ones(3)) + kernels.WhiteKernel(0.01)
    first = GaussianProcessRegressor(shape, n_restarts_optimizer=1, random_state=0)
    kernel = first.fit(inputs / spread, (values - middle) / unit).kernel_
    data = [inputs, values]
    held = [first]

    def step(where: np.ndarray, what: np.ndarray) -> None:
        data[0], data[1] = np.concatenate([data[0], where]), np.concatenate([data[1], what])
        held[0] = GaussianProcessRegressor(kernel, optimizer=None).fit(
            data[0] / spread, (data[1] - middle) / unit
        )

    def ask(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean, deviation = held[0].predict(where / spread, return_std=True)
        noise = kernel.k2.noise_level
        return middle + mean * unit, np.sqrt(np.maximum(deviation**2 - noise, 1e-12)) * unit

    return step, ask


def tiny(inputs: np.ndarray, values: np.ndarray) -> tuple[Step, Ask]:
    """One process an output, hyper-parameters by its own likelihood, conditioned anew each time."""
    import tinygp
    from scipy import optimize

    middle, unit, spread = values.mean(axis=0), values.std(axis=0), inputs.std(axis=0)

    def process(vector, where):
        kernel = jax.numpy.exp(vector[0]) * tinygp.transforms.Linear(
            jax.numpy.exp(-vector[1:4]), tinygp.kernels.ExpSquared()
        )
        return tinygp.GaussianProcess(kernel, where, diag=jax.numpy.exp(vector[4]))

    found = []
    for output in range(3):
        wanted = (values[:, output] - middle[output]) / unit[output]
        cost = jax.jit(
            jax.value_and_grad(
                lambda vector, wanted=wanted: (
                    -process(vector, inputs / spread).log_probability(wanted)
                )
            )
        )
        best = optimize.minimize(
            lambda vector, cost=cost: [np.asarray(one, dtype=float) for one in cost(vector)],
            np.array([0.0, 0.0, 0.0, 0.0, -3.0]), jac=True, method="L-BFGS-B",
        )  # fmt: skip
        found.append(best.x)
    data = [inputs, values]

    def step(where: np.ndarray, what: np.ndarray) -> None:
        data[0], data[1] = np.concatenate([data[0], where]), np.concatenate([data[1], what])

    def ask(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean, deviation = [], []
        for output in range(3):
            wanted = (data[1][:, output] - middle[output]) / unit[output]
            known = process(found[output], data[0] / spread).condition(wanted, where / spread).gp
            mean.append(middle[output] + np.asarray(known.loc) * unit[output])
            deviation.append(np.sqrt(np.asarray(known.variance)) * unit[output])
        return np.stack(mean, axis=1), np.stack(deviation, axis=1)

    return step, ask


def torch(inputs: np.ndarray, values: np.ndarray) -> tuple[Step, Ask]:
    """A batch of independent exact processes, extended by `get_fantasy_model`."""
    import gpytorch
    import torch

    middle, unit, spread = values.mean(axis=0), values.std(axis=0), inputs.std(axis=0)
    batch = torch.Size([3])

    def tensor(where: np.ndarray) -> torch.Tensor:
        return torch.tensor(where / spread).expand(3, -1, -1)

    class Process(gpytorch.models.ExactGP):
        def __init__(self, where, what, likelihood):
            super().__init__(where, what, likelihood)
            self.mean_module = gpytorch.means.ZeroMean(batch_shape=batch)
            self.covar_module = gpytorch.kernels.ScaleKernel(
                gpytorch.kernels.RBFKernel(ard_num_dims=3, batch_shape=batch), batch_shape=batch
            )

        def forward(self, where):
            return gpytorch.distributions.MultivariateNormal(
                self.mean_module(where), self.covar_module(where)
            )

    likelihood = gpytorch.likelihoods.GaussianLikelihood(batch_shape=batch).double()
    what = torch.tensor(((values - middle) / unit).T)
    model = Process(tensor(inputs), what, likelihood).double()
    model.train()
    likelihood.train()
    optimizer = torch.optim.Adam(model.parameters(), lr=0.1)
    marginal = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, model)
    for _ in range(100):
        optimizer.zero_grad()
        loss = -marginal(model(tensor(inputs)), what).sum()
        loss.backward()
        optimizer.step()
    model.eval()
    likelihood.eval()
    model(tensor(inputs[:2]))
    held = [model]

    def step(where: np.ndarray, what: np.ndarray) -> None:
        held[0] = held[0].get_fantasy_model(tensor(where), torch.tensor(((what - middle) / unit).T))

    def ask(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with torch.no_grad():
            found = held[0](tensor(where))
        mean, variance = found.mean.numpy().T, found.variance.numpy().T
        return middle + mean * unit, np.sqrt(np.maximum(variance, 1e-12)) * unit

    return step, ask


if __name__ == "__main__":
    main()
