from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.figures.residuals import binned_mean, figures, memory


def test_autocorrelation_of_one_run_is_the_textbook_sum() -> None:
    run = np.random.default_rng(1).normal(size=200)
    left = run - run.mean()
    expected = [left[: 200 - lag] @ left[lag:] / (left @ left) for lag in range(11)]
    found = memory([run], interval=0.1, reach=1.0)
    np.testing.assert_allclose(found.correlation, expected, atol=1e-12)
    np.testing.assert_allclose(found.lag, np.arange(11) * 0.1)


def test_products_do_not_cross_from_one_run_to_the_next() -> None:
    """Two runs, each constant and opposite: within a run everything is alike."""
    found = memory([np.ones(50), -np.ones(50)], interval=1.0, reach=5.0)
    np.testing.assert_allclose(found.correlation, 1.0 - np.arange(6) / 50.0, atol=1e-12)


def test_white_noise_stays_inside_its_bound_and_counts_in_full() -> None:
    found = memory([np.random.default_rng(2).normal(size=20_000)], interval=0.02, reach=2.0)
    inside = np.abs(found.correlation[1:]) <= found.bound
    # 100 lags, each inside with probability 0.95: below 0.85 has a chance under 1e-4.
    assert inside.mean() > 0.85
    assert found.effective == pytest.approx(20_000, rel=0.05)


def test_a_first_order_sequence_is_worth_what_theory_says() -> None:
    """N (1 - a) / (1 + a) for x(i) = a x(i-1) + white."""
    rng = np.random.default_rng(3)
    rho, count = 0.9, 60_000
    drive = rng.normal(size=count)
    values = np.zeros(count)
    for step in range(1, count):
        values[step] = rho * values[step - 1] + drive[step]
    found = memory([values], interval=0.02, reach=3.0)
    assert found.effective == pytest.approx(count * (1 - rho) / (1 + rho), rel=0.15)


def test_runs_shorter_than_the_reach_are_allowed() -> None:
    found = memory([np.array([1.0, -1.0, 1.0])], interval=1.0, reach=10.0)
    assert found.correlation.shape == (11,)
    np.testing.assert_array_equal(found.correlation[3:], 0.0)


def test_a_residual_of_nothing_but_zeros_has_no_memory() -> None:
    assert memory([np.zeros(10)], interval=1.0, reach=3.0).effective == 10.0


def test_histogram_is_a_density_and_counts_what_lies_beyond(
    samples: dict[str, np.ndarray],
) -> None:
    wild = samples | {"Cm_measured": samples["Cm_measured"] + 100.0}
    for table in (samples, wild):
        bars = figures(table, "Cm", bins=100)[2].panels[0].series[0]
        width = bars.x[1] - bars.x[0]
        assert bars.y.sum() * width == pytest.approx(1.0, rel=1e-9)
    assert bars.y[-1] * width == pytest.approx(1.0, rel=1e-9)


def test_histogram_scores_the_held_out_maneuvers(samples: dict[str, np.ndarray]) -> None:
    off = np.where(samples["held_out"], 0.0, 50.0)
    shown = figures(samples | {"Cm_measured": samples["Cm"] + off}, "Cm", bins=100)[2]
    assert "100 % inside" in shown.caption
    assert "held out" in shown.caption
    nobody = np.zeros_like(samples["held_out"])
    assert "all samples" in figures(samples | {"held_out": nobody}, "Cm", bins=100)[2].caption


def test_every_residual_figure_has_units_and_finite_limits(
    samples: dict[str, np.ndarray],
) -> None:
    shown = figures(samples, "CX", bins=100)
    assert len({figure.name for figure in shown}) == 4
    for figure in shown:
        assert figure.x.unit
        assert np.isfinite(figure.x.limits).all()
        assert np.isfinite(figure.panels[0].y.limits).all()


def test_binned_mean_follows_a_curve() -> None:
    x = np.random.default_rng(4).uniform(-1.0, 1.0, 6000)
    centre, mean, spread = binned_mean(x, 3.0 * x)
    np.testing.assert_allclose(mean, 3.0 * centre, atol=0.05)
    assert (spread < 0.2).all()
