"""The aerodynamics inside the filter beside the flight: its rows, how it begins and goes on."""

from __future__ import annotations

import itertools
import json
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.cli import numerics
from gcs_sysid.estimate import in_common
from gcs_sysid.estimate.flight_rows import Flight
from gcs_sysid.live import inside, inside_fit, inside_rows
from gcs_sysid.live.commands import Commands
from gcs_sysid.live.filter import Estimate
from gcs_sysid.live.inside import Inside
from gcs_sysid.live.inside_fit import Found, Task
from gcs_sysid.live.inside_rows import BATCH, HOLE_S, SETTLED_S, Batch, InsideRows
from gcs_sysid.live.station import Compiled
from gcs_sysid.model import aided
from gcs_sysid.offline import aided_flight, flight, maneuver_choice
from gcs_sysid.offline.identify import file_prior
from gcs_sysid.reconstruct.aided_smoother import Beginning

DEMO = Path(__file__).resolve().parents[2] / "data/flights/demo.tlog"
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def live(listened) -> tuple[aided.Row, aided.State, np.ndarray]:
    """Rows of the whole flight, the kinematic states there, and their times."""
    parts = [
        jax.tree.map(lambda *each: np.concatenate(each), *(one[part] for one in listened.batches))
        for part in range(3)
    ]
    return parts[0], parts[1], parts[2]


def test_rows_are_those_of_the_batch_run(live, listened, aircraft: Aircraft) -> None:
    """Of the same inertial samples: what was measured, commanded, and when.

    But for the flight's first second, before which nothing was heard live, and for what knows the
    future: lost commands that the batch run makes up for, and the wind.
    """
    rows, _, time = live
    one = flight.read(
        *(listened.log, aircraft),
        vehicle=None,
        segments=maneuver_choice.chooser(None, aircraft),
        delay=None,
        progress=lambda *_: None,
    )
    batch = aided_flight.prepare(one.recording, aircraft, one.reconstruction).rows
    sensed, others = (np.hstack([one.gyro, one.accelerometer]) for one in (rows, batch))
    # Coarse readings repeat themselves: those that do are nobody's.
    ours, theirs = (places_of(one) for one in (sensed, others))
    both = sorted(ours.keys() & theirs.keys(), key=lambda sample: ours[sample])
    here, there = (np.array([one[sample] for sample in both]) for one in (ours, theirs))
    assert here.size > 0.9 * np.count_nonzero(rows.inertial) > 1000
    assert np.all(np.diff(there) > 0)
    assert np.all(np.diff(time) > 0.0)
    later = np.flatnonzero(time[here] > time[0] + 1.0)
    here, there = here[later], there[later]
    # Small holes are filled in steps of another length.
    assert np.mean(np.abs(rows.step[here] - batch.step[there]) < 1e-9) > 0.995
    off = np.abs(rows.controls[here] - batch.controls[there])
    assert np.mean(off < 1e-6) > 0.9
    assert off.max() < np.deg2rad(3.0)
    slopes = np.abs(rows.control_slopes[here] - batch.control_slopes[there])
    assert np.mean(slopes < 1e-3) > 0.9
    assert np.mean(np.abs(rows.settings[here] - batch.settings[there]) < 1e-4) > 0.9
    np.testing.assert_allclose(rows.density[here], batch.density[there], rtol=1e-3)
    for index, group in enumerate(("airspeed", "velocity", "attitude")):
        seen, other = rows.measured.valid[here, index], batch.measured.valid[there, index]
        assert np.mean(seen == other) > 0.98, group
        both = seen & other
        values, others = (
            np.asarray(getattr(one.measured, group))[places][both]
            for one, places in ((rows, here), (batch, there))
        )
        # True airspeed is by the last pressure heard, here, and by one between two, there.
        same = np.all(np.abs(values - others) < 5e-3, axis=1)
        assert np.mean(same) > 0.98, group
        ages, olds = rows.measured.age[here, index][both], batch.measured.age[there, index][both]
        # Messages without a stamp are where they arrived, here, and on a clock of their own, there.
        assert np.max(np.abs(ages - olds)[same]) < (0.02 if group == "airspeed" else 1e-6), group


def places_of(samples: np.ndarray) -> dict[tuple[float, ...], int]:
    """Where each sample is that occurs once."""
    every, first, counts = np.unique(samples, axis=0, return_index=True, return_counts=True)
    alone = counts == 1
    return dict(zip(map(tuple, every[alone]), first[alone].tolist(), strict=True))


def test_estimates_that_come_fast_are_thinned_and_lose_no_measurement(
    listened, aircraft: Aircraft, compiled: Compiled, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three times in the time of one: a third of them are rows, all measurements at some row."""
    monkeypatch.setattr(inside_rows, "SETTLED_S", 0.0)
    maker = InsideRows(aircraft, Commands(aircraft, compiled.maps))
    fast, begun = listened.estimates[300:1500], listened.estimates[300].row.time
    quick = [
        replace(one, row=replace(one.row, time=begun + (one.row.time - begun) / 3.0))
        for one in fast
    ]
    made = [batch for one in quick if (batch := maker.take(one, np.zeros(3))) is not None]
    rows = np.concatenate([batch.rows.step for batch in made])
    assert len(rows) == BATCH * len(made)
    assert 0.28 < len(rows) / len(fast) < 0.36
    end = made[-1].time[-1]
    # Of velocities, ten a second and thirty now, two rarely belong to one row.
    given = sum(int(one.row.measured.valid[1]) for one in quick if one.row.time < end)
    found = sum(int(np.sum(batch.rows.measured.valid[:, 1])) for batch in made)
    assert found > 0.9 * given > 50
    assert max(np.abs(batch.rows.measured.age[:, 1]).max() for batch in made) <= 0.02


def test_over_a_hole_rows_begin_anew_and_small_ones_are_filled(
    listened, aircraft: Aircraft, compiled: Compiled
) -> None:
    maker = InsideRows(aircraft, Commands(aircraft, compiled.maps))
    every = listened.estimates[300:500]
    settled = int(SETTLED_S * 50)
    lacking = every[: settled + 20] + every[settled + 24 :]
    first = next(batch for one in lacking if (batch := maker.take(one, np.zeros(3))) is not None)
    assert first.rows.step[0] == 0.0
    assert np.all(first.rows.step[1:] > 0.0)
    assert np.max(first.rows.step) <= aided_flight.LONGEST_STEP
    assert np.count_nonzero(~first.rows.inertial) >= 2
    assert not first.rows.measured.valid[~first.rows.inertial].any()
    after = listened.estimates[500 + int(2.0 * HOLE_S * 50) :]
    again = next(batch for one in after if (batch := maker.take(one, np.zeros(3))) is not None)
    assert again.rows.step[0] == 0.0
    assert again.time[0] >= after[0].row.time + SETTLED_S


class Given:
    """Stands in for the maker of rows: a batch that is there already at every 32nd estimate."""

    def __init__(self, batches: list[Batch]) -> None:
        self._batches, self._count = iter(batches), 0

    def take(self, _estimate: Estimate, _lever: np.ndarray) -> Batch | None:
        self._count += 1
        return next(self._batches, None) if self._count % BATCH == 0 else None

    def clear(self) -> None:
        """There is nothing to forget."""


class Fitting:
    """Fits when asked to, and knows the file's derivatives to a tenth."""

    def __init__(self) -> None:
        self.task: Task | None = None
        self.coming: Future[Found | None] = Future()

    def __call__(self, task: Task) -> Future[Found | None]:
        self.task, self.coming = task, Future()
        return self.coming

    def found(self) -> Found:
        """The file, sensors without errors, gusts as kinematics have them."""
        assert self.task is not None
        aircraft, _, rows, states, begun, _ = self.task
        first = jax.tree.map(lambda part: part[-1], states)
        spread = np.diag(aided_flight.START_DEVIATION**2)
        whole = Flight(rows, states, Beginning(first, spread))
        terms = inside_fit.first_terms(aircraft, file_prior(aircraft))
        unknowns = aided_flight.first_unknowns(whole, aircraft, begun, terms)
        flat = np.asarray(ravel_pytree(unknowns.means)[0])
        sizes = np.zeros(flat.size)
        count = len(in_common.derivative_keys(unknowns.means.aerodynamics))
        sizes[:count] = np.maximum(0.1 * np.abs(flat[:count]), 1e-4)
        none = np.zeros((aided.SIZE, flat.size))
        return Found(unknowns, np.diag(sizes**2), whole.beginning, none, True, 0.0)


def going(
    listened, aircraft: Aircraft, compiled: Compiled, fit: Fitting | None
) -> tuple[Inside, Callable[[int], None]]:
    """One that is given the rows of the flight, and what moves it on by so many estimates."""
    commands = Commands(aircraft, compiled.maps)
    found = Inside(aircraft, commands, file_prior(aircraft), fit)
    found._maker = Given(listened.batches)  # ty: ignore[invalid-assignment]
    noise, used = listened.station.filter.noise, {"accelerometer": "RAW_IMU"}

    last, taken = listened.estimates[-1], itertools.count()

    def on(count: int) -> None:
        for number in itertools.islice(taken, count):
            row = replace(last.row, time=last.row.time + 0.02 * number)
            found.take(replace(last, row=row), noise, np.zeros(3), used)

    return found, on


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inside, "FIRST_S", 10.0)


def test_it_collects_has_a_part_fitted_and_goes_on_from_there(
    listened, aircraft: Aircraft, compiled: Compiled
) -> None:
    """Rows that came while it was fitted are taken in, faster than new ones come."""
    fit = Fitting()
    one, on = going(listened, aircraft, compiled, fit)
    on(400)
    assert one.phase == "collecting"
    assert 7.0 < one.collected < 10.0
    assert one.newest() is None
    assert one.derivatives() == {}
    on(200)
    assert one.phase == "fitting"
    assert fit.task is not None
    assert float(fit.task.rows.step.sum()) == pytest.approx(10.0, abs=0.7)
    assert one.state() == {}
    fit.coming.set_result(fit.found())
    waited = one.collected
    on(150)
    assert one.phase == "known"
    assert one.collected < waited + 0.7
    found = one.newest()
    assert found is not None
    truth = np.load(DEMO.with_name("demo_truth.npz"))
    columns = {str(name): truth["rows"][:, i] for i, name in enumerate(truth["cols"])}
    epoch = listened.station.rows.epoch_us
    at = (epoch + found.time * 1e6 - int(truth["t0_us"])) * 1e-6
    right = [np.interp(at, columns["t"], columns[name]) for name in ("V", "alpha", "beta")]
    assert np.all(np.abs(found.flow - right) < 4.0 * found.deviation)
    assert found.deviation[1] < np.deg2rad(1.5)
    known = one.derivatives()
    assert known["Cm"]["elevator"].deviation < 0.1 * abs(aircraft_value(aircraft))
    assert 0.2 < one.excess < 4.0

    # Over a hole the state is begun anew, in the wind of before, whatever kinematics have of it.
    one.clear()
    assert one._filter is not None
    wind = np.array(one._filter.state.air.wind)
    again = listened.batches[20]
    step, air = np.array(again.rows.step), again.states.air
    step[0] = 0.0
    blown = air._replace(wind=air.wind + 4.0, gust=air.gust - 3.0)
    again = again._replace(
        rows=again.rows._replace(step=step), states=again.states._replace(air=blown)
    )
    one._maker = Given([again])  # ty: ignore[invalid-assignment]
    one._batches.clear()
    one._place = 0
    on(BATCH + 1)
    assert np.linalg.norm(np.asarray(one._filter.state.air.wind) - wind) < 1.0
    after = one.derivatives()
    assert one.phase == "known"
    assert after["Cm"]["elevator"].deviation <= known["Cm"]["elevator"].deviation * 1.001

    # And so by a program that was killed.
    kept = {name: np.array(part) for name, part in one.state().items()}
    other, go = going(listened, aircraft, compiled, Fitting())
    assert not other.restore({})
    assert other.restore(kept)
    same = other.state()
    assert kept.keys() == same.keys()
    for name, part in kept.items():
        np.testing.assert_array_equal(part, same[name], err_msg=name)
    go(BATCH + 1)
    assert other.phase == "known"
    for name, damaged in (("covariance", np.zeros((2, 2))), ("gyro_bias", np.full(3, np.nan))):
        with pytest.raises(ValueError, match="finite"):
            other.restore(kept | {f"{inside.PREFIX}{name}": damaged})


def aircraft_value(aircraft: Aircraft) -> float:
    return aircraft.aerodynamics["Cm"].terms["elevator"].value


def test_a_part_in_which_the_aircraft_is_lost_is_followed_by_another(
    listened, aircraft: Aircraft, compiled: Compiled
) -> None:
    fit = Fitting()
    one, on = going(listened, aircraft, compiled, fit)
    on(600)
    fit.coming.set_result(None)
    on(1)
    assert (one.phase, one.lost) == ("collecting", 1)
    on(600)
    assert one.phase == "fitting"
    fit.coming.set_exception(RuntimeError("the process that fits has ended"))
    on(1)
    assert one.phase == "failed: RuntimeError: the process that fits has ended"
    on(600)
    assert one.phase.startswith("failed")


def test_what_an_unknown_command_moved_is_not_fitted(
    listened, aircraft: Aircraft, compiled: Compiled
) -> None:
    fit = Fitting()
    one, on = going(listened, aircraft, compiled, fit)
    silent = [
        batch._replace(rows=batch.rows._replace(modelled=np.zeros(BATCH, dtype=bool)))
        for batch in listened.batches
    ]
    one._maker = Given(silent)  # ty: ignore[invalid-assignment]
    on(1000)
    assert one.phase == "collecting"
    assert fit.task is None
    off, go = going(listened, aircraft, compiled, None)
    go(1000)
    assert off.phase == "off"


def test_a_process_of_its_own_fits_what_was_flown(
    listened, aircraft: Aircraft, compiled: Compiled, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a minute with an elevator and a rudder input, by an aircraft that its file has wrong."""
    monkeypatch.setattr(inside, "FIRST_S", 30.0)
    fit = Fitting()
    one, on = going(listened, aircraft, compiled, fit)
    on(1700)
    assert one.phase == "fitting"
    found = inside_fit.Beside(numerics.enable)(fit.task).result(timeout=600.0)
    assert found is not None
    assert found.converged
    flown = json.loads(DEMO.with_name("demo_truth.json").read_text())["flown"]["aerodynamics"]
    keys = in_common.derivative_keys(found.unknowns.means.aerodynamics)
    deviation = np.sqrt(np.diagonal(found.covariance))[: len(keys)]
    off = []
    for (name, key), spread in zip(keys, deviation, strict=True):
        believed = aircraft.aerodynamics[name].terms.get(key)
        true = flown.get(name, {}).get(key, 0.0 if believed is None else believed.value)
        off.append((float(found.unknowns.means.aerodynamics[name][key]) - true) / spread)
    assert np.mean(np.abs(off) < 2.0) > 0.8
    assert np.max(np.abs(off)) < 5.0
    fit.coming.set_result(found)
    on(100)
    assert one.phase == "known"
    assert one.excess < 3.0


def test_a_process_that_ends_is_told(listened, aircraft: Aircraft, compiled: Compiled) -> None:
    fit = Fitting()
    _, on = going(listened, aircraft, compiled, fit)
    on(600)
    beside = inside_fit.Beside(failing)
    with pytest.raises(RuntimeError, match="has ended"):
        beside(fit.task).result(timeout=120.0)
    slow = inside_fit.Beside(waiting)
    coming = slow(fit.task)
    while slow._process is None or not slow._process.is_alive():
        time.sleep(0.01)
    slow.close()
    with pytest.raises(RuntimeError, match="has ended"):
        coming.result(timeout=120.0)


def failing() -> None:
    raise OSError("no memory")


def waiting() -> None:
    time.sleep(600.0)
