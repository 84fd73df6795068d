"""What the Gaussian processes learn from: rows of inputs with some or all outputs, scaled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gcs_sysid.errors import UsageError
from gcs_sysid.frames import Array


class Rows(NamedTuple):
    """Samples: one row of inputs with a value of every output.

    Attributes:
        inputs: regressors, scaled.
        values: outputs, scaled, the mean taken off; anything where missing.
        precision: 1/variance of each value's own error; 0 where the value is missing.
    """

    inputs: Float[Array, "sample input"]
    values: Float[Array, "sample output"]
    precision: Float[Array, "sample output"]


class Scaling(NamedTuple):
    """How inputs and outputs become numbers of about one.

    Attributes:
        centre: of each input.
        spread: of each input.
        unit: of each output.
    """

    centre: Float[np.ndarray, " input"]
    spread: Float[np.ndarray, " input"]
    unit: Float[np.ndarray, " output"]


def scaling(
    inputs: Float[np.ndarray, "sample input"], values: Float[np.ndarray, "sample output"]
) -> Scaling:
    """Scales by mean and standard deviation; NaN in `values` is a missing output."""
    spread = np.std(inputs, axis=0)
    known = (column[np.isfinite(column)] for column in values.T)
    unit = np.array([np.std(column) if column.size else 0.0 for column in known])
    return Scaling(
        centre=np.mean(inputs, axis=0),
        spread=np.where(spread > 0.0, spread, 1.0),
        unit=np.where(unit > 0.0, unit, 1.0),
    )


def rows(
    scale: Scaling,
    inputs: Float[np.ndarray, "sample input"],
    values: Float[np.ndarray, "sample output"],
    variance: Float[np.ndarray, "sample output"],
) -> Rows:
    """Samples in scaled units; NaN in `values` or an infinite variance is a missing output.

    Raises:
        UsageError: an input is not finite, or a variance is not positive.
    """
    if not np.all(np.isfinite(inputs)):
        raise UsageError("an input of a sample is not finite; leave such samples out")
    missing = ~np.isfinite(values) | np.isinf(variance)
    if not np.all((variance > 0.0) | missing):
        raise UsageError("the variance of a sample is not positive; give every value its noise")
    filled = np.where(missing, 1.0, variance)
    return Rows(
        inputs=(inputs - scale.centre) / scale.spread,
        values=np.where(missing, 0.0, values) / scale.unit,
        precision=np.where(missing, 0.0, scale.unit**2 / filled),
    )


def some_of(whole: Rows, which: np.ndarray) -> Rows:
    """The samples that a mask or a list of indices picks."""
    return Rows(*(np.asarray(part)[which] for part in whole))


def padded(some: Rows, size: int) -> list[Rows]:
    """Batches of exactly `size` rows, the last filled with rows that count nothing."""
    count = some.inputs.shape[0]
    missing = -count % size
    whole = Rows(*(np.pad(np.asarray(part), ((0, missing), (0, 0))) for part in some))
    return [
        Rows(*(part[start : start + size] for part in whole))
        for start in range(0, count + missing, size)
    ]
