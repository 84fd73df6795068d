"""The last steps of a search: parameters and intensities together, with all that a filter changes.

`settling` brings a flight near by turns that take seconds each: parameters by an equation that
holds the gains, intensities with the parameters held. Steps that hold neither go the rest of the
way, to where the sums of `likelihood.scores` and the priors balance.

Intensities, the lag of the moments and how late the airspeed is are asked by the slope of the
likelihood. Held gains tell that lag from the surfaces' delay by next to nothing, and with it the
roll derivatives, and an airspeed that lags hardly from one that is late; the likelihood knows how
gusts and noise come through as well. All other parameters are asked by sensitivities at held gains:
those hang less on the gusts' spectrum being right, for deviations a tenth to a quarter wider than
the bound.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.estimate import likelihood, quasi_newton, settling
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.likelihood import Curvature
from gcs_sysid.estimate.settling import Beliefs, Settled, overdispersion
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Means, Noise
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.reconstruct import causal
from gcs_sysid.reconstruct.causal import Path
from gcs_sysid.reconstruct.linear_filter import Filtered

STEPS = 8
"""With one set of instruments."""
NEAR = 0.25
"""A step that moves every parameter of the mean by less than so many deviations ends the search.
Intensities of what is hardly there go on: less of nothing is still nothing."""
RENEWED = 100.0
"""Where steps promised more than this together, the instruments are made anew [nat]."""
SLOW = 10.0
"""And where steps did not end that gained more than this together."""
SETS = 6
"""Times that instruments are made, at most."""
WITHIN = 1.0
"""A search that stops with a derivative still to move by less than so many of its deviations has
told it, to a deviation that is as much wider."""
ASTRAY = 10.0
"""A search that is still to move a derivative by so many deviations is not near its end."""
KEPT_PROMISE = 0.1
"""Where steps that were still astray gained less than this share of what they promised, others will
not do better: on two of twenty flights they went on for six sets, five of them for nothing."""
BY_LIKELIHOOD = ("moment_lag", "airspeed_lag", "airspeed_delay")
"""Errors of the sensors that are asked by the slope of the likelihood."""
ONLY_TOGETHER = ("airspeed_lag", "airspeed_delay")
"""Errors of which the sum is told, and each hardly: while they change places nothing else moves,
and a search may end."""
SLACK = 0.5
"""A step may lose so much [nat]: instruments are those of a point nearby."""
DAMPED = ((0.0, 0.0), (0.0, 0.1), (0.0, 1.0), (0.0, 10.0), (1.0, 10.0), (10.0, 10.0))
"""Shares of the information's diagonal that are added, one pair after the other, until a step
gains: of the parameters of the mean, and of the intensities. These first: where their likelihood is
no parabola (of two that do the same, one fades) the mean goes to where its scores balance beside
intensities that stay."""
NOTHING = 1.0
"""Where the mean stays (`NEAR`) by a step with only the intensities damped, and the step gains less
than this, the search ends: what steps promise of the intensities is not there [nat]."""
LONGEST = 0.7
"""A logarithm of an intensity changes by no more in a step."""
TIMING = 1e-3
"""How well the lag of the moments can be known [s]. It is told by how disturbances come through,
not by the answer to the controls, and there whatever is late by a few milliseconds looks like it: a
gyro's own filter, the steps of a simulation. On a flight whose simulator seems to step by 10 ms it
comes out at 3.5 ms where 5 ms make all roll derivatives right, and they are 3 % too large."""
WIDER = 1e3
"""A belief so many times as wide is none."""
PASSES = 4
"""Of the filter at most, after which its path has followed the parameters."""
STILL = 5e-3
"""A path that moves by less in a pass has followed them: attitude, velocity, rates and what a tube
shows by their rms [rad, m/s, rad/s]. The log-likelihood of such a pass is within 0.3 nat of what it
is in the end. Where a step moves the path by tenths it is off by hundreds after two passes."""
Unknown = Float[np.ndarray, " unknown"]


@dataclass(frozen=True)
class Scored:
    """Where the steps ended.

    Attributes:
        unknowns: parameters of the mean and intensities.
        free: parameters and intensities that were sought.
        curvature: of the scores.
        blocks: scores of every so many rows.
        precision: of the beliefs about what was sought.
        whitened: innovations there.
        log_likelihood: of the rows that count, where the steps began and after each.
        ended: whether nothing more was to be gained.
        moving: how far the last step wanted to move the derivative that it moved most, in its
            deviations.
        moved: how the last state moves with all parameters, where the steps began.
    """

    unknowns: Unknowns
    free: tuple[Bool[np.ndarray, " parameter"], Bool[np.ndarray, " intensity"]]
    curvature: Curvature
    blocks: Float[np.ndarray, "block unknown"]
    precision: Float[np.ndarray, "unknown unknown"]
    whitened: Float[np.ndarray, "sample row"]
    log_likelihood: tuple[float, ...]
    ended: bool
    moving: float
    moved: Float[np.ndarray, "state parameter"]

    @property
    def settled(self) -> bool:
        """Whether the derivatives are told, to the deviations that are stated (`covariance`)."""
        return self.ended or self.moving < WITHIN

    @property
    def near(self) -> bool:
        """Whether the search ended, or is at least not astray."""
        return self.ended or self.moving < ASTRAY

    def doubting(self, doubted: Bool[np.ndarray, " unknown"]) -> Scored:
        """The same with beliefs about these that are `WIDER` as wide."""
        wide = np.where(doubted, 1.0 / WIDER, 1.0)
        return replace(self, precision=self.precision * np.outer(wide, wide))

    def balanced(self, pull: Unknown) -> Unknown:
        """How far unknowns go until the scores have changed by as much as is pulled."""
        size = np.sqrt(np.diagonal(self.curvature.scatter + self.precision))
        matrix = (self.curvature.slope + self.precision) / np.outer(size, size)
        return np.linalg.solve(matrix, pull / size) / size

    def scatter(self) -> float:
        """Overdispersion of the parameters' scores."""
        count = int(self.free[0].sum())
        return overdispersion(self.blocks[:, :count], np.diagonal(self.curvature.scatter)[:count])

    def equations(self) -> Float[np.ndarray, "unknown unknown"]:
        """Covariance of where scores and beliefs balance (Godambe, Biometrika 72, 1985).

        A⁻¹ M A⁻ᵀ with the prior in both, as if the lag of the moments meant what it seems to.
        """
        factor = self.scatter()
        scatter = self.curvature.scatter / factor + self.precision
        size = np.sqrt(np.diagonal(scatter))
        unit = np.outer(size, size)
        inner = np.linalg.inv((self.curvature.slope / factor + self.precision) / unit)
        return inner @ (scatter / unit) @ inner.T / unit

    def as_ended(
        self, covariance: Float[np.ndarray, "unknown unknown"]
    ) -> Float[np.ndarray, "unknown unknown"]:
        """What the flight tells counts for less where the search had not ended.

        By as much as a derivative was still to move; what was believed before stays.
        """
        if self.ended:
            return covariance
        return _doubted(covariance, self.precision, 1.0 + self.moving**2)

    def timing(self, covariance: Float[np.ndarray, "unknown unknown"]) -> Unknown:
        """What each of all that was sought goes by with `TIMING` more lag of the moments."""
        for lag in np.flatnonzero(marked(self.unknowns.means, ("moment_lag",))[self.free[0]]):
            return by_timing(covariance, int(lag))
        return np.zeros(len(covariance))

    def covariance(self) -> Float[np.ndarray, "unknown unknown"]:
        """Of all that was sought.

        The lag of the moments is believed to `TIMING` at best, and what goes with it accordingly.
        """
        found = self.equations()
        late = self.timing(found)
        return self.as_ended(found + np.outer(late, late))


class LostError(Exception):
    """The filter lost the aircraft: nothing that it says of the flight is a number."""


class Point(NamedTuple):
    """Where a search stands.

    Attributes:
        values: parameters of the mean, flat.
        log_noise: intensities.
        path: that the filter predicts with them.
        log_likelihood: of the rows that count.
        whitened: innovations over the root of their covariance.
    """

    values: Float[np.ndarray, " parameter"]
    log_noise: Noise
    path: Path
    log_likelihood: float
    whitened: Float[np.ndarray, "sample row"]


def passed(
    model: FlightModel,
    unknowns: Unknowns,
    path: Path,
    counts: Bool[np.ndarray, " sample"],
) -> Point:
    """The filter over a flight, about the path that it predicts itself.

    Args:
        model: the aircraft.
        unknowns: parameters of the mean and intensities.
        path: one nearby.
        counts: rows whose likelihood is told.
    """
    for _ in range(PASSES):
        path, _, steps = causal.filtered(path, causal.joined(model, *unknowns, path))
        if not _moved(steps) >= STILL:
            break
    each = np.concatenate([step.log_likelihood for step in steps])[: counts.size]
    white = np.concatenate([step.whitened for step in steps])
    values = np.asarray(ravel_pytree(unknowns.means)[0])
    return Point(values, unknowns.log_noise, path, float(each[counts].sum()), white)


def _moved(steps: Sequence[Filtered]) -> float:
    """Rms of what of the motion a pass has moved most; nan where it lost the aircraft."""
    motion = [np.asarray(step.predicted.mean)[:, : aided.MOVING] for step in steps]
    return float(np.sqrt(np.mean(np.square(np.concatenate(motion)), axis=0).max()))


def climbed(
    model: FlightModel,
    like: Means,
    settled: Settled,
    beliefs: Beliefs,
    progress: Callable[[str], None],
    stretch: Curvature | None = None,
) -> Scored:
    """Steps from where a flight settled.

    Args:
        model: the aircraft.
        like: parameters of the mean, of which the form is taken.
        settled: where to begin.
        beliefs: about everything.
        progress: told about every step.
        stretch: curvature of a stretch of the flight, where it is known.

    Raises:
        LostError: the filter lost the aircraft.
    """
    sigma = np.asarray(ravel_pytree(beliefs.noise.sigma)[0])
    centre = np.asarray(ravel_pytree(beliefs.noise.mean)[0])
    free = (np.diagonal(beliefs.covariance) > 0.0, sigma > 0.0)
    found, noises = np.flatnonzero(free[0]), np.flatnonzero(free[1])
    precision = np.diag(np.concatenate([np.zeros(found.size), 1.0 / sigma[noises] ** 2]))
    precision[: found.size, : found.size] = inverse(beliefs.covariance[np.ix_(found, found)])

    def off(point: Point) -> Unknown:
        logs = np.asarray(ravel_pytree(point.log_noise)[0])
        return np.concatenate([(point.values - beliefs.mean)[found], (logs - centre)[noises]])

    def density(point: Point) -> float:
        return point.log_likelihood - 0.5 * float(off(point) @ precision @ off(point))

    def moved(point: Point, move: Unknown) -> Point:
        values, logs = point.values.copy(), np.array(ravel_pytree(point.log_noise)[0])
        values[found] += move[: found.size]
        logs[noises] += move[found.size :]
        log_noise = ravel_pytree(point.log_noise)[1](jnp.asarray(logs))
        unknowns = Unknowns(ravel_pytree(like)[1](jnp.asarray(values)), log_noise)
        return passed(model, unknowns, point.path, settled.fitted)

    longest = np.concatenate([np.full(found.size, np.inf), np.full(noises.size, LONGEST)])
    sizes = np.zeros(free[0].size)
    held = settled.last.told.matrix[np.ix_(found, found)] + precision[: found.size, : found.size]
    sizes[found] = np.sqrt(np.diagonal(inverse(held)))
    here = passed(model, settling.at(settled, like), settled.last.path, settled.fitted)
    history, ended, moving = [here.log_likelihood], False, np.inf
    derivatives = found < ravel_pytree(like.aerodynamics)[0].size
    told = ~marked(like, ONLY_TOGETHER)[found]
    for number in range(SETS):
        progress(f"instruments {number + 1}: log-likelihood {here.log_likelihood:.0f}")
        means = ravel_pytree(like)[1](jnp.asarray(here.values))
        of = likelihood.Asking(
            *(model, means, here.log_noise, here.path, settled.fitted, free, sizes),
            marked(like, BY_LIKELIHOOD),
        )
        if stretch is None:
            asked, curvature = likelihood.curved(of)
        else:
            asked = likelihood.instruments(of)
            curvature = stretch.on(likelihood.scatter(asked, settled.fitted), precision)
        if not np.isfinite(curvature.information).all() or not np.isfinite(here.log_likelihood):
            raise LostError
        matrix, hoped, ended, begun = curvature.slope + precision, 0.0, False, here
        metric = curvature.information + precision
        deviation = np.sqrt(np.diagonal(inverse(metric)))
        taken, foretold = np.zeros((2, found.size + noises.size))
        for _ in range(STEPS):
            slope = likelihood.scores(asked, here.whitened).sum(axis=0) - precision @ off(here)
            if taken.any():
                # A stretch's curvature is not the whole flight's: along what one stretch hardly
                # tells (roll derivatives of a flying wing) steps went from side to side, 7, 6, 4
                # and 3 deviations, until none gained.
                matrix = quasi_newton.corrected(matrix, taken, slope - foretold, metric)
            move = quasi_newton.bounded(matrix, slope, longest)
            promised = 0.5 * float(slope @ move)
            shares = np.abs(move / deviation)[: found.size]
            farthest = float(np.max(shares[told]))
            moving = float(np.max(shares[derivatives], initial=0.0))
            ended = farthest < NEAR
            if ended:
                break
            for damping in DAMPED:
                damped = _damped(matrix, np.repeat(damping, (found.size, noises.size)))
                taken = quasi_newton.bounded(damped, slope, longest)
                there = moved(here, taken)
                gained = density(there) - density(here)
                if gained > -SLACK:
                    break
            else:
                break
            hoped, here, foretold = hoped + promised, there, slope - matrix @ taken
            progress(f"log-likelihood {here.log_likelihood:.0f}, moved {farthest:.1f} deviations")
            history.append(here.log_likelihood)
            ended = _last(damping, gained, np.abs(taken / deviation)[: found.size][told])
            if ended:
                break
        if not _promising(hoped, density(here) - density(begun), moving, ended=ended):
            break
    return Scored(
        unknowns=Unknowns(ravel_pytree(like)[1](jnp.asarray(here.values)), here.log_noise),
        free=free,
        curvature=curvature,
        blocks=likelihood.scores(asked, here.whitened),
        precision=precision,
        whitened=here.whitened,
        log_likelihood=tuple(history),
        ended=ended,
        moving=moving,
        moved=settled.last.moved,
    )


def _last(damping: tuple[float, float], gained: float, moved: Float[np.ndarray, " mean"]) -> bool:
    """Whether a step that was taken ends the search; see `NOTHING`.

    Args:
        damping: of the mean and of the intensities.
        gained: by the step [nat].
        moved: parameters of the mean, in their deviations.
    """
    mean, intensities = damping
    return mean == 0.0 < intensities and gained < NOTHING and bool(np.max(moved) < NEAR)


def _promising(hoped: float, gained: float, moving: float, *, ended: bool) -> bool:
    """Whether steps with instruments made anew would lead on.

    Args:
        hoped: what those with the last ones promised [nat].
        gained: what they gained.
        moving: as `Scored.moving`.
        ended: whether they came to an end.
    """
    lost = moving >= ASTRAY and gained < KEPT_PROMISE * hoped
    slow = not ended and gained >= SLOW
    return (hoped >= RENEWED or slow) and not lost


def timed(covariance: Float[np.ndarray, "row row"], lag: int) -> Float[np.ndarray, "row row"]:
    """A covariance with the lag of the moments in row `lag` known to `TIMING` at best.

    And all that goes with it accordingly.
    """
    late = by_timing(covariance, lag)
    return covariance + np.outer(late, late)


def by_timing(covariance: Float[np.ndarray, "row row"], lag: int) -> Float[np.ndarray, " row"]:
    """What each goes by with `TIMING` more of the lag in row `lag`, timed or not."""
    return TIMING * covariance[:, lag] / covariance[lag, lag]


def _doubted(
    covariance: Float[np.ndarray, "unknown unknown"],
    precision: Float[np.ndarray, "unknown unknown"],
    times: float,
) -> Float[np.ndarray, "unknown unknown"]:
    """A covariance with that of what was measured so many times as large, and the beliefs' kept."""
    size = np.sqrt(np.diagonal(covariance))
    believed = precision * np.outer(size, size)
    told = np.linalg.inv(covariance / np.outer(size, size)) - believed
    values, vectors = np.linalg.eigh(0.5 * (told + told.T))
    told = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return np.linalg.inv(told / times + believed) * np.outer(size, size)


def inverse(matrix: Float[np.ndarray, "row row"]) -> Float[np.ndarray, "row row"]:
    """Of a positive definite matrix whose rows may have any units."""
    size = np.sqrt(np.diagonal(matrix))
    return np.linalg.inv(matrix / np.outer(size, size)) / np.outer(size, size)


def _damped(
    matrix: Float[np.ndarray, "unknown unknown"], share: Float[np.ndarray, " unknown"]
) -> Float[np.ndarray, "unknown unknown"]:
    return matrix + np.diag(share * np.abs(np.diagonal(matrix)))


def marked(like: Means, sensors: Sequence[str]) -> Bool[np.ndarray, " parameter"]:
    """Which of all parameters these of the sensors are."""
    none = jax.tree.map(jnp.zeros_like, like)
    ones = {name: jnp.ones_like(getattr(none.sensors, name)) for name in sensors}
    chosen = none._replace(sensors=none.sensors._replace(**ones))
    return np.asarray(ravel_pytree(chosen)[0]) > 0.0
