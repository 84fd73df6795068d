"""What maneuvers tell of all coefficients together."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.maneuvers.knowledge import Added, Knowledge

RANDOM = np.random.default_rng(5)
PLACES = {"Cl": slice(0, 2), "Cn": slice(2, 5)}
"""Of two coefficients; behind them lie two errors."""


def drawn(size: int, rows: int) -> np.ndarray:
    some = RANDOM.standard_normal((rows, size))
    return some.T @ some


@pytest.fixture
def known() -> Knowledge:
    believed = np.zeros((7, 7))
    for part in (slice(0, 2), slice(2, 5), slice(5, 7)):
        believed[part, part] = drawn(part.stop - part.start, 4)
    return Knowledge(PLACES, believed, Added(np.zeros((7, 7)), 0.0))


def test_of_one_coefficient_it_is_what_all_leave_of_it(known) -> None:
    """Bayes' rule for all together, and the coefficient's own part of that."""
    more = [Added(drawn(7, 3), 3.0), Added(drawn(7, 5), 5.0)]
    later = known.with_more(more[0]).with_more(more[1], share=0.5)
    together = known.believed + more[0].information + 0.25 * more[1].information
    for name, place in PLACES.items():
        found = np.linalg.inv(known.believed[place, place] + later.of(name).information)
        np.testing.assert_allclose(found, np.linalg.inv(together)[place, place], rtol=1e-9)
        assert later.of(name).samples == 8.0


def test_what_an_error_does_is_not_taken_away_by_more_of_the_same(known) -> None:
    """A scale that nobody knows: of a slope under it no more is told than of the scale."""
    seen = np.zeros(7)
    seen[0], seen[5] = 1.0, 2.0  # the slope is one, and the scale takes part twice
    often = known.with_more(Added(1e9 * np.outer(seen, seen), 1e9))
    scale = 1.0 / (known.believed[5, 5] - known.believed[5, 6] ** 2 / known.believed[6, 6])
    told = often.of("Cl").information[0, 0]
    assert told == pytest.approx(1.0 / (4.0 * scale), rel=1e-6)


def test_at_a_share_of_the_amplitude_information_goes_as_its_square() -> None:
    one = Added(drawn(3, 4), 7.0)
    np.testing.assert_allclose(one.smaller(0.5).information, 0.25 * one.information)
    assert one.smaller(0.5).samples == 7.0
