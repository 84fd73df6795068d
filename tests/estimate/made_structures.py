"""Flights whose force coefficient has exactly the terms given."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_sysid.aircraft import Aircraft, Control, Geometry, Mass
from gcs_sysid.estimate import basis, stepwise
from gcs_sysid.estimate.coefficients import Samples
from tests.estimate.made_problems import STEP, coloured

CONTROLS = ("elevator", "aileron", "rudder")
SIZE = {"alpha": 0.06, "beta": 0.05, "phat": 0.03, "qhat": 0.003, "rhat": 0.02, "elevator": 0.05,
        "aileron": 0.05, "rudder": 0.05}  # fmt: skip
AIRCRAFT = Aircraft(
    "made up",
    Mass(2.0, 0.1, 0.1, 0.2, mass_sigma=0.0, inertia_sigma=0.0),
    Geometry(0.3, 1.3, 0.25),
    controls=tuple(Control(name, {name: 1.0}) for name in CONTROLS),
)


def flight(
    terms: Mapping[str, float], *, seed: int, noise: float, memory: float = 0.9, count: int = 3000
) -> Samples:
    """A minute of CZ made of `terms`, with residuals that remember."""
    generator = np.random.default_rng(seed)
    values = {name: size * coloured(generator, count, 0.96) for name, size in SIZE.items()}
    truth = basis.columns(tuple(terms), CONTROLS, values) @ np.array(list(terms.values()))
    measured = truth + noise * coloured(generator, count, memory)
    nothing = np.zeros(count)
    return Samples(
        time=STEP * np.arange(count),
        qbar=np.full(count, 180.0),
        regressors=values,
        regressor_variance={"alpha": nothing},
        measured={"CZ": measured},
        noise={"CZ": np.full(count, noise)},
        mass_part={"CZ": nothing},
        thrust_part={"CZ": nothing},
        smoothing=1e5,
        refused={},
    )


def false_entries(
    terms: Mapping[str, float], *, seeds: range, noise: float, memory: float
) -> tuple[int, int]:
    """Terms chosen that are not there, and how many that are not there were offered."""
    offered = set(stepwise.candidates(AIRCRAFT)) - set(terms)
    entries = 0
    for seed in seeds:
        samples = flight(terms, seed=1000 + seed, noise=noise, memory=memory)
        piece = np.zeros(samples.time.size, dtype=int)
        chosen = stepwise.choose([samples], AIRCRAFT, {"CZ": ("1", "alpha")}, [piece])["CZ"]
        entries += len(set(chosen) & offered)
    return entries, len(seeds) * len(offered)
