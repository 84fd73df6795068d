"""What passes for a change of the flow angles, by hand."""

from __future__ import annotations

import numpy as np

from gcs_sysid.estimate import disguise

KEYS = (
    ("CX", "1"),
    ("CX", "alpha"),
    ("CX", "alpha^2"),
    ("CZ", "1"),
    ("CZ", "alpha"),
    ("CZ", "elevator"),
    ("Cl", "beta"),
    ("Cl", "phat"),
)
VALUES = np.array([-0.04, 0.2, 5.0, -0.2, -5.5, -0.3, -0.1, -0.5])


def test_a_constant_of_alpha_moves_the_constants_and_turns_the_polar() -> None:
    """C(α + ε) = C(α) + ε ∂C/∂α: of a quadratic, the constant and the slope."""
    rows = disguise.directions(KEYS, VALUES, ("elevator",))
    wanted = np.array([0.2, 10.0, 0.0, -5.5, 0.0, 0.0, 0.0, 0.0])
    assert any(np.allclose(row, wanted, atol=1e-9) for row in rows)


def test_a_stretch_of_alpha_scales_its_slope() -> None:
    """CX has no cubic to follow the square's: it stays; CZ_alpha follows by itself."""
    rows = disguise.directions(KEYS[3:6], VALUES[3:6], ("elevator",))
    assert any(np.allclose(row, [0.0, -5.5, 0.0], atol=1e-9) for row in rows)


def test_sideslip_moves_lateral_terms_only() -> None:
    rows = disguise.directions(KEYS, VALUES, ("elevator",))
    lateral = rows[np.any(rows[:, 6:] != 0.0, axis=1)]
    assert len(lateral) == 1  # by itself: Cl has no constant
    np.testing.assert_allclose(lateral, [[0.0] * 6 + [-0.1, 0.0]], atol=1e-9)
