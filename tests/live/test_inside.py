"""The aerodynamics inside the filter beside the flight: its rows, how it begins and goes on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import jax
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.cli import numerics
from gcs_sysid.estimate import in_common, quick_air
from gcs_sysid.estimate.file_prior import file_prior
from gcs_sysid.estimate.flight_rows import Flight
from gcs_sysid.estimate.quick_air import QuickAirError
from gcs_sysid.live import inside, inside_fit, inside_rows
from gcs_sysid.live.commands import Commands
from gcs_sysid.live.departure import WINDOWS, DerivativeDepartures
from gcs_sysid.live.inside import Inside
from gcs_sysid.live.inside_beside import Beside
from gcs_sysid.live.inside_feed import InsideFeed
from gcs_sysid.live.inside_fit import Found, Task
from gcs_sysid.live.inside_known import PREFIX, Fed, Known, learned
from gcs_sysid.live.inside_rows import BATCH, HOLE_S, SETTLED_S, Batch, InsideRows
from gcs_sysid.live.station import Compiled
from gcs_sysid.model import aided
from gcs_sysid.offline import aided_flight, flight, maneuver_choice
from gcs_sysid.offline.aided_flight import Kinematics
from gcs_sysid.reconstruct.aided_smoother import Beginning
from tests.live.flown import sure

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "data/flights/demo.tlog"
AIRCRAFT = ROOT / "data/aircraft/ultra_stick_25e.toml"
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
    assert np.mean(rows.modelled[here] == batch.modelled[there]) > 0.98
    assert rows.modelled[here].mean() > 0.5
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


def fed(batches: list[Batch], first: int = 0) -> list[Fed]:
    """Batches as they come, of a unit without errors in gusts of a metre a second."""
    begun = Kinematics(np.zeros(3), np.zeros(3), np.ones(3))
    used = {"accelerometer": "RAW_IMU"}
    return [Fed(first + number, batch, begun, used) for number, batch in enumerate(batches)]


def anew(batch: Batch, wind: float = 0.0) -> Batch:
    """As after a hole in the data; kinematics have another wind then [m/s]."""
    step, air = np.array(batch.rows.step), batch.states.air
    step[0] = 0.0
    blown = air._replace(wind=air.wind + wind, gust=air.gust - wind)
    return batch._replace(
        rows=batch.rows._replace(step=step), states=batch.states._replace(air=blown)
    )


class Fitted:
    """Stands in for a fit: knows the file's derivatives to a tenth, or has no use of a flight."""

    def __init__(self, *, losing: int = 0, refusing: Exception | None = None) -> None:
        self.tasks: list[Task] = []
        self._losing, self._refusing = losing, refusing

    def __call__(self, task: Task) -> Found | None:
        self.tasks.append(task)
        if len(self.tasks) <= self._losing:
            if self._refusing is not None:
                raise self._refusing
            return None
        aircraft, _, rows, states, begun, _ = task
        last = jax.tree.map(lambda part: part[-1], states)
        spread = np.diag(aided_flight.START_DEVIATION**2)
        whole = Flight(rows, states, Beginning(last, spread))
        terms = inside_fit.first_terms(aircraft, file_prior(aircraft))
        unknowns = aided_flight.first_unknowns(whole, aircraft, begun, terms)
        flat = np.asarray(ravel_pytree(unknowns.means)[0])
        sizes = np.zeros(flat.size)
        count = len(in_common.derivative_keys(unknowns.means.aerodynamics))
        sizes[:count] = np.maximum(0.1 * np.abs(flat[:count]), 1e-4)
        none = np.zeros((aided.SIZE, flat.size))
        return Found(unknowns, np.diag(sizes**2), whole.beginning, none, True, 0.0)


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inside, "FIRST_S", 10.0)


def test_it_collects_has_a_part_fitted_and_goes_on_from_there(listened, aircraft: Aircraft) -> None:
    fit, told, coming = Fitted(), [], iter(fed(listened.batches))
    one = Inside(aircraft, file_prior(aircraft), fit=fit, tell=told.append)
    for _ in range(12):
        one.take(next(coming))
    assert one.known.phase == "collecting"
    assert 7.0 < one.known.collected < 10.0
    assert one.known.newest is None
    assert one.known.derivatives == one.known.state == {}
    while not fit.tasks:
        one.take(next(coming))
    assert [known.phase for known in told] == ["fitting"]
    assert told[0].collected == pytest.approx(10.0, abs=0.7)
    assert float(fit.tasks[0].rows.step.sum()) == told[0].collected
    for _ in range(4):
        one.take(next(coming))
    assert one.known.phase == "known"
    found = one.known.newest
    assert found is not None
    truth = np.load(DEMO.with_name("demo_truth.npz"))
    columns = {str(name): truth["rows"][:, i] for i, name in enumerate(truth["cols"])}
    epoch = listened.station.rows.epoch_us
    at = (epoch + found.time * 1e6 - int(truth["t0_us"])) * 1e-6
    right = [np.interp(at, columns["t"], columns[name]) for name in ("V", "alpha", "beta")]
    assert np.all(np.abs(found.flow - right) < 4.0 * found.deviation)
    assert found.deviation[1] < np.deg2rad(1.5)
    known = one.known.derivatives["Cm"].terms()["elevator"]
    body = aircraft.mass.inertia_sigma * abs(known.value)
    told_of = np.sqrt(known.deviation**2 - body**2)
    assert told_of < 0.1 * abs(aircraft.aerodynamics["Cm"].terms["elevator"].value)
    assert 0.2 < one.known.excess < 4.0

    # Over a hole the state is begun anew, in the wind of before, whatever kinematics have of it;
    # and so where rows that follow were left out.
    wind = np.array(one._filter.state.air.wind)
    number = one._number
    one.take(fed([anew(listened.batches[20], wind=4.0)], number + 1)[0])
    one.take(fed([listened.batches[22]], number + 3)[0])
    assert np.linalg.norm(np.asarray(one._filter.state.air.wind) - wind) < 1.0
    after = one.known.derivatives["Cm"].terms()["elevator"]
    assert one.known.phase == "known"
    assert after.deviation <= known.deviation * 1.001
    assert abs(after.value - known.value) < 2.0 * known.deviation

    # And so by a program that was killed.
    kept = one.known.state
    other = Inside(aircraft, file_prior(aircraft), fit=Fitted())
    other.restore(kept)
    same = other.known.state
    assert kept.keys() == same.keys()
    for name, part in kept.items():
        np.testing.assert_array_equal(part, same[name], err_msg=name)
    other.take(fed([listened.batches[22]])[0])
    assert other.known.phase == "known"
    assert learned({}, aircraft, file_prior(aircraft)) is None
    for name, damaged in (("covariance", np.zeros((2, 2))), ("gyro_bias", np.full(3, np.nan))):
        with pytest.raises(ValueError, match="finite"):
            learned(kept | {f"{PREFIX}{name}": damaged}, aircraft, file_prior(aircraft))


@pytest.mark.parametrize("refusing", [None, QuickAirError(0.26, 1.5)])
def test_a_part_that_is_no_use_is_followed_by_another(
    listened, aircraft: Aircraft, refusing: Exception | None
) -> None:
    """The aircraft is lost in it, or cannot be told from the air, and then it is said why."""
    fit = Fitted(losing=1, refusing=refusing)
    one = Inside(aircraft, file_prior(aircraft), fit=fit)
    for part in fed(listened.batches[:20]):
        one.take(part)
    assert (one.known.phase, one.known.lost, len(fit.tasks)) == ("collecting", 1, 1)
    why = "" if refusing is None else f"{refusing}: {quick_air.FIX}"
    assert one.known.refused == why
    for part in fed(listened.batches[20:], 20):
        one.take(part)
    assert (one.known.phase, len(fit.tasks)) == ("known", 2)
    assert (one.known.refused, one.known.troubles) == ("", 0)
    # What failed otherwise is told, and begun anew.
    one.trouble(FloatingPointError("no number"))
    known = one.known
    assert (known.phase, known.troubles) == ("collecting", 1)
    assert known.trouble == "FloatingPointError: no number"


def test_only_flight_that_follows_is_fitted_and_whose_commands_are_known(
    listened, aircraft: Aircraft
) -> None:
    fit = Fitted()
    one = Inside(aircraft, file_prior(aircraft), fit=fit)
    every = listened.batches
    holes = [batch if number % 10 else anew(batch) for number, batch in enumerate(every)]
    for part in fed(holes):
        one.take(part)
    lacking = [part for part in fed(every, 100) if part.number % 10]
    for part in lacking:
        one.take(part)
    silent = [
        batch._replace(rows=batch.rows._replace(modelled=np.zeros(BATCH, dtype=bool)))
        for batch in every
    ]
    for part in fed(silent, 200):
        one.take(part)
    assert (one.known.phase, fit.tasks) == ("collecting", [])
    # Where some are known, these count.
    told = np.arange(BATCH) % 2 == 0
    half = [batch._replace(rows=batch.rows._replace(modelled=told)) for batch in every[:10]]
    for part in fed(half, 300):
        one.take(part)
    known = sum(float(batch.rows.step[told].sum()) for batch in half)
    assert one.known.collected == pytest.approx(known)


def test_a_feed_without_a_filter_is_off_and_without_an_accelerometer_silent(
    listened, aircraft: Aircraft, compiled: Compiled
) -> None:
    noise, commands = listened.station.filter.noise, listened.station.commands

    class Kept(list):
        known = Known()

        def take(self, part: Fed) -> None:
            self.append(part)

        def restore(self, _state: Mapping[str, np.ndarray]) -> None:
            pytest.fail("nothing was to restore")

    for used, count in (({"accelerometer": "RAW_IMU"}, len(listened.batches)), ({}, 0)):
        kept = Kept()
        feed = InsideFeed(aircraft, commands, None, kept)
        for estimate in listened.estimates:
            feed.take(estimate, noise, listened.station.filter.lever, used)
        assert [part.number for part in kept] == list(range(count))
        assert feed.known.phase == "collecting"
    off = InsideFeed(aircraft, commands, None, None)
    off.take(listened.estimates[0], noise, np.zeros(3), {"accelerometer": "RAW_IMU"})
    assert off.known.phase == "off"
    assert not off.restore({})


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Beside]]:
    """Filters in processes of their own."""
    every: list[Beside] = []

    def begin(prepare: Callable[[], None], aircraft: Aircraft) -> Beside:
        every.append(Beside(prepare, aircraft, file_prior(aircraft)))
        return every[-1]

    yield begin
    for one in every:
        one.close()


def told(beside: Beside, wanted: Callable[[Known], bool], patience: float = 500.0) -> Known:
    """Waits until it tells what is wanted."""
    until = time.monotonic() + patience
    while not wanted(beside.known):
        assert time.monotonic() < until, beside.known._replace(state={})
        time.sleep(0.05)
    return beside.known


def test_a_process_of_its_own_fits_what_was_flown_and_filters_on(
    listened, aircraft: Aircraft, begun
) -> None:
    """Half a minute with an elevator and a rudder input, by an aircraft that its file has wrong."""
    beside, parts = begun(half_a_minute, aircraft), fed(listened.batches)
    for part in parts:
        beside.take(part)
    fitting = told(beside, lambda known: known.phase == "fitting")
    assert 30.0 <= fitting.collected < 31.0
    end = listened.batches[-1].time[-1]
    known = told(beside, lambda one: one.newest is not None and one.newest.time == end)
    assert (known.phase, known.lost, known.troubles) == ("known", 0, 0)
    assert known.excess < 3.0
    flown = json.loads(DEMO.with_name("demo_truth.json").read_text())["flown"]["aerodynamics"]
    off = []
    for name, solution in known.derivatives.items():
        for key, term in solution.terms().items():
            believed = aircraft.aerodynamics[name].terms.get(key)
            true = flown.get(name, {}).get(key, 0.0 if believed is None else believed.value)
            off.append((term.value - true) / term.deviation)
    assert np.mean(np.abs(off) < 2.0) > 0.8
    assert np.max(np.abs(off)) < 5.0
    # Of a file that is sure to 3 % the stability departs, a fifth less than it says; nothing else.
    watched = DerivativeDepartures(sure(aircraft, 0.03))
    for number in range(WINDOWS):
        watched.take(end + number, known.derivatives)
    assert {name: one.derivative for name, one in watched.told().items()} == {"Cm": "alpha"}
    # What it knows another one goes on with.
    feed = InsideFeed(aircraft, listened.station.commands, file_prior(aircraft), beside)
    other = begun(numerics.enable, aircraft)
    again = InsideFeed(aircraft, listened.station.commands, file_prior(aircraft), other)
    assert again.restore(feed.state())
    assert again.state().keys() == feed.state().keys()
    other.take(parts[-1])
    assert told(other, lambda one: one.newest is not None).phase == "known"


def test_a_process_that_ends_is_told_and_what_it_knew_stays(
    listened, aircraft: Aircraft, begun
) -> None:
    part, kept = fed(listened.batches)[0], {f"{PREFIX}drift": np.ones(1)}
    beside = begun(failing, aircraft)
    beside.restore(kept)
    beside.take(part)
    assert "has ended" in told(beside, lambda known: known.phase != "collecting").phase
    assert beside.known.state == kept
    # Whoever feeds it still never waits.
    for _ in range(1000):
        beside.take(part)
    slow = begun(waiting, aircraft)
    slow.take(part)
    while slow._process is None:
        time.sleep(0.01)
    slow.close()
    told(slow, lambda known: known.phase.startswith("failed"))


def test_rows_that_fail_are_told_and_the_next_ones_taken(
    listened, aircraft: Aircraft, begun
) -> None:
    beside, parts = begun(numerics.enable, aircraft), fed(listened.batches)
    broken = parts[0]._replace(batch=parts[0].batch._replace(rows=None))
    beside.take(broken)
    known = told(beside, lambda one: one.troubles == 1)
    assert known.phase == "collecting"
    assert "NoneType" in known.trouble
    for part in parts[1:5]:
        beside.take(part)
    told(beside, lambda one: one.collected > 1.0)


@pytest.mark.skipif(sys.platform != "linux", reason="looks in /proc")
def test_it_ends_with_a_listener_that_is_killed(tmp_path: Path) -> None:
    """By `kill -9`, which asks nobody."""
    program = tmp_path / "program.py"
    program.write_text(
        "import time\n"
        "from gcs_sysid import aircraft_file\n"
        "from gcs_sysid.live.inside_beside import Beside\n"
        "def nothing():\n"
        "    pass\n"
        "if __name__ == '__main__':\n"
        f"    beside = Beside(nothing, aircraft_file.load({str(AIRCRAFT)!r}), None)\n"
        "    beside.take(None)\n"
        "    while beside._process is None or beside.known.troubles == 0:\n"
        "        time.sleep(0.05)\n"
        "    print(beside._process.pid, flush=True)\n"
        "    time.sleep(600.0)\n"
    )
    listener = subprocess.Popen([sys.executable, str(program)], stdout=subprocess.PIPE, text=True)
    assert listener.stdout is not None
    with listener.stdout:
        child = Path(f"/proc/{int(listener.stdout.readline())}")
        assert child.exists()
        os.kill(listener.pid, signal.SIGKILL)
        listener.wait()
    until = time.monotonic() + 30.0
    while child.exists() and "Z" not in (child / "stat").read_text().rpartition(")")[2][:3]:
        assert time.monotonic() < until
        time.sleep(0.05)


def half_a_minute() -> None:
    numerics.enable()
    inside.FIRST_S = 30.0


def failing() -> None:
    raise OSError("no memory")


def waiting() -> None:
    time.sleep(600.0)
