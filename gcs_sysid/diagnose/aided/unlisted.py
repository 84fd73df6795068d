"""What nothing in the catalogue explains: which coefficient is off, and with what it goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import expit, logsumexp

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.diagnose.aided.beliefs import NEGLIGIBLE
from gcs_sysid.diagnose.aided.ranking import ACCURACIES
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.evidence import Information, posterior
from gcs_sysid.diagnose.hypothesis import PRIOR_OF_UNLISTED, Ranked
from gcs_sysid.diagnose.verdict import NAMED
from gcs_sysid.estimate.lacking import SIZE, log_bayes_factor


@dataclass(frozen=True)
class MissingTerm:
    """A term that the flights ask for.

    Attributes:
        coefficient: that it belongs to.
        variables: of which it is the product.
        log_bayes_factor: evidence for any term missing, against nothing being wrong [nat].
        value: of this one.
        deviation: one sigma of it.
        sigma: what was believed of it.
        accuracy: of the rest of the file, as for `Ranked`.
    """

    coefficient: str
    variables: tuple[str, ...]
    log_bayes_factor: float
    value: float
    deviation: float
    sigma: float
    accuracy: float

    @property
    def key(self) -> str:
        """The term as an aircraft file has it."""
        return "*".join(self.variables)


def names(terms: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """Of every such term in every coefficient."""
    return tuple(f"missing.{name}.{'*'.join(term)}" for name in COEFFICIENTS for term in terms)


def sizes(
    terms: Sequence[tuple[str, ...]],
    flow: Mapping[str, Float[np.ndarray, " sample"]],
    measured: Mapping[str, Float[np.ndarray, " sample"]],
) -> Float[np.ndarray, " term"]:
    """One sigma of every term in every coefficient.

    Args:
        terms: the products.
        flow: variables and controls.
        measured: the coefficients.
    """
    spread = [float(np.std(np.prod([flow[name] for name in term], axis=0))) for term in terms]
    return np.array(
        [
            SIZE * float(np.std(measured[name])) / max(size, 1e-12)
            for name in COEFFICIENTS
            for size in spread
        ]
    )


def strongest(
    fitted: Information,
    apart: Information,
    listed: Unknowns,
    terms: Sequence[tuple[str, ...]],
    sigma: Float[np.ndarray, " term"],
) -> MissingTerm | None:
    """The one more term that the flights ask for most, if what took no part asks for it too.

    Any term, and any accuracy of the file, is averaged over: what is told is whether something is
    missing, and which term it looks like. What no simulation is good to is not missing: that a term
    is large is weighed against its being negligible, and not against its being nothing.

    Args:
        fitted: what was fitted says of all unknowns, the terms among them.
        apart: what took no part says.
        listed: the unknowns; the terms are the last of the model's parameters.
        terms: the products.
        sigma: of every term in every coefficient.
    """
    accurate = [listed.as_accurate(share) for share in ACCURACIES]
    tried = [_added(fitted, one, sigma) for one in accurate]
    prior = np.log(list(ACCURACIES.values()))
    nothing = logsumexp([one.nothing for one in tried] + prior)
    having = np.array([one.nothing + one.gain - one.negligible for one in tried])
    having = having + prior[:, None]
    place, best = divmod(int(np.argmax(having)), sigma.size)
    if apart.count and _added(apart, accurate[place], sigma).gain[best] <= 0.0:
        return None
    return MissingTerm(
        COEFFICIENTS[best // len(terms)],
        terms[best % len(terms)],
        float(logsumexp(having) - np.log(sigma.size) - nothing),
        float(tried[place].value[best]),
        float(tried[place].deviation[best]),
        float(sigma[best]),
        tuple(ACCURACIES)[place],
    )


def gained(
    fitted: Information, apart: Information, listed: Unknowns, index: int, sigma: np.ndarray
) -> float:
    """Log predictive density per measurement that a term gains on what took no part [nat]."""
    both, one = (_added(data, listed, sigma).gain[index] for data in (fitted.plus(apart), fitted))
    return float(both - one) / apart.count if apart.count else float(np.nan)


def weighed(
    ranked: Sequence[Ranked], missing: MissingTerm | None, won: float = 0.0
) -> tuple[tuple[Ranked, ...], float]:
    """The sets of causes with what is left to them, and the probability of something unlisted.

    Args:
        ranked: sets of causes, the most probable first.
        missing: a term that the flights ask for; None for none.
        won: by how much what took no part speaks for it and against the first set [nat]. (In a wind
            that grows with height the square of the angle of attack in Cm had as much evidence as
            the wind where they were fitted, and half of its gain on what was not.)
    """
    if missing is None:
        return tuple(ranked), 0.0
    # Over the prior, every set's probability holds the same factor.
    best = ranked[0]
    share = np.log(best.probability * PRIOR_OF_UNLISTED / best.prior)
    probability = float(expit(missing.log_bayes_factor + won - best.log_bayes_factor + share))
    left = 1.0 - probability
    return tuple(replace(one, probability=left * one.probability) for one in ranked), probability


def named(missing: MissingTerm, probability: float, ranked: Sequence[Ranked]) -> bool:
    """Whether that a term is missing is more probable than any set of causes."""
    return missing.log_bayes_factor >= NAMED and probability > ranked[0].probability


@dataclass(frozen=True)
class _Added:
    """Evidence for terms, each by itself.

    Attributes:
        nothing: without any term [nat].
        gain: of each term.
        negligible: of each where it is no more than that.
        value: of each.
        deviation: one sigma of it.
    """

    nothing: float
    gain: Float[np.ndarray, " term"]
    negligible: Float[np.ndarray, " term"]
    value: Float[np.ndarray, " term"]
    deviation: Float[np.ndarray, " term"]


def _added(data: Information, listed: Unknowns, sigma: Float[np.ndarray, " term"]) -> _Added:
    """Each term by itself on top of nothing being wrong.

    By what remains of a term when everything already free has had its share: information
    G_jj − G_jF Σ G_Fj and score b_j − G_jF θ.
    """
    base = posterior(data, *listed.freed(()))
    places = slice(listed.parameters - sigma.size, listed.parameters)
    cross = data.gram[:, places]
    told = np.diagonal(data.gram)[places] - np.sum(cross * (base.covariance @ cross), axis=0)
    told = np.maximum(told, 0.0)
    rest = data.score[places] - cross.T @ base.mean
    share = 1.0 + told * sigma**2
    return _Added(
        base.log_evidence,
        log_bayes_factor(rest, told, sigma),
        log_bayes_factor(rest, told, NEGLIGIBLE / SIZE * sigma),
        sigma**2 * rest / share,
        sigma / np.sqrt(share),
    )
