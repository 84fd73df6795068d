"""The aerodynamics inside the filter, beside the flight: states and derivatives in gusts, live.

A minute of flight is fitted (`inside_fit`), which tells gusts and noise, and where derivatives and
sensor errors begin; from there `AidedFilter` goes on finding them, a row at a time. What it makes
of a row rests on everything up to it and costs the same after an hour.

A filter that loses the aircraft says so, and another minute is fitted. All of it runs in a process
beside the listener (`inside_beside`), where rows wait while a minute is fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Float

from gcs_sysid.aircraft import MOMENTS, Aircraft
from gcs_sysid.estimate import in_common, quick_air, scoring
from gcs_sysid.estimate.quick_air import QuickAirError
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live import inside_fit, inside_known
from gcs_sysid.live.inside_fit import Found, Task
from gcs_sysid.live.inside_known import Fed, Known, Learned, Newest
from gcs_sysid.live.inside_rows import BATCH
from gcs_sysid.live.regression import Solution
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Row, State
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import aided_flight
from gcs_sysid.reconstruct.aided_ekf import AidedFilter
from gcs_sysid.reconstruct.aided_smoother import Beginning, positive

FIRST_S = 60.0
"""Flight with known commands that is fitted [s]: gusts and noise are known to some per cent after a
minute."""
AGEING_S = 120.0
"""What the minute left unknown of derivatives and sensor errors comes back in so much flight [s].
What is wrong in the intensities that a minute told bends derivatives however long it is flown: on
three flights (seeds 7000 to 7002 of `bench_live_inside.py`) errors after four minutes were those
after one, and stated deviations of a filter that believed in constants half as large. In balance
with what more flight tells, this leaves what 85 seconds tell."""
WIND_CHANGES = 0.5
"""Of the steady wind over a hole in the data, one standard deviation of each component [m/s]."""


class Inside:
    """Collects, fits a minute, and filters from there on.

    Args:
        aircraft: its file.
        prior: derivatives believed before; None ignores the file's.
        fit: fits a minute of flight.
        tell: told what is known before a minute is fitted, which takes a minute or two.

    Attributes:
        known: the newest of everything.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        prior: Mapping[str, Prior] | None,
        *,
        fit: Callable[[Task], Found | None] = inside_fit.fitted,
        tell: Callable[[Known], None] = lambda _: None,
    ) -> None:
        # A file without aerodynamics believes in nothing.
        self._aircraft, self._prior = aircraft, prior or None
        self._fit, self._tell = fit, tell
        start = inside_fit.first_terms(aircraft, self._prior)
        self._model = FlightModel(aided_flight.with_structure(aircraft, start))
        self._fed: list[Fed] = []
        self._number = -1
        self._fitting = False
        self._learned: Learned | None = None
        self._filter: AidedFilter | None = None
        self._newest: tuple[float, Row] | None = None
        self._lost = 0
        self._troubles, self._trouble = 0, ""
        self._refused = ""
        self.known = self._all_known()

    def take(self, fed: Fed) -> None:
        """Adds rows: collects them, fits them where there are enough, or filters on.

        Args:
            fed: the next ones.
        """
        self._take(fed)
        self.known = self._all_known()

    def _take(self, fed: Fed) -> None:
        follows = fed.number == self._number + 1 and bool(fed.batch.rows.step[0] > 0.0)
        self._number = fed.number
        if self._learned is not None:
            self._move_on(fed, follows)
            return
        if not follows:
            self._fed = []
        # Nothing is to be learned where nobody knows what was commanded.
        self._fed = [*self._fed, fed] if fed.batch.rows.modelled.any() else []
        if self._collected >= FIRST_S:
            self._begin()

    def trouble(self, error: Exception) -> None:
        """Forgets what was learned, for a reason: another minute has to be fitted."""
        self._troubles += 1
        self._trouble = f"{type(error).__name__}: {error}"
        self._restart()
        self.known = self._all_known()

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Goes on from what another one knew; see `inside_known.learned`."""
        self._learned = inside_known.learned(state, self._aircraft, self._prior)
        self.known = self._all_known()

    def _all_known(self) -> Known:
        self._keep()
        running, newest = self._filter, None
        if running is not None and self._newest is not None:
            time, row = self._newest
            newest = Newest(time, *running.flow(row))
        phase = "collecting" if running is None else "known"
        return Known(
            phase="fitting" if self._fitting else phase,
            collected=self._collected,
            lost=self._lost,
            refused=self._refused,
            troubles=self._troubles,
            trouble=self._trouble,
            newest=newest,
            derivatives={} if running is None else _derivatives(running, self._aircraft),
            excess=np.nan if running is None else running.excess,
            state={} if self._learned is None else inside_known.state(self._learned),
        )

    @property
    def _collected(self) -> float:
        each = (one.batch.rows for one in self._fed)
        return float(sum(rows.step[rows.modelled].sum() for rows in each))

    def _restart(self) -> None:
        self._fed, self._fitting = [], False
        self._filter = self._learned = self._newest = None

    def _begin(self) -> None:
        """Fits what was collected, and begins the filter at its end."""
        self._fitting = True
        self._tell(self._all_known())
        self._refused = ""
        try:
            found = self._fit(self._task())
        except QuickAirError as error:
            found, self._refused = None, f"{error}: {quick_air.FIX}"
        if found is None or not found.converged:
            # Another minute has other gusts.
            self._lost += 1
            self._restart()
            return
        self._fed, self._fitting = [], False
        drift = found.covariance / AGEING_S
        self._learned = Learned(found.unknowns, found.covariance, drift)
        self._filter = self._filtering(self._learned, found.beginning, found.moved)

    def _task(self) -> Task:
        """What was collected, to be fitted."""
        rows, states = (
            jax.tree.map(
                lambda *parts: np.concatenate(parts), *(one.batch[part] for one in self._fed)
            )
            for part in (0, 1)
        )
        rows.step[0] = 0.0
        last = self._fed[-1]
        return Task(self._aircraft, self._prior, rows, states, last.begun, dict(last.used))

    def _filtering(
        self, learned: Learned, beginning: Beginning, moved: Float[np.ndarray, "state parameter"]
    ) -> AidedFilter:
        (means, log_noise), covariance, drift = learned
        return AidedFilter(
            self._model, means, covariance, positive(log_noise), beginning, moved, drift
        )

    def _move_on(self, fed: Fed, follows: bool) -> None:
        batch = fed.batch
        for place in range(BATCH):
            row, state = (jax.tree.map(lambda part, at=place: part[at], part) for part in batch[:2])
            if self._filter is None or (place == 0 and not follows):
                self._filter = self._again(state)
                row = row._replace(step=np.zeros(()))
            self._filter.predict(row)
            self._filter.observe()
            if self._filter.lost:
                self._lost += 1
                self._restart()
                return
            self._newest = (float(batch.time[place]), row)

    def _keep(self) -> None:
        """Keeps what the filter has learned so far."""
        if self._filter is not None and self._learned is not None:
            unknowns = self._learned.unknowns._replace(means=self._filter.means)
            self._learned = self._learned._replace(
                unknowns=unknowns, covariance=self._filter.covariance
            )

    def _again(self, state: State) -> AidedFilter:
        """The filter begun anew where kinematics have the aircraft.

        Not where they have the air: in gusts their flow angles are several degrees off, and a
        filter that knows its derivatives would change these to make up for it. The steady wind is
        that of before, gusts are unknown to their intensity.

        Raises:
            ValueError: nothing was learned.
        """
        self._keep()
        if self._learned is None:
            raise ValueError("nothing was learned")
        gusts = positive(self._learned.unknowns.log_noise).turbulence
        spread = aided_flight.START_DEVIATION.copy()
        spread[aided.BLOCKS["gust"]] = gusts.gust
        spread[aided.BLOCKS["spin"]] = gusts.spin
        spread[aided.BLOCKS["tube"]] = np.linalg.norm(gusts.gust)
        wind = state.air.wind
        if self._filter is not None:
            wind = np.asarray(self._filter.state.air.wind)
            place = aided.BLOCKS["wind"]
            deviation = np.sqrt(np.diagonal(self._filter.P)[place])
            spread[place] = np.hypot(deviation, WIND_CHANGES)
        still = jax.tree.map(np.zeros_like, state.air)._replace(wind=wind)
        speed = np.array([np.linalg.norm(np.asarray(state.velocity - wind))])
        begun = Beginning(state._replace(air=still, tube=speed), jnp.diag(spread**2))
        none = np.zeros((aided.SIZE, self._learned.covariance.shape[0]))
        return self._filtering(self._learned, begun, none)


def _derivatives(running: AidedFilter, aircraft: Aircraft) -> dict[str, Solution]:
    """Derivatives by coefficient.

    As after the flight, the lag of the moments is believed to `scoring.TIMING` at best, and all
    derivatives of a coefficient are wrong by one factor as mass or inertia is.
    """
    means, covariance = running.means, running.covariance
    keys = in_common.derivative_keys(means.aerodynamics)
    values = np.asarray(ravel_pytree(means)[0])[: len(keys)]
    sought = np.diagonal(covariance) > 0.0
    for lag in np.flatnonzero(scoring.marked(means, ("moment_lag",)) & sought):
        covariance = scoring.timed(covariance, int(lag))
    out = {}
    for name in dict.fromkeys(name for name, _ in keys):
        rows = [place for place, (own, _) in enumerate(keys) if own == name]
        body = aircraft.mass.inertia_sigma if name in MOMENTS else aircraft.mass.mass_sigma
        factor = body * values[rows]
        spread = covariance[np.ix_(rows, rows)] + np.outer(factor, factor)
        out[name] = Solution(tuple(keys[place][1] for place in rows), values[rows], spread)
    return out
