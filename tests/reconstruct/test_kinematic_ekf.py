"""The live filter on filterpy against the scanned one, and its handling of outliers."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
import pytest

from gcs_sysid.model.kinematics import BLOCKS, MEASURED, SIZE
from gcs_sysid.reconstruct.kinematic_ekf import KinematicFilter
from gcs_sysid.reconstruct.observation import NIS_LIMIT
from tests.reconstruct.filtered_example import OUTLIER, ROWS, example, row, smoothed


class History(NamedTuple):
    nis: np.ndarray
    innovation: np.ndarray
    deviation: np.ndarray
    folded: np.ndarray
    end: KinematicFilter


@functools.cache
def history() -> History:
    """The example through the live filter, sample by sample."""
    flight = example()
    live = KinematicFilter(flight.state, flight.covariance, flight.levers, flight.noise)
    nis, innovation, deviation, folded = [], [], [], []
    for index in range(ROWS):
        now = row(flight.inputs, index)
        live.predict((now.before, now.after, float(now.step)))
        live.observe(now.after, now.measured)
        nis.append(live.nis)
        innovation.append(np.asarray(live.y).ravel())
        deviation.append(np.sqrt(np.diagonal(live.P)))
        folded.append(live.x[BLOCKS["attitude"]])
    return History(*(np.array(values) for values in (nis, innovation, deviation, folded)), live)


def test_filterpy_and_the_scan_run_the_same_equations() -> None:
    """560 steps with every kind of message at its own age, a gap and an outlier, to 1e-9."""
    live, scanned = history(), smoothed()
    present = np.isfinite(scanned.nis)
    assert present.any(axis=0).all()
    np.testing.assert_allclose(live.innovation, scanned.innovation, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(live.nis[present], scanned.nis[present], rtol=1e-8)
    # The smoother starts at its end with what the filter has there.
    np.testing.assert_allclose(live.end.attitude, scanned.attitude[-1], atol=1e-9)
    np.testing.assert_allclose(live.end.x, scanned.rest[-1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(live.deviation[-1], scanned.deviation[-1], rtol=1e-7)


def test_the_attitude_error_is_folded_into_the_quaternion() -> None:
    live = history()
    assert (live.folded == 0.0).all()
    assert np.linalg.norm(live.end.attitude) == pytest.approx(1.0, abs=1e-12)


def test_smoothing_narrows_every_band() -> None:
    wider = smoothed().deviation / history().deviation
    assert wider.max() < 1.0 + 1e-6  # rounding of a difference of covariances
    assert np.median(wider[ROWS // 2, BLOCKS["velocity"]]) < 0.9


def test_a_gross_outlier_is_noticed_and_pulls_little() -> None:
    live = history()
    group = list(MEASURED).index("velocity")
    valid = np.asarray(example().inputs.measured.valid)[:, group]
    wrong = OUTLIER + int(np.argmax(valid[OUTLIER:]))
    assert live.nis[wrong, group] > 100.0 * NIS_LIMIT
    others = np.flatnonzero(valid)
    others = others[others != wrong]
    assert np.median(live.nis[others, group]) < NIS_LIMIT
    # Taken at its word it would move the velocity by tens of metres a second.
    after = others[others > wrong][0]
    assert abs(live.innovation[after, MEASURED["velocity"].start]) < 3.0


def test_a_step_that_is_no_step_is_refused() -> None:
    flight = example()
    live = KinematicFilter(flight.state, flight.covariance, flight.levers, flight.noise)
    with pytest.raises(TypeError, match="`u` must be"):
        live.predict()


def test_deviation_names_blocks_of_the_state() -> None:
    flight = example()
    live = KinematicFilter(flight.state, flight.covariance, flight.levers, flight.noise)
    expected = np.sqrt(np.diagonal(flight.covariance))[BLOCKS["wind"]]
    np.testing.assert_allclose(live.deviation("wind"), expected)
    assert live.x.shape == (SIZE,)
