"""Evidence against closed forms and against the dense Gaussian density."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gcs_sysid.diagnose.evidence import Posterior, disputed, gained, information, posterior

RANDOM = np.random.default_rng(7)
COLUMNS = RANDOM.standard_normal((40, 4))
LEFT = RANDOM.standard_normal(40) + COLUMNS @ np.array([0.5, 0.0, -1.0, 0.2])
SIGMA = np.array([1.0, 0.0, 2.0, 0.3])


def test_evidence_is_the_density_of_the_data_under_the_prior() -> None:
    """Relative to that of nothing free, also where the prior's mean is not zero."""
    covariance = np.eye(40) + (COLUMNS * SIGMA**2) @ COLUMNS.T
    fixed = stats.multivariate_normal(np.zeros(40), np.eye(40)).logpdf(LEFT)
    for mean in (np.zeros(4), np.array([0.4, 0.7, 0.0, -0.1])):
        dense = stats.multivariate_normal(COLUMNS @ mean, covariance).logpdf(LEFT)
        found = posterior(information(COLUMNS, LEFT), SIGMA, mean)
        assert found.log_evidence == pytest.approx(dense - fixed, rel=1e-10)


def test_posterior_is_that_of_the_normal_equations() -> None:
    found = posterior(information(COLUMNS, LEFT), SIGMA)
    free = SIGMA > 0.0
    precision = COLUMNS[:, free].T @ COLUMNS[:, free] + np.diag(SIGMA[free] ** -2)
    np.testing.assert_allclose(found.covariance[np.ix_(free, free)], np.linalg.inv(precision))
    np.testing.assert_allclose(
        found.mean[free], np.linalg.solve(precision, COLUMNS[:, free].T @ LEFT)
    )
    assert found.mean[1] == 0.0
    assert found.covariance[1, 1] == 0.0


def test_one_mean_of_known_noise_has_the_textbook_bayes_factor() -> None:
    """n values of mean m: ln B = ½ (n m)² σ²/(1 + n σ²) − ½ ln(1 + n σ²)."""
    left = np.full(25, 0.4)
    data = information(np.ones((25, 1)), left)
    free, fixed = posterior(data, np.array([0.5])), posterior(data, np.array([0.0]))
    spread = 1.0 + 25 * 0.25
    expected = 0.5 * 0.25 * (25 * 0.4) ** 2 / spread - 0.5 * np.log(spread)
    assert free.log_evidence - fixed.log_evidence == pytest.approx(expected, rel=1e-12)


def test_independent_data_add_up() -> None:
    halves = information(COLUMNS[:15], LEFT[:15]).plus(information(COLUMNS[15:], LEFT[15:]))
    whole = information(COLUMNS, LEFT)
    together, once = posterior(halves, SIGMA), posterior(whole, SIGMA)
    assert together.log_evidence == pytest.approx(once.log_evidence, rel=1e-12)


def test_units_of_an_unknown_do_not_matter() -> None:
    scaled = COLUMNS * np.array([10.0, 1.0, 0.1, 1.0])
    other = SIGMA / np.array([10.0, 1.0, 0.1, 1.0])
    first = posterior(information(COLUMNS, LEFT), SIGMA).log_evidence
    second = posterior(information(scaled, LEFT), other).log_evidence
    assert first == pytest.approx(second, rel=1e-12)


def test_another_prior_of_a_few_needs_no_second_posterior() -> None:
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((60, 7)) * np.array([1.0, 30.0, 1e-4, 1.0, 200.0, 1.0, 1.0])
    columns[:, 3] = columns[:, 0] + 1e-3 * columns[:, 3]
    data = information(columns, rng.standard_normal(60) + 0.4 * columns[:, 0])
    before = np.array([0.3, 0.02, 1.0, 0.3, 0.01, 0.0, 0.2])
    base = posterior(data, before)
    for places in ([0], [1, 3], [0, 3, 4], [2]):
        chosen = np.array(places)
        after, mean = before.copy(), np.zeros(7)
        after[chosen], mean[chosen] = 8.0 * before[chosen], 0.5 * before[chosen]
        asked = (before[chosen], chosen, after[chosen], mean[chosen])
        found = gained(base.mean, base.covariance, *asked)
        direct = posterior(data, after, mean).log_evidence - base.log_evidence
        assert float(found) == pytest.approx(direct, rel=1e-6, abs=1e-8)
        # Several at once, of one covariance and of one each.
        means, both = np.stack([base.mean, 0.0 * base.mean]), np.stack(2 * [base.covariance])
        for covariance in (base.covariance, both):
            np.testing.assert_allclose(gained(means, covariance, *asked)[0], found, rtol=1e-12)


def two_that_disagree(off: float) -> tuple[Posterior, np.ndarray]:
    """Believed 0 ± 1, measured `off` ± 1; a second quantity is measured as their sum, ± 0.1."""
    columns = np.array([[1.0, 0.0], [10.0, 10.0]])
    sigma = np.array([1.0, 50.0])
    return posterior(information(columns, np.array([off, 0.0])), sigma), sigma


def test_what_flights_had_to_bend_is_known_less_well_and_so_is_what_hangs_on_it() -> None:
    """Birge's ratio of two measurements: the root of (10 − 0)²/(1 + 1)."""
    found, sigma = two_that_disagree(10.0)
    told = disputed(found, sigma, np.zeros(2), np.array([True, False]))
    ratio = np.sqrt(50.0)
    before, after = (np.sqrt(np.diagonal(one.covariance)) for one in (found, told))
    assert after[0] / before[0] == pytest.approx(ratio, rel=1e-3)
    # The second is minus the first to 0.1, which nobody disputes.
    assert after[1] == pytest.approx(np.hypot(ratio * before[0], 0.1), rel=1e-2)
    np.testing.assert_array_equal(told.mean, found.mean)


def test_what_agrees_or_is_free_to_be_anything_is_as_sure_as_it_was() -> None:
    near, sigma = two_that_disagree(4.0)
    far, _ = two_that_disagree(10.0)
    ordinary = np.array([True, False])
    assert disputed(near, sigma, np.zeros(2), ordinary) is near
    assert disputed(far, sigma, np.zeros(2), np.zeros(2, dtype=bool)) is far
