from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcs_sysid.estimate import equation_error
from gcs_sysid.estimate.verdict import LAGGING
from gcs_sysid.offline import advice
from tests.estimate.made_problems import TRUE, columns, problem

CONTROLS = ("elevator", "aileron", "rudder")


def entry(verdict: str, reason: str) -> dict[str, Any]:
    return {"verdict": verdict, "reason": reason}


def told(key: str, reason: str, verdict: str = "no") -> dict[str, str]:
    (only,) = advice.cannot_tell({"Cm": {key: entry(verdict, reason)}}, {}, CONTROLS)
    return only


def test_refusals_come_first_then_what_is_unknown_then_what_is_weak() -> None:
    derivatives = {
        "Cm": {"alpha": entry("weak", "too short or too noisy"), "qhat": entry("yes", "")},
        "Cl": {"beta": entry("no", "beta hardly moved: 1 % of the variation")},
    }
    listed = advice.cannot_tell(derivatives, {"CX": "no accelerometer"}, CONTROLS)
    assert [item["what"] for item in listed] == ["CX", "Cl_beta", "Cm_alpha"]
    assert listed[0]["why"] == "no accelerometer"


def test_what_is_known_and_the_constants_are_not_listed() -> None:
    derivatives = {"Cm": {"1": entry("no", "too short"), "alpha": entry("yes", "")}}
    assert advice.cannot_tell(derivatives, {}, CONTROLS) == []


@pytest.mark.parametrize(
    ("key", "reason", "word"),
    [
        ("elevator", "elevator hardly moved: 0 % of the variation", "multisine or 3-2-1-1 on the"),
        ("alpha*elevator", "too short or too noisy", "on the elevator"),
        ("alpha", "alpha moved together with qhat (correlation +0.95)", "3-2-1-1 inputs"),
        ("beta", "too short or too noisy", "sideslips"),
        ("phat", "too short or too noisy", "aileron doublets"),
        ("rhat", "too short or too noisy", "rudder doublets"),
        ("qhat", "too short or too noisy", "50 Hz"),
        ("h_over_b", "h_over_b hardly moved: 0 % of the variation", "h_over_b varies"),
        ("alpha", "gusts: the flow was not measured well enough", "calm air"),
        ("elevator", "mass, inertia or thrust are not known well enough", "weigh the aircraft"),
        ("elevator", LAGGING, "which no flight betters"),
    ],
)
def test_the_maneuver_fits_the_term_and_the_reason(key: str, reason: str, word: str) -> None:
    item = told(key, reason)
    assert item["what"] == f"Cm_{key}"
    assert item["why"] == reason
    assert word in item["fly"]


def test_terms_with_one_reason_and_one_remedy_share_an_entry() -> None:
    why = "gusts: the flow was not measured well enough"
    derivatives = {
        "Cm": {"alpha": entry("no", why), "elevator": entry("no", why)},
        "CZ": {"alpha": entry("no", why)},
    }
    (only,) = advice.cannot_tell(derivatives, {}, CONTROLS)
    assert only["what"] == "Cm_alpha, Cm_elevator, CZ_alpha"


def test_pairs_that_moved_together_are_warned_of_once() -> None:
    matrix = columns(np.random.default_rng(1), 3000)
    matrix[:, 2] = 0.05 * matrix[:, 1] + 0.0002 * matrix[:, 2] / 0.003
    fit = equation_error.solve(problem(matrix, matrix @ TRUE), None)
    (warning,) = [line for line in advice._collinear("Cm", fit) if "together" in line]
    correlation = np.corrcoef(matrix[:, 1], matrix[:, 2])[0, 1]
    assert warning.startswith(f"Cm: alpha and qhat moved together (correlation {correlation:+.2f}")


@pytest.mark.parametrize(("independent", "warned"), [(19.0, True), (21.0, False)])
def test_too_few_independent_samples_are_warned_of(independent: float, warned: bool) -> None:
    """Fewer than five for each of four terms."""
    matrix = columns(np.random.default_rng(2), 500)
    fit = equation_error.solve(problem(matrix, matrix @ TRUE), None)
    fit = replace(fit, effective_samples=independent)
    lines = advice._collinear("Cm", fit)
    assert any("only about 19 independent samples for 4 terms" in line for line in lines) == warned
