"""Learned aerodynamics: a polynomial, and what Gaussian processes found beyond it.

In place of the polynomial alone wherever a model of the aerodynamics is asked, by array
(`LearnedModel`) or inside the flight model (`beyond`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate.result import AeroModel, Prediction
from gcs_sysid.frames import Array
from gcs_sysid.gp import dependent, fitting, posterior
from gcs_sysid.gp.fitting import Fitted
from gcs_sysid.gp.posterior import Posterior

TOLD = 0.1
"""Share of a process's prior variance that data must have taken away for it to count as told."""


@dataclass(frozen=True)
class LearnedModel(AeroModel):
    """A polynomial model with Gaussian processes beside it.

    Attributes:
        process: the Gaussian processes.
        inputs: variables and controls that they are functions of.
        outputs: coefficients that they are of.
    """

    process: Fitted
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def variables(self) -> tuple[str, ...]:
        """Variables and controls that any coefficient uses."""
        return tuple(dict.fromkeys((*super().variables, *self.inputs)))

    def depends_on(self, name: str) -> tuple[str, ...]:
        """Variables and controls that one coefficient uses."""
        own = self.inputs if self._has(name) else ()
        return tuple(dict.fromkeys((*super().depends_on(name), *own)))

    def predict(
        self, values: Mapping[str, Float[np.ndarray, " sample"]], *, measured: bool
    ) -> dict[str, Prediction]:
        """Every coefficient at given conditions; see `AeroModel.predict`."""
        plain = super().predict(values, measured=measured)
        found = fitting.predict(self.process, self._rows(values))
        for column, name in enumerate(self.outputs):
            if self._has(name):
                # The polynomial's discrepancy was what the processes now explain, or leave.
                variance = plain[name].deviation ** 2 - self.fits[name].discrepancy ** 2
                variance = np.maximum(variance, 0.0) + found.variance[:, column]
                total = variance + self.process.discrepancy[column]
                plain[name] = Prediction(plain[name].mean + found.mean[:, column], np.sqrt(total))
        return plain

    def derivative(
        self, name: str, variable: str, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Prediction:
        """∂C/∂variable at given conditions: of the polynomial and of the global part."""
        plain = super().derivative(name, variable, values)
        if variable not in self.inputs or not self._has(name):
            return plain
        column, row = self.inputs.index(variable), self.outputs.index(name)
        if not self.process.use_global[row]:
            return plain
        scale = self.process.scaling
        ratio = scale.unit[row] / scale.spread[column]
        found = posterior.slopes(self.process.posterior, self.process.scaled(self._rows(values)))
        spread = np.asarray(found.variance)[:, row, column] * ratio**2
        return Prediction(
            plain.mean + np.asarray(found.mean)[:, row, column] * ratio,
            np.sqrt(plain.deviation**2 + spread),
        )

    def linear_variance(
        self, name: str, keys: Sequence[str], values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Float[np.ndarray, " term"]:
        """What the global part adds to the variance of each term, where it is constant or linear.

        Args:
            name: the coefficient.
            keys: regressors of its polynomial.
            values: one condition.
        """
        out = np.zeros(len(keys))
        if name not in self.outputs or not self.process.use_global[self.outputs.index(name)]:
            return out
        row, scale = self.outputs.index(name), self.process.scaling
        scaled = self.process.scaled(self._rows(values))
        slopes = np.asarray(posterior.slopes(self.process.posterior, scaled).variance)[0, row]
        level = float(
            np.asarray(posterior.predict(self.process.posterior, scaled).variance)[0, row]
        )
        for index, key in enumerate(keys):
            if key == "1":
                out[index] = level * scale.unit[row] ** 2
            elif key in self.inputs:
                column = self.inputs.index(key)
                out[index] = slopes[column] * (scale.unit[row] / scale.spread[column]) ** 2
        return out

    def known(
        self, name: str, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Float[np.ndarray, " sample"]:
        """Share of the global part's prior variance that data have taken away.

        Near 0 the answer is the prior: the polynomial alone, with the deviation it had before.
        """
        return self._known(values)[:, self.outputs.index(name)]

    def untold(
        self, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> dict[str, Bool[np.ndarray, " sample"]]:
        """Where the global part of each coefficient that has one extrapolates; see `TOLD`."""
        known = self._known(values)
        return {
            name: known[:, row] < TOLD
            for row, name in enumerate(self.outputs)
            if self.process.use_global[row]
        }

    def region(
        self, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Int[np.ndarray, " sample"]:
        """Number, from 1, of the nearest inducing point; 0 throughout without a local part."""
        if self.process.local is None:
            return super().region(values)
        places = KDTree(np.asarray(self.process.posterior.points.inputs))
        return places.query(self.process.scaled(self._rows(values)))[1] + 1

    def discrepancy(self, name: str) -> float:
        """Deviation that is no uncertainty of the function; see `AeroModel.discrepancy`."""
        if not self._has(name):
            return super().discrepancy(name)
        return float(np.sqrt(self.process.discrepancy[self.outputs.index(name)]))

    def _known(
        self, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Float[np.ndarray, "sample output"]:
        scaled = self.process.scaled(self._rows(values))
        prior = np.asarray(dependent.variance(self.process.base.kernel))
        left = np.asarray(fitting.in_batches(self.process.posterior, scaled).variance)
        return 1.0 - left / prior[None, :]

    def _has(self, name: str) -> bool:
        if name not in self.outputs:
            return False
        row = self.outputs.index(name)
        return bool(self.process.use_global[row] or self.process.use_local[row])

    def _rows(
        self, values: Mapping[str, Float[np.ndarray, " sample"]]
    ) -> Float[np.ndarray, "sample input"]:
        return stacked(self.inputs, values)


def stacked(
    names: tuple[str, ...], values: Mapping[str, Float[np.ndarray, " sample"]]
) -> Float[np.ndarray, "sample input"]:
    """Inputs side by side.

    Raises:
        UsageError: one of them is not in `values`.
    """
    missing = [name for name in names if name not in values]
    if missing:
        raise UsageError(f"the learned model needs {', '.join(missing)}; add it to `values`")
    return np.stack([np.asarray(values[name], dtype=float) for name in names], axis=-1)


def untold(
    model: AeroModel, values: Mapping[str, Float[np.ndarray, " sample"]]
) -> dict[str, Bool[np.ndarray, " sample"]]:
    """`LearnedModel.untold` of any model; nothing of a polynomial."""
    return model.untold(values) if isinstance(model, LearnedModel) else {}


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("process", "centre", "spread", "unit"),
    meta_fields=("inputs", "columns"),
)
@dataclass(frozen=True, eq=False)
class Beyond:
    """The mean of the global part as the flight model asks for it (`Aircraft.beyond`).

    Attributes:
        process: the global part.
        centre: of the inputs.
        spread: of the inputs.
        unit: of each output, 0 for those that have no global part.
        inputs: variables and controls, in order.
        columns: which coefficient each output is.
    """

    process: Posterior
    centre: Float[Array, " input"]
    spread: Float[Array, " input"]
    unit: Float[Array, " output"]
    inputs: tuple[str, ...]
    columns: tuple[int, ...]

    def __call__(self, flow: Mapping[str, Float[Array, "*sample"]]) -> Float[Array, "*sample six"]:
        """CX…Cn beyond the polynomial, at flow angles, rates and controls by name."""
        inputs = jnp.stack([jnp.asarray(flow[name]) for name in self.inputs], axis=-1)
        flat = (inputs.reshape((-1, len(self.inputs))) - self.centre[None, :]) / self.spread[None]
        found = posterior.mean(self.process, flat) * self.unit[None, :]
        # One by one: a scatter is a loop of its own in every step of a simulation.
        column = dict(zip(self.columns, found.T, strict=True))
        nothing = jnp.zeros(flat.shape[0])
        six = jnp.stack([column.get(place, nothing) for place in range(len(COEFFICIENTS))], axis=-1)
        return six.reshape((*inputs.shape[:-1], len(COEFFICIENTS)))


def beyond(model: AeroModel) -> Beyond | None:
    """What a model has beyond its polynomial for the flight model; None where that is all.

    The local part, whose neighbours change from place to place, takes no part.
    """
    if not isinstance(model, LearnedModel) or not model.process.use_global.any():
        return None
    process = model.process
    return Beyond(
        process=jax.tree.map(jnp.asarray, process.posterior),
        centre=jnp.asarray(process.scaling.centre),
        spread=jnp.asarray(process.scaling.spread),
        unit=jnp.asarray(process.scaling.unit * process.use_global),
        inputs=model.inputs,
        columns=tuple(COEFFICIENTS.index(name) for name in model.outputs),
    )
