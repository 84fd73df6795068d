"""New hyper-parameters and inducing points for a learner that has grown, off the live path.

What the store still holds is learned anew, exactly. What left it is carried over as information
about the old inducing points (see `inducing.carried`), so that nothing observed is lost but what
the new points cannot hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from gcs_sysid.frames import Array
from gcs_sysid.gp import exact, inducing, learner, learning, samples, selection
from gcs_sysid.gp.dependent import Kernel, Points
from gcs_sysid.gp.inducing import Basis, Information
from gcs_sysid.gp.learner import Learner
from gcs_sysid.gp.learning import Learned, Structure
from gcs_sysid.gp.samples import Rows, padded
from gcs_sysid.gp.selection import Method


@dataclass(frozen=True)
class Settings:
    """How much is spent on a refresh.

    Attributes:
        structure: of the covariance.
        points: inducing points.
        rows: samples that the hyper-parameters are learned from.
        scaffold: places whose outputs carry the likelihood while they are.
        candidates: places among whose outputs the inducing points are chosen.
        starts: of the search.
        steps: of each.
        method: how inducing points are chosen.
        seed: of every draw.
    """

    structure: Structure = field(default_factory=Structure)
    points: int = 200
    rows: int = 400
    scaffold: int = 16
    candidates: int = 150
    starts: int = 2
    steps: int = 40
    method: Method = "mutual information"
    seed: int = 0


def learned(some: Rows, repeats: Float[Array, " output"], settings: Settings) -> Learned:
    """Hyper-parameters from a draw of the samples, of which each then repeats fewer others."""
    part = thinned(some, settings.rows, settings.seed)
    share = part.inputs.shape[0] / some.inputs.shape[0]
    places = _places(part, settings.scaffold, settings.seed)
    return learning.fit_inducing(
        part,
        _all_outputs(places, part.values.shape[1]),
        np.maximum(np.asarray(repeats) * share, 1.0),
        settings.structure,
        starts=settings.starts,
        steps=settings.steps,
        seed=settings.seed,
    )


def chosen_points(
    some: Rows, kernel: Kernel, noise: Float[Array, " output"], settings: Settings
) -> Points:
    """Inducing points among the samples."""
    part = thinned(some, settings.candidates, settings.seed + 1)
    candidates, _, own = exact.observed(part)
    total = np.asarray(own) + np.asarray(noise)[candidates.output]
    picked = selection.choose(
        settings.method, kernel, candidates, total, settings.points, seed=settings.seed
    )
    return selection.take(candidates, picked)


def based_on(some: Rows, repeats: Float[Array, " output"], settings: Settings) -> Basis:
    """Prior and inducing points learned from samples."""
    found = learned(some, repeats, settings)
    points = chosen_points(some, found.kernel, found.noise, settings)
    return inducing.basis(found.kernel, found.noise, repeats, points)


def refreshed(old: Learner, settings: Settings) -> Learner:
    """The learner with hyper-parameters and inducing points from its store.

    The store thins the samples out, so that those in it repeat each other less.
    """
    share = old.store.kept.drawn.size / max(old.count, 1)
    thin = np.maximum(np.asarray(old.base.repeats) * share, 1.0)
    found = based_on(old.store.rows(), thin, settings)
    return moved(old, found._replace(repeats=old.base.repeats))


def moved(old: Learner, base: Basis) -> Learner:
    """The learner on another basis."""
    flights = {}
    for number, known in old.flights.items():
        held = old.store.rows(old.store.kept.flight == number)
        gone = inducing.minus(known, _told(old.base, held))
        flights[number] = inducing.plus(inducing.carried(old.base, gone, base), _told(base, held))
    total = inducing.nothing(base.points.output.shape[0])
    for known in flights.values():
        total = inducing.plus(total, known)
    return replace(old, base=base, total=total, flights=flights)


def _told(base: Basis, some: Rows) -> Information:
    total = inducing.nothing(base.points.output.shape[0])
    for batch in padded(some, learner.BATCH):
        total = inducing.plus(total, inducing.told(base, batch))
    return total


def thinned(some: Rows, count: int, seed: int) -> Rows:
    """At most `count` of the samples."""
    total = some.inputs.shape[0]
    if total <= count:
        return some
    return samples.some_of(some, np.sort(np.random.default_rng(seed).permutation(total)[:count]))


def _places(some: Rows, count: int, seed: int) -> Float[Array, "place input"]:
    inputs = np.asarray(some.inputs)
    single = Points(inputs, np.zeros(inputs.shape[0], dtype=int))
    return inputs[selection.k_means(single, count, seed=seed)]


def _all_outputs(places: Float[Array, "place input"], outputs: int) -> Points:
    return Points(np.repeat(places, outputs, axis=0), np.tile(np.arange(outputs), places.shape[0]))


class Refresher:
    """Keeps observing while a refresh runs in another thread.

    `observe` answers at once: it serves the old posterior's learner until the new one is there, and
    what came in between is added to it then.

    Args:
        first: what is known so far.
        settings: how much is spent on a refresh.
        worker: the other thread; it is `close`d with this.
    """

    def __init__(self, first: Learner, settings: Settings, worker: ThreadPoolExecutor) -> None:
        self.learner = first
        self._settings = settings
        self._worker = worker
        self._coming: Future[Learner] | None = None
        self._since: list[tuple[Rows, int]] = []

    def begin(self) -> None:
        """Starts a refresh, unless one is running."""
        if self._coming is None:
            self._since = []
            self._coming = self._worker.submit(refreshed, self.learner, self._settings)

    def observe(self, some: Rows, flight: int) -> None:
        """Adds samples, and takes over a refresh that is done."""
        self.learner = learner.observe(self.learner, some, flight)
        if self._coming is None:
            return
        self._since.append((some, flight))
        if self._coming.done():
            self._take_over(self._coming.result())

    def close(self) -> None:
        """Waits for a refresh that is running, and ends the thread."""
        self._worker.shutdown(wait=True)
        if self._coming is not None:
            self._take_over(self._coming.result())

    def _take_over(self, new: Learner) -> None:
        for some, flight in _joined(self._since):
            new = learner.observe(new, some, flight)
        self.learner, self._coming, self._since = new, None, []


def _joined(parts: Sequence[tuple[Rows, int]]) -> list[tuple[Rows, int]]:
    """Samples that came one by one as few batches, in their order."""
    out: list[tuple[Rows, int]] = []
    for flight in dict.fromkeys(number for _, number in parts):
        own = [some for some, number in parts if number == flight]
        out.append((Rows(*(np.concatenate(each) for each in zip(*own, strict=True))), flight))
    return out
