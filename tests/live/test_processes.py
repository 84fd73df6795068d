"""Gaussian processes beside the flight: what they know, what not, and going on with them."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.gp import refresh
from gcs_sysid.gp.refresh import Settings
from gcs_sysid.live import processes
from gcs_sysid.live.processes import Processes
from gcs_sysid.live.regression import UNCERTAIN
from gcs_sysid.regressors import VARIABLES

ROOT = Path(__file__).resolve().parents[2]
ROWS, STEP, NOISE, FLOW = 32, 0.02, 0.01, 0.002
KEPT = slice(0, ROWS)
EVERY = 8
"""Rows from one that is learned from to the next, at 50 Hz."""
ENOUGH_S = 120.0


@pytest.fixture(scope="module")
def aircraft() -> Aircraft:
    return aircraft_file.load(ROOT / "data/aircraft/ultra_stick_25e.toml")


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A learning that takes a second, not ten."""
    few = Settings(points=48, rows=160, scaffold=8, candidates=60, starts=1, steps=20)
    monkeypatch.setattr(processes, "SETTINGS", few)
    monkeypatch.setattr(processes, "FIRST", 160)


def flow(aircraft: Aircraft, random: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    """Flow and deflections around a trim; what the processes do not use is constant."""
    values = {name: np.zeros(count) for name in VARIABLES}
    for name in (*UNCERTAIN, *aircraft.control_names):
        values[name] = random.normal(0.0, 0.04, count)
    values["alpha"] = random.uniform(-0.05, 0.15, count)
    return values


def truth(values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Not a polynomial, and no two outputs alike."""
    lift = np.tanh(6.0 * values["alpha"])
    return {name: (1.0 + row) * 0.1 * lift for row, name in enumerate(COEFFICIENTS)}


def windows(aircraft: Aircraft, count: int, *, only: tuple[str, ...] = COEFFICIENTS) -> Iterator:
    """Windows of 32 rows with what their flow errors add."""
    random = np.random.default_rng(3)
    for number in range(count):
        values = flow(aircraft, random, ROWS)
        measured = {
            name: value + random.normal(0.0, NOISE, ROWS)
            for name, value in truth(values).items()
            if name in only
        }
        window = Samples(
            time=STEP * (ROWS * number + np.arange(ROWS)),
            qbar=np.full(ROWS, 200.0),
            regressors=values,
            regressor_variance={},
            measured=measured,
            noise={name: np.full(ROWS, NOISE) for name in measured},
            mass_part={name: np.zeros(ROWS) for name in measured},
            thrust_part={name: np.zeros(ROWS) for name in measured},
            smoothing=1.0,
            refused={},
        )
        small = np.full((len(UNCERTAIN), ROWS), FLOW**2)
        yield window, dict.fromkeys(measured, small)


def taught(found: Processes, aircraft: Aircraft, count: int = 60, **only: tuple) -> Processes:
    """After so many windows, and whatever learning they began."""
    for window, variance in windows(aircraft, count, **only):
        found.take(window, KEPT, variance)
        until = time.monotonic() + ENOUGH_S
        while found.phase == "learning" and not found._coming.done():
            assert time.monotonic() < until
            time.sleep(0.01)
    return found


@pytest.fixture
def known(aircraft: Aircraft) -> Iterator[Processes]:
    found = taught(Processes(aircraft, believing=False), aircraft)
    yield found
    found.close()


@pytest.mark.parametrize("rate", [10.0, 25.0, 50.0, 60.0, 100.0, 140.0])
def test_six_rows_a_second_are_learned_from_however_fast_they_come(
    aircraft: Aircraft, rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One in eight rows was, which at 100 Hz cost twice the time."""
    monkeypatch.setattr(processes, "FIRST", 10_000)
    found = Processes(aircraft, believing=False)
    for number, (window, variance) in enumerate(windows(aircraft, int(20.0 * rate / ROWS))):
        # A clock on which nothing falls together exactly.
        time = 1e5 + (ROWS * number + np.arange(ROWS)) / rate
        found.take(replace(window, time=time), KEPT, variance)
    times = np.concatenate([part.time for part in found._waiting])
    assert np.all(np.abs(np.diff(times) - processes.PERIOD_S) < 0.5 / rate)
    assert np.ptp(times) > 18.0


def test_they_foretell_what_they_have_not_seen_within_their_intervals(
    known: Processes, aircraft: Aircraft
) -> None:
    assert known.phase == "known"
    assert known.count == 60 * ROWS // EVERY
    values = flow(aircraft, np.random.default_rng(9), 64)
    found, true = known.at(values), truth(values)
    assert found is not None
    off = np.concatenate([(found.value[name] - true[name]) for name in COEFFICIENTS])
    sd = np.concatenate([found.deviation[name] for name in COEFFICIENTS])
    assert 0.9 < np.mean(np.abs(off) < 1.96 * sd) <= 1.0
    assert np.sqrt(np.mean(off**2)) < 0.2 * np.std(np.concatenate(list(true.values())))


def test_where_nothing_was_flown_they_say_so(known: Processes, aircraft: Aircraft) -> None:
    here, far = (flow(aircraft, np.random.default_rng(9), 1) for _ in range(2))
    far["beta"] = np.array([1.5])
    near, away = known.at(here), known.at(far)
    assert near is not None
    assert away is not None
    for name in COEFFICIENTS:
        assert away.lack[name][0] > 3.0 * near.lack[name][0]
        # Beside what more flight would tell stand lasting errors of both flow angles, in full.
        rest = near.deviation[name] ** 2 - near.lack[name] ** 2
        np.testing.assert_allclose(rest, 2.0 * FLOW**2, rtol=1e-6)


def test_the_mean_is_the_simulation_of_the_file(aircraft: Aircraft) -> None:
    """Far from all that was flown the file is believed again."""
    values = flow(aircraft, np.random.default_rng(9), 1)
    values["beta"] = np.array([40.0])
    found = taught(Processes(aircraft, believing=True), aircraft, 50)
    away = found.at(values)
    found.close()
    assert away is not None
    simulated = sum(
        item.value * (values["beta"] if key == "beta" else 0.0)
        for key, item in aircraft.aerodynamics["CY"].terms.items()
        if key == "beta"
    )
    assert away.value["CY"][0] == pytest.approx(float(simulated[0]), rel=0.01)


def test_a_coefficient_that_is_not_measured_is_not_told(aircraft: Aircraft) -> None:
    found = taught(Processes(aircraft, believing=False), aircraft, 50, only=("Cl", "Cm", "Cn"))
    here = found.at(flow(aircraft, np.random.default_rng(9), 1))
    found.close()
    assert here is not None, found.phase
    assert set(here.value) == {"Cl", "Cm", "Cn"}


@pytest.mark.parametrize("count", [20, 60])
def test_they_go_on_as_they_were_kept(aircraft: Aircraft, count: int) -> None:
    """Before the first learning the samples are kept, after it what they taught."""
    first = taught(Processes(aircraft, believing=False), aircraft, count)
    again = Processes(aircraft, believing=False)
    assert again.restore(first.state())
    assert (again.phase, again.count) == (first.phase, first.count)
    # What was learned beyond nothing says nothing beyond the file's simulation.
    other = Processes(aircraft, believing=True)
    assert not other.restore(first.state())
    assert (other.phase, other.count) == ("collecting", 0)
    values = flow(aircraft, np.random.default_rng(9), 8)
    for one in (first, again):
        one.close()
    before, after = first.at(values), again.at(values)
    assert (before is None) == (count == 20)
    if before is not None:
        assert after is not None
        for name in COEFFICIENTS:
            np.testing.assert_allclose(after.value[name], before.value[name], atol=1e-9)
            np.testing.assert_allclose(after.deviation[name], before.deviation[name], rtol=1e-6)


def test_what_a_learning_takes_is_kept_until_it_has_ended(
    aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed meanwhile, the samples of the first minute would be gone."""
    held = threading.Event()
    learn = refresh.based_on

    def slow(*given: object) -> object:
        held.wait(ENOUGH_S)
        return learn(*given)

    monkeypatch.setattr(refresh, "based_on", slow)
    found = Processes(aircraft, believing=False)
    for window, variance in windows(aircraft, 60):
        found.take(window, KEPT, variance)
    assert found.phase == "learning"
    again = Processes(aircraft, believing=False)
    again.restore(found.state())
    assert again.count == found.count == 60 * ROWS // EVERY
    held.set()
    found._coming.result(ENOUGH_S)
    assert taught(found, aircraft, 1).count == 61 * ROWS // EVERY
    assert found.phase == "known"
    found.close()


def test_what_does_not_fit_is_refused(known: Processes, aircraft: Aircraft) -> None:
    kept = known.state()
    for name, wrong in (
        ("centre", np.zeros(3)),
        ("matrix", np.full_like(kept["processes.matrix"], np.nan)),
        ("lasting", np.zeros(2)),
    ):
        with pytest.raises(ValueError, match="do not fit"):
            Processes(aircraft, believing=False).restore({**kept, f"processes.{name}": wrong})


def test_a_learning_that_fails_is_told_and_ends_nothing(
    aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise FloatingPointError("no covariance")

    monkeypatch.setattr(refresh, "based_on", broken)
    found = taught(Processes(aircraft, believing=False), aircraft, 60)
    assert found.phase == "failed: FloatingPointError: no covariance"
    told = processes.document(found, flow(aircraft, np.random.default_rng(9), 1))
    assert told["coefficients"] == {}


def test_memory_does_not_grow_and_kernel_and_points_are_learned_anew(
    aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, "STORE", 200)
    found = taught(Processes(aircraft, believing=False), aircraft, 60)
    assert found._known is not None
    before = found._known.held.learner.base
    for window, variance in windows(aircraft, 60):
        found.take(replace(window, time=window.time + 60.0), KEPT, variance)
    found._known.held.close()
    after = found._known.held.learner
    assert after.base is not before
    assert after.count == 120 * ROWS // EVERY
    assert after.store.kept.drawn.size == 200
    assert found._waiting == []


def test_what_a_learning_took_is_given_back(
    aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the first, and after each that follows."""
    given: list[int] = []
    monkeypatch.setattr(processes.heap, "give_back", lambda: given.append(1))
    found = taught(Processes(aircraft, believing=False), aircraft, 50)
    assert found.phase == "known"
    until = time.monotonic() + ENOUGH_S
    for window, variance in windows(aircraft, 600):
        found.take(window, KEPT, variance)
        if len(given) == 2:
            break
        assert time.monotonic() < until
        time.sleep(0.01)
    found.close()
    assert len(given) == 2
