"""Stretches of a flight."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.estimate import flight_rows
from tests.estimate import made_flight as made


@pytest.fixture(scope="module")
def flight() -> flight_rows.Flight:
    """Controls at rest but for one command and its end, two thirds of the way."""
    whole = made.made_flight()
    controls = np.zeros_like(np.asarray(whole.rows.controls))
    begin = 2 * len(controls) // 3
    controls[begin : begin + 20] = 0.1
    return flight_rows.Flight(
        whole.rows._replace(controls=controls), whole.nominal, whole.beginning
    )


def test_no_longer_than_that_it_is_the_flight_itself(flight: flight_rows.Flight) -> None:
    counts = np.ones(flight.rows.step.shape[0], dtype=bool)
    assert flight_rows.busiest(flight, counts)[0] is flight


def test_the_stretch_holds_the_command(flight: flight_rows.Flight) -> None:
    size = flight.rows.step.shape[0]
    counts = np.arange(size) >= 2 * size // 3
    part, kept = flight_rows.busiest(flight, counts, size // 4)
    assert part.rows.step.shape == kept.shape == (size // 4,)
    moved = np.asarray(part.rows.controls)[:, 0, 0]
    assert moved.max() == 0.1
    assert moved[0] == moved[-1] == 0.0
    # Rows count as they did where they came from: the command began where they do.
    assert np.flatnonzero(kept)[0] == np.flatnonzero(moved)[0]
    assert part.rows.step[0] == 0.0


def test_stretches_differ_by_half_and_the_liveliest_is_first(flight: flight_rows.Flight) -> None:
    size = flight.rows.step.shape[0]
    numbered = flight_rows.Flight(
        flight.rows._replace(passing=np.arange(size, dtype=float)),
        flight.nominal,
        flight.beginning,
    )
    length = size // 5
    parts = list(flight_rows.busy(numbered, np.ones(size, dtype=bool), length))
    begins = np.array([int(part.rows.passing[0]) for part, _ in parts])
    assert len(parts) >= 5
    assert np.diff(np.sort(begins)).min() >= length // 2
    moved = [np.ptp(np.asarray(part.rows.controls)[:, 0, 0]) > 0.0 for part, _ in parts]
    assert moved[0]
    assert not all(moved)


def test_states_are_found_after_a_while_and_so_again_where_they_were_lost(
    flight: flight_rows.Flight,
) -> None:
    size, step = 1200, np.full(1200, 0.02)
    step[0] = 0.0
    blind, unbelieved = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
    blind[300:325] = blind[600:900] = blind[910:920] = True  # half a second, six, and a fifth
    unbelieved[450:550] = True  # its sensors lead it
    rows = flight.rows._replace(step=step, modelled=~(blind | unbelieved), inertial=~blind)
    found = flight_rows.Flight(rows, flight.nominal, flight.beginning).found
    # Two seconds after the beginning, and after the second, of which the first is not lost yet.
    changes = np.flatnonzero(np.diff(found.astype(int))) + 1
    np.testing.assert_allclose(changes, [100, 650, 1000], atol=1)


def test_where_nothing_is_flown_blind_nothing_is_lost_later(flight: flight_rows.Flight) -> None:
    silent = np.arange(len(flight.rows.step)) % 5 != 0
    rows = flight.rows._replace(modelled=np.ones_like(silent), inertial=~silent)
    found = flight_rows.Flight(rows, flight.nominal, flight.beginning).found
    passed = np.cumsum(rows.step) >= flight_rows.FINDING
    np.testing.assert_array_equal(found, passed)
    assert 0 < passed.sum() < passed.size
