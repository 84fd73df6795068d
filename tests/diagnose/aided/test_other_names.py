"""An airspeed that lags and one that is late: the same cause by its other name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.diagnose.aided import unknowns
from gcs_sysid.diagnose.aided.other_names import gathered, renamed, unnamed
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate

NAMES = ("departures.mass", "sensors.airspeed_lag", "sensors.airspeed_delay")
QUANTITIES = {
    "mass": {"departures.mass": 1.0},
    "airspeed_lag": {"sensors.airspeed_lag": 1.0},
    "skew.AIRSPEED": {"sensors.airspeed_delay": 1.0},
}
MASS, LAG = Candidate(CAUSES["mass"]), Candidate(CAUSES["pitot_lag"])
LATE = Candidate(CAUSES["time_skew"], "AIRSPEED")
EVERY = (MASS, LAG, LATE)


def listed() -> unknowns.Unknowns:
    ordinary, usual = np.full(3, 0.01), dict.fromkeys(QUANTITIES, 1e-4)
    found = unknowns.of_flights(NAMES, ordinary, QUANTITIES, usual, {"": 1.0}, 1, np.zeros(3))
    return replace(found, either=frozenset({frozenset({"airspeed_lag", "skew.AIRSPEED"})}))


def values(every: unknowns.Unknowns, **known: float) -> np.ndarray:
    return np.array([known.get(name.rpartition(".")[2], 0.0) for name in every.names])


def test_what_was_late_lags_by_all_that_it_was_late() -> None:
    every = listed()
    found = renamed((MASS, LATE), values(every, AIRSPEED=0.12, airspeed_delay=0.02), every, EVERY)
    assert found is not None
    assert found.causes == (MASS, LAG)
    assert found.other is LAG
    expected = values(every, airspeed_lag=0.0)
    expected[every.names.index("airspeed_lag")] = 0.14
    np.testing.assert_allclose(found.values, expected)


def test_and_the_other_way_round() -> None:
    every = listed()
    before = values(every)
    before[every.names.index("airspeed_lag")] = 0.2
    found = renamed((LAG,), before, every, EVERY)
    assert found is not None
    assert found.causes == (LATE,)
    assert found.values[every.names.index("skew.AIRSPEED")] == pytest.approx(0.2)
    assert np.count_nonzero(found.values) == 1


def test_all_of_an_effect_goes_under_the_name_that_is_free() -> None:
    """Mass stays; a lag that was shared with an ordinary delay has all of it, or the other way.

    The other name is not free then.
    """
    every = listed()
    moved = np.array([0.3, 0.13, 0.07])
    np.testing.assert_allclose(gathered((MASS, LAG), moved, every, 0), [0.3, 0.2, 0.0])
    np.testing.assert_allclose(gathered((LATE,), moved, every, 0), [0.3, 0.0, 0.2])
    np.testing.assert_array_equal(unnamed((MASS, LAG), every, 0), [False, False, True])
    np.testing.assert_array_equal(unnamed((LATE,), every, 0), [False, True, False])


def test_a_delay_that_a_cause_sets_free_is_not_shared_with_the_ordinary_one() -> None:
    """Half of 0.1 s stayed with the ordinary delay, and the throttle was half as late."""
    names = ("departures.mass", "departures.actuators.0", "sensors.surface_delay")
    quantities = {
        "mass": {"departures.mass": 1.0},
        "skew.SERVO.0.07": {"departures.actuators.0": 1.0},
    }
    usual = dict.fromkeys(quantities, 1e-4)
    found = unknowns.of_flights(
        *(names, np.full(3, 0.01), quantities, usual, {"": 1.0}, 1, np.zeros(3)),
        beside={"skew.SERVO.0.07": "sensors.surface_delay"},
    )
    late = Candidate(CAUSES["time_skew"], "SERVO", 0.07)
    assert late.frees == ("skew.SERVO.0.07",)
    moved = np.array([0.3, 0.05, 0.049])
    np.testing.assert_allclose(gathered((MASS, late), moved, found, 0), [0.3, 0.099, 0.0])
    np.testing.assert_array_equal(gathered((MASS,), moved, found, 0), moved)


def test_nothing_is_gathered_where_nothing_goes_by_another_name() -> None:
    every, moved = listed(), np.array([0.3, 0.13, 0.07])
    np.testing.assert_array_equal(gathered((MASS,), moved, every, 0), moved)
    assert not unnamed((MASS,), every, 0).any()


def test_what_has_one_name_only_has_no_other() -> None:
    every = listed()
    assert renamed((MASS,), values(every), every, EVERY) is None
    assert renamed((), values(every), every, EVERY) is None
