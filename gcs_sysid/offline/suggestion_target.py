"""What the command line asks to know better, as a target."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_sysid import regressors
from gcs_sysid.aircraft import MOMENTS, Aircraft
from gcs_sysid.errors import RegressorError, UsageError
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.innovation_spectrum import Spectrum
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.suspects import Suspect, file_sigmas, named, suspects
from gcs_sysid.estimate.traces import traces
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers import target as targets
from gcs_sysid.maneuvers.separation import Pair, Separation, apart, separation
from gcs_sysid.maneuvers.target import Target
from gcs_sysid.maneuvers.widened import widened
from gcs_sysid.offline.model_store import StoredModel

ALIKE = 1e-9
"""Part of what is known of a cause alone, from which on another is called the same."""
IN_DEGREES = ("alpha", "beta")
"""Variables whose limits people write in degrees; controls too."""


@dataclass(frozen=True)
class Question:
    """What is asked of `suggest`.

    Attributes:
        confidence: a coefficient is unsure where its deviation exceeds this part of its variation.
        target: coefficient or derivative to plan for, sure or not; None takes all moments that are
            unsure.
        region: limits of the envelope's part to plan for, see `chosen`.
        separate: two causes to tell apart, see `causes`; instead of the two before.
        minutes: flight time of the sortie.
        gust: horizontal intensity to reckon with [m/s]; None takes that of the model's flight.
        home: latitude, longitude and heading of the legs [deg], for a mission; None writes none.
        fly: link to a vehicle that flies the best maneuver at once; None for none.
        fly_share: of its amplitude.
        fly_beyond: whether that link may lead beyond this machine.
        flown: folder of the suggestion that has been flown since, if any.
        seed: of the aircraft and gusts drawn.
    """

    confidence: float = 0.1
    target: str | None = None
    region: str | None = None
    separate: str | None = None
    minutes: float = 6.0
    gust: float | None = None
    home: str | None = None
    fly: str | None = None
    fly_share: float = 0.25
    fly_beyond: bool = False
    flown: Path | None = None
    seed: int = 0


def chosen(
    model: AeroModel, asked: str | None, region: str | None, level: Mapping[str, float]
) -> Target:
    """The target that `--target` and `--region` name.

    Args:
        model: identified so far.
        asked: a coefficient, or one of its derivatives as `Cm.qhat`; None takes the moments.
        region: limits as `alpha=6:12,V=13:16` (deg, m/s), or None.
        level: every variable in level flight.

    Raises:
        UsageError: the model has no such coefficient, derivative or variable.
    """
    name, _, key = (asked or "").partition(".")
    known = tuple(model.fits)
    if asked is not None and name not in known:
        raise UsageError(
            f"--target {asked}: the model has the coefficients {', '.join(known) or 'none'}; name "
            "one of them, or one of its derivatives as in Cm.qhat"
        )
    coefficients = (name,) if asked else tuple(item for item in MOMENTS if item in known)
    if not coefficients:
        raise UsageError(f"the model has no moment coefficients; name one of {', '.join(known)}")
    if region is not None:
        return targets.region(model, coefficients, _limits(region, model), level)
    if key:
        try:
            parsed = regressors.parse(key, controls=model.controls).key
        except RegressorError as error:
            raise UsageError(f"--target {asked}: {error}") from error
        return targets.derivative(model, name, parsed)
    return targets.derivatives(model, coefficients)


def causes(model: AeroModel, aircraft: Aircraft, asked: str) -> tuple[Suspect, Suspect]:
    """The two causes that `--separate` names.

    Args:
        model: identified so far.
        aircraft: with the model for its aerodynamics.
        asked: two causes as `mass,cg_shift`; with what they are about after a colon where there
            are several, as `surface_effectiveness:elevator` or `aero_derivative:CZ_alpha`.

    Raises:
        UsageError: not two causes, or one that moves no coefficient.
    """
    every = [
        one
        for one in (*suspects(aircraft), *traces(aircraft))
        if {name for name, _ in one.moves} & set(model.fits)
    ]
    names = [part.strip() for part in asked.split(",")]
    if len(names) != 2:
        raise UsageError(f"--separate {asked}: give two causes, as in mass,cg_shift")
    return _suspect(every, names[0]), _suspect(every, names[1])


def separating(
    stored: StoredModel,
    pair: tuple[Suspect, Suspect],
    flown: Callable[[], Values],
    heard: Spectrum | None = None,
) -> tuple[Separation, AeroModel]:
    """The target of two causes, and the model with all terms that it asks about.

    Args:
        stored: identified so far, and the file whose simulation the causes are about.
        pair: the causes.
        flown: every variable along the flights of the model, those of `traces` among them; asked
            for where a cause shows in other ways than the model's terms do.
        heard: by which the filter tells of coefficients; None where least squares do.

    Raises:
        UsageError: they move the coefficients alike.
    """
    one, other = pair
    model = stored.model
    further = _further(model, pair)
    if further:
        model = widened(model, further, flown(), heard)
    moves = Pair(one.moves, other.moves, file_sigmas(stored.aircraft))
    nothing = information.nothing(model, heard)
    alone = apart(model, nothing, replace(moves, second={}))
    if apart(model, nothing, moves) <= ALIKE * alone:
        raise UsageError(
            f"--separate {one.label}, {other.label}: they move the coefficients alike, so that no "
            "maneuver tells them apart; weigh, swing or measure one of them on the ground"
        )
    return separation(model, f"{one.label} or {other.label}", moves, one.unit), model


def _further(model: AeroModel, pair: Sequence[Suspect]) -> dict[str, tuple[str, ...]]:
    """Terms of two causes that the model does not have, by coefficient."""
    found: dict[str, dict[str, None]] = {}
    for one in pair:
        for name, key in one.moves:
            if name in model.fits and key not in model.fits[name].keys:
                found.setdefault(name, {})[key] = None
    return {name: tuple(keys) for name, keys in found.items()}


def _suspect(every: Sequence[Suspect], text: str) -> Suspect:
    found = named(every, text)
    if len(found) == 1:
        return found[0]
    near = found or named(every, text.partition(":")[0]) or every
    listed = (f"{one.cause}:{one.about}" if one.about else one.cause for one in near)
    raise UsageError(f"--separate: `{text}` is not one cause; there are {', '.join(listed)}")


def _limits(text: str, model: AeroModel) -> dict[str, tuple[float, float]]:
    found = {}
    for part in text.split(","):
        name, _, pair = part.strip().partition("=")
        low, _, high = pair.partition(":")
        try:
            limits = (float(low), float(high))
        except ValueError as error:
            raise UsageError(
                f"--region {text}: `{part}` is no pair of limits; write it as alpha=6:12"
            ) from error
        scale = math.radians(1.0) if name in (*IN_DEGREES, *model.controls) else 1.0
        found[name] = (scale * min(limits), scale * max(limits))
    return found
