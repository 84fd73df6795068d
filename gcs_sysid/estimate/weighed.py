"""A flight searched and weighed under beliefs, by scores and all that is known of them.

Turns (`settling`) take the scatter JᵀJ of scores at held gains for their information. Along much
that makes a response quicker or weaker, gains and the predicted path take most of it away. Beside
beliefs such scores then count for far too much: searches end where the flight is less likely than
where they began, and of two causes the one is preferred whose small errors lie well.

Here both search and weights go by Godambe's information (`godambe`), of parameters and intensities
together. By how much an error moves scores takes seconds for each unknown, and hangs on the
aircraft and its gusts: it is worked out once, on a busy stretch of the flight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.estimate import godambe, intensities, likelihood, quasi_newton, scoring, settling
from gcs_sysid.estimate.flight_rows import Flight, Unknowns
from gcs_sysid.estimate.likelihood import Curvature, Instruments
from gcs_sysid.estimate.scoring import Point
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Means
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import causal
from gcs_sysid.reconstruct.causal import Path, Told

SETS, STEPS = 6, 8
"""Times that instruments are made at most, and steps with each."""
ENOUGH = 4.0
"""A step that promises less, or gains less than half of it, is the last with these instruments
[nat]."""
FAR = 200.0
"""Where steps gained more together, the instruments are made anew [nat]: they serve all around, and
are half a minute's work."""
NEAR = 30.0
"""Where a step promises less, the search has ended, and no instruments are made anew [nat]."""
MOST_DOUBT = 4.0
"""Where scores and likelihood disagree by more than two deviations of each unknown, on average, the
flight is no flight of this model, and says nothing of it (see `Weighed.doubt`). By chance alone the
scores at the truth promise half a nat an unknown."""
ANOTHER_TUBE = 0.1
"""Share by which the lag of a pitot tube changes at most for the same instruments: made where there
was none they say of a lag of 0.1 s half of what it tells, and of its delay a thirtieth."""
SLACK = 0.5
"""A step may lose so much [nat]: scores are not the likelihood's slope."""
DOUBLED = 7
"""Times that a step along a lag alone is doubled at most, as long as it gains."""
STIFFER = 1.0
"""Share of what was expected that the change of a slope over a step counts as at least. Believed
where it changed by less as well, what had promised too much went on to promise ever more."""
SHARES = (1.0, 0.3, 0.1)
"""Of a step, one after the other, until one gains. What bends is not how well each unknown is known
but the way: where the centre of gravity moves, the moment's slope has to go along."""


class Relation(NamedTuple):
    """How errors of all unknowns move the scores of a flight.

    Attributes:
        curvature: of a stretch of it.
        precision: of what was believed of the unknowns, for what the stretch hides.
        free: parameters of which the flight tells anything, and intensities that are not held.
        sizes: one deviation of each parameter, over which matrices are taken as linear.
        about: unknowns with which it was worked out.
    """

    curvature: Curvature
    precision: Float[np.ndarray, "unknown unknown"]
    free: tuple[Bool[np.ndarray, " parameter"], Bool[np.ndarray, " intensity"]]
    sizes: Float[np.ndarray, " parameter"]
    about: Unknowns


class Weighed(NamedTuple):
    """A flight where its search ended, and what it says there.

    Attributes:
        settled: where.
        told: what the rows that were fitted say of all parameters, intensities integrated out.
        apart: what the others say, with intensities as they were found.
        asked: instruments by which they say it.
        by: how errors were taken to move scores.
        doubt: square of the deviations that the unknowns are from where all scores vanish, on
            average: where the flight is most probable elsewhere, it knows by so much less than
            either says (Birge, Physical Review 40, 1932). Not below 1.
    """

    settled: Settled
    told: Told
    apart: Told
    asked: Instruments
    by: Relation
    doubt: float = 1.0

    @property
    def moved(self) -> bool:
        """Whether the search ended elsewhere than where `by` was worked out."""
        return not self.by.about.same(settling.at(self.settled, self.by.about.means))

    def asked_again(self, by: Relation) -> Instruments | None:
        """Instruments for a search nearby by another relation; None where it asks of others.

        Of a wind's growth with height a flight tells nothing where it finds no wind.
        """
        same = all(map(np.array_equal, by.free, self.by.free))
        return self.asked if same else None


def relation(model: FlightModel, stretch: Flight, unknowns: Unknowns, beliefs: Beliefs) -> Relation:
    """How errors move scores, as a stretch of a flight has it.

    Args:
        model: the aircraft.
        stretch: of the flight, one with much control.
        unknowns: near what is sought.
        beliefs: about everything.
    """
    path = settling.along(model, stretch, unknowns)
    every = stretch.found
    held = np.diagonal(causal.passed(model, *unknowns, path, every).told.matrix)
    noise = np.asarray(ravel_pytree(beliefs.noise.sigma)[0])
    free = held > 0.0, noise > 0.0
    believed = np.sqrt(np.diagonal(beliefs.covariance))
    sizes = np.divide(1.0, np.sqrt(held), out=np.zeros_like(held), where=free[0])
    sizes = np.where(believed > 0.0, np.minimum(sizes, believed), sizes)
    known = np.divide(1.0, believed**2, out=np.zeros_like(held), where=believed > 0.0)
    precision = np.diag(np.concatenate([known[free[0]], noise[free[1]] ** -2.0]))
    of = likelihood.Asking(
        *(model, *unknowns, path, every, free, sizes),
        scoring.marked(unknowns.means, scoring.BY_LIKELIHOOD),
    )
    return Relation(likelihood.curved(of)[1], precision, free, sizes, unknowns)


def climbed(
    model: FlightModel,
    flight: Flight,
    first: Sequence[Unknowns],
    beliefs: Beliefs,
    counts: Bool[np.ndarray, " sample"],
    by: Relation,
    progress: Callable[[str], None],
    asked: Instruments | None = None,
    *,
    sets: int = SETS,
    near: Path | None = None,
) -> Weighed:
    """Steps to where scores and beliefs balance, none of which makes the flight less probable.

    Args:
        model: the aircraft.
        flight: measurements and first states.
        first: where to begin, near what is sought; the most probable is taken.
        beliefs: about everything.
        counts: rows from which everything is learned, but for those in which the filter is still
            finding its states; where there are none, no step is taken.
        by: relation of the same flight at another point nearby.
        progress: told about every step.
        asked: instruments of the same flight at another point nearby, where they are known.
        sets: times that instruments are used at most, those given among them.
        near: a path of this flight that was found before; of another one it is not used.
    """
    counts, apart = counts & flight.found, ~counts & flight.found
    search = _Search(model, first[0], beliefs, counts, by)
    if near is not None:
        near = causal.taken_up(near, flight.rows, flight.nominal)
    here = max((search.begun(flight, one, near) for one in first), key=search.density)
    serving = asked is not None and search.serves(asked, here)
    used = search.using(asked if serving else search.instruments(here))
    history, left = [here.log_likelihood], 0.0
    for number in range(sets):
        if number:
            used = search.using(search.instruments(here))
        before, shorter, looked = search.density(here), 0, list[_Looked]()
        made_here = used.asked.about.same(search.unknowns(here))
        if counts.any():
            here = search.farther(used, here)
            history.append(here.log_likelihood)
        for step in range(STEPS if counts.any() else 0):
            inner, slope = search.quadratic(used, here)
            for one in looked:
                inner = quasi_newton.updated(inner, *one, least=STIFFER)
            left = search.promised(inner, slope)
            progress(
                f"step {number + 1}.{step + 1}: log-likelihood {here.log_likelihood:.0f}, "
                f"{left:.1f} to gain"
            )
            if left < ENOUGH:
                break
            there, shorter = search.stepped(used, here, inner, slope, max(shorter - 1, 0), looked)
            if there is None:
                break
            grown = search.density(there) - search.density(here)
            here = there
            history.append(here.log_likelihood)
            if grown < 0.5 * ENOUGH:
                break
        gained = search.density(here) - before
        if not search.serves(used.asked, here):
            continue
        if (left < NEAR and gained < FAR) or (made_here and gained < ENOUGH):
            break
    done = causal.passed(model, *search.unknowns(here), here.path, counts, apart=apart)
    settled = Settled(
        *(here.values, here.log_noise, done, counts, apart, tuple(history), left < NEAR, left),
        tolerated=0.5 * MOST_DOUBT * search.count,
    )
    doubt = max(2.0 * left / search.count, 1.0)
    return Weighed(settled, *search.told(used, here, settled), used.asked, by, doubt)


class _Using(NamedTuple):
    """Instruments, and what of them is the same from wherever the flight is asked.

    Attributes:
        asked: the instruments.
        scatter: of the sums made with them, of the rows from which everything is learned.
        slope: by how much errors of all unknowns move these sums.
        shares: `likelihood.shares` of the intensities by which the sought ones go.
    """

    asked: Instruments
    scatter: Float[np.ndarray, "unknown unknown"]
    slope: Float[np.ndarray, "unknown unknown"]
    shares: Float[np.ndarray, " intensity"]


class _Looked(NamedTuple):
    """A step that was looked at, taken or not.

    Attributes:
        step: in units of the beliefs' root.
        change: by how much the slope has fallen over it.
    """

    step: Float[np.ndarray, " unit"]
    change: Float[np.ndarray, " unit"]


class _Search:
    """What does not change from step to step.

    Args:
        model: the aircraft.
        first: unknowns, of which the form is taken.
        beliefs: about everything.
        counts: rows from which everything is learned.
        by: how errors move scores.
    """

    def __init__(
        self,
        model: FlightModel,
        first: Unknowns,
        beliefs: Beliefs,
        counts: Bool[np.ndarray, " sample"],
        by: Relation,
    ) -> None:
        self._model, self._like, self._counts, self._by = model, first.means, counts, by
        self._unravel = ravel_pytree(first.means)[1]
        self._logs = ravel_pytree(first.log_noise)[1]
        self._mean = beliefs.mean
        self._root = settling.root(beliefs.covariance)
        self._centre = np.asarray(ravel_pytree(beliefs.noise.mean)[0])
        self._noises = np.flatnonzero(by.free[1])
        self._deviations = intensities.deviations(first.log_noise)[self._noises]
        self._spread = np.asarray(ravel_pytree(beliefs.noise.sigma)[0])[self._noises]
        # Steps are in units of the beliefs' root, so that what is held stays.
        size, count = self._root.shape[1], int(by.free[0].sum())
        self._both = np.zeros((count + self._noises.size, size + self._noises.size))
        self._both[:count, :size] = self._root[by.free[0]]
        self._both[count:, size:] = np.diag(self._spread)
        # A logarithm that runs to nothing promises more the farther it may go, and gains nothing.
        self._longest = np.full(size + self._noises.size, np.inf)
        self._longest[size:] = scoring.LONGEST / self._spread

    @property
    def count(self) -> int:
        """Number of unknowns that beliefs do not hold."""
        return self._both.shape[1]

    def unknowns(self, point: Point) -> Unknowns:
        """Of a point."""
        return Unknowns(self._means(point.values), point.log_noise)

    def believed(self, one: Unknowns) -> Unknowns:
        """The unknowns with what beliefs hold where they hold it.

        They may come from a search with another cause set free, whose size is not to stay.
        """
        off = np.asarray(ravel_pytree(one.means)[0]) - self._mean
        at = np.linalg.lstsq(self._root, off, rcond=None)[0]
        return one._replace(means=self._means(self._mean + self._root @ at))

    def begun(self, flight: Flight, one: Unknowns, near: Path | None) -> Point:
        """Where to begin: about a path that is known already, or one along the nominal flight."""
        believed = self.believed(one)
        if near is not None:
            point = self.passed(believed, near)
            if np.isfinite(point.whitened).all():
                return point
        return self.passed(believed, settling.along(self._model, flight, one))

    def passed(self, unknowns: Unknowns, path: Path) -> Point:
        """`scoring.passed` over this flight."""
        return scoring.passed(self._model, unknowns, path, self._counts)

    def off(self, point: Point) -> Float[np.ndarray, " unit"]:
        """Where a point lies, in units of the beliefs' root."""
        logs = np.asarray(ravel_pytree(point.log_noise)[0])
        mean = np.linalg.lstsq(self._root, point.values - self._mean, rcond=None)[0]
        return np.concatenate([mean, (logs - self._centre)[self._noises] / self._spread])

    def density(self, point: Point) -> float:
        """Of flight and beliefs [nat]; −∞ where the filter lost the aircraft."""
        density = point.log_likelihood - 0.5 * float(np.sum(self.off(point) ** 2))
        return density if np.isfinite(density) else -np.inf

    def instruments(self, point: Point) -> Instruments:
        """Of all rows about a point."""
        of = likelihood.Asking(
            *(self._model, *self.unknowns(point), point.path, np.ones_like(self._counts)),
            *(self._by.free, self._by.sizes, scoring.marked(self._like, scoring.BY_LIKELIHOOD)),
        )
        return likelihood.instruments(of)

    def using(self, asked: Instruments) -> _Using:
        """Instruments, ready to be used at every step nearby."""
        return _Using(asked, *self._moved(asked, self._counts), self._shares(asked))

    def serves(self, asked: Instruments, point: Point) -> bool:
        """Whether instruments tell of a point, and not of a tube that lags otherwise."""
        made, here = (
            float(aided.tube_lag(self._model.aircraft, each.means.sensors))
            for each in (asked.about, self.unknowns(point))
        )
        return abs(here - made) < ANOTHER_TUBE * made

    def quadratic(
        self, used: _Using, point: Point
    ) -> tuple[Float[np.ndarray, "unit unit"], Float[np.ndarray, " unit"]]:
        """Information, beliefs included, and slope of the density, in units of the beliefs."""
        matrix, score = self._scored(used, point, self._counts)
        inner = np.eye(self._both.shape[1]) + self._both.T @ matrix @ self._both
        return inner, self._both.T @ score - self.off(point)

    def promised(
        self, inner: Float[np.ndarray, "unit unit"], slope: Float[np.ndarray, " unit"]
    ) -> float:
        """What a step would gain by the quadratic form [nat]."""
        move = quasi_newton.bounded(inner, slope, self._longest)
        return float(move @ slope - 0.5 * move @ inner @ move)

    def stepped(
        self,
        used: _Using,
        here: Point,
        inner: Float[np.ndarray, "unit unit"],
        slope: Float[np.ndarray, " unit"],
        shorter: int,
        looked: list[_Looked],
    ) -> tuple[Point | None, int]:
        """A step that makes flight and beliefs more probable; None if there is none.

        Of all unknowns, or else of the intensities alone: these are asked by the likelihood's own
        slope, and gain where the parameters, which are not, stand in the way. How errors move
        scores is carried from a stretch, and off by a part; what a step changes, one that is not
        taken as well, is known of the next.

        Args:
            used: instruments.
            here: where the search is.
            inner: information.
            slope: of the density.
            shorter: first of `SHARES` that is tried.
            looked: takes every step that is looked at.

        Returns:
            Where it leads, and which of `SHARES` it was.
        """
        size = self._root.shape[1]
        tried = [(number, SHARES[number], False) for number in range(shorter, len(SHARES))]
        tried += [(len(SHARES), share, True) for share in SHARES]
        for number, share, alone in tried:
            move = np.zeros_like(slope)
            part = slice(size, None) if alone else slice(None)
            move[part] = share * quasi_newton.bounded(
                inner[part, part], slope[part], self._longest[part]
            )
            logs = np.array(ravel_pytree(here.log_noise)[0])
            logs[self._noises] += self._spread * move[size:]
            means = self._means(here.values + self._root @ move[:size])
            there = self.passed(Unknowns(means, self._logs(jnp.asarray(logs))), here.path)
            if np.isfinite(self.density(there)):
                looked.append(_Looked(move, slope - self.quadratic(used, there)[1]))
                inner = quasi_newton.updated(inner, *looked[-1], least=STIFFER)
            if self.density(there) > self.density(here) - SLACK:
                return there, number
        return None, len(SHARES)

    def farther(self, used: _Using, here: Point) -> Point:
        """A point farther along each lag that beliefs leave free, as far as it gains.

        Lags are asked by the likelihood's own slope, and where a sensor's noise is not the model's
        this falls off more slowly than it scatters: of an autopilot's airspeed eight times more
        slowly, so that steps were an eighth of what was missing, and promised next to nothing.
        """
        sums = likelihood.sums(used.asked, here.whitened, self._counts)
        covariance = self._root @ self._root.T
        places = np.flatnonzero(self._by.free[0])
        for number in np.flatnonzero(used.asked.by_likelihood[: places.size]):
            place = places[number]
            variance = covariance[place, place]
            # Were it for the beliefs alone, that much could be gained.
            if abs(sums[number]) * np.sqrt(variance) < NEAR:
                continue
            step = (
                sums[number] / (used.scatter[number, number] * variance + 1.0) * covariance[place]
            )
            best = here
            for doubled in range(DOUBLED):
                means = self._means(here.values + 2.0**doubled * step)
                there = self.passed(Unknowns(means, here.log_noise), best.path)
                if not self.density(there) > self.density(best):
                    break
                best = there
            here = best
        return here

    def told(self, used: _Using, point: Point, done: Settled) -> tuple[Told, Told]:
        """What fitted rows say of all parameters, and what the others say."""
        count = int(self._by.free[0].sum())
        off = self.off(point)[self._root.shape[1] :]
        mine = godambe.integrated(
            *self._scored(used, point, self._counts), self._spread**-2.0, -off / self._spread
        )
        others = _Using(used.asked, *self._moved(used.asked, done.apart), used.shares)
        matrix, score = self._scored(others, point, done.apart)
        free, last = self._by.free[0], done.last
        return (
            godambe.placed(*mine, free, last.told.count),
            godambe.placed(matrix[:count, :count], score[:count], free, last.apart.count),
        )

    def _means(self, values: Float[np.ndarray, " parameter"]) -> Means:
        return self._unravel(jnp.asarray(values))

    def _moved(
        self, asked: Instruments, counts: Bool[np.ndarray, " sample"]
    ) -> tuple[Float[np.ndarray, "unknown unknown"], Float[np.ndarray, "unknown unknown"]]:
        """How the sums of the rows that count scatter, and how errors move them."""
        scatter = likelihood.scatter(asked, counts)
        if not counts.any():
            return scatter, scatter
        return scatter, self._by.curvature.on(scatter, self._by.precision).slope

    def _scored(
        self, used: _Using, point: Point, counts: Bool[np.ndarray, " sample"]
    ) -> tuple[Float[np.ndarray, "unknown unknown"], Float[np.ndarray, " unknown"]]:
        if not counts.any():
            return used.scatter, likelihood.sums(used.asked, point.whitened, counts)
        faded = self._faded(used, point)
        score = faded * likelihood.sums(used.asked, point.whitened, counts)
        moved, scatter = (part * np.outer(faded, faded) for part in (used.slope, used.scatter))
        return godambe.quadratic(moved, scatter, score, self._by.precision)

    def _shares(self, asked: Instruments) -> Float[np.ndarray, " intensity"]:
        """`likelihood.shares` of the intensities by which the sought ones go."""
        found = np.zeros(self._by.free[1].size)
        found[self._noises] = likelihood.shares(asked, self._noises.size)
        return found[self._deviations]

    def _faded(self, used: _Using, point: Point) -> Float[np.ndarray, " unknown"]:
        """What instruments that were made elsewhere have become at a point."""
        both = point.log_noise, used.asked.about.log_noise
        here, there = (np.asarray(ravel_pytree(each)[0])[self._deviations] for each in both)
        felt, before = (intensities.floors(each)[self._noises] for each in both)
        faded = likelihood.faded(here - there, used.shares) * np.exp(felt - before)
        return np.concatenate([np.ones(len(used.scatter) - faded.size), faded])
