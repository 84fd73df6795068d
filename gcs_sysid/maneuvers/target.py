"""What is to be known better, and what a maneuver is worth for it.

A question is a quadratic form E over the terms of one coefficient: the variance asked about is
tr(E Σ). One derivative is E = e eᵀ; a coefficient over a region of the envelope is the mean of x xᵀ
over regressors x of the region. Worth is Σ ½ log(tr(E Σ)/tr(E Σ′)): halving a standard deviation is
worth log 2, whichever it is. Σ there is what flying can change: what is not known of mass, inertia
and the moments' lag is the same after every maneuver, and with it in Σ a coefficient whose inertia
is poorly known would never be flown for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate import basis
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.knowledge import Added, Knowledge

POINTS = 400
"""Points drawn in a region."""


@dataclass(frozen=True)
class Target:
    """Questions about an aircraft's coefficients.

    Attributes:
        questions: quadratic forms by coefficient.
        words: what is asked, for people.
        region: limits of the variables of a region [SI, rad]; empty without one.
    """

    questions: Mapping[str, tuple[Float[np.ndarray, "term term"], ...]]
    words: str
    region: Mapping[str, tuple[float, float]]

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Coefficients that are asked about."""
        return tuple(self.questions)

    def worth(
        self,
        model: AeroModel,
        known: Knowledge,
        more: Added,
        *,
        before: Sequence[float] | None = None,
    ) -> float:
        """What more rows are worth, see the module.

        Args:
            model: whose fits the questions are about.
            known: what was added to these fits before.
            more: what is added now.
            before: `variances` before; who asks about many maneuvers finds them once.
        """
        if before is None:
            before = self.variances(model, known)
        return _shrunk(before, self.variances(model, known.with_more(more)))

    def stated_worth(
        self, model: AeroModel, known: Knowledge, more: Added, *, before: Sequence[float]
    ) -> float:
        """The same of what will be `stated`: near nothing where no flight changes what is left."""
        return _shrunk(before, self.stated(model, known.with_more(more)))

    def variances(self, model: AeroModel, known: Knowledge) -> tuple[float, ...]:
        """What flying can change of what is asked about, once so much was added to the fits."""
        return self._forms(model, known, information.changeable)

    def stated(self, model: AeroModel, known: Knowledge) -> tuple[float, ...]:
        """What is asked about as it will be stated, with what no flight changes."""
        return self._forms(model, known, information.covariance)

    def slope(
        self, model: AeroModel, known: Knowledge
    ) -> tuple[float, Float[np.ndarray, "unknown unknown"]]:
        """What is known so far, and how it grows with information, as `worth` counts it.

        Of noise alone: where errors of the regressors pull (least squares), these are left out.

        Args:
            model: whose fits the questions are about.
            known: what was added to these fits before.

        Returns:
            Σ −½ log tr(E Σ), and ½ Σ Σ E Σ/tr(E Σ), by which Σ changes as −Σ dI Σ.
        """
        covariance = known.covariance()
        total, found = 0.0, np.zeros(covariance.shape)
        for name, forms in self.questions.items():
            own = known.places[name]
            columns = covariance[:, own]
            for form in forms:
                variance = float(np.sum(form * columns[own]))
                total -= 0.5 * float(np.log(max(variance, 1e-300)))
                found += columns @ form @ columns.T / (2.0 * max(variance, 1e-300))
        return total, found

    def _forms(
        self, model: AeroModel, known: Knowledge, of: Callable[[CoefficientFit, Added], np.ndarray]
    ) -> tuple[float, ...]:
        found = []
        for name, forms in self.questions.items():
            covariance = of(model.fits[name], known.of(name))
            found += [float(np.sum(form * covariance)) for form in forms]
        return tuple(found)


def _shrunk(before: Sequence[float], after: Sequence[float]) -> float:
    return 0.5 * sum(
        float(np.log(max(one, 1e-300) / max(other, 1e-300)))
        for one, other in zip(before, after, strict=True)
    )


def derivatives(model: AeroModel, coefficients: tuple[str, ...]) -> Target:
    """All derivatives of some coefficients, each as good as the other; constants left out."""
    questions = {}
    for name in coefficients:
        keys = model.fits[name].keys
        unit = np.eye(len(keys))
        questions[name] = tuple(
            np.outer(unit[index], unit[index])
            for index, key in enumerate(keys)
            if key != regressors.CONSTANT or len(keys) == 1
        )
    return Target(questions, ", ".join(coefficients), {})


def derivative(model: AeroModel, coefficient: str, key: str) -> Target:
    """One derivative.

    Raises:
        UsageError: the model's coefficient has no such term.
    """
    keys = model.fits[coefficient].keys
    if key not in keys:
        raise UsageError(
            f"{coefficient} of the model has no term `{key}`; it has {', '.join(keys)}"
        )
    unit = np.eye(len(keys))[keys.index(key)]
    return Target({coefficient: (np.outer(unit, unit),)}, f"{coefficient}.{key}", {})


def region(
    model: AeroModel,
    coefficients: tuple[str, ...],
    limits: Mapping[str, tuple[float, float]],
    level: Mapping[str, float],
) -> Target:
    """Coefficients over a region of the envelope.

    Args:
        model: identified so far.
        coefficients: asked about.
        limits: of each variable in the region [SI, rad].
        level: every variable in level flight; those without limits stay there.

    Raises:
        UsageError: a variable that the model does not have.
    """
    unknown = [name for name in limits if name not in level]
    if unknown:
        raise UsageError(f"--region: no variable `{unknown[0]}`; there are {', '.join(level)}")
    generator = np.random.default_rng(0)
    values = {name: np.full(POINTS, value) for name, value in level.items()}
    for name, (low, high) in limits.items():
        values[name] = generator.uniform(low, high, POINTS)
    questions = {}
    for name in coefficients:
        rows = basis.columns(model.fits[name].keys, model.controls, values)
        questions[name] = (rows.T @ rows / POINTS,)
    return Target(questions, f"{', '.join(coefficients)} over a region", dict(limits))
