"""The batch fit of the dependent processes on whatever device JAX finds: a processor or a GPU.

The same program, unchanged: hyper-parameters by the exact marginal likelihood, and by that through
inducing points, the posterior, and a map of the envelope. Beside each time how far the result is
from the processor's of the same run.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import jax  # noqa: E402 - found from ROOT

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402

from gcs_sysid.gp import exact, inducing, learning, posterior, refresh  # noqa: E402
from gcs_sysid.gp.inducing import Basis  # noqa: E402
from gcs_sysid.gp.learning import Structure  # noqa: E402
from gcs_sysid.gp.refresh import Settings  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.benchmarks.bench_gp import INPUTS, OUTPUTS, POINTS, flown  # noqa: E402

EXACT, MANY, MAP = 500, 20_000, 10_000
STEPS = 10
TWO = Structure(latents=2)


def prior() -> Basis:
    """Hyper-parameters and points from some samples, the same for every device."""
    settings = Settings(structure=TWO, points=POINTS, starts=1, steps=STEPS)
    base = refresh.based_on(flown(1, 2000), np.ones(OUTPUTS), settings)
    return jax.tree.map(np.asarray, base)


def fits(base: Basis) -> dict[str, Callable[[], object]]:
    """What is timed, by name; each answers with numbers that can be compared."""
    few, many, places = flown(1, EXACT), flown(2, MANY), flown(3, MAP).inputs
    points, values, own = exact.observed(few)
    noise = own + np.asarray(base.noise)[points.output]
    known = inducing.posterior(base, inducing.told(base, many))

    def by_inducing() -> object:
        found = learning.fit_inducing(
            *(many, base.points, np.ones(OUTPUTS), TWO), starts=1, seed=0, steps=STEPS
        )
        return found.log_posterior / (MANY * OUTPUTS)

    def exactly() -> object:
        found = learning.fit_exact(few, TWO, starts=1, seed=0, steps=STEPS)
        return found.log_posterior / (EXACT * OUTPUTS)

    return {
        f"exact fit, {EXACT * OUTPUTS} values, {STEPS} steps": exactly,
        f"exact posterior of {EXACT * OUTPUTS} values": lambda: (
            exact.condition(base.kernel, points, values, noise).weights
        ),
        f"fit by {POINTS} inducing points, {MANY * OUTPUTS} values, {STEPS} steps": by_inducing,
        f"{MANY * OUTPUTS} values into {POINTS} inducing points": lambda: (
            inducing.posterior(base, inducing.told(base, many)).weights
        ),
        f"mean and sd at {MAP} places": lambda: posterior.predict(known, places).mean,
    }


def timed(ask: Callable[[], object]) -> tuple[float, float, np.ndarray]:
    """Seconds of the first time and of the second, and the answer."""
    taken = []
    for _ in range(2):
        begun = time.perf_counter()
        answer = jax.block_until_ready(ask())
        taken.append(time.perf_counter() - begun)
    print(f"{taken[0]:.2f} s, {taken[1]:.3f} s", flush=True)
    return taken[0], taken[1], np.asarray(answer)


def on(device: jax.Device, base: Basis) -> dict[str, tuple[float, float, np.ndarray]]:
    """Every fit on a device."""
    with jax.default_device(device):
        return {name: timed(ask) for name, ask in fits(base).items()}


def main() -> None:
    device, processor = jax.devices()[0], jax.devices("cpu")[0]
    with jax.default_device(processor):
        base = prior()
    found = {processor: on(processor, base)}
    if device != processor:
        found[device] = on(device, base)
    rows = []
    for where, every in found.items():
        for name, (first, again, answer) in every.items():
            right = found[processor][name][2]
            off = float(np.max(np.abs(answer - right)) / np.max(np.abs(right)))
            rows.append((name, where.device_kind, f"{first:.2f} s", f"{again:.3f} s", f"{off:.0e}"))
    table.show(
        f"gp_batch_{device.platform}",
        f"Batch fit of {OUTPUTS} dependent outputs of {INPUTS} inputs in double precision",
        ("what", "device", "first time", "again", "off the processor's"),
        rows,
    )


if __name__ == "__main__":
    main()
