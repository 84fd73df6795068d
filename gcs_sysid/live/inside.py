"""The aerodynamics inside the filter, beside the flight: states and derivatives in gusts, live.

A minute of flight is fitted in a process of its own (`inside_fit`), which tells gusts and noise,
and where derivatives and sensor errors begin; from there `AidedFilter` goes on finding them, a row
at a time. What it makes of a row rests on everything up to it and costs the same after an hour.

A filter that loses the aircraft says so, and another minute is fitted.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate import in_common, scoring
from gcs_sysid.estimate.flight_rows import Unknowns
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live import inside_fit, inside_rows
from gcs_sysid.live.commands import Commands
from gcs_sysid.live.filter import Estimate
from gcs_sysid.live.inside_fit import Found, Task
from gcs_sysid.live.inside_rows import BATCH, Batch, InsideRows
from gcs_sysid.live.regression import TermEstimate
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Means, Noise, Row, Sensors, State
from gcs_sysid.model.air import Turbulence
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.model.kinematics import BLOCKS
from gcs_sysid.model.kinematics import Noise as KinematicNoise
from gcs_sysid.offline import aided_flight
from gcs_sysid.offline.aided_flight import Kinematics
from gcs_sysid.reconstruct.aided_ekf import AidedFilter
from gcs_sysid.reconstruct.aided_smoother import Beginning, positive

FIRST_S = 60.0
"""Flight that is fitted [s]: gusts and noise are known to some per cent after a minute."""
MOST = 384
"""Batches that wait at most, four minutes at 50 Hz: longer than any fit takes."""
AGEING_S = 120.0
"""What the minute left unknown of derivatives and sensor errors comes back in so much flight [s].
What is wrong in the intensities that a minute told bends derivatives however long it is flown: on
three flights (seeds 7000 to 7002 of `bench_live_inside.py`) errors after four minutes were those
after one, and stated deviations of a filter that believed in constants half as large. In balance
with what more flight tells, this leaves what 85 seconds tell."""
CATCHING_UP = 2.0
"""Flight that is taken in while a second of it comes [s], as long as rows wait."""
WIND_CHANGES = 0.5
"""Of the steady wind over a hole in the data, one standard deviation of each component [m/s]."""
PREFIX = "inside."
_AIR = "turbulence"


class Newest(NamedTuple):
    """What the filter knows at its newest row.

    Attributes:
        time: of the row [s after the epoch].
        flow: true airspeed [m/s], angle of attack, sideslip [rad] at the centre of gravity.
        deviation: one standard deviation of each.
    """

    time: float
    flow: Float[np.ndarray, " three"]
    deviation: Float[np.ndarray, " three"]


class _Learned(NamedTuple):
    """What of a filter outlasts a hole in the data, and a program that was killed."""

    unknowns: Unknowns
    covariance: Float[np.ndarray, "parameter parameter"]
    drift: Float[np.ndarray, "parameter parameter"]


class Inside:
    """Collects, has a minute fitted, and filters from there on.

    Args:
        aircraft: its file.
        commands: what the autopilot commands; filled by the caller.
        prior: derivatives believed before; None ignores the file's.
        fit: has a minute fitted, elsewhere; None fits nothing.

    Attributes:
        compiling: whether what the filter needs is being compiled still, elsewhere.
        lost: how often the filter lost the aircraft.
        failed: why there is no fit; empty where there is or may be.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        commands: Commands,
        prior: Mapping[str, Prior] | None,
        fit: Callable[[Task], Future[Found | None]] | None,
    ) -> None:
        # A file without aerodynamics believes in nothing.
        self._aircraft, self._prior, self._fit = aircraft, prior or None, fit
        self._maker = InsideRows(aircraft, commands)
        start = inside_fit.first_terms(aircraft, self._prior)
        self._model = FlightModel(aided_flight.with_structure(aircraft, start))
        self._batches: deque[Batch] = deque(maxlen=MOST)
        self._place = 0
        self._time, self._owed = -math.inf, 0.0
        self._coming: Future[Found | None] | None = None
        self._learned: _Learned | None = None
        self._filter: AidedFilter | None = None
        self._newest: tuple[float, Row] | None = None
        self.compiling = False
        self.lost = 0
        self.failed = ""

    @property
    def phase(self) -> str:
        """What is going on: off, compiling, collecting, fitting, known, or failed and why."""
        if self._fit is None:
            return "off"
        if self._filter is not None:
            return "known"
        if self._coming is not None:
            return "fitting"
        if self.failed:
            return f"failed: {self.failed}"
        return "compiling" if self.compiling else "collecting"

    @property
    def collected(self) -> float:
        """Flight that waits to be fitted or filtered [s]."""
        return float(sum(batch.rows.step.sum() for batch in self._batches))

    def clear(self) -> None:
        """What comes next does not follow what came."""
        self._maker.clear()
        if self._learned is None and self._coming is None:
            self._batches.clear()

    def restart(self) -> None:
        """Forgets what was learned: another minute has to be fitted."""
        self._maker.clear()
        self._batches.clear()
        self._filter = self._learned = self._newest = self._coming = None
        self._place = 0

    def take(
        self,
        estimate: Estimate,
        noise: KinematicNoise,
        lever: Float[np.ndarray, " axis"],
        used: Mapping[str, str],
    ) -> None:
        """Adds a finished estimate, and moves the filter on.

        Args:
            estimate: of the kinematic filter.
            noise: intensities that it rests on.
            lever: from the centre of gravity to the inertial unit [m].
            used: stream behind each kind of measurement.
        """
        if self._fit is None or self.failed or "accelerometer" not in used:
            return
        batch = self._maker.take(estimate, lever)
        if batch is not None:
            waits = self._learned is None and self._coming is None
            if waits and not batch.rows.modelled.all():
                # Nothing is to be learned where nobody knows what was commanded.
                self._batches.clear()
            else:
                self._batches.append(batch)
        if self._coming is not None and self._coming.done():
            self._begin(self._coming)
        if self._learned is not None:
            self._move_on(estimate.row.time)
        elif batch is not None and self._coming is None and self.collected >= FIRST_S:
            self._coming = self._fit(self._task(estimate, noise, used))

    def compile_all(
        self, estimate: Estimate, noise: KinematicNoise, used: Mapping[str, str]
    ) -> None:
        """Compiles what the filter will need, on what was collected, which is then given up."""
        if self._batches:
            inside_fit.compile_for(self._task(estimate, noise, used))

    def _task(self, estimate: Estimate, noise: KinematicNoise, used: Mapping[str, str]) -> Task:
        """What was collected, to be fitted."""
        rows, states = (
            jax.tree.map(
                lambda *parts: np.concatenate(parts), *(one[part] for one in self._batches)
            )
            for part in (0, 1)
        )
        rows.step[0] = 0.0
        begun = Kinematics(
            *(estimate.rest[BLOCKS[name]] for name in ("gyro_bias", "accelerometer_bias")),
            np.asarray(noise.gust),
        )
        self._batches.clear()
        return Task(self._aircraft, self._prior, rows, states, begun, dict(used))

    def _begin(self, coming: Future[Found | None]) -> None:
        """Takes what was fitted."""
        self._coming = None
        error = coming.exception()
        if error is not None:
            self.failed = f"{type(error).__name__}: {error}"
            return
        found = coming.result()
        if found is None or not found.converged:
            # Another minute has other gusts.
            self.lost += 1
            self.restart()
            return
        drift = found.covariance / AGEING_S
        self._learned = _Learned(found.unknowns, found.covariance, drift)
        self._place = 0
        # What waits follows the minute, unless too much did, or there was a hole.
        hole = any(batch.rows.step[0] == 0.0 for batch in list(self._batches)[:1])
        whole = len(self._batches) < MOST and not hole
        self._filter = self._filtering(found.beginning, found.moved) if whole else None

    def _filtering(
        self, beginning: Beginning, moved: Float[np.ndarray, "state parameter"]
    ) -> AidedFilter | None:
        if self._learned is None:
            return None
        (means, log_noise), covariance, drift = self._learned
        return AidedFilter(
            self._model, means, covariance, positive(log_noise), beginning, moved, drift
        )

    def _move_on(self, time: float) -> None:
        """Takes in rows that wait, little by little: between two estimates others wait."""
        passed, self._time = time - self._time, time
        self._owed += CATCHING_UP * min(max(passed, 0.0), inside_rows.HOLE_S)
        while self._batches and self._owed > 0.0:
            batch = self._batches[0]
            self._owed -= float(batch.rows.step[self._place])
            self._one(batch, self._place)
            self._place += 1
            if self._place == BATCH:
                self._place = 0
                if self._batches:
                    self._batches.popleft()
        if not self._batches:
            self._owed = 0.0

    def _one(self, batch: Batch, place: int) -> None:
        row = jax.tree.map(lambda part: part[place], batch.rows)
        if self._filter is None or row.step == 0.0:
            self._keep()
            state = jax.tree.map(lambda part: part[place], batch.states)
            self._filter = self._again(state)
            row = row._replace(step=np.zeros(()))
        running = self._filter
        if running is None:
            return
        running.predict(row)
        running.observe()
        self._newest = (float(batch.time[place]), row)
        if running.lost:
            self.lost += 1
            self.restart()

    def _keep(self) -> None:
        """Keeps what the filter has learned so far."""
        if self._filter is not None and self._learned is not None:
            unknowns = self._learned.unknowns._replace(means=self._filter.means)
            self._learned = self._learned._replace(
                unknowns=unknowns, covariance=self._filter.covariance
            )

    def _again(self, state: State) -> AidedFilter | None:
        """The filter begun anew where kinematics have the aircraft.

        Not where they have the air: in gusts their flow angles are several degrees off, and a
        filter that knows its derivatives would change these to make up for it. The steady wind is
        that of before, gusts are unknown to their intensity.
        """
        if self._learned is None:
            return None
        gusts = positive(self._learned.unknowns.log_noise).turbulence
        spread = aided_flight.START_DEVIATION.copy()
        spread[aided.BLOCKS["gust"]] = gusts.gust
        spread[aided.BLOCKS["spin"]] = gusts.spin
        spread[aided.BLOCKS["tube"]] = np.linalg.norm(gusts.gust)
        wind = state.air.wind
        if self._filter is not None:
            wind = np.asarray(self._filter.state.air.wind)
            place = aided.BLOCKS["wind"]
            known = np.sqrt(np.diagonal(self._filter.P)[place])
            spread[place] = np.hypot(known, WIND_CHANGES)
        still = jax.tree.map(np.zeros_like, state.air)._replace(wind=wind)
        speed = np.array([np.linalg.norm(np.asarray(state.velocity - wind))])
        begun = Beginning(state._replace(air=still, tube=speed), jnp.diag(spread**2))
        return self._filtering(begun, np.zeros((aided.SIZE, self._learned.covariance.shape[0])))

    def newest(self) -> Newest | None:
        """Flow at the newest row; None before there is any."""
        if self._filter is None or self._newest is None:
            return None
        time, row = self._newest
        return Newest(time, *self._filter.flow(row))

    def derivatives(self) -> dict[str, dict[str, TermEstimate]]:
        """Derivatives by coefficient and regressor; empty before they are known.

        As after the flight, the lag of the moments is believed to `scoring.TIMING` at best.
        """
        if self._filter is None:
            return {}
        means = self._filter.means
        keys = in_common.derivative_keys(means.aerodynamics)
        values = np.asarray(ravel_pytree(means)[0])[: len(keys)]
        covariance = self._filter.covariance
        sought = np.diagonal(covariance) > 0.0
        for lag in np.flatnonzero(scoring.marked(means, ("moment_lag",)) & sought):
            covariance = scoring.timed(covariance, int(lag))
        deviation = np.sqrt(np.maximum(np.diagonal(covariance)[: len(keys)], 0.0))
        out: dict[str, dict[str, TermEstimate]] = {}
        for (name, key), value, spread in zip(keys, values, deviation, strict=True):
            out.setdefault(name, {})[key] = TermEstimate(float(value), float(spread))
        return out

    @property
    def excess(self) -> float:
        """Squares of the last innovations over what they should be; not a number before."""
        return math.nan if self._filter is None else self._filter.excess

    def state(self) -> dict[str, np.ndarray]:
        """Everything learned so far, as arrays by name; nothing before there is anything."""
        self._keep()
        if self._learned is None:
            return {}
        (means, noise), covariance, drift = self._learned
        derivatives = ravel_pytree(means.aerodynamics)[0]
        known = {
            "covariance": covariance,
            "drift": drift,
            "derivatives": derivatives,
            **means.sensors._asdict(),
            **{f"noise.{name}": one for name, one in noise._asdict().items() if name != _AIR},
            **{f"{_AIR}.{name}": one for name, one in noise.turbulence._asdict().items()},
        }
        return {f"{PREFIX}{name}": np.asarray(one) for name, one in known.items()}

    def restore(self, state: Mapping[str, np.ndarray]) -> bool:
        """Goes on from the `state` of one for the same aircraft.

        Returns:
            Whether it does; without a state it begins anew.

        Raises:
            KeyError: something is missing.
            ValueError: something has another shape, or is not finite.
        """
        own = {key[len(PREFIX) :]: part for key, part in state.items() if key.startswith(PREFIX)}
        if not own:
            return False
        terms = inside_fit.first_terms(self._aircraft, self._prior)
        flat, unravel = ravel_pytree(terms)
        sensors = Sensors(**{name: own[name] for name in Sensors._fields})
        turbulence = Turbulence(**{name: own[f"{_AIR}.{name}"] for name in Turbulence._fields})
        others = {name: own[f"noise.{name}"] for name in Noise._fields if name != _AIR}
        means = Means(unravel(jnp.asarray(_shaped(own["derivatives"], flat.shape))), sensors)
        count = ravel_pytree(means)[0].size
        covariance, drift = (_shaped(own[name], (count, count)) for name in ("covariance", "drift"))
        unknowns = Unknowns(means, Noise(turbulence=turbulence, **others))
        if not np.isfinite(ravel_pytree(unknowns)[0]).all():
            raise ValueError("not finite")
        self._learned = _Learned(unknowns, covariance, drift)
        return True


def _shaped(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The values, which are to be of this shape and finite."""
    if values.shape != shape or not np.isfinite(values).all():
        raise ValueError("another shape, or not finite")
    return values
