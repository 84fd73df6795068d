"""Since when, and in which coefficient, the simulation departs from the flight.

Each window's measured coefficients are held against those of the aircraft file at the same flow and
deflections. What the difference may be without meaning anything is counted in: the noise of the
measurement, as if a window were one sample, the file's own uncertainty, and that of the flow.

In gusts that no vane sees the last is nearly everything. Once derivatives are known that gusts do
not bend, these are held against the file's instead, within what both may be off by.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import MOMENTS, Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.suspects import RIGGING, file_sigmas, file_values
from gcs_sysid.live.regression import Solution
from gcs_sysid.live.simulation import Simulation

BEGIN, END = 3.0, 2.0
"""Standard deviations from which a departure begins, and below which it is over."""
LATELY_S = 30.0
"""A departure that is over is remembered for so long: it comes and goes with what is flown."""
WINDOWS = 3
"""Windows in a row before it is told: at 50 Hz two seconds."""


@dataclass(frozen=True)
class Departure:
    """A coefficient that the simulation has wrong now.

    Attributes:
        since: time of the first window [s after the epoch].
        size: measured less simulated, over the newest window; of the derivative where one is named.
        deviations: the same over what it may be.
        derivative: regressor of the one that is farthest off; None where coefficients tell.
    """

    since: float
    size: float
    deviations: float
    derivative: str | None = None


@dataclass
class _Watched:
    since: float | None = None
    windows: int = 0
    size: float = 0.0
    deviations: float = 0.0
    derivative: str | None = None
    departed: float = -math.inf


class _Watch:
    """What departs of some coefficients, and lately did."""

    def __init__(self, names: Iterable[str]) -> None:
        self._watched = {name: _Watched() for name in names}

    def told(self) -> dict[str, Departure]:
        """What departs now."""
        return {
            name: Departure(one.since, one.size, one.deviations, one.derivative)
            for name, one in self._watched.items()
            if one.since is not None and one.windows >= WINDOWS
        }

    def lately(self, time: float) -> bool:
        """Whether something departs, or did within `LATELY_S` before a time [s after the epoch]."""
        return any(time - one.departed <= LATELY_S for one in self._watched.values())


class Departures(_Watch):
    """Watches the coefficients for which the aircraft file has aerodynamics without tables.

    Args:
        aircraft: its file.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._simulation = Simulation(aircraft)
        super().__init__(self._simulation.names)

    def take(self, samples: Samples, kept: slice) -> None:
        """Looks at the rows `kept` of a window."""
        values = {name: value[kept] for name, value in samples.regressors.items()}
        for name in self._simulation.names:
            if name not in samples.measured:
                continue
            simulated, own = self._simulation.at(name, values)
            variance = own + samples.noise[name][kept] ** 2
            for variable, unsure in samples.regressor_variance.items():
                moved = {**values, variable: values[variable] + np.sqrt(unsure[kept])}
                variance = variance + (self._simulation.at(name, moved)[0] - simulated) ** 2
            variance = variance + scale_variance(self._aircraft, name, samples, kept)
            size = float(np.mean(samples.measured[name][kept] - simulated))
            away = size / float(np.sqrt(np.mean(variance)))
            _judge(self._watched[name], float(samples.time[kept][0]), size, away)


class DerivativeDepartures(_Watch):
    """Watches the derivatives of coefficients that the aircraft file has without tables.

    A constant may be off by what surfaces ordinarily stand off by.

    Args:
        aircraft: its file.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._values, self._sigmas = file_values(aircraft), file_sigmas(aircraft)
        for (name, key), value in self._values.items():
            if key in aircraft.control_names:
                constant = (name, regressors.CONSTANT)
                sigma = self._sigmas.get(constant, 0.0)
                self._sigmas[constant] = math.hypot(sigma, RIGGING * value)
        super().__init__(dict.fromkeys(name for name, _ in self._values))

    def take(self, time: float, found: Mapping[str, Solution]) -> None:
        """Looks at what is known of the derivatives at a time [s after the epoch]."""
        for name, watched in self._watched.items():
            if name not in found:
                continue
            known = found[name]
            believed, sigma = (
                np.array([part.get((name, key), 0.0) for key in known.keys])
                for part in (self._values, self._sigmas)
            )
            apart = known.value - believed
            variance = np.diagonal(known.covariance) + sigma**2
            away = np.abs(apart) / np.sqrt(np.maximum(variance, 1e-300))
            most = int(np.argmax(away))
            _judge(watched, time, float(apart[most]), float(away[most]))
            watched.derivative = known.keys[most]


def scale_variance(
    aircraft: Aircraft, name: str, samples: Samples, kept: slice | np.ndarray
) -> Float[np.ndarray, " sample"]:
    """Variance of a coefficient by what mass, inertia and thrust may be wrong by."""
    weight = aircraft.mass.inertia_sigma if name in MOMENTS else aircraft.mass.mass_sigma
    push = max((engine.thrust_sigma for engine in aircraft.propulsion), default=0.0)
    return (weight * samples.mass_part[name][kept]) ** 2 + (
        push * samples.thrust_part[name][kept]
    ) ** 2


def _judge(watched: _Watched, time: float, size: float, away: float) -> None:
    """Begins, goes on with or ends a departure."""
    same = watched.since is None or away * watched.deviations > 0.0
    if abs(away) >= (BEGIN if watched.since is None else END) and same:
        watched.since = time if watched.since is None else watched.since
        watched.windows += 1
        if watched.windows >= WINDOWS:
            watched.departed = time
    else:
        watched.since, watched.windows = None, 0
    watched.size, watched.deviations = size, away
