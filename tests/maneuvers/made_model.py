"""A made-up aircraft with an identified model, for tests of maneuvers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy import linalg

from gcs_sysid.aircraft import Aircraft, CoefficientModel, Value
from gcs_sysid.estimate import innovation_spectrum
from gcs_sysid.estimate.innovation_spectrum import Spectrum
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers.flown import STEP
from gcs_sysid.maneuvers.knowledge import Added
from tests.offline.made_aircraft import small

TERMS = {
    "CX": {"1": -0.05, "alpha^2": 2.0},
    "CY": {"beta": -0.9, "rudder": 0.2},
    "CZ": {"1": -0.3, "alpha": -5.0, "qhat": -8.0},
    "Cl": {"beta": -0.1, "phat": -0.5, "rhat": 0.2, "aileron": 0.17},
    "Cm": {"1": 0.01, "alpha": -1.5, "qhat": -30.0, "elevator": -0.99},
    "Cn": {"beta": 0.08, "phat": -0.05, "rhat": -0.1, "rudder": -0.07},
}


def aircraft() -> Aircraft:
    models = {
        name: CoefficientModel(
            {key: Value(value, 0.05 * abs(value)) for key, value in terms.items()}
        )
        for name, terms in TERMS.items()
    }
    servos = tuple(replace(servo, time_constant=0.04, delay=0.02) for servo in small().servos)
    return replace(small(), aerodynamics=models, servos=servos)


def rows_of(of: AeroModel, blocks: Mapping[str, np.ndarray], samples: float = 1.0) -> Added:
    """Information on the terms of some coefficients, each by itself."""
    every = [
        blocks.get(name, np.zeros((len(fit.keys), len(fit.keys)))) for name, fit in of.fits.items()
    ]
    return Added(linalg.block_diag(*every), samples)


def model(*, relative: float = 0.05) -> AeroModel:
    """With every value known to this part of itself, independently."""
    fits = {}
    for name, terms in TERMS.items():
        value = np.array(list(terms.values()))
        zero = np.zeros(value.size)
        fits[name] = CoefficientFit(
            keys=tuple(terms),
            value=value,
            covariance=np.diag((relative * value) ** 2),
            flight_value=value,
            deviations={"noise": np.abs(relative * value), "scale": zero},
            late=zero,
            white_deviation=zero,
            repeated_covariance=np.diag((relative * value) ** 2),
            discrepancy=0.0,
            calibration=1.0,
            residual=0.01,
            correlation=np.eye(value.size),
            excitation=np.ones(value.size),
            lowest=zero,
            highest=zero,
            spread=zero,
            samples=10000,
            effective_samples=1000.0,
        )
    return AeroModel(fits, ("aileron", "elevator", "rudder"))


def white(variance: float, *, delay: float = 1e-6) -> Spectrum:
    """A filter to which rows of every coefficient count alike, whatever their frequency.

    `delay` is how well it knows how late all surfaces are [s]; other errors it knows perfectly.
    """
    names = tuple(TERMS)
    channels = len(names) + innovation_spectrum.CONSTANTS
    density = np.zeros((2, channels, channels), dtype=complex)
    density[:, : len(names), : len(names)] = np.eye(len(names)) / variance
    edges = np.array([0.0, 0.5 / STEP])
    precision = np.full(12, 1e12)
    precision[innovation_spectrum.DELAY] = delay**-2.0
    return Spectrum(STEP, edges, density, names, precision, TERMS, aircraft().control_names)
