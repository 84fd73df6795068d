from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.estimate import equation_error
from gcs_sysid.estimate.result import CoefficientFit, Prior
from gcs_sysid.estimate.verdict import LAGGING, Verdict, blurred, collinear_with, judge
from tests.estimate.made_problems import KEYS, TRUE, coloured, columns, problem


def fitted(
    matrix: np.ndarray, *, scatter: float = 0.01, error: np.ndarray | None = None
) -> CoefficientFit:
    generator = np.random.default_rng(100)
    measured = matrix @ TRUE + scatter * coloured(generator, len(matrix), 0.9)
    return equation_error.solve(problem(matrix, measured, error=error), None)


@pytest.fixture
def matrix() -> np.ndarray:
    return columns(np.random.default_rng(101), 3000)


def test_a_well_flown_term_is_known_and_needs_no_reason(matrix: np.ndarray) -> None:
    verdict = judge(fitted(matrix, scatter=0.002), KEYS.index("elevator"), None)
    assert (verdict.answer, verdict.reason) == ("yes", "")


def test_terms_that_moved_together_are_named_with_their_correlation(matrix: np.ndarray) -> None:
    tied = matrix.copy()
    tied[:, 2] = 0.05 * matrix[:, 1] + 0.0005 * matrix[:, 2] / 0.003
    fit = fitted(tied, scatter=0.05)
    correlation = float(np.corrcoef(tied[:, 1], tied[:, 2])[0, 1])
    assert correlation > 0.9
    partner = collinear_with(fit, KEYS.index("qhat"))
    assert partner is not None
    assert partner[0] == "alpha"
    assert partner[1] == pytest.approx(correlation, abs=1e-12)
    verdict = judge(fit, KEYS.index("qhat"), None)
    assert verdict.answer == "weak"
    assert verdict.reason == f"qhat moved together with alpha (correlation {correlation:+.2f})"


def test_correlation_is_the_textbook_one(matrix: np.ndarray) -> None:
    expected = np.corrcoef(matrix[:, 1:].T)
    assert fitted(matrix).correlation[1:, 1:] == pytest.approx(expected, abs=1e-12)
    assert np.all(fitted(matrix).correlation[0] == 0.0)


def test_a_control_that_hardly_moved_is_named(matrix: np.ndarray) -> None:
    still = matrix.copy()
    still[:, 3] *= 0.01
    verdict = judge(fitted(still, scatter=0.02), KEYS.index("elevator"), None)
    assert verdict.answer == "weak"
    assert verdict.reason.startswith("elevator hardly moved: ")


def test_errors_of_the_flow_are_named_where_they_are_the_largest_part(matrix: np.ndarray) -> None:
    error = np.array([0.0, (0.8 * 0.05) ** 2, 0.0, 0.0])
    verdict = judge(fitted(matrix, scatter=0.002, error=error), KEYS.index("alpha"), None)
    assert verdict.answer == "no"
    assert verdict.reason.startswith("gusts: ")


def test_a_model_is_blurred_where_many_slopes_are(matrix: np.ndarray) -> None:
    clear = fitted(matrix, scatter=0.002)
    error = (np.array([0.0, 0.8, 0.8, 0.8]) * matrix.std(axis=0)) ** 2
    unclear = fitted(matrix, scatter=0.002, error=error)
    assert blurred([unclear])
    assert blurred([clear, unclear])
    assert not blurred([clear, clear, unclear])
    weak = fitted(matrix, scatter=0.002, error=error / 4.0)
    assert [judge(weak, index, None).answer for index in (1, 2, 3)] == ["weak"] * 3
    assert blurred([weak])
    assert not blurred([fitted(matrix, scatter=0.002, error=error / 16.0)])


def test_wrong_mass_properties_are_named_where_they_are_the_largest_part(
    matrix: np.ndarray,
) -> None:
    measured = matrix @ TRUE
    stated = problem(
        matrix, measured, systematic=np.stack([measured, 0 * measured], 1), sigma=(0.3, 0.0)
    )
    verdict = judge(equation_error.solve(stated, None), KEYS.index("alpha"), None)
    assert verdict.answer == "weak"
    assert verdict.reason == "mass, inertia or thrust are not known well enough"


def test_the_lag_is_named_where_it_is_the_largest_part(matrix: np.ndarray) -> None:
    fit, row = fitted(matrix, scatter=0.002), KEYS.index("alpha")
    lag = np.zeros(len(KEYS))
    lag[row] = 0.3 * abs(fit.value[row])
    late = replace(fit, deviations={**fit.deviations, "lag": lag})
    assert judge(late, row, None) == Verdict("weak", LAGGING)
    assert judge(fit, row, None).answer == "yes"


def test_too_short_a_flight_is_said_to_be_short(matrix: np.ndarray) -> None:
    verdict = judge(fitted(matrix[:150], scatter=0.05), KEYS.index("qhat"), None)
    assert verdict.answer != "yes"
    assert verdict.reason == "too short or too noisy"


@pytest.mark.parametrize(("ratio", "answer"), [(0.14, "yes"), (0.16, "weak"), (0.51, "no")])
def test_answers_turn_where_they_are_said_to(matrix: np.ndarray, ratio: float, answer: str) -> None:
    """15 % of the value is known, 50 % is the end of weak."""
    fit = fitted(matrix)
    size = abs(float(fit.value[1]))
    stated = replace(fit, deviations={"noise": np.full(4, ratio * size), "scale": np.zeros(4)})
    assert judge(stated, 1, None).answer == answer


def test_a_term_known_to_be_small_beside_what_is_believed_is_known(matrix: np.ndarray) -> None:
    """A flight that says "0 ± 0.05" of a derivative believed to be −0.8 has answered."""
    fit = fitted(matrix)
    small = replace(
        fit, value=np.full(4, 0.001), deviations={"noise": np.full(4, 0.05), "scale": np.zeros(4)}
    )
    assert judge(small, 1, None).answer == "no"
    assert judge(small, 1, -0.8).answer == "yes"


def test_the_prior_does_not_count_as_the_flight_knowing(matrix: np.ndarray) -> None:
    """A firm prior narrows the deviation of the value, not what the flight itself determined."""
    still = matrix.copy()
    still[:, 3] *= 0.01
    measured = still @ TRUE + 0.02 * coloured(np.random.default_rng(102), 3000, 0.9)
    fit = equation_error.solve(
        problem(still, measured), Prior({"elevator": -0.85}, {"elevator": 0.01})
    )
    assert fit.deviation[3] < 0.011
    assert judge(fit, 3, -0.85).answer == "no"
