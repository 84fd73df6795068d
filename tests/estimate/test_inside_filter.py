"""Derivatives from what several flights say and what was believed: Bayes' rule by closed forms."""

from __future__ import annotations

import numpy as np

from gcs_sysid.estimate.in_common import Said
from gcs_sysid.estimate.inside_filter import Derivatives

KEYS = (("Cm", "alpha"), ("Cm", "elevator"))
BELIEVED = np.array([-0.7, -0.9])
PRECISION = np.diag([1.0 / 0.2**2, 1.0 / 0.1**2])


def said(
    information: list[list[float]], value: tuple[float, float], late: tuple[float, float]
) -> Said:
    known = np.array(information)
    return Said(known, known @ value, known @ late)


def known_after(*flights: Said) -> Derivatives:
    before = Derivatives(KEYS, BELIEVED, PRECISION, Said.nothing(2), np.zeros(2))
    for each in flights:
        before = before._replace(said=before.said.plus(each))
    return before


FIRST = said([[400.0, 90.0], [90.0, 50.0]], (-0.5, -0.7), (0.0, 0.0))
SECOND = said([[30.0, 0.0], [0.0, 900.0]], (-0.6, -0.8), (0.0, 0.0))


def test_nothing_said_leaves_what_was_believed() -> None:
    alone = known_after()
    np.testing.assert_allclose(alone.value, BELIEVED)
    np.testing.assert_allclose(alone.covariance, np.linalg.inv(PRECISION))


def test_beliefs_and_flights_multiply_in_any_order() -> None:
    found, again = known_after(FIRST, SECOND), known_after(SECOND, FIRST)
    total = PRECISION + FIRST.information + SECOND.information
    vector = PRECISION @ BELIEVED + FIRST.told + SECOND.told
    np.testing.assert_allclose(found.value, np.linalg.solve(total, vector))
    np.testing.assert_allclose(found.covariance, np.linalg.inv(total))
    np.testing.assert_allclose(again.value, found.value)
    np.testing.assert_allclose(again.covariance, found.covariance)
    assert np.linalg.eigvalsh(np.linalg.inv(PRECISION) - found.covariance).min() > 0.0


def test_a_lag_that_all_flights_have_does_not_go_away_with_their_number() -> None:
    """A multitude of flights knows both to nothing but by what the lag may be off."""
    late = (0.05, -0.02)
    flight = said([[400.0, 90.0], [90.0, 50.0]], (-0.5, -0.7), late)
    many = Said(*(1e4 * part for part in flight))
    sure = np.sqrt(np.diagonal(known_after(many).covariance))
    np.testing.assert_allclose(sure, np.abs(late), rtol=0.01)
