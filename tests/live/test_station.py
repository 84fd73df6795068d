"""A station that falls behind, loses data, or hears two vehicles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.live import station as stations
from gcs_sysid.live.document import Outside, document
from gcs_sysid.live.inside_known import Fed, Known, Newest
from gcs_sysid.live.regression import RunningModel, Solution
from gcs_sysid.live.station import Compiled, Station
from gcs_sysid.live.warming import _flight
from gcs_sysid.model.kinematics import BLOCKS
from gcs_sysid.recording import NO_AUTOPILOT, Vehicle
from gcs_sysid.sources.samples import Sample
from tests.live.flown import sure

PART_S = 6.5


def made(aircraft: Aircraft, *, hole: tuple[float, float] = (0.0, 0.0)) -> Iterator[Sample]:
    """A made-up flight, without the samples of a hole [s]."""
    for sample in _flight(aircraft):
        if not hole[0] <= sample.time_us * 1e-6 < hole[1]:
            yield sample


def flown(aircraft: Aircraft, compiled: Compiled, late_us: int = 0, **hole: object) -> Station:
    """A station after the made-up flight; its clock is `late_us` behind each arrival."""
    station = Station(aircraft, compiled, prior=None, vehicle=None, clock_us=lambda: late_us)
    station.take(made(aircraft, **hole))
    station.work(2**62)
    assert station.idle
    return station


@pytest.fixture(scope="module")
def steady(aircraft: Aircraft, compiled: Compiled) -> Station:
    return flown(aircraft, compiled)


def test_the_made_flight_goes_through_everything(steady: Station) -> None:
    """What compiles must reach all that is compiled, or the first window would stall a flight."""
    assert steady.samples is not None
    assert set(steady.samples.measured) == {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
    assert steady.phase() == "waiting for data"  # made samples come without a heartbeat
    assert steady.newest is not None
    speed = np.hypot(*steady.newest.rest[BLOCKS["velocity"]][:2])
    assert steady.newest.flow[0] == pytest.approx(speed, abs=1.0)


def test_a_second_behind_every_other_sample_is_left_out(
    aircraft: Aircraft, compiled: Compiled, steady: Station
) -> None:
    late = flown(aircraft, compiled, late_us=2_000_000)
    assert late.rows.decimated == pytest.approx(steady.updates / 2, rel=0.4)
    assert late.updates == pytest.approx(steady.updates / 2, rel=0.2)
    assert late.filter.restarts == 0
    assert late.newest is not None
    np.testing.assert_allclose(late.newest.flow[0], steady.newest.flow[0], atol=0.5)


def test_what_is_too_old_is_not_filtered_but_counted(
    aircraft: Aircraft, compiled: Compiled, steady: Station
) -> None:
    lost = flown(aircraft, compiled, late_us=5_000_000)
    assert lost.updates == 0
    assert lost.skipped > steady.updates


def test_what_is_too_old_for_the_filter_flies_none_the_less(
    aircraft: Aircraft, compiled: Compiled
) -> None:
    """A short flight that ended while the filter was compiled was said to be on the ground,

    where `inspect` found it airborne in the recording.
    """
    lost = flown(aircraft, compiled, late_us=5_000_000)
    lost.decoder.vehicle = Vehicle(1, 1, NO_AUTOPILOT, "MAV_TYPE_FIXED_WING", 1)
    assert lost.phase() == "flying, the filter is behind"


def test_a_hole_begins_attitude_and_velocity_anew_and_keeps_the_wind(
    aircraft: Aircraft, compiled: Compiled, steady: Station
) -> None:
    hole = flown(aircraft, compiled, hole=(5.5, 6.2))
    assert hole.filter.restarts == 1
    assert hole.newest is not None
    assert steady.newest is not None
    wind = BLOCKS["wind"]
    apart = hole.newest.rest[wind] - steady.newest.rest[wind]
    assert np.all(np.abs(apart) < 2.0 * hole.newest.deviation[wind])
    assert np.all(hole.newest.deviation[wind][:2] < 7.0)
    assert hole.newest.flow[0] == pytest.approx(steady.newest.flow[0], abs=0.5)


def test_samples_wait_in_bounded_memory(
    aircraft: Aircraft, compiled: Compiled, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stations, "WAITING", 100)
    station = Station(aircraft, compiled, prior=None, vehicle=None, clock_us=lambda: 0)
    station.take(made(aircraft))
    assert len(station._waiting) == 100
    assert station.skipped > 100


def test_learning_that_fails_leaves_states_alone(
    aircraft: Aircraft, compiled: Compiled, steady: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One matrix that could not be solved ended the recording."""

    def broken(*_given: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(RunningModel, "take", broken)
    station = flown(aircraft, compiled)
    assert station.updates == steady.updates
    assert station.filter.restarts == 0
    assert station.failures.count > 0
    (told,) = station.failures.told()
    assert told.what.startswith("learning")


def test_a_window_without_numbers_teaches_nothing(steady: Station) -> None:
    """It would stay in every sum, and nothing could be solved any more."""
    assert steady.samples is not None
    empty = {**steady.samples.measured, "Cm": np.full_like(steady.samples.time, np.nan)}
    before = {name: np.array(one) for name, one in steady.model.state().items()}
    with pytest.raises(FloatingPointError, match="Cm not finite"):
        steady._learn(replace(steady.samples, measured=empty))
    for name, one in steady.model.state().items():
        np.testing.assert_array_equal(one, before[name])


class Knowing:
    """A filter that knows its derivatives at every row it is fed."""

    def __init__(self, derivatives: Mapping[str, Solution]) -> None:
        self.known = Known(derivatives=derivatives)

    def take(self, fed: Fed) -> None:
        newest = Newest(float(fed.batch.time[-1]), np.array([20.0, 0.1, 0.0]), np.full(3, 0.1))
        self.known = self.known._replace(phase="known", newest=newest)

    def restore(self, _state: Mapping[str, np.ndarray]) -> None:
        pytest.fail("nothing was to restore")


@pytest.mark.parametrize("ratio", [0.5, 1.0])
def test_what_the_filter_inside_knows_says_what_departs_and_why(
    aircraft: Aircraft, compiled: Compiled, ratio: float
) -> None:
    """Kinematics of a made-up flight, which no aerodynamics flew, say nothing of it any more."""
    aircraft, derivatives = sure(aircraft, 0.05), {}
    for name, model in aircraft.aerodynamics.items():
        value = np.array(
            [one.value * (ratio if key == "elevator" else 1.0) for key, one in model.terms.items()]
        )
        spread = np.diag((0.02 * np.abs(value) + 1e-5) ** 2)
        derivatives[name] = Solution(tuple(model.terms), value, spread)
    inside = Knowing(derivatives)
    station = Station(
        aircraft, compiled, prior=None, vehicle=None, clock_us=lambda: 0, inside=inside
    )
    station.take(made(aircraft))
    station.work(2**62)
    told = document(station, Outside(link="", phase=""))
    assert told["derivatives_by"] == "inside the filter"
    if ratio == 1.0:
        assert told["departures"] == {}
        assert told["causes"] == []
        return
    assert told["departures"]["Cm"]["derivative"] == "elevator"
    assert told["departures"]["Cm"]["size"] == pytest.approx(
        (ratio - 1.0) * aircraft.aerodynamics["Cm"].terms["elevator"].value
    )
    (cause,) = told["causes"]
    assert (cause["cause"], cause["about"]) == ("surface_effectiveness", "elevator")
    assert cause["size"] == pytest.approx(ratio - 1.0, abs=3.0 * cause["sd"])
