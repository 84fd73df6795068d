"""All that may have made what a simulation leaves of its flights, as one vector.

First come the parameters of the flight model, with what they ordinarily are off by; those that
belong to one flight, such as the bias of its accelerometer, once for each. Behind them stand the
quantities that causes set free, in their own units: directions in the same parameters. They too are
ordinarily off by a little, since no file is exact: a calm flight shows servos that lag by two
milliseconds more than it says, which is no cause of anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.aided.quantities import MORE
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, posterior
from gcs_sysid.diagnose.extended import Direction

TOLERATED = 0.05
"""Of the size of a cause that matters: one ordinary standard deviation of what it sets free."""
ALIKE = 1e-8
"""Directions that differ by less, of their size, are one."""
OWN = ("sensors.gyro_bias", "sensors.accelerometer_bias")
"""What belongs to one flight."""


@dataclass(frozen=True)
class Unknowns:
    """Names and ordinary standard deviations.

    Attributes:
        names: of the unknowns.
        sigma: ordinary standard deviation of each.
        own: for each flight, where the model's parameters stand.
        parameters: how many unknowns are parameters of the model.
        directions: of the quantities, in the parameters.
        sizes: what a cause's shares refer to.
        negligible: deviation that each unknown has in any case, however accurate the file.
        least: what a quantity cannot be less than, where there is such a limit.
        either: pairs of quantities of which only one is ever free.
        beside: parameter that is ordinarily off in the same way as a quantity that has its own.
        acting: sizes of the lags and delays that flights were searched with, by quantity.
    """

    names: tuple[str, ...]
    sigma: Float[np.ndarray, " unknown"]
    own: tuple[np.ndarray, ...]
    parameters: int
    directions: Float[np.ndarray, "parameter quantity"]
    sizes: Mapping[str, float]
    negligible: Float[np.ndarray, " unknown"]
    least: Mapping[str, float]
    either: frozenset[frozenset[str]]
    beside: Mapping[str, str]
    acting: Mapping[str, float] = field(default_factory=dict)

    def freed(self, causes: Sequence[Candidate]) -> tuple[np.ndarray, np.ndarray]:
        """Prior standard deviations and means with some causes set free."""
        sigma, mean = self.sigma.copy(), np.zeros(self.sigma.size)
        for candidate in causes:
            for name, parameter in zip(candidate.frees, candidate.cause.parameters, strict=True):
                index = self.names.index(name)
                sigma[index] = parameter.sigma * self.sizes[parameter.per]
                mean[index] = parameter.expected
        return sigma, mean

    def estimated(self, data: Information, causes: Sequence[Candidate]) -> Posterior:
        """Posterior and evidence with some causes set free.

        Lags and delays that flights were searched with are told by what more of them does where
        they are, not by what all of them does: over the size that is more, so that what is found
        is too near to the size that it was taken at.
        """
        sigma, mean = self.freed(causes)
        found = posterior(data, sigma, mean)
        acting = [name for one in causes for name in one.frees if name in self.acting]
        if not acting:
            return found
        into = np.eye(sigma.size)
        for name in acting:
            here, more = (self.names.index(each) for each in (name, f"{MORE}{name}"))
            sigma[more], mean[more] = sigma[here], mean[here] - self.acting[name]
            sigma[here], mean[here] = 0.0, self.acting[name]
            into[here, more], into[more, more] = 1.0, 0.0
        there = posterior(data, sigma, mean)
        covariance = into @ there.covariance @ into.T
        return replace(found, mean=into @ there.mean, covariance=covariance)

    def alone(
        self, causes: Sequence[Candidate], values: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, " unknown"]:
        """The values, 0 for quantities that these causes do not free."""
        freed = {name for candidate in causes for name in candidate.frees}
        kept = [index < self.parameters or name in freed for index, name in enumerate(self.names)]
        return np.where(kept, values, 0.0)

    def farthest(self, causes: Sequence[Candidate], values: Float[np.ndarray, " unknown"]) -> float:
        """By how many of its own sigmas the most extreme size of causes is off; 0 of none."""
        sigma, mean = self.freed(causes)
        freed = [self.names.index(name) for candidate in causes for name in candidate.frees]
        return float(np.max(np.abs(values - mean)[freed] / sigma[freed], initial=0.0))

    def as_it_is(self, causes: Sequence[Candidate]) -> Unknowns:
        """With what causes are about held where the file has it, ordinary errors too."""
        freed = [self.names.index(name) for candidate in causes for name in candidate.frees]
        about = self.directions[:, [index - self.parameters for index in freed]]
        sigma = self.sigma.copy()
        sigma[: self.parameters][np.any(about != 0.0, axis=1)] = 0.0
        sigma[freed] = 0.0
        return replace(self, sigma=sigma)

    def as_accurate(self, share: float) -> Unknowns:
        """The file's aerodynamics off by a share of its sigmas, and by what is negligible."""
        aerodynamic = [name.startswith("aerodynamics.") for name in self.names]
        scaled = np.where(aerodynamic, share * self.sigma, self.sigma)
        known = self.sigma == 0.0
        return replace(self, sigma=np.where(known, 0.0, np.hypot(scaled, self.negligible)))

    def with_more(self, names: Sequence[str]) -> Unknowns:
        """The same with parameters of the model more, the last of them, all held."""
        first, none = self.parameters, np.zeros(len(names))
        last = np.arange(first, first + len(names))
        return replace(
            self,
            names=(*self.names[:first], *names, *self.names[first:]),
            sigma=np.insert(self.sigma, first, none),
            own=tuple(np.concatenate([own, last]) for own in self.own),
            parameters=first + len(names),
            directions=np.pad(self.directions, ((0, len(names)), (0, 0))),
            negligible=np.insert(self.negligible, first, none),
        )

    @property
    def of_file(self) -> Float[np.ndarray, " unknown"]:
        """Ordinary standard deviation of what the model has as parameters; 0 for quantities."""
        return self.alone((), self.sigma)

    def along(
        self, names: Sequence[str], mean: Float[np.ndarray, " unknown"], covariance: np.ndarray
    ) -> dict[str, tuple[float, float]]:
        """How far the model's parameters moved along quantities, ordinary errors included.

        Not those that every flight has of its own, such as the bias of its accelerometer: a cause
        is what there is beyond them. Where quantities move the same parameters, such as a control's
        effect and what it loses with dynamic pressure, each is what explains the move together with
        the others. Servo commands that are late are so by the delay that is ordinary as well.

        Args:
            names: of the quantities that are free together.
            mean: of all unknowns.
            covariance: of them.

        Returns:
            By name, value and standard deviation in the quantity's unit.
        """
        places = {name: self.names.index(name) for name in names}
        found, shared = {}, []
        for name, index in places.items():
            column = self.directions[:, index - self.parameters]
            if all("#" in self.names[place] for place in np.flatnonzero(column)):
                found[name] = (float(mean[index]), float(np.sqrt(covariance[index, index])))
            else:
                shared.append(name)
        if shared:
            columns = self.directions[:, [places[name] - self.parameters for name in shared]]
            views = np.linalg.pinv(columns, rcond=ALIKE)
            for row, name in enumerate(shared):
                if name in self.beside:
                    views[row, self.names.index(self.beside[name])] += 1.0
            views = np.concatenate([views, views @ self.directions], axis=1)
            for name, view in zip(shared, views, strict=True):
                found[name] = (float(view @ mean), float(np.sqrt(view @ covariance @ view)))
        return found

    def in_flight(
        self, number: int, values: Float[np.ndarray, " unknown"]
    ) -> Float[np.ndarray, " parameter"]:
        """Change of a flight's parameters of the model."""
        every = values[: self.parameters] + self.directions @ values[self.parameters :]
        return every[self.own[number]]


def of_flights(
    names: Sequence[str],
    ordinary: Float[np.ndarray, " parameter"],
    quantities: Mapping[str, Direction],
    usual: Mapping[str, float],
    sizes: Mapping[str, float],
    flights: int,
    negligible: Float[np.ndarray, " parameter"],
    least: Mapping[str, float] | None = None,
    either: Iterable[frozenset[str]] = (),
    beside: Mapping[str, str] | None = None,
) -> Unknowns:
    """The unknowns of so many flights.

    Args:
        names: of the model's parameters.
        ordinary: standard deviation of each.
        quantities: what causes set free.
        usual: ordinary standard deviation of each quantity.
        sizes: what a cause's shares refer to.
        flights: how many.
        negligible: deviation that each parameter has in any case.
        least: limits of quantities; None for none.
        either: pairs of quantities that are not both free.
        beside: parameter that is ordinarily off in the same way as a quantity; None for none.
    """
    listed = [name for name in names if not _owned(name)]
    sigma = [float(ordinary[i]) for i, name in enumerate(names) if not _owned(name)]
    for number in range(flights):
        listed += [f"{name} #{number}" for name in names if _owned(name)]
        sigma += [float(ordinary[i]) for i, name in enumerate(names) if _owned(name)]
    place = {name: index for index, name in enumerate(listed)}
    ignored = np.zeros(len(listed) + len(quantities))
    for name, value in zip(names, negligible, strict=True):
        if not _owned(name):
            ignored[place[name]] = value
    own = tuple(
        np.array([place[f"{name} #{number}" if _owned(name) else name] for name in names])
        for number in range(flights)
    )
    directions = np.zeros((len(listed), len(quantities)))
    for column, direction in enumerate(quantities.values()):
        for name, weight in direction.items():
            index = names.index(name)
            for places in own:
                directions[places[index], column] = weight
    return Unknowns(
        (*listed, *quantities),
        np.concatenate([sigma, [usual[name] for name in quantities]]),
        own,
        len(listed),
        directions,
        sizes,
        ignored,
        least or {},
        frozenset(either),
        beside or {},
    )


def tolerated(
    candidates: Sequence[Candidate], quantities: Mapping[str, Direction], sizes: Mapping[str, float]
) -> dict[str, float]:
    """Ordinary standard deviation of every quantity, 0 of those that no candidate frees."""
    found = dict.fromkeys(quantities, 0.0)
    for candidate in candidates:
        for name, parameter in zip(candidate.frees, candidate.cause.parameters, strict=True):
            found[name] = TOLERATED * parameter.matters * sizes[parameter.per]
    return found


def _owned(name: str) -> bool:
    return name.rpartition(".")[0] in OWN


def of_flight(
    unknowns: Unknowns,
    number: int,
    matrix: Float[np.ndarray, "parameter parameter"],
    score: Float[np.ndarray, " parameter"],
    count: float,
    shared: float = 0.0,
) -> Information:
    """What one flight says of all unknowns.

    Args:
        unknowns: of all flights.
        number: of the flight.
        matrix: information about the flight's parameters.
        score: about their deviation from what the file says.
        count: measurements.
        shared: log density where nothing deviates.
    """
    places = unknowns.own[number]
    gram = np.zeros((unknowns.parameters, unknowns.parameters))
    gram[np.ix_(places, places)] = matrix
    along = np.zeros(unknowns.parameters)
    along[places] = score
    spread = np.concatenate([np.eye(unknowns.parameters), unknowns.directions], axis=1)
    return Information(spread.T @ gram @ spread, spread.T @ along, count, shared)
