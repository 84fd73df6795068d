"""The first model beside the flight: recursive least squares on measured coefficients.

Of every coefficient only sums are kept (information form), so a sample costs the same after an hour
as after a minute, and the estimate is that of all samples so far: the equation error of
`estimate.equation_error`, with its kinds of uncertainty. The coloured residuals' part comes from
stretches of `STRETCH` seconds taken as independent of each other (Liang & Zeger 1986): the score of
a stretch is linear in the estimate, so sums of its products hold for any later estimate.

The live filter knows the flow angles to half a degree, and what it has wrong it has wrong for
minutes: an error δ of one of them moves the estimate by −(Σ w x xᵀ)⁻¹ Σ w x (∂x/∂angle · θ) δ,
whatever the number of samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import MOMENTS, Aircraft
from gcs_sysid.estimate import equation_error, plausible
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.estimate.result import Prior
from gcs_sysid.frames import Array
from gcs_sysid.reconstruct import rates

STRETCH = 2.0
"""Residuals further apart than this [s] are taken as independent."""

UNCERTAIN = ("alpha", "beta", "phat", "qhat", "rhat")
"""Variables whose error counts, see `coefficients.Samples.regressor_variance`."""
ANGLES = slice(0, 2)
"""Those of them that are wrong for minutes when they are; gusts turn the air anew each second."""


@dataclass(frozen=True)
class TermEstimate:
    """One derivative: value and one standard deviation."""

    value: float
    deviation: float


@dataclass(frozen=True)
class Solution:
    """Derivatives of one coefficient.

    Attributes:
        keys: their regressors.
        value: of each.
        covariance: of the values.
    """

    keys: tuple[str, ...]
    value: Float[np.ndarray, " term"]
    covariance: Float[np.ndarray, "term term"]

    def terms(self) -> dict[str, TermEstimate]:
        """One by one."""
        deviation = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        return {
            key: TermEstimate(float(one), float(sd))
            for key, one, sd in zip(self.keys, self.value, deviation, strict=True)
        }


class Regressors:
    """The regressors of all coefficients side by side, evaluated by one compiled function.

    Args:
        structure: regressor keys by coefficient.
        controls: names of the aircraft's controls.

    Attributes:
        keys: canonical keys by coefficient.
        place: columns of each coefficient.
        moments: columns of the moments.
    """

    def __init__(self, structure: Mapping[str, Sequence[str]], controls: Sequence[str]) -> None:
        parsed = {
            name: [regressors.parse(key, controls=controls) for key in keys]
            for name, keys in structure.items()
        }
        self._flat = [item for items in parsed.values() for item in items]
        ends = np.cumsum([len(items) for items in parsed.values()])
        self.keys = {name: tuple(item.key for item in items) for name, items in parsed.items()}
        self.place = {
            name: slice(int(end) - len(items), int(end))
            for (name, items), end in zip(parsed.items(), ends, strict=True)
        }
        self.moments = np.concatenate(
            [
                np.arange(item.start, item.stop)
                for name, item in self.place.items()
                if name in MOMENTS
            ]
        )
        self.evaluate = jax.jit(self._columns_and_slopes)

    def _columns_and_slopes(
        self, values: Mapping[str, Array]
    ) -> tuple[Float[Array, "sample term"], Float[Array, "variable sample term"]]:
        """Every regressor of every coefficient, and its derivative by each variable."""

        def columns(moved: Mapping[str, Array]) -> Float[Array, "sample term"]:
            every = {**values, **moved}
            return jnp.stack([regressors.evaluate(item, every) for item in self._flat], axis=1)

        def slope(name: str) -> Float[Array, "sample term"]:
            point = {name: values[name]}
            return jax.jvp(columns, (point,), ({name: jnp.ones_like(values[name])},))[1]

        return columns({}), jnp.stack([slope(name) for name in UNCERTAIN])


class RunningModel:
    """First model of an aircraft while it flies.

    Args:
        aircraft: relative uncertainty of mass, inertia and thrust.
        structure: its regressors.
        prior: values believed before, by coefficient; None uses the flight alone.
    """

    def __init__(
        self, aircraft: Aircraft, structure: Regressors, prior: Mapping[str, Prior] | None
    ) -> None:
        self._structure = structure
        self._prior = prior
        self._sums = {
            name: _Sums(plausible.sizes(name, keys, aircraft.control_names), len(UNCERTAIN))
            for name, keys in structure.keys.items()
        }
        self._variance = np.zeros(len(UNCERTAIN))
        self._lasting = np.zeros((2, len(UNCERTAIN[ANGLES])))
        self._newest = np.zeros((len(UNCERTAIN), 0))
        self._slopes = np.zeros((len(UNCERTAIN), 0, 0))
        push = max((item.thrust_sigma for item in aircraft.propulsion), default=0.0)
        mass = aircraft.mass
        self._sigma = {
            name: np.array([mass.inertia_sigma if name in MOMENTS else mass.mass_sigma, push])
            for name in structure.keys
        }

    @property
    def structure(self) -> str:
        """Which regressors it has, as text: two models of the same text understand each other."""
        return "; ".join(f"{name} {' '.join(keys)}" for name, keys in self._structure.keys.items())

    def state(self) -> dict[str, np.ndarray]:
        """Everything learned so far, as arrays by name."""
        sums = {
            f"{name}.{part}": value
            for name, own in self._sums.items()
            for part, value in own.state().items()
        }
        return {"variance": self._variance, "lasting": self._lasting, **sums}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Goes on from the `state` of a model of the same structure.

        Raises:
            KeyError: something is missing.
            ValueError: something has another shape, or is not finite.
        """
        self._variance = _alike(state["variance"], self._variance)
        self._lasting = _alike(state["lasting"], self._lasting)
        for name, own in self._sums.items():
            own.restore({part: state[f"{name}.{part}"] for part in own.state()})

    def take(self, samples: Samples, kept: slice) -> None:
        """Adds the rows `kept` of a window; the rest serves the smoothing of the regressors."""
        values = {name: jnp.asarray(value) for name, value in samples.regressors.items()}
        columns, slopes = (np.array(item) for item in self._structure.evaluate(values))
        moments = self._structure.moments
        # A moment and its regressors go through the same smoother.
        columns[:, moments] = rates.smooth(
            samples.time, columns[:, moments], samples.smoothing
        ).value
        self._newest = np.stack([samples.regressor_variance[name][kept] for name in UNCERTAIN])
        self._slopes = slopes[:, kept]
        self._variance = self._newest.mean(axis=1)
        # Samples count by what is known of the flow, and so do its errors in what they say.
        known = 1.0 / np.maximum(self._newest[ANGLES], 1e-30)
        self._lasting += (np.full(len(known), known.shape[1]), known.sum(axis=1))
        for name, measured in samples.measured.items():
            place = self._structure.place[name]
            self._sums[name].add(
                time=samples.time[kept],
                columns=columns[kept, place],
                measured=measured[kept],
                noise=samples.noise[name][kept],
                slopes=slopes[:, kept, place],
                systematic=np.stack(
                    [samples.mass_part[name][kept], samples.thrust_part[name][kept]], axis=1
                ),
            )

    def flow_variance(
        self, known: Mapping[str, Mapping[str, TermEstimate]]
    ) -> dict[str, Float[np.ndarray, "variable sample"]]:
        """Variance that errors of each of `UNCERTAIN` add to the coefficients in the newest rows.

        Args:
            known: derivatives, by which they do; a coefficient without is left out.
        """
        out = {}
        for name, terms in known.items():
            value = [terms[key].value for key in self._structure.keys[name]]
            slopes = self._slopes[:, :, self._structure.place[name]] @ np.array(value)
            out[name] = slopes**2 * self._newest
        return out

    def solutions(self, *, believing: bool = True) -> dict[str, Solution]:
        """Derivatives by coefficient with their covariance.

        Args:
            believing: whether the values believed before take part.

        Returns:
            Nothing of a coefficient that has too few samples yet.
        """
        found = {}
        count, known_by = self._lasting
        lasting = np.sqrt(count / np.where(known_by > 0.0, known_by, 1.0))
        for name, sums in self._sums.items():
            keys = self._structure.keys[name]
            if sums.stretches <= 2 * len(keys):
                continue
            known = None if self._prior is None or not believing else self._prior.get(name)
            value, covariance = sums.solved(self._variance, lasting, self._sigma[name], known, keys)
            found[name] = Solution(keys, value, covariance)
        return found

    def estimates(self) -> dict[str, dict[str, TermEstimate]]:
        """Derivatives by coefficient and regressor; empty for what has too few samples yet."""
        return {name: one.terms() for name, one in self.solutions().items()}


class _Sums:
    """What least squares needs of the samples of one coefficient.

    Over all samples: information, vector, square, squared slopes by each uncertain variable,
    products of regressors and slopes by each angle, effect of scale errors. How uncertain the
    variables are is taken as it is believed at the end: early on, gusts are not known yet.
    Over the running stretch: its information and vector. Over complete stretches: products of
    these two, from which the scores' covariance follows for any estimate.
    """

    def __init__(self, size: Float[np.ndarray, " term"], variables: int) -> None:
        terms = size.size
        self._plausible = size
        self._information = np.zeros((terms, terms))
        self._vector = np.zeros(terms)
        self._square = 0.0
        self._count = 0
        self._slopes = np.zeros((variables, terms, terms))
        self._pull = np.zeros((len(UNCERTAIN[ANGLES]), terms, terms))
        self._effect = np.zeros((terms, 2))
        self._begun: float | None = None
        self._stretch = np.zeros((terms, terms + 1))
        self._products = np.zeros((terms, terms + 1, terms, terms + 1))
        self.stretches = 0

    def state(self) -> dict[str, np.ndarray]:
        """Sums over complete stretches and all samples; a running stretch is given up."""
        return {
            "information": self._information,
            "vector": self._vector,
            "scalars": np.array([self._square, float(self._count), float(self.stretches)]),
            "slopes": self._slopes,
            "pull": self._pull,
            "effect": self._effect,
            "products": self._products,
        }

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """The inverse of `state`."""
        own = self.state()
        new = {name: _alike(state[name], value) for name, value in own.items()}
        self._information, self._vector = new["information"], new["vector"]
        self._square, count, stretches = (float(item) for item in new["scalars"])
        self._count, self.stretches = round(count), round(stretches)
        self._slopes, self._pull, self._effect = new["slopes"], new["pull"], new["effect"]
        self._products = new["products"]

    def add(
        self,
        *,
        time: Float[np.ndarray, " sample"],
        columns: Float[np.ndarray, "sample term"],
        measured: Float[np.ndarray, " sample"],
        noise: Float[np.ndarray, " sample"],
        slopes: Float[np.ndarray, "variable sample term"],
        systematic: Float[np.ndarray, "sample two"],
    ) -> None:
        """Adds samples; see `equation_error.Problem` for what they hold."""
        weight = 1.0 / noise**2
        weighted = columns * weight[:, None]
        both = np.column_stack([columns, measured])
        part = weighted.T @ both
        self._information += part[:, :-1]
        self._vector += part[:, -1]
        self._square += float(weight @ measured**2)
        self._count += time.size
        self._slopes += np.einsum("s,vsi,vsj->vij", weight, slopes, slopes, optimize=True)
        self._pull += weighted.T @ slopes[ANGLES]
        self._effect += weighted.T @ systematic
        if self._begun is None:
            self._begun = float(time[0])
        self._stretch += part
        if float(time[-1]) - self._begun >= STRETCH:
            self._products += self._stretch[:, :, None, None] * self._stretch[None, None]
            self._stretch = np.zeros_like(self._stretch)
            self._begun = None
            self.stretches += 1

    def solved(
        self,
        variance: Float[np.ndarray, " variable"],
        lasting: Float[np.ndarray, " angle"],
        systematic_sigma: Float[np.ndarray, " two"],
        prior: Prior | None,
        keys: tuple[str, ...],
    ) -> tuple[Float[np.ndarray, " term"], Float[np.ndarray, "term term"]]:
        """Estimate and covariance from all samples so far, the prior's part included."""
        inverse, unseen = equation_error.inverse_where_seen(
            self._information, float(np.sqrt(self._square)), self._count
        )
        value = inverse @ self._vector
        # The score of a stretch is its vector less its information times the estimate.
        along = np.append(-value, 1.0)
        scores = np.einsum("iajb,a,b->ij", self._products, along, along, optimize=True)
        corrected = scores * self.stretches / (self.stretches - len(keys))
        effect = inverse @ self._effect * systematic_sigma
        turned = inverse @ (self._pull @ value).T * lasting
        left = float(np.sqrt(max(self._square - value @ self._vector, 0.0)))
        error = np.einsum("v,vij->ij", variance, self._slopes)
        # Samples are weighed by their noise: of each it is one.
        noise = float(np.sqrt(self._count))
        bent = equation_error.pull(error, self._information, value, left, noise)
        covariance = (
            inverse @ corrected @ inverse
            + unseen @ unseen.T
            + effect @ effect.T
            + turned @ turned.T
            + equation_error.bounded(bent @ bent.T, self._plausible)
        )
        mean, spread, _ = equation_error.with_prior(value, covariance, prior, keys)
        return mean, spread


def _alike(new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """A copy of `new`, known to be of the shape of `old`, and finite."""
    array = np.array(new, dtype=np.float64)
    if array.shape != old.shape or not np.isfinite(array).all():
        raise ValueError(f"shape {array.shape} instead of {old.shape}, or not finite")
    return array
