"""Dependent Gaussian processes beside the flight: what the coefficients are, and where unknown.

The mean is the aircraft file's simulation, or nothing where its values are ignored; the processes
learn what the flight says beyond it. The first samples wait until there are enough to learn how
long and how strong the processes are; from then on every sample is added at once, at a cost and in
a memory that do not grow. Whenever there are twice as many, kernel and inducing points are learned
anew, in a thread of its own that gives way to the flight.

Where nothing was flown the answer is the mean again, as uncertain as the processes are strong.
Errors of the flow angles last, and those of mass, inertia and thrust the whole flight: no number of
samples takes them away, so that they stand beside what the processes do not know, in full.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.stepwise import MOTION
from gcs_sysid.gp import fitting, inducing, learner, posterior, refresh, samples
from gcs_sysid.gp.dependent import Kernel, Points
from gcs_sysid.gp.inducing import Information
from gcs_sysid.gp.learner import Learner
from gcs_sysid.gp.posterior import Posterior
from gcs_sysid.gp.refresh import Refresher, Settings
from gcs_sysid.gp.reservoir import Kept, Reservoir
from gcs_sysid.gp.samples import Scaling
from gcs_sysid.live import departure, heap
from gcs_sysid.live.regression import ANGLES
from gcs_sysid.live.simulation import Simulation, Values

PERIOD_S = 0.16
"""So far apart [s] are rows that are learned from, six a second. Those between say the same."""
FIRST = 512
"""Samples from which kernel and inducing points are learned first: a minute or so."""
STORE = 1024
"""Samples kept for learning them anew."""
SETTINGS = Settings(points=120, rows=320, scaffold=12, candidates=120, starts=1, steps=30)
AT_ONCE = 64
"""Places that are asked about together: the cells of a map."""
PATIENT = 10
"""By how much the learning thread steps back for others, as `nice` counts it."""
FLIGHT = 0
PREFIX = "processes."


@dataclass(frozen=True)
class Belief:
    """Coefficients at some places, by name.

    Attributes:
        value: mean.
        deviation: one standard deviation, all told.
        lack: the part of it that more flight there would take away.
    """

    value: Mapping[str, Float[np.ndarray, " place"]]
    deviation: Mapping[str, Float[np.ndarray, " place"]]
    lack: Mapping[str, Float[np.ndarray, " place"]]


class _Raw(NamedTuple):
    """Samples as they come, the mean taken off; NaN where a coefficient is missing."""

    time: Float[np.ndarray, " sample"]
    inputs: Float[np.ndarray, "sample input"]
    values: Float[np.ndarray, "sample output"]
    variance: Float[np.ndarray, "sample output"]


class _Known(NamedTuple):
    """What was learned, and the units it is in."""

    scaling: Scaling
    held: Refresher


class Processes:
    """Learns window by window.

    Args:
        aircraft: its controls, and its simulation as the mean.
        believing: whether that simulation is the mean; else there is none.
    """

    def __init__(self, aircraft: Aircraft, *, believing: bool) -> None:
        self._aircraft = aircraft
        self.inputs = (*MOTION, *aircraft.control_names)
        self._mean = Simulation(aircraft) if believing else None
        self._next = -np.inf
        self._waiting: list[_Raw] = []
        self._taken = 0
        self._worker: ThreadPoolExecutor | None = None
        self._coming: Future[tuple[Scaling, Learner]] | None = None
        self._known: _Known | None = None
        self._refreshed_at = 0
        self._asked: tuple[Learner, Posterior] | None = None
        self._lasting = np.zeros((2, len(COEFFICIENTS)))
        self.failed = ""

    @property
    def phase(self) -> str:
        """What is going on: collecting, learning, known, or failed and why."""
        if self.failed:
            return f"failed: {self.failed}"
        if self._known is not None:
            return "known"
        return "collecting" if self._coming is None else "learning"

    @property
    def count(self) -> int:
        """Samples so far."""
        waiting = sum(part.time.size for part in self._waiting)
        return waiting + (0 if self._known is None else self._known.held.learner.count)

    def take(
        self,
        window: Samples,
        kept: slice,
        flow_variance: Mapping[str, Float[np.ndarray, "variable sample"]],
    ) -> None:
        """Adds some of the rows `kept` of a window.

        Args:
            window: measured coefficients.
            kept: rows that are new.
            flow_variance: what errors of each of `UNCERTAIN` add to each coefficient's variance in
                these rows; a coefficient that is not in it is left out.
        """
        if self.failed or not flow_variance:
            return
        rows = self._due(window.time[kept])
        if not rows.size:
            return
        raw = self._raw(window, kept, rows, flow_variance)
        if self._known is not None:
            self._observe(self._known, raw)
            return
        self._waiting.append(raw)
        try:
            if self._coming is None and self.count >= FIRST:
                # They wait on: what is kept on disk meanwhile must hold them.
                self._taken = len(self._waiting)
                self._coming = self._thread().submit(_begun, _joined(self._waiting))
            elif self._coming is not None and self._coming.done():
                self._begin(*self._coming.result())
        except Exception as error:  # noqa: BLE001 - the flight goes on, and its recording
            self._fail(error)

    def at(self, values: Values) -> Belief | None:
        """Coefficients at no more than `AT_ONCE` places; None while nothing is known."""
        if self._known is None:
            return None
        scaling, known = self._known.scaling, self._known.held.learner
        if self._asked is None or self._asked[0] is not known:
            self._asked = (known, learner.posterior(known))
        stacked = np.stack([np.asarray(values[name]) for name in self.inputs], axis=1)
        found = _predicted(self._asked[1], scaling, stacked)
        mean, unit = self._simulated(values), scaling.unit
        total, count = self._lasting
        lasting = np.sqrt(total / np.where(count > 0.0, count, 1.0))
        lack = unit * np.sqrt(found.variance)
        columns = (mean + unit * found.mean, np.hypot(lack, lasting), lack)
        names = [(row, name) for row, name in enumerate(COEFFICIENTS) if count[row] > 0.0]
        return Belief(*({name: one[:, row] for row, name in names} for one in columns))

    def state(self) -> dict[str, np.ndarray]:
        """Everything learned so far, as arrays by name."""
        if self._known is None:
            if not self._waiting:
                return {}
            out = _joined(self._waiting)._asdict()
        else:
            known = self._known.held.learner
            out = {
                **self._known.scaling._asdict(),
                **known.base.kernel._asdict(),
                **{f"points.{name}": part for name, part in known.base.points._asdict().items()},
                **{f"kept.{name}": part for name, part in known.store.kept._asdict().items()},
                **known.total._asdict(),
                "base.noise": known.base.noise,
                "base.repeats": known.base.repeats,
                "count": np.array(known.count),
            }
        out |= {"lasting": self._lasting, "beyond": np.array(self._beyond)}
        return {f"{PREFIX}{name}": np.asarray(part) for name, part in out.items()}

    @property
    def _beyond(self) -> str:
        """What the samples are told beyond, as text."""
        return "" if self._mean is None else self._mean.text()

    def restore(self, state: Mapping[str, np.ndarray]) -> bool:
        """Goes on from the `state` of one for the same aircraft.

        Returns:
            Whether it does: without a state, or with one that was learned beyond another
            simulation, it begins anew.

        Raises:
            KeyError: something is missing.
            ValueError: something does not fit, or is not finite.
        """
        own = {key[len(PREFIX) :]: part for key, part in state.items() if key.startswith(PREFIX)}
        if not own or str(own["beyond"]) != self._beyond:
            return False
        _check(own["lasting"].shape == self._lasting.shape, np.isfinite(own["lasting"]).all())
        self._lasting = own["lasting"]
        if "count" not in own:
            raw = _Raw(*(own[name] for name in _Raw._fields))
            _check(raw.inputs.shape == (raw.time.size, len(self.inputs)))
            _check(raw.values.shape == raw.variance.shape == (raw.time.size, len(COEFFICIENTS)))
            _check(np.isfinite(raw.inputs).all(), np.isfinite(raw.time).all())
            self._waiting = [raw]
            return True
        scaling = Scaling(*(own[name] for name in Scaling._fields))
        total = Information(*(own[name] for name in Information._fields))
        kept = Kept(*(own[f"kept.{name}"] for name in Kept._fields))
        points = Points(*(own[f"points.{name}"] for name in Points._fields))
        size = points.inputs.shape[0]
        _check(scaling.centre.shape == (len(self.inputs),))
        _check(scaling.unit.shape == (len(COEFFICIENTS),))
        _check(total.matrix.shape == (size, size), total.vector.shape == (size,))
        numbers = (*scaling, *total, *kept, *points, own["base.noise"])
        _check(*(np.isfinite(part).all() for part in numbers))
        kernel = Kernel(*(own[name] for name in Kernel._fields))
        count = int(own["count"])
        known = Learner(
            base=inducing.basis(kernel, own["base.noise"], own["base.repeats"], points),
            total=total,
            flights={FLIGHT: total},
            store=Reservoir(STORE, kept),
            counts={FLIGHT: count},
        )
        _compile(scaling, known)
        self._begin(scaling, known)
        return True

    def close(self) -> None:
        """Ends the learning thread; what it had begun is not waited for."""
        if self._worker is not None:
            self._worker.shutdown(wait=False, cancel_futures=True)

    def _begin(self, scaling: Scaling, known: Learner) -> None:
        self._coming = None
        self._known = _Known(scaling, Refresher(known, SETTINGS, self._thread()))
        self._thread().submit(heap.give_back)
        self._refreshed_at = known.count
        waiting, self._waiting = self._waiting[self._taken :], []
        for raw in waiting:
            self._observe(self._known, raw)

    def _observe(self, known: _Known, raw: _Raw) -> None:
        base = known.held.learner.base
        try:
            known.held.observe(_rows(known.scaling, raw), FLIGHT)
            if known.held.learner.base is not base:
                # Another one was learned, and what that took is free.
                self._thread().submit(heap.give_back)
            if known.held.learner.count >= 2 * self._refreshed_at:
                self._refreshed_at = known.held.learner.count
                known.held.begin()
        except Exception as error:  # noqa: BLE001 - the flight goes on, and its recording
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        """Stops learning; what was known would grow old without saying so."""
        self.failed = f"{type(error).__name__}: {' '.join(str(error).split())[:100]}"
        self._waiting, self._known, self._coming = [], None, None

    def _thread(self) -> ThreadPoolExecutor:
        if self._worker is None:
            self._worker = ThreadPoolExecutor(
                max_workers=1, thread_name_prefix="processes", initializer=_give_way
            )
        return self._worker

    def _due(self, time: Float[np.ndarray, " row"]) -> np.ndarray:
        """Which rows to learn from; a clock that falls back begins anew."""
        picked, early = [], 0.5 * float(np.median(np.diff(time)))
        for row, one in enumerate(time):
            if not self._next - PERIOD_S <= one < self._next - early:
                picked.append(row)
                self._next = float(one) + PERIOD_S
        return np.array(picked, dtype=int)

    def _raw(
        self,
        window: Samples,
        kept: slice,
        due: np.ndarray,
        flow_variance: Mapping[str, Float[np.ndarray, "variable sample"]],
    ) -> _Raw:
        rows = kept.start + due
        here = {name: np.asarray(value)[rows] for name, value in window.regressors.items()}
        mean = self._simulated(here)
        missing = np.full(mean.shape[0], np.nan)
        values, variance = [], []
        for row, name in enumerate(COEFFICIENTS):
            if name not in window.measured or name not in flow_variance:
                values.append(missing)
                variance.append(missing)
                continue
            uncertain = flow_variance[name][:, due]
            values.append(window.measured[name][rows] - mean[:, row])
            variance.append(window.noise[name][rows] ** 2 + uncertain.sum(axis=0))
            scale = departure.scale_variance(self._aircraft, name, window, rows)
            # Samples weigh by what is known of the flow, and so do its errors in what they say.
            worth = 1.0 / np.maximum(uncertain[ANGLES].sum(axis=0), 1e-30)
            self._lasting[:, row] += (np.sum(1.0 + scale * worth), np.sum(worth))
        inputs = np.stack([here[name] for name in self.inputs], axis=1)
        return _Raw(window.time[rows], inputs, np.stack(values, 1), np.stack(variance, 1))

    def _simulated(self, values: Values) -> Float[np.ndarray, "place six"]:
        out = np.zeros((len(next(iter(values.values()))), len(COEFFICIENTS)))
        if self._mean is not None:
            for name in self._mean.names:
                out[:, COEFFICIENTS.index(name)] = self._mean.at(name, values)[0]
        return out


def document(processes: Processes, here: Values | None) -> dict[str, Any]:
    """What they know, for `live.json`; `here` is the newest flow."""
    found = None if here is None else processes.at(here)
    return {
        "phase": processes.phase,
        "samples": processes.count,
        "wanted": FIRST,
        "coefficients": {}
        if found is None
        else {
            name: {"value": float(value[0]), "sd": float(found.deviation[name][0])}
            for name, value in found.value.items()
        },
    }


def _begun(raw: _Raw) -> tuple[Scaling, Learner]:
    """What the first samples say."""
    step = float(np.median(np.diff(raw.time)))
    piece = np.concatenate([[0], np.cumsum(np.diff(raw.time) > 1.5 * step)])
    repeats = fitting.repeats(raw.inputs, raw.values, piece, step)
    scaling = samples.scaling(raw.inputs, raw.values)
    rows = _rows(scaling, raw)
    known = learner.start(refresh.based_on(rows, repeats, SETTINGS), capacity=STORE)
    known = learner.observe(known, rows, FLIGHT)
    _compile(scaling, known)
    return scaling, known


def _compile(scaling: Scaling, known: Learner) -> None:
    """Runs once what a flight will ask: compiled while it flies, it would hold up the filter."""
    for count in (1, 2):  # a window has one row for us at 145 Hz, else several
        few = samples.some_of(known.store.rows(), np.arange(count))
        learner.observe(known, few, FLIGHT)
    _predicted(learner.posterior(known), scaling, scaling.centre[None])


def _predicted(
    known: Posterior, scaling: Scaling, inputs: Float[np.ndarray, "place input"]
) -> posterior.Belief:
    scaled = (inputs - scaling.centre) / scaling.spread
    count = scaled.shape[0]
    filled = np.pad(scaled, ((0, AT_ONCE - count), (0, 0)), mode="edge")
    found = posterior.predict(known, filled)
    return posterior.Belief(*(np.asarray(part)[:count] for part in found))


def _rows(scaling: Scaling, raw: _Raw) -> samples.Rows:
    variance = np.where(np.isfinite(raw.variance), raw.variance, np.inf)
    return samples.rows(scaling, raw.inputs, raw.values, variance)


def _joined(parts: list[_Raw]) -> _Raw:
    return _Raw(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _check(*fits: bool | np.bool) -> None:
    if not all(fits):
        raise ValueError("the processes' arrays do not fit the aircraft")


def _give_way() -> None:
    """Lets everything else go first: on one core too the flight has its turn at once."""
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), PATIENT)
