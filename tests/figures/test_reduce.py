from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gcs_sysid.figures.reduce import (
    broken_at_holes,
    extreme_indices,
    holes,
    limits,
    thin_cloud,
)

values = st.floats(-1e6, 1e6, allow_nan=False)
with_gaps = st.one_of(values, st.just(np.nan))
columns = st.integers(1, 400).flatmap(
    lambda size: st.lists(arrays(float, size, elements=with_gaps), min_size=1, max_size=3)
)


@settings(deadline=None)
@given(columns, st.integers(1, 40))
def test_every_bin_keeps_its_extremes(table: list[np.ndarray], bins: int) -> None:
    kept = extreme_indices(table, bins=bins)
    size = table[0].size
    width = 1 if size <= 2 * bins else -(-size // bins)
    for column in table:
        for start in range(0, size, width):
            part = column[start : start + width]
            shown = column[kept[(kept >= start) & (kept < start + width)]]
            if np.isfinite(part).any():
                assert np.nanmin(shown) == np.nanmin(part)
                assert np.nanmax(shown) == np.nanmax(part)


@settings(deadline=None)
@given(columns, st.integers(1, 40))
def test_kept_indices_are_increasing_bounded_and_hold_the_ends(
    table: list[np.ndarray], bins: int
) -> None:
    kept = extreme_indices(table, bins=bins)
    assert np.all(np.diff(kept) > 0)
    assert kept[0] == 0
    assert kept[-1] == table[0].size - 1
    assert kept.size <= max(2 * bins, bins * 3 * len(table) + 2)


@settings(deadline=None)
@given(arrays(float, st.integers(50, 400), elements=with_gaps), st.integers(1, 20))
def test_a_gap_stays_a_gap(column: np.ndarray, bins: int) -> None:
    kept = column[extreme_indices([column], bins=bins)]
    assert np.isnan(kept).any() == np.isnan(column).any()


def test_few_samples_are_all_kept() -> None:
    assert extreme_indices([np.arange(10.0)], bins=5).tolist() == list(range(10))


def test_reducing_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="must not be empty"):
        extreme_indices([], bins=3)


def test_a_single_spike_in_a_long_record_survives() -> None:
    column = np.zeros(30_000)
    column[17_171] = 1.0
    assert column[extreme_indices([column], bins=500)].max() == 1.0


def test_a_hole_breaks_the_line_and_adds_nothing_else() -> None:
    time = np.array([0.0, 0.1, 0.2, 3.0, 3.1])
    value = np.arange(5.0)
    filled, (broken,) = broken_at_holes(time, (value,))
    assert holes(time).tolist() == [False, False, True, False]
    assert np.isnan(broken).nonzero()[0].tolist() == [3]
    np.testing.assert_array_equal(broken[~np.isnan(broken)], value)
    assert np.all(np.diff(filled) >= 0.0)


def test_a_steady_record_has_no_hole() -> None:
    time = np.arange(0.0, 10.0, 0.02)
    assert not holes(time).any()
    assert broken_at_holes(time, (time,))[0].size == time.size


def test_holes_of_a_single_sample() -> None:
    assert holes(np.zeros(1)).size == 0


@settings(deadline=None)
@given(
    arrays(float, 200, elements=with_gaps),
    arrays(float, 200, elements=with_gaps),
    st.integers(1, 30),
)
def test_a_thinned_cloud_covers_every_occupied_cell(
    x: np.ndarray, y: np.ndarray, cells: int
) -> None:
    kept = thin_cloud(x, y, cells=cells)
    valid = np.isfinite(x) & np.isfinite(y)
    assert kept.size <= cells**2
    assert valid[kept].all()
    assert (kept.size > 0) == valid.any()
    for axis in (x, y):
        if not valid.any():
            continue
        reach = np.ptp(axis[valid]) / cells * (1.0 + 1e-9)
        gaps = np.abs(axis[valid][:, None] - axis[kept][None, :]).min(axis=1)
        assert gaps.max() <= reach


@settings(deadline=None)
@given(st.lists(with_gaps, max_size=60), st.lists(values, max_size=2))
def test_limits_are_finite_ordered_and_around_what_was_asked(
    numbers: list[float], around: list[float]
) -> None:
    low, high = limits(np.array(numbers, dtype=float), around=tuple(around))
    assert np.isfinite([low, high]).all()
    assert low < high
    assert all(low <= value <= high for value in around)


def test_one_wild_sample_does_not_flatten_the_axis() -> None:
    calm = np.sin(np.linspace(0.0, 60.0, 5000))
    low, high = limits(np.append(calm, 1e4))
    assert -2.0 < low < -1.0
    assert 1.0 < high < 2.0
