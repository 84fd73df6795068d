from __future__ import annotations

import pytest

from gcs_sysid.report import labels


@pytest.mark.parametrize(
    ("key", "shown"),
    [
        ("1", "constant"),
        ("alpha^2", "α²"),
        ("alpha*elevator", "α·elevator"),
        ("max(0, alpha - 0.12)", "max(0, α \u2212 0.12)"),
        ("alphabet_flap", "alphabet_flap"),
    ],
)
def test_regressors_in_symbols(key: str, shown: str) -> None:
    assert labels.regressor(key) == shown


def test_only_coefficients_get_subscripts_and_all_is_escaped() -> None:
    assert labels.coefficient("Cm") == "C<sub>m</sub>"
    assert labels.coefficient("<b>") == "&lt;b&gt;"
    text = labels.typeset("Cm_alpha, CX & <i>: Cmxy CL 5 %")
    assert "C<sub>m α</sub>" in text
    assert "C<sub>X</sub> &amp; &lt;i&gt;: Cmxy CL 5\u00a0%" in text


@pytest.mark.parametrize(
    ("r2", "word"),
    [(0.992, "excellent"), (0.97, "good"), (0.9, "good"), (0.7, "usable"), (0.1, "weak"),
     (-0.2, "worse than a constant"), (None, ""), (float("nan"), "")],
)  # fmt: skip
def test_grades(r2: float | None, word: str) -> None:
    assert labels.grade(r2) == word
