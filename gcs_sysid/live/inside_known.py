"""What the filter with the aerodynamics inside is fed, what it answers, and what of it is kept.

All of it goes from process to process: the filter runs beside the listener, in one of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live.inside_fit import first_terms
from gcs_sysid.live.inside_rows import Batch
from gcs_sysid.live.regression import Solution
from gcs_sysid.model.aided import Means, Noise, Sensors
from gcs_sysid.model.air import Turbulence
from gcs_sysid.offline.aided_flight import Kinematics

PREFIX = "inside."
_AIR = "turbulence"


class Fed(NamedTuple):
    """Some rows of flight, and what is known beside them.

    Attributes:
        number: counts batches: one that is not one more does not follow.
        batch: the rows.
        begun: sensors and gusts as the kinematic filter has them.
        used: stream behind each kind of measurement.
    """

    number: int
    batch: Batch
    begun: Kinematics
    used: Mapping[str, str]


class Newest(NamedTuple):
    """What the filter knows at its newest row.

    Attributes:
        time: of the row [s after the epoch].
        flow: true airspeed [m/s], angle of attack, sideslip [rad] at the centre of gravity.
        deviation: one standard deviation of each.
    """

    time: float
    flow: Float[np.ndarray, " three"]
    deviation: Float[np.ndarray, " three"]


class Known(NamedTuple):
    """Everything that is told of the filter.

    Attributes:
        phase: off, collecting, fitting, known, or failed and why.
        collected: flight that waits to be fitted [s].
        lost: how often the filter lost the aircraft, or a fit was no use.
        refused: why the last fit was refused; empty where it was not.
        troubles: how often it failed otherwise, and began anew.
        trouble: the last time, why.
        newest: None before there is any.
        derivatives: by coefficient; empty before they are known.
        excess: squares of the last innovations over what they should be; not a number before.
        state: what of it outlasts the program, as arrays by name.
    """

    phase: str = "collecting"
    collected: float = 0.0
    lost: int = 0
    refused: str = ""
    troubles: int = 0
    trouble: str = ""
    newest: Newest | None = None
    derivatives: Mapping[str, Solution] = MappingProxyType({})
    excess: float = math.nan
    state: Mapping[str, np.ndarray] = MappingProxyType({})


@runtime_checkable
class Filtering(Protocol):
    """What is fed with rows, and tells what it makes of them when it has."""

    @property
    def known(self) -> Known:
        """The newest of everything."""
        ...

    def take(self, fed: Fed) -> None:
        """Adds rows."""
        ...

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Goes on from what another one knew of the same aircraft; see `learned`."""
        ...


class Learned(NamedTuple):
    """What of a filter outlasts a hole in the data, and a program that was killed.

    Attributes:
        unknowns: derivatives, sensor errors and intensities.
        covariance: of the first two, in the order of `ravel_pytree`.
        drift: by how much more they are believed wrong each second.
    """

    unknowns: Unknowns
    covariance: Float[np.ndarray, "parameter parameter"]
    drift: Float[np.ndarray, "parameter parameter"]


def state(known: Learned) -> dict[str, np.ndarray]:
    """What was learned as arrays by name."""
    (means, noise), covariance, drift = known
    parts = {
        "covariance": covariance,
        "drift": drift,
        "derivatives": ravel_pytree(means.aerodynamics)[0],
        **means.sensors._asdict(),
        **{f"noise.{name}": one for name, one in noise._asdict().items() if name != _AIR},
        **{f"{_AIR}.{name}": one for name, one in noise.turbulence._asdict().items()},
    }
    return {f"{PREFIX}{name}": np.array(one) for name, one in parts.items()}


def learned(
    state: Mapping[str, np.ndarray], aircraft: Aircraft, prior: Mapping[str, Prior] | None
) -> Learned | None:
    """What the `state` of a filter of the same aircraft holds; None where there is none in it.

    Raises:
        KeyError: something is missing.
        ValueError: something has another shape, or is not finite.
    """
    own = {key[len(PREFIX) :]: part for key, part in state.items() if key.startswith(PREFIX)}
    if not own:
        return None
    flat, unravel = ravel_pytree(first_terms(aircraft, prior))
    sensors = Sensors(**{name: own[name] for name in Sensors._fields})
    turbulence = Turbulence(**{name: own[f"{_AIR}.{name}"] for name in Turbulence._fields})
    others = {name: own[f"noise.{name}"] for name in Noise._fields if name != _AIR}
    means = Means(unravel(jnp.asarray(_shaped(own["derivatives"], flat.shape))), sensors)
    count = ravel_pytree(means)[0].size
    covariance, drift = (_shaped(own[name], (count, count)) for name in ("covariance", "drift"))
    unknowns = Unknowns(means, Noise(turbulence=turbulence, **others))
    if not np.isfinite(ravel_pytree(unknowns)[0]).all():
        raise ValueError("not finite")
    return Learned(unknowns, covariance, drift)


def _shaped(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The values, which are to be of this shape and finite."""
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError("another shape, or not finite")
    return values
