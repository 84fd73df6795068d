"""A model fitted to a regression of the test's own, with everything a saved model holds."""

from __future__ import annotations

import numpy as np

from gcs_sysid.estimate import basis, equation_error
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.offline.model_store import StoredModel
from tests.estimate.made_problems import coloured, problem
from tests.offline.made_aircraft import small

STRUCTURE = {
    "CZ": {"1": -0.2, "alpha": -5.6, "alpha^2": 2.0, "elevator": -0.13},
    "Cl": {"1": 0.0, "beta": -0.1, "phat": -0.5, "aileron": 0.17},
    "Cm": {"1": 0.01, "alpha": -2.7, "qhat": -38.0, "elevator": -1.0, "alpha*elevator": 0.8},
}
SIZE = {"alpha": 0.05, "beta": 0.04, "phat": 0.03, "qhat": 0.002, "elevator": 0.05, "aileron": 0.06}


def conditions(seed: int, count: int) -> dict[str, np.ndarray]:
    """Random flight conditions [rad, 1]."""
    generator = np.random.default_rng(seed)
    return {name: size * generator.standard_normal(count) for name, size in SIZE.items()}


def model() -> AeroModel:
    """Three coefficients, one of them not linear."""
    controls = small().control_names
    values = conditions(1, 3000)
    generator = np.random.default_rng(2)
    fits = {}
    for name, terms in STRUCTURE.items():
        matrix = basis.columns(tuple(terms), controls, values)
        measured = matrix @ np.array(list(terms.values())) + 0.01 * coloured(generator, 3000, 0.9)
        part = np.stack([measured, 0.1 * measured], axis=1)
        stated = problem(
            matrix,
            measured,
            keys=tuple(terms),
            noise=0.004,
            error=np.array([0.0, 1e-4, *[0.0] * (len(terms) - 2)]),
            systematic=part,
            sigma=(0.01, 0.1),
        )
        fits[name] = equation_error.solve(stated, None)
    return AeroModel(fits, controls)


def stored() -> StoredModel:
    """The model with its aircraft, a delay and where it came from."""
    return StoredModel(
        model(), small(), 0.0375, [{"source": "flight.tlog", "sha256": "0" * 64, "vehicle": 1}]
    )
