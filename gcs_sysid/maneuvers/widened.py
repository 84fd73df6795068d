"""A model with terms beside its own, all of them 0, as surely known as its flights say.

Of what flights tell of a further regressor z, its own part R is what the model's regressors X do
not explain, the rest it shares with them: with z = X b + r and J what is known of X,

    J′ = [J, J b; bᵀJ, bᵀJ b + rᵀr/v].

Whoever asks what another flight tells of both then asks as of any model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcs_sysid.estimate import basis, traces
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.result import AeroModel, CoefficientFit
from gcs_sysid.maneuvers import information

VAGUE = 1e-6
"""Share of what a flight tells of a further term alone that is told of it even where the model's
own regressors explain all of it: a matrix has to have an inverse."""


def widened(model: AeroModel, further: Mapping[str, Sequence[str]], flown: Values) -> AeroModel:
    """A model with further terms.

    Args:
        model: identified so far.
        further: regressors beside those of each coefficient; they may hold `traces.names`.
        flown: every variable along the flights of the model, those among them.
    """
    controls = (*model.controls, *traces.names(model.controls))
    fits = {
        name: _wider(fit, tuple(further[name]), controls, flown) if further.get(name) else fit
        for name, fit in model.fits.items()
    }
    return AeroModel(fits, controls)


def _wider(
    fit: CoefficientFit, more: tuple[str, ...], controls: Sequence[str], flown: Values
) -> CoefficientFit:
    own, added = (basis.columns(keys, controls, flown) for keys in (fit.keys, more))
    weight = fit.effective_samples / (fit.residual**2 * own.shape[0])
    known = information.seen(fit)
    share = np.linalg.lstsq(own, added, rcond=None)[0]
    left = added - own @ share
    across = known @ share
    alone = weight * (left.T @ left) + share.T @ across
    alone += VAGUE * np.diag(np.diagonal(weight * (added.T @ added)))
    both = np.block([[known, across], [across.T, alone]])
    size = np.sqrt(np.diagonal(both))
    covariance = np.linalg.inv(both / np.outer(size, size)) / np.outer(size, size)
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
