"""Learning sample by sample, flight by flight: constant time, constant memory, and forgetting.

Each flight has its own sum of information; the posterior comes from their total. A sample is added
in compiled code of one fixed shape. Between two refreshes the posterior is that of the batch, in
whatever order the samples came.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gcs_sysid.errors import UsageError
from gcs_sysid.gp import inducing, local, reservoir
from gcs_sysid.gp.inducing import Basis, Information
from gcs_sysid.gp.local import Local, Shape, Store
from gcs_sysid.gp.posterior import Posterior, mean
from gcs_sysid.gp.reservoir import Reservoir
from gcs_sysid.gp.samples import Rows, padded

BATCH = 512
SIZES = (1, 8, BATCH)
"""Rows that compiled steps take: a sample, a few of them, many."""


@dataclass(frozen=True)
class Learner:
    """All that was learned.

    Attributes:
        base: prior and inducing points.
        total: information of all flights.
        flights: information of each, by its number.
        store: a bounded draw of the samples, from which a refresh is made.
        count: samples seen, less those forgotten.
        counts: of each flight.
    """

    base: Basis
    total: Information
    flights: Mapping[int, Information]
    store: Reservoir
    counts: Mapping[int, int]

    @property
    def count(self) -> int:
        """Samples that the posterior rests on."""
        return sum(self.counts.values())


def start(base: Basis, *, capacity: int) -> Learner:
    """Before the first sample; `capacity` samples are kept for refreshes."""
    outputs, inputs = base.noise.shape[0], base.points.inputs.shape[1]
    return Learner(
        base=base,
        total=inducing.nothing(base.points.output.shape[0]),
        flights={},
        store=reservoir.empty(capacity, inputs=inputs, outputs=outputs),
        counts={},
    )


def observe(learner: Learner, some: Rows, flight: int) -> Learner:
    """After one sample or a batch of one flight."""
    count = some.inputs.shape[0]
    size = next((one for one in SIZES if count <= one), BATCH)
    total = learner.total
    own = learner.flights.get(flight) or inducing.nothing(total.vector.shape[0])
    for batch in padded(some, size):
        told = inducing.told(learner.base, batch)
        total, own = inducing.plus(total, told), inducing.plus(own, told)
    return replace(
        learner,
        total=total,
        flights={**learner.flights, flight: own},
        store=reservoir.with_rows(learner.store, some, flight),
        counts={**learner.counts, flight: learner.counts.get(flight, 0) + count},
    )


def forget(learner: Learner, flight: int) -> Learner:
    """As if a flight had never been.

    Raises:
        UsageError: there is no such flight.
    """
    if flight not in learner.flights:
        known = ", ".join(map(str, learner.flights)) or "none"
        raise UsageError(f"no flight {flight} to forget; known: {known}")
    left = {number: told for number, told in learner.flights.items() if number != flight}
    # Summed anew: what is taken away from a sum would leave its rounding behind.
    total = inducing.nothing(learner.total.vector.shape[0])
    for told in left.values():
        total = inducing.plus(total, told)
    return replace(
        learner,
        total=total,
        flights=left,
        store=reservoir.without_flight(learner.store, flight),
        counts={number: count for number, count in learner.counts.items() if number != flight},
    )


def posterior(learner: Learner) -> Posterior:
    """What all flights say."""
    return inducing.posterior(learner.base, learner.total)


def without(learner: Learner, flight: int) -> Posterior:
    """What all flights but one say: for judging the model on what it has not seen."""
    return inducing.posterior(learner.base, inducing.minus(learner.total, learner.flights[flight]))


def residuals(learner: Learner) -> Store:
    """What the global part leaves of the samples in the store; the stretch of each is its flight.

    The store is bounded, thinned as flights go on, and loses a flight that is forgotten, and so
    does what is built from it.

    Raises:
        UsageError: the store is empty.
    """
    kept = learner.store.rows()
    count = kept.inputs.shape[0]
    if count == 0:
        raise UsageError("nothing is in the store; observe samples before asking for its residuals")
    whole = posterior(learner)
    said = [np.asarray(mean(whole, batch.inputs)) for batch in padded(kept, BATCH)]
    left = (kept.values - np.concatenate(said)[:count]) * (kept.precision > 0.0)
    return local.stored(kept._replace(values=left), learner.store.kept.flight)


def local_part(learner: Learner, shape: Shape) -> Local:
    """Neighbours for what the global part leaves, from the samples in the store."""
    return local.built(shape, residuals(learner))
