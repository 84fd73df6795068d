"""Filter error: derivatives, sensor errors and gust intensities of greatest likelihood.

The innovations of the aided filter are independent if the model is right, so that their density is
the likelihood of everything in it (Maine & Iliff, NASA RP-1138, 1985; Jategaonkar, *Flight Vehicle
System Identification*, 2nd ed. 2015, chapter 5). Maximised by Levenberg–Marquardt steps with the
exact gradient; the curvature is the Fisher information, of means from the innovations'
sensitivities, of means and intensities together from those of their covariance,
½ tr(S⁻¹ ∂S S⁻¹ ∂S). Its inverse is the covariance that is told.

The search goes in stages, since a filter with wrong derivatives would rather believe in wrong
intensities: derivatives alone with intensities from the sensors and the turbulence model;
derivatives and intensities; everything. All but the last look at the stretch of the flight with the
most control only. The information is good for every derivative by itself, not for
the directions of `disguise`, in which large numbers cancel: there the curvature is measured, by the
slope a step away. After every step the nominal flight is smoothed anew, and the step is kept
only if the likelihood about *that* flight has grown.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Bool, Float

from gcs_sysid.estimate import disguise, quasi_newton
from gcs_sysid.frames import Array
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Linearised, Means, Noise, Row, State
from gcs_sysid.reconstruct import aided_smoother, linear_filter
from gcs_sysid.reconstruct.aided_smoother import Beginning, Chunk, FlightModel, Smoothed
from gcs_sysid.reconstruct.linear_filter import Belief

LONGEST_LOG_STEP = 0.5
"""An intensity changes by no more than this factor's logarithm in a step."""
SAMPLE_ROWS = 500
"""Rows on which the information of the innovations' covariance is worked out."""
LEAST_SHARE = 0.03
"""Least curvature along a direction, as a share of what the information says."""
PROBE = 2.0
"""How far away the slope is taken again, in deviations."""
MOST_TRIALS = 7
DIFFERENCE = 1e-3
"""Step of a parameter, in deviations or of a logarithm, for the change of a covariance."""
Change = tuple[np.ndarray, np.ndarray]
"""A step, and the change of the slope over it."""


class Stage(NamedTuple):
    """Which parameters move, on what, and for how long.

    Attributes:
        whole: whether on the whole flight; otherwise on the stretch with the most control.
        sensors: names of the sensor errors set free.
        intensities: whether the intensities are free.
        steps: at most.
        gain: least growth of the log-likelihood for which another step is worth it.
    """

    whole: bool
    sensors: tuple[str, ...]
    intensities: bool
    steps: int
    gain: float


STAGES = (
    Stage(False, ("accelerometer_bias",), False, 12, 100.0),
    Stage(
        False,
        ("accelerometer_bias", "gyro_bias", "surface_delay", "moment_lag", "attitude_delay"),
        True,
        30,
        5.0,
    ),
    Stage(False, aided.Sensors._fields, True, 10, 2.0),
    Stage(True, aided.Sensors._fields, True, 25, 1.0),
)
STRETCH = 4000
"""Rows of the stretch on which the search begins."""
RENEWED = 4
"""After so many steps the information is worked out anew; in between the slopes correct it."""


class Unknowns(NamedTuple):
    """A value, or one standard deviation, of everything that can be estimated."""

    means: Means
    log_noise: Noise


@dataclass(frozen=True)
class Flight:
    """One flight as the filter reads it.

    Attributes:
        rows: samples.
        nominal: first guess of the states, one a row.
        beginning: belief about the state before the first row.
    """

    rows: Row
    nominal: State
    beginning: Beginning


@dataclass(frozen=True)
class Fit:
    """What a maximisation found.

    Attributes:
        unknowns: values of greatest posterior density.
        deviation: one standard deviation of each.
        covariance: of the derivatives, in the order of `keys`.
        keys: coefficient and regressor of each derivative.
        bound: one standard deviation by the flight alone, were all intensities known.
        states: smoothed flight, one state a row.
        smoothed: its covariance, the innovations.
        objective: negative log posterior after each step.
        converged: whether the last stage ended because nothing more was to be gained.
    """

    unknowns: Unknowns
    deviation: Unknowns
    covariance: Float[np.ndarray, "term term"]
    keys: tuple[tuple[str, str], ...]
    bound: Float[np.ndarray, " term"]
    states: State
    smoothed: Smoothed
    objective: tuple[float, ...]
    converged: bool


class _Measured(NamedTuple):
    """Curvature that was measured along some directions.

    Attributes:
        along: the directions, in all parameters.
        curvature: of the objective along them.
    """

    along: Float[np.ndarray, "direction parameter"]
    curvature: Float[np.ndarray, "direction direction"]


class _Point(NamedTuple):
    """Parameters with the flight smoothed under them."""

    values: Float[np.ndarray, " parameter"]
    nominal: State
    chunks: list[Chunk]
    start: Belief
    objective: float


def fit(
    model: FlightModel,
    flight: Flight,
    first: Unknowns,
    prior: Unknowns,
    sigma: Unknowns,
    progress: Callable[[str], None],
    *,
    precision: Float[np.ndarray, "term term"] | None = None,
    near: bool = False,
) -> Fit:
    """Maximises the posterior density.

    Args:
        model: the aircraft; its aerodynamic terms are those of `first`.
        flight: measurements and first states.
        first: where to begin.
        prior: means of the Gaussian priors.
        sigma: their standard deviations; infinite for none, 0 to hold a parameter.
        progress: told about every step.
        precision: of the derivatives' prior where that is not diagonal, as after another flight;
            their `sigma` only says which are held.
        near: whether `first` is near what is sought, so that the last stage is enough.
    """
    problem = _Problem(model, flight, first, prior, sigma, precision)
    values = problem.flat(first)
    history: list[float] = []
    if not near:
        part = most_controlled(flight, STRETCH)
        early = problem
        if part is not flight:
            early = _Problem(model, part, first, prior, sigma, precision)
        point = early.smoothed(values, early.flight.nominal, rounds=3)
        for number, stage in enumerate(STAGES[:-1], 1):
            point, _ = _climbed(early, point, stage, history, f"stage {number}", progress)
        values = point.values
    point = problem.smoothed(values, flight.nominal, rounds=3)
    progress("whole flight: curvature where flow angles may be mistaken")
    measured = problem.measured(point)
    point, converged = _climbed(
        problem, point, STAGES[-1], history, "whole flight", progress, measured
    )
    return problem.result(point, tuple(history), converged, measured)


def _climbed(
    problem: _Problem,
    point: _Point,
    stage: Stage,
    history: list[float],
    name: str,
    progress: Callable[[str], None],
    measured: _Measured | None = None,
) -> tuple[_Point, bool]:
    """The point where a stage ends, and whether nothing more was to be gained.

    Args:
        problem: flight, model and priors.
        point: where to begin.
        stage: what may move.
        history: negative log posteriors, appended to.
        name: of the stage, for `progress`.
        progress: told about every step.
        measured: curvature that is known better than by the information.
    """
    free, changes, before, damping = problem.free(stage), [], None, 0.1
    curvature = np.zeros((0, 0))
    history.append(point.objective)
    for index in range(stage.steps):
        progress(f"{name}, step {index + 1}: log-likelihood {-point.objective:.1f}")
        slope = problem.slope(point)
        if before is not None:
            changes.append((point.values - before[0], slope - before[1]))
        before = (point.values, slope)
        if index % RENEWED == 0:
            curvature = problem.curvature(point, intensities=stage.intensities)
            if measured is not None:
                curvature = _with_measured(curvature, measured)
        found, damping = _improved(
            problem, point, slope, _corrected(curvature, free, changes), free, damping
        )
        if found is None:
            return point, True
        gained = point.objective - found.objective
        point = found
        history.append(point.objective)
        if gained < stage.gain:
            return point, True
    return point, False


def most_controlled(flight: Flight, count: int) -> Flight:
    """The stretch of `count` rows where the controls moved most; the flight if it is no longer.

    The one with the greatest product of the controls' shares of movement, so that none is left out.
    """
    return flight if flight.rows.step.shape[0] <= count else cut(flight, busiest(flight, count))


def busiest(flight: Flight, count: int) -> slice:
    """Where the controls of a flight move most for `count` rows."""
    moved = np.diff(np.asarray(flight.rows.controls)[:, 0], axis=0, prepend=0.0) ** 2
    moved[0] = 0.0
    moved = np.where(np.asarray(flight.rows.modelled)[:, None], moved, 0.0)
    sums = np.cumsum(moved, axis=0)
    share = (sums[count:] - sums[:-count]) / np.maximum(sums[-1], 1e-12)
    start = int(np.argmax(np.sum(np.log(np.maximum(share, 1e-6)), axis=1)))
    return slice(start, start + count)


def cut(flight: Flight, rows: slice) -> Flight:
    """A stretch of a flight, before which no more is believed than before its first row."""
    taken, nominal = jax.tree.map(lambda part: part[rows], (flight.rows, flight.nominal))
    first = jax.tree.map(lambda part: part[0], nominal)
    step = np.array(taken.step)
    step[0] = 0.0
    beginning = Beginning(first, flight.beginning.covariance)
    return Flight(taken._replace(step=step), nominal, beginning)


def _corrected(
    curvature: Float[np.ndarray, "parameter parameter"],
    free: Bool[np.ndarray, " parameter"],
    changes: Sequence[Change],
) -> Float[np.ndarray, "free free"]:
    """Curvature of the free parameters, made to explain how the slope has changed so far.

    The information leaves out what squares of innovations larger than their stated size add, and
    how intensities act together with the motion; without this the search swings from side to side.
    One update for every step of the stage.
    """
    matrix = curvature[np.ix_(free, free)]
    for step, change in changes:
        matrix = quasi_newton.updated(matrix, step[free], change[free])
    return matrix


def _with_measured(
    curvature: Float[np.ndarray, "parameter parameter"], measured: _Measured
) -> Float[np.ndarray, "parameter parameter"]:
    """The curvature, along some directions as it was measured; positive in any case."""
    images = measured.along @ curvature
    stated = images @ measured.along.T
    roots, vectors = np.linalg.eigh(0.5 * (stated + stated.T))
    kept = roots > 1e-6 * roots[-1]
    # Directions of unit curvature by the information.
    unit = vectors[:, kept] / np.sqrt(roots[kept])
    shares, turned = np.linalg.eigh(unit.T @ measured.curvature @ unit)
    change = np.clip(shares, LEAST_SHARE, 1.0 / LEAST_SHARE) - 1.0
    rows = (unit @ turned).T @ images
    return curvature + (rows.T * change) @ rows


def _improved(
    problem: _Problem,
    point: _Point,
    slope: Float[np.ndarray, " parameter"],
    curvature: Float[np.ndarray, "free free"],
    free: Bool[np.ndarray, " parameter"],
    damping: float,
) -> tuple[_Point | None, float]:
    """A better point and the damping that led to it; None when none was found."""
    logs = np.arange(slope.size) >= problem.mean_count
    # Where the information is far too small, a diagonal that keeps the step inside its limit.
    least = np.where(logs, np.abs(slope) / LONGEST_LOG_STEP, 0.0)[free]
    diagonal = np.diagonal(curvature)
    curvature = curvature + np.diag(np.maximum(least - diagonal, 0.0))
    for _ in range(MOST_TRIALS):
        damped = curvature + damping * np.diag(np.diagonal(curvature))
        step = np.zeros(slope.size)
        step[free] = -np.linalg.solve(damped, slope[free])
        step = np.where(logs, np.clip(step, -LONGEST_LOG_STEP, LONGEST_LOG_STEP), step)
        found = problem.smoothed(point.values + step, point.nominal, rounds=2)
        if np.isfinite(found.objective) and found.objective < point.objective:
            return found, max(damping / 5.0, 1e-6)
        damping = max(8.0 * damping, 1e-3)
    return None, damping


class _Problem:
    """A flight, its model and its priors as functions of one flat vector."""

    def __init__(
        self,
        model: FlightModel,
        flight: Flight,
        first: Unknowns,
        prior: Unknowns,
        sigma: Unknowns,
        precision: Float[np.ndarray, "term term"] | None = None,
    ) -> None:
        self.model, self.flight = model, flight
        self._unravel = ravel_pytree(first)[1]
        self.mean_count = ravel_pytree(first.means)[0].size
        self._prior, self._sigma = self.flat(prior), self.flat(sigma)
        held = self._sigma == 0.0
        self._held = held
        self._weight = np.diag(np.where(held, 0.0, 1.0 / np.where(held, 1.0, self._sigma) ** 2))
        if precision is not None:
            count = len(precision)
            self._weight[:count, :count] = precision

    def flat(self, unknowns: Unknowns) -> Float[np.ndarray, " parameter"]:
        return np.asarray(ravel_pytree(unknowns)[0])

    def unknowns(self, values: Float[np.ndarray, " parameter"]) -> Unknowns:
        return self._unravel(jnp.asarray(values))

    def free(self, stage: Stage) -> Bool[np.ndarray, " parameter"]:
        """Which parameters a stage moves."""
        zeros = jax.tree.map(jnp.zeros_like, self.unknowns(self._prior))
        ones = jax.tree.map(jnp.ones_like, zeros)
        sensors = zeros.means.sensors._replace(
            **{name: getattr(ones.means.sensors, name) for name in stage.sensors}
        )
        noise = ones.log_noise if stage.intensities else zeros.log_noise
        chosen = Unknowns(Means(ones.means.aerodynamics, sensors), noise)
        return (self.flat(chosen) > 0.0) & ~self._held

    def smoothed(
        self, values: Float[np.ndarray, " parameter"], nominal: State, *, rounds: int
    ) -> _Point:
        """The point at `values`, the flight smoothed from another's."""
        means, logs = self.unknowns(values)
        nominal, _ = aided_smoother.iterated(
            self.model, means, logs, self.flight.rows, nominal, self.flight.beginning, rounds=rounds
        )
        chunks = aided_smoother.chunks(self.flight.rows, nominal)
        start = aided_smoother.belief(self.flight.beginning, chunks)
        density = aided_smoother.log_likelihood(self.model, means, logs, chunks, start)
        away = values - self._prior
        penalty = 0.5 * float(away @ self._weight @ away)
        return _Point(values, nominal, chunks, start, penalty - density)

    def slope(self, point: _Point) -> Float[np.ndarray, " parameter"]:
        """Gradient of the objective."""
        means, logs = self.unknowns(point.values)
        parts = aided_smoother.gradient(self.model, means, logs, point.chunks, point.start)
        return self._weight @ (point.values - self._prior) - self.flat(Unknowns(*parts))

    def curvature(
        self, point: _Point, *, intensities: bool
    ) -> Float[np.ndarray, "parameter parameter"]:
        """Fisher information and prior.

        Args:
            point: where.
            intensities: whether they are free. Then the information is that of the innovations'
                density, of which their covariance is a part; otherwise that of derivatives alone
                with the air of the smoothed flight.
        """
        means, logs = self.unknowns(point.values)
        total = self._weight.copy()
        count = self.mean_count
        total[:count, :count] += aided_smoother.information(
            self.model, means, logs, point.chunks, point.start, air_known=not intensities
        )
        if intensities:
            total += self._spread_information(point, np.diagonal(total)[:count])
        return total

    def _spread_information(
        self, point: _Point, alone: Float[np.ndarray, " mean"]
    ) -> Float[np.ndarray, "parameter parameter"]:
        """½ Σ tr(S⁻¹ ∂S S⁻¹ ∂S), S the innovations' covariance, from a stretch of the flight.

        Derivatives change S as well as intensities do: a gust that rolls the aircraft is known by
        Clp. What both can explain is told by the products between them.

        Args:
            point: where.
            alone: information about each mean by itself, for the size of differences.
        """
        chunk = point.chunks[len(point.chunks) // 2]

        def rows(values: Float[np.ndarray, " parameter"]) -> Linearised:
            found = aided_smoother.linearised(self.model, *self.unknowns(values), chunk)
            return jax.tree.map(lambda part: part[:SAMPLE_ROWS], found)

        here = rows(point.values)
        settled, _ = linear_filter.run(Belief(point.start.mean, point.start.covariance), here)
        begun = Belief(jnp.zeros_like(settled.mean), settled.covariance)
        sizes = np.full(point.values.size, DIFFERENCE)
        sizes[: self.mean_count] /= np.sqrt(np.maximum(alone, 1.0))
        count = here.residual.shape[0]
        changes = np.zeros((point.values.size, count * aided.ROW_COUNT**2))
        for index in np.flatnonzero(~self._held):
            moved = point.values.copy()
            moved[index] += sizes[index]
            change = linear_filter.spread_change(begun, here, rows(moved))
            changes[index] = np.ravel(change) / sizes[index]
        share = self.flight.rows.step.shape[0] / count
        return 0.5 * share * (changes @ changes.T)

    def measured(self, point: _Point) -> _Measured | None:
        """Curvature along the disguises of the flow angles; None with vanes, which see them."""
        if np.asarray(self.flight.rows.measured.valid)[:, 3].any():
            return None
        values = self.unknowns(point.values).means.aerodynamics
        keys = derivative_keys(values)
        found = disguise.directions(
            keys, point.values[: len(keys)], self.model.aircraft.control_names
        )
        along = np.zeros((len(found), point.values.size))
        along[:, : len(keys)] = np.where(self._held[: len(keys)], 0.0, found)
        along = along[np.any(along != 0.0, axis=1)]
        if not len(along):
            return None
        curvature = self.curvature(point, intensities=True)
        size = np.sqrt(np.einsum("di,ij,dj->d", along, curvature, along))
        along *= PROBE / size[:, None]
        here, rows = self.slope(point), []
        for step in along:
            there = self.smoothed(point.values + step, point.nominal, rounds=2)
            rows.append(along @ (self.slope(there) - here))
        return _Measured(along, 0.5 * (np.array(rows) + np.array(rows).T))

    def result(
        self,
        point: _Point,
        history: tuple[float, ...],
        converged: bool,
        measured: _Measured | None,
    ) -> Fit:
        """What is told.

        The covariance is that of White (Econometrica 50, 1982): the slope at the truth scatters by
        the information, and the curvature turns that into an error.
        """
        unknowns = self.unknowns(point.values)
        nominal, smoothed = aided_smoother.iterated(
            self.model,
            *unknowns,
            self.flight.rows,
            point.nominal,
            self.flight.beginning,
            rounds=1,
        )
        curvature = self.curvature(point, intensities=True)
        free = ~self._held
        covariance = np.zeros_like(curvature)
        chosen = np.ix_(free, free)
        real = curvature if measured is None else _with_measured(curvature, measured)
        inverse = np.linalg.inv(real[chosen])
        covariance[chosen] = inverse @ curvature[chosen] @ inverse
        keys = derivative_keys(unknowns.means.aerodynamics)
        first = slice(len(keys))
        count = self.mean_count
        alone = curvature[:count, :count] - self._weight[:count, :count]
        return Fit(
            unknowns=unknowns,
            deviation=self.unknowns(np.sqrt(np.maximum(np.diagonal(covariance), 0.0))),
            covariance=covariance[first, first],
            keys=keys,
            bound=_bound(alone, free[:count])[first],
            states=nominal,
            smoothed=smoothed,
            objective=history,
            converged=converged,
        )


def derivative_keys(
    aerodynamics: Mapping[str, Mapping[str, Array]],
) -> tuple[tuple[str, str], ...]:
    """Coefficient and regressor of every derivative in the order of the flat vector.

    They come first in it: `Means.aerodynamics` is the first field, and dictionaries are flattened
    in the order of their sorted keys.
    """
    return tuple((name, key) for name in sorted(aerodynamics) for key in sorted(aerodynamics[name]))


def _bound(
    information: Float[np.ndarray, "parameter parameter"], free: Bool[np.ndarray, " parameter"]
) -> Float[np.ndarray, " parameter"]:
    """Cramér–Rao: what no unbiased estimate can beat, infinite where the flight says nothing.

    Parameters that are held count as known, and have none.
    """
    values, vectors = np.linalg.eigh(information[np.ix_(free, free)])
    seen = values > 1e-12 * values[-1]
    spread = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    hidden = np.sum(vectors[:, ~seen] ** 2, axis=1) > 1e-6
    bound = np.zeros(free.size)
    bound[free] = np.where(hidden, np.inf, np.sqrt(np.diagonal(spread)))
    return bound
