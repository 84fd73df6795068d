"""The largest share of a recipe that is safe, and what flying it would teach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid import parallel
from gcs_sysid.aircraft import Aircraft, Envelope
from gcs_sysid.estimate.innovation_spectrum import Spectrum
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.maneuvers import axes, envelope, flown, gusts, holding, information
from gcs_sysid.maneuvers.axes import Axes
from gcs_sysid.maneuvers.envelope import Excursion
from gcs_sysid.maneuvers.flown import LANES, LEAD, STEP, Drawn, Fleet, Flown, Simulator
from gcs_sysid.maneuvers.flown_hold import FlownHold
from gcs_sysid.maneuvers.holding import Linear
from gcs_sysid.maneuvers.information import Gain, Reach
from gcs_sysid.maneuvers.knowledge import Added, Knowledge
from gcs_sysid.maneuvers.recipes import TURNS, Place, Recipe
from gcs_sysid.model.trim import Trim

AFTER = 3.0
"""Answer of the aircraft after the input that is flown and counted too [s]."""
SETTLE = 5.0
"""Straight and level before each maneuver [s]."""
TURN = 20.0
"""To turn round and settle after two maneuvers on a leg [s]."""
ON_A_LEG = 2
"""Maneuvers on one leg before turning round: the next two are flown in the other direction, so
that a steady wind does not look like the aircraft."""
AROUND = SETTLE + TURN / ON_A_LEG
"""Flight time beside each maneuver and its answer [s]."""
LONGEST = 24.0
"""Longest maneuver with its answer [s]: gusts are drawn for so long."""
CALM = 8
"""Of the aircraft flown at once, the mean first, so many fly in calm air: what they teach counts,
the others show how far gusts and errors may carry. What gusts do to an aircraft tells next to
nothing of it: how strong they are is as unknown."""
TRIALS = 8
"""Times `LANES` aircraft that a maneuver must be flown by before it is suggested."""
SHARES = np.concatenate([[0.05, 0.07], np.geomspace(0.1, 1.0, 40)])
"""Shares of full size that are considered."""
SMALLER = 0.87
"""Step down where a maneuver left the envelope all the same."""
TRIES = 10
LEAST = 0.05
"""Smallest share that is worth flying."""


@dataclass(frozen=True)
class Condition:
    """A flight condition: level flight there, the aircraft drawn for it, and their gusts.

    `heard` is how the filter tells of coefficients there, None where least squares made the model.
    """

    aircraft: Aircraft
    model: AeroModel
    allowed: Envelope
    axes: Axes
    simulator: Simulator
    drawn: Drawn
    gust: float
    trim: Trim
    linear: Linear
    fleet: Fleet
    air: Float[np.ndarray, "draw sample six"]
    still: Flown
    heard: Spectrum | None

    @property
    def height(self) -> float:
        """Above ground [m]."""
        return -float(self.trim.state.position[2])

    def place(self) -> Place:
        """What recipes are made from."""
        return Place(
            self.aircraft,
            self.allowed,
            self.axes,
            self.trim,
            self.linear,
            self.linear.frequencies(),
        )

    def fly(self, fleet: Fleet, recipe: Recipe, share: float, air: np.ndarray) -> Flown:
        """Motions under a share of a recipe, and of what answers it."""
        added = np.zeros((_rows(recipe), recipe.added.shape[1]))
        added[: recipe.added.shape[0]] = share * recipe.added
        linear = self.linear.turning() if recipe.kind in TURNS else self.linear
        return self.simulator.fly(fleet, linear, self.trim.density, added, air)


@dataclass(frozen=True)
class Maneuver:
    """An input to fly.

    Attributes:
        recipe: what is flown, at full size.
        share: of it that is flown.
        airspeed: of the level flight it begins in [m/s].
        height: likewise [m].
        flown: motions of the drawn aircraft, answer after the input included.
        excursion: how far these go.
        reach: how far it goes in each coefficient, the mean over some aircraft (`CALM`).
        each: what each of these aircraft's flights adds to the fits.
        taught: the mean of these.
    """

    recipe: Recipe
    share: float
    airspeed: float
    height: float
    flown: Flown
    excursion: Excursion
    reach: Mapping[str, Reach]
    each: tuple[Added, ...]
    taught: Added

    @property
    def added(self) -> Float[np.ndarray, "sample input"]:
        """To each control [rad] and last to the throttle."""
        return self.share * self.recipe.added

    @property
    def time(self) -> Float[np.ndarray, " sample"]:
        """Of the input [s]."""
        return STEP * np.arange(self.recipe.added.shape[0])

    @property
    def name(self) -> str:
        """Unique in a sortie."""
        return f"{self.recipe.name}_{self.airspeed:.0f}mps"

    def gains(self, model: AeroModel, known: Knowledge) -> dict[str, Gain]:
        """Uncertainty of every coefficient before and after it."""
        later = known.with_more(self.taught)
        return {
            name: information.gain(model.fits[name], over, known.of(name), later.of(name))
            for name, over in self.reach.items()
        }


@dataclass(frozen=True)
class Refusal:
    """A maneuver that cannot be made safe, and why."""

    name: str
    reason: str


def condition(
    aircraft: Aircraft,
    model: AeroModel,
    simulator: Simulator,
    drawn: Drawn,
    trim: Trim,
    *,
    gust: float,
    generator: np.random.Generator,
    heard: Spectrum | None = None,
    hold: FlownHold | None = None,
) -> Condition:
    """Everything that maneuvers from one level flight share.

    Args:
        aircraft: with the model's mean as its aerodynamics, and an envelope.
        model: identified so far.
        simulator: of the aircraft.
        drawn: aircraft from the posterior, the mean first; `LANES` times `TRIALS`.
        trim: level flight.
        gust: horizontal intensity that is reckoned with [m/s].
        generator: of the gusts.
        heard: how the filter tells of coefficients there; None where least squares do.
        hold: that the autopilot flew with; where nobody knows, it is as fast as servos allow.
    """
    linear = holding.linearised(aircraft, trim)
    if hold is not None:
        linear = hold.on(linear, trim, aircraft.control_names)
    fleet = simulator.settle(flown.lanes(drawn, 0), trim)
    air = _air(aircraft, trim, gust, generator)
    air[:CALM] = 0.0
    nothing = np.zeros((air.shape[1] - LEAD, len(aircraft.controls) + 1))
    still = simulator.fly(fleet, linear, trim.density, nothing, air)
    if aircraft.envelope is None:
        raise ValueError("an aircraft without envelope has no safe maneuvers")
    return Condition(
        aircraft,
        model,
        aircraft.envelope,
        axes.found(aircraft, model),
        simulator,
        drawn,
        gust,
        trim,
        linear,
        fleet,
        air,
        still,
        heard,
    )


def unsafe_level_flight(at: Condition) -> str | None:
    """The limit that level flight alone breaks in these gusts; None where it does not."""
    found = envelope.broken(at.still, at.allowed, at.aircraft)
    lost = np.zeros(LANES, dtype=bool)
    for which in found.values():
        lost |= which
    return envelope.most_broken(found) if lost.any() else None


def sized(at: Condition, recipe: Recipe) -> Maneuver | Refusal:
    """The largest share of a recipe that keeps every aircraft of the first trial inside."""
    still = Flown(*(values[:, : _rows(recipe)] for values in at.still))
    moved = at.fly(at.fleet, recipe, 1.0, at.air)
    share = envelope.largest_inside(still, moved, at.allowed, at.aircraft, SHARES)
    path = moved
    for _ in range(TRIES):
        if share < LEAST:
            return Refusal(recipe.name, _why(moved, at, recipe))
        path = moved if share == 1.0 else at.fly(at.fleet, recipe, share, at.air)
        if not _lost(path, at).any():
            return _maneuver(at, recipe, share, path)
        share *= SMALLER
    return Refusal(recipe.name, _why(path, at, recipe))


def proved(at: Condition, maneuver: Maneuver, generator: np.random.Generator) -> Maneuver | Refusal:
    """A maneuver flown by every drawn aircraft in gusts of its own, smaller until it is safe.

    The bound of `envelope.upper_bound` then holds for the probability to leave the envelope.
    """
    tried = maneuver
    for _ in range(TRIES):
        found = _proof(at, tried, generator)
        if found.violation_probability <= envelope.LIKELY:
            return replace(tried, excursion=found)
        share = SMALLER * tried.share
        if share < LEAST:
            break
        tried = _rescaled(at, tried, share)
    return Refusal(
        maneuver.recipe.name,
        f"even at {100.0 * tried.share:.0f} % of full size {found.left} of {found.flights} flights "
        f"leave the envelope ({found.first})",
    )


def _proof(at: Condition, maneuver: Maneuver, generator: np.random.Generator) -> Excursion:
    most = envelope.allowed_to_leave(LANES * TRIALS)
    counts: dict[str, int] = {}
    left = flights = 0

    def tried(trial: int, own: np.random.Generator) -> dict[str, Bool[np.ndarray, " draw"]]:
        fleet = at.simulator.settle(flown.lanes(at.drawn, trial * LANES), at.trim)
        air = _air(at.aircraft, at.trim, at.gust, own, samples=LEAD + _rows(maneuver.recipe))
        path = at.fly(fleet, maneuver.recipe, maneuver.share, air)
        return envelope.broken(path, at.allowed, at.aircraft)

    for found in parallel.ahead(tried, range(TRIALS), generator.spawn(TRIALS)):
        for name, which in found.items():
            counts[name] = counts.get(name, 0) + int(which.sum())
        left += int(np.any(np.stack(list(found.values())), axis=0).sum())
        flights += LANES
        if left > most:
            break
    first = max(counts, key=lambda name: counts[name]) if left else None
    return Excursion(envelope.ranges(maneuver.flown), left, flights, first)


def _rescaled(at: Condition, maneuver: Maneuver, share: float) -> Maneuver:
    path = at.fly(at.fleet, maneuver.recipe, share, at.air)
    return _maneuver(at, maneuver.recipe, share, path)


def _rows(recipe: Recipe) -> int:
    """Samples of a maneuver with its answer."""
    return round((recipe.duration + AFTER) / STEP) + 1


def _lost(path: Flown, at: Condition) -> np.ndarray:
    return np.any(np.stack(list(envelope.broken(path, at.allowed, at.aircraft).values())), axis=0)


def _why(path: Flown, at: Condition, recipe: Recipe) -> str:
    first = envelope.most_broken(envelope.broken(path, at.allowed, at.aircraft))
    return (
        f"at {at.trim.airspeed:.0f} m/s in gusts of {at.gust:.1f} m/s even a twentieth of it "
        f"({recipe.kind}) leaves the envelope: {first}"
    )


def _maneuver(at: Condition, recipe: Recipe, share: float, path: Flown) -> Maneuver:
    """With what it teaches: to aircraft in calm air."""
    calm = [
        flown.regressor_values(at.aircraft, at.trim.density, path, draw) for draw in range(CALM)
    ]
    each = tuple(information.told(at.model, item, STEP, at.heard, AROUND) for item in calm)
    reach = {
        name: _mean([information.reach(fit, at.model.controls, item) for item in calm])
        for name, fit in at.model.fits.items()
    }
    taught = Added(np.mean([one.information for one in each], axis=0), each[0].samples)
    excursion = Excursion(envelope.ranges(path), 0, LANES, None)
    return Maneuver(
        *(recipe, share, at.trim.airspeed, at.height, path, excursion, reach, each, taught)
    )


def _mean(each: Sequence[Reach]) -> Reach:
    return Reach(
        np.mean([one.mean for one in each], axis=0), float(np.mean([one.spread for one in each]))
    )


def _air(
    aircraft: Aircraft,
    trim: Trim,
    gust: float,
    generator: np.random.Generator,
    *,
    samples: int = LEAD + round(LONGEST / STEP) + 1,
) -> Float[np.ndarray, "draw sample six"]:
    return gusts.draw(
        LANES,
        samples,
        horizontal=gust,
        airspeed=trim.airspeed,
        height=-float(trim.state.position[2]),
        span=aircraft.geometry.wing_span,
        step=STEP,
        generator=generator,
    )
