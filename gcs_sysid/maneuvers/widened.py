"""A model with terms beside its own, all of them 0, as surely known as its flights say.

What flights tell of a further term and of the model's own together is T; of the own terms J is
known, which is T at best, and more honest. What T has of the further one is a part S = Tₒₒ⁻¹ Tₒₐ
of the own terms and a rest that is none,

    J′ = [J, J S; SᵀJ, Sᵀ J S + Tₐₐ − Tₐₒ S].

By least squares T is ZᵀZ/v of rows Z and their variance v, and the rest is what own regressors do
not explain of further ones. Of a fit of the filter's it is what that hears in the flights, whatever
the other coefficients and the errors of the sensors are: a lag of one servo shows by less than what
all surfaces together may be late. Whoever asks what another flight tells of both then asks as of
any model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from gcs_sysid.estimate import basis, traces
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.innovation_spectrum import Spectrum
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers.knowledge import Added, Knowledge

VAGUE = 1e-6
"""Share of what a flight tells of a further term alone that is told of it even where the model's
own regressors explain all of it: a matrix has to have an inverse."""


def widened(
    model: AeroModel,
    further: Mapping[str, Sequence[str]],
    flown: Values,
    heard: Spectrum | None = None,
) -> AeroModel:
    """A model with further terms.

    Args:
        model: identified so far.
        further: regressors beside those of each coefficient; they may hold `traces.names`.
        flown: every variable along the flights of the model, those among them; row by row of the
            filter where `heard` is given.
        heard: by which the filter tells of coefficients; None where least squares do.
    """
    controls = (*model.controls, *traces.names(model.controls))
    wider = {name: tuple(more) for name, more in further.items() if more and name in model.fits}
    # Only its terms are asked for.
    asked = AeroModel(
        {
            name: replace(fit, keys=(*fit.keys, *wider.get(name, ())))
            for name, fit in model.fits.items()
        },
        controls,
    )
    told = _rows(asked, wider, flown) if heard is None else _heard(asked, wider, flown, heard)
    fits = {
        name: _wider(fit, wider[name], controls, flown, told[name]) if name in wider else fit
        for name, fit in model.fits.items()
    }
    return AeroModel(fits, controls)


def _rows(
    asked: AeroModel, wider: Mapping[str, Sequence[str]], flown: Values
) -> dict[str, Float[np.ndarray, "term term"]]:
    """T of each coefficient that has further terms, by least squares."""
    found = {}
    for name in wider:
        fit = asked.fits[name]
        columns = basis.columns(fit.keys, asked.controls, flown)
        weight = fit.effective_samples / (fit.residual**2 * columns.shape[0])
        found[name] = weight * (columns.T @ columns)
    return found


def _heard(
    asked: AeroModel, wider: Mapping[str, Sequence[str]], flown: Values, heard: Spectrum
) -> dict[str, Float[np.ndarray, "term term"]]:
    """T of each coefficient that has further terms, by the filter."""
    whole = heard.information(asked, flown, heard.step)
    placed, count = information.places(asked)
    vague = VAGUE * np.diagonal(whole)
    vague[count:] = heard.precision
    known = Knowledge(placed, np.diag(vague), Added(whole, 0.0))
    return {name: known.of(name).information for name in wider}


def _wider(
    fit: CoefficientFit,
    more: tuple[str, ...],
    controls: Sequence[str],
    flown: Values,
    told: Float[np.ndarray, "term term"],
) -> CoefficientFit:
    own, added = (basis.columns(keys, controls, flown) for keys in (fit.keys, more))
    known, first = information.seen(fit), len(fit.keys)
    size = np.sqrt(np.diagonal(told)[:first])
    inner = np.linalg.pinv(told[:first, :first] / np.outer(size, size), rcond=1e-12, hermitian=True)
    share = inner @ (told[:first, first:] / size[:, None]) / size[:, None]
    across = known @ share
    left = told[first:, first:] - told[first:, :first] @ share
    alone = left + share.T @ across + VAGUE * np.diag(np.diagonal(told)[first:])
    both = np.block([[known, across], [across.T, alone]])
    units = np.sqrt(np.diagonal(both))
    covariance = np.linalg.inv(both / np.outer(units, units)) / np.outer(units, units)
    # What is not noise of the measurement stays beside it.
    noise = np.sqrt(np.diagonal(covariance))
    rest = np.maximum(np.diagonal(fit.covariance) - information.noise_deviation(fit) ** 2, 0.0)
    every = np.sqrt(noise**2 + np.concatenate([rest, np.zeros(len(more))]))
    widest = covariance * np.outer(every / noise, every / noise)
    nothing = np.zeros(len(more))
    return replace(
        fit,
        keys=(*fit.keys, *more),
        value=np.concatenate([fit.value, nothing]),
        covariance=widest,
        flight_value=np.concatenate([fit.flight_value, nothing]),
        deviations={
            **{
                origin: np.concatenate([np.asarray(deviation), nothing])
                for origin, deviation in fit.deviations.items()
            },
            "noise": noise,
        },
        late=np.concatenate([fit.late, nothing]),
        white_deviation=np.concatenate([fit.white_deviation, nothing]),
        repeated_covariance=widest,
        correlation=basis.correlation(np.concatenate([own, added], axis=1)),
        excitation=np.concatenate([fit.excitation, nothing]),
        lowest=np.concatenate([fit.lowest, added.min(axis=0)]),
        highest=np.concatenate([fit.highest, added.max(axis=0)]),
        spread=np.concatenate([fit.spread, added.std(axis=0)]),
    )
