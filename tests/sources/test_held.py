from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gcs_sysid.sources.held import hold, measured_rows


def slow(count, times, seed=0):
    """Values of `count` measurements, each held for `times` rows."""
    return np.repeat(np.random.default_rng(seed).standard_normal((count, 2)), times, axis=0)


@given(st.integers(2, 60), st.integers(12, 80))
def test_each_held_value_is_kept_once_where_it_first_appears(times, count):
    values = slow(count, times)
    assert hold(values) == times
    assert measured_rows(values).tolist() == list(range(0, count * times, times))


@given(st.integers(0, 2**31), st.integers(1, 6))
def test_no_value_is_lost_whatever_the_stretches(seed, coarse):
    random = np.random.default_rng(seed)
    lengths = random.integers(1, 2 * coarse + 1, 40)
    values = np.repeat(np.arange(40.0), lengths)[:, None]
    rows = measured_rows(values)
    assert np.all(np.diff(rows) > 0)
    assert rows[-1] < values.size
    assert set(values[rows, 0]) == set(range(40))


def test_a_value_measured_at_every_row_stays_although_some_repeat():
    random = np.random.default_rng(1)
    coarse = np.round(random.standard_normal((2000, 1)) * 3.0)
    assert np.mean(np.diff(coarse[:, 0]) == 0.0) > 0.05
    assert measured_rows(coarse).size == 2000


def test_a_sensor_at_rest_keeps_its_rate():
    values = slow(100, 5)
    still = np.repeat(values[:1], 1000, axis=0)
    rows = measured_rows(np.concatenate([still, values]))
    assert rows.tolist() == list(range(0, 1500, 5))


def test_uneven_holding_counts_no_value_twice():
    """40 Hz in a table of 100 Hz: two rows, three rows, in turn."""
    lengths = np.tile([2, 3], 100)
    values = np.repeat(np.random.default_rng(2).standard_normal((200, 1)), lengths, axis=0)
    assert measured_rows(values).tolist() == (np.cumsum(lengths) - lengths).tolist()


def test_a_column_that_hardly_changes_does_not_tell_how_long_it_holds():
    values = np.repeat([[1.0], [2.0]], 500, axis=0)
    assert hold(values) == 1.0
    assert measured_rows(values).size == 1000
