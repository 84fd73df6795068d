"""From samples of a flight to Gaussian processes that earned their place.

Global part, local part and their variances are judged on stretches of flight that took no part in
what is judged: the global part by taking each fold's information away, the local part by asking
neighbours of other folds only. Where a part foretells an output no better than without it, that
output goes without; what then still differs by more than noise and stated variance is the output's
discrepancy.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from gcs_sysid.gp import learner, local, noise, posterior, refresh, samples
from gcs_sysid.gp.inducing import Basis
from gcs_sysid.gp.learner import Learner
from gcs_sysid.gp.local import Local
from gcs_sysid.gp.posterior import Belief, Posterior
from gcs_sysid.gp.refresh import Settings
from gcs_sysid.gp.samples import Rows, Scaling

FOLDS = 5
LEAST_GAIN = 5.0
"""A part is kept if it foretells all independent samples together by this much better [nat]."""
ENOUGH = 4.0
"""Samples that are kept of those that say the same."""
AT_ONCE = 512
"""Queries predicted together."""


@dataclass(frozen=True)
class Data:
    """Samples less what the mean explains, in their own units.

    Attributes:
        inputs: regressors.
        values: measured less mean, NaN where an output is missing.
        variance: of the noise of each value.
        input_variance: of each regressor's error.
        slopes: of the mean, with respect to each regressor.
        piece: unbroken stretch of flight of each sample, in the order of time.
        step: sample interval [s].
    """

    inputs: Float[np.ndarray, "sample input"]
    values: Float[np.ndarray, "sample output"]
    variance: Float[np.ndarray, "sample output"]
    input_variance: Float[np.ndarray, "sample input"]
    slopes: Float[np.ndarray, "sample output input"]
    piece: Int[np.ndarray, " sample"]
    step: float


@dataclass(frozen=True)
class Effort:
    """What is spent on a fit.

    Attributes:
        settings: hyper-parameters and inducing points.
        store: samples kept for refreshes and neighbours.
        local: whether a local part is tried.
        queries: samples that the local part's hyper-parameters are learned from.
        always: whether parts are kept whatever they foretell; for comparisons.
    """

    settings: Settings = field(default_factory=Settings)
    store: int = 4096
    local: bool = True
    queries: int = 128
    always: bool = False


@dataclass(frozen=True)
class Gain:
    """How much better samples of other stretches are foretold, a sample [nat].

    Attributes:
        global_part: with the global part over without.
        local_part: with the local part over without it.
        samples: independent ones that this was judged on.
    """

    global_part: Float[np.ndarray, " output"]
    local_part: Float[np.ndarray, " output"]
    samples: Float[np.ndarray, " output"]


@dataclass(frozen=True)
class Fitted:
    """What was learned, with what is needed to ask it.

    Attributes:
        scaling: of inputs and outputs.
        base: prior and inducing points.
        posterior: the global part.
        local: neighbours; None where no output has a local part.
        use_global: outputs that have a global part.
        use_local: outputs that have a local part.
        discrepancy: variance of each output that neither the noise of the measurement nor the
            stated variance explains: what errors of the inputs leave is part of it.
        gain: what the parts were judged by.
    """

    scaling: Scaling
    base: Basis
    posterior: Posterior
    local: Local | None
    use_global: Bool[np.ndarray, " output"]
    use_local: Bool[np.ndarray, " output"]
    discrepancy: Float[np.ndarray, " output"]
    gain: Gain

    def scaled(
        self, inputs: Float[np.ndarray, "sample input"]
    ) -> Float[np.ndarray, "sample input"]:
        """Inputs in the units of the posterior."""
        return (inputs - self.scaling.centre) / self.scaling.spread


def fit(data: Data, effort: Effort) -> Fitted:
    """Learns global and local part and judges them.

    Args:
        data: samples.
        effort: what to spend.
    """
    data, repeated = _without_repeats(data)
    scale = samples.scaling(data.inputs, data.values)
    rows = _rows(scale, data, data.slopes)
    base = refresh.based_on(rows, repeated, effort.settings)
    fold = _folds(data.piece)
    known = _observed(base, rows, fold, effort.store)
    without = _left_out(known, rows, fold)
    weight = np.asarray(rows.precision > 0.0) / repeated[None, :]
    plain = Belief(np.zeros_like(rows.values), np.zeros_like(rows.values))
    used, first_gain = _judged(rows, weight, plain, without, always=effort.always)
    if used.any():
        # The slopes of what was learned make uncertain inputs count for more, or for less.
        rows = _rows(
            scale, data, data.slopes + _slopes(scale, learner.posterior(known), rows, used)
        )
        known = _observed(base, rows, fold, effort.store)
        without = _left_out(known, rows, fold)
    whole = learner.posterior(known)
    judged = _where(used, without, plain)
    found, added, second_gain = (
        _local(rows, fold, whole, judged, weight, used, effort)
        if effort.local
        else (None, np.zeros_like(used), np.zeros(used.size))
    )
    if found is not None and added.any():
        far = local.predict(found, np.asarray(rows.inputs), piece=fold)
        judged = _plus(judged, _where(added, far, plain))
    return Fitted(
        scaling=scale,
        base=base,
        posterior=whole,
        local=found if added.any() else None,
        use_global=used,
        use_local=added,
        discrepancy=_discrepancy(rows, weight, judged, data.variance / scale.unit**2)
        * scale.unit**2,
        gain=Gain(first_gain, second_gain, weight.sum(axis=0)),
    )


def more(fitted: Fitted, data: Data, effort: Effort) -> Fitted:
    """The same parts, judged as they were, after other samples in place of the first ones."""
    data, repeated = _without_repeats(data)
    rows = _rows(fitted.scaling, data, data.slopes)
    if fitted.use_global.any():
        own = _slopes(fitted.scaling, fitted.posterior, rows, fitted.use_global)
        rows = _rows(fitted.scaling, data, data.slopes + own)
    base = fitted.base._replace(repeats=repeated)
    known = _observed(base, rows, np.zeros(rows.inputs.shape[0], dtype=int), effort.store)
    whole = learner.posterior(known)
    found = fitted.local
    if found is not None:
        explained = np.asarray(in_batches(whole, np.asarray(rows.inputs)).mean)
        left = rows.values - explained * fitted.use_global[None, :]
        kept = refresh.thinned(rows._replace(values=left), effort.store, effort.settings.seed)
        one_flight = np.zeros(kept.inputs.shape[0], dtype=int)
        found = local.built(found.shape, local.stored(kept, one_flight))
    return replace(fitted, base=base, posterior=whole, local=found)


def predict(fitted: Fitted, inputs: Float[np.ndarray, "sample input"]) -> Belief:
    """Mean and variance of what the mean leaves, in the outputs' units, discrepancy excluded."""
    scaled = fitted.scaled(inputs)
    zero = Belief(*(np.zeros((inputs.shape[0], fitted.use_global.size)) for _ in range(2)))
    total = zero
    if fitted.use_global.any():
        total = _where(fitted.use_global, in_batches(fitted.posterior, scaled), zero)
    if fitted.local is not None:
        total = _plus(total, _where(fitted.use_local, local.predict(fitted.local, scaled), zero))
    unit = fitted.scaling.unit[None, :]
    return Belief(total.mean * unit, total.variance * unit**2)


def in_batches(known: Posterior, inputs: Float[np.ndarray, "sample input"]) -> Belief:
    """The posterior at many places, in steps of one shape."""
    parts = []
    for start in range(0, inputs.shape[0], AT_ONCE):
        part = inputs[start : start + AT_ONCE]
        filled = np.pad(part, ((0, AT_ONCE - part.shape[0]), (0, 0)), mode="edge")
        belief = posterior.predict(known, filled)
        parts.append([np.asarray(each)[: part.shape[0]] for each in belief])
    return Belief(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def repeats(
    inputs: Float[np.ndarray, "sample input"],
    values: Float[np.ndarray, "sample output"],
    piece: Int[np.ndarray, " sample"],
    step: float,
) -> Float[np.ndarray, " output"]:
    """How many samples say the same, by what a straight line in all inputs leaves.

    Args:
        inputs: in any units.
        values: likewise, NaN where an output is missing.
        piece: unbroken stretch of flight of each sample, in the order of time.
        step: sample interval [s].
    """
    columns = np.concatenate([np.ones((inputs.shape[0], 1)), inputs], axis=1)
    columns /= np.maximum(np.abs(columns).max(axis=0), 1e-300)
    out = []
    for column in values.T:
        known = np.isfinite(column)
        if not known.any():
            out.append(1.0)
            continue
        line = columns[known] @ np.linalg.lstsq(columns[known], column[known], rcond=None)[0]
        out.append(noise.repeats(column[known] - line, piece[known], step))
    return np.array(out)


def _rows(scale: Scaling, data: Data, slopes: Float[np.ndarray, "sample output input"]) -> Rows:
    variance = noise.with_inputs(data.variance, slopes, data.input_variance)
    return samples.rows(scale, data.inputs, data.values, variance)


def _without_repeats(data: Data) -> tuple[Data, Float[np.ndarray, " output"]]:
    """A few of those samples that say the same, and how many of them still do.

    The others would cost as much, and tell nothing.
    """
    repeated = repeats(data.inputs, data.values, data.piece, data.step)
    stride = max(int(repeated.min() / ENOUGH), 1)
    parts = ("inputs", "values", "variance", "input_variance", "slopes", "piece")
    fewer = {name: getattr(data, name)[::stride] for name in parts}
    return replace(data, **fewer, step=data.step * stride), np.maximum(repeated / stride, 1.0)


def _folds(piece: Int[np.ndarray, " sample"]) -> Int[np.ndarray, " sample"]:
    """Stretches dealt out to folds of about one size, the longest first."""
    names, counts = np.unique(piece, return_counts=True)
    held = np.zeros(min(FOLDS, names.size), dtype=int)
    fold = np.zeros(piece.size, dtype=int)
    for index in np.argsort(-counts, kind="stable"):
        smallest = int(np.argmin(held))
        fold[piece == names[index]] = smallest
        held[smallest] += counts[index]
    return fold


def _observed(base: Basis, rows: Rows, fold: Int[np.ndarray, " sample"], store: int) -> Learner:
    known = learner.start(base, capacity=store)
    for number in np.unique(fold):
        known = learner.observe(known, samples.some_of(rows, fold == number), int(number))
    return known


def _left_out(known: Learner, rows: Rows, fold: Int[np.ndarray, " sample"]) -> Belief:
    """The belief at every sample by all folds but its own."""
    inputs = np.asarray(rows.inputs)
    mean, variance = np.zeros(rows.values.shape), np.zeros(rows.values.shape)
    for number in known.flights:
        own = fold == number
        belief = in_batches(learner.without(known, number), inputs[own])
        mean[own], variance[own] = np.asarray(belief.mean), np.asarray(belief.variance)
    return Belief(mean, variance)


def _judged(
    rows: Rows,
    weight: Float[np.ndarray, "sample output"],
    before: Belief,
    after: Belief,
    *,
    always: bool,
) -> tuple[Bool[np.ndarray, " output"], Float[np.ndarray, " output"]]:
    """Which outputs gain, and how much a sample."""
    total = weight.sum(axis=0)
    gain = _density(rows, weight, after) - _density(rows, weight, before)
    used = (total > 0.0) if always else (gain > LEAST_GAIN)
    return used, gain / np.maximum(total, 1.0)


def _density(
    rows: Rows, weight: Float[np.ndarray, "sample output"], belief: Belief
) -> Float[np.ndarray, " output"]:
    """Log density of the samples [nat], each with the discrepancy that makes the belief fit."""
    own = _own(rows)
    extra = _discrepancy(rows, weight, belief, own)
    total = np.asarray(belief.variance) + own + extra[None, :]
    error = np.asarray(rows.values - belief.mean)
    return -0.5 * np.sum(weight * (np.log(total) + error**2 / total), axis=0)


def _discrepancy(
    rows: Rows,
    weight: Float[np.ndarray, "sample output"],
    belief: Belief,
    own: Float[np.ndarray, "sample output"],
) -> Float[np.ndarray, " output"]:
    """What the squared error exceeds the stated variances by, on average."""
    error = np.asarray(rows.values - belief.mean)
    excess = error**2 - np.asarray(belief.variance) - own
    total = np.maximum(weight.sum(axis=0), 1e-300)
    return np.maximum(np.sum(weight * np.where(weight > 0.0, excess, 0.0), axis=0) / total, 0.0)


def _own(rows: Rows) -> Float[np.ndarray, "sample output"]:
    precision = np.asarray(rows.precision)
    return 1.0 / np.where(precision > 0.0, precision, 1.0)


def _slopes(
    scale: Scaling, known: Posterior, rows: Rows, used: Bool[np.ndarray, " output"]
) -> Float[np.ndarray, "sample output input"]:
    """Slopes of the posterior's mean in the outputs' and inputs' units."""
    parts = []
    for batch in samples.padded(rows, AT_ONCE):
        parts.append(np.asarray(posterior.mean_slopes(known, batch.inputs)))
    slope = np.concatenate(parts)[: rows.inputs.shape[0]]
    return slope * used[None, :, None] * (scale.unit[:, None] / scale.spread[None, :])[None]


def _local(
    rows: Rows,
    fold: Int[np.ndarray, " sample"],
    whole: Posterior,
    judged: Belief,
    weight: Float[np.ndarray, "sample output"],
    used: Bool[np.ndarray, " output"],
    effort: Effort,
) -> tuple[Local, Bool[np.ndarray, " output"], Float[np.ndarray, " output"]]:
    """The local part on what the global one leaves, and which outputs gain from it."""
    explained = in_batches(whole, np.asarray(rows.inputs)).mean * used[None, :]
    left = rows._replace(values=(rows.values - explained) * (rows.precision > 0.0))
    picked = np.arange(fold.size)
    if fold.size > effort.store:
        random = np.random.default_rng(effort.settings.seed)
        picked = np.sort(random.permutation(fold.size)[: effort.store])
    kept = samples.some_of(left, picked)
    found = local.learned(
        local.stored(kept, fold[picked]), queries=effort.queries, seed=effort.settings.seed
    )
    tested = np.sort(np.random.default_rng(1).permutation(fold.size)[: 8 * effort.queries])
    part = samples.some_of(rows, tested)
    before = Belief(*(np.asarray(each)[tested] for each in judged))
    far = local.predict(found, np.asarray(part.inputs), piece=fold[tested])
    scaled = weight[tested] * (fold.size / tested.size)
    added, gain = _judged(part, scaled, before, _plus(before, far), always=effort.always)
    return found, added, gain


def _where(use: Bool[np.ndarray, " output"], one: Belief, other: Belief) -> Belief:
    mask = use[None, :]
    return Belief(*(np.where(mask, a, b) for a, b in zip(one, other, strict=True)))


def _plus(one: Belief, other: Belief) -> Belief:
    return Belief(one.mean + other.mean, one.variance + other.variance)
