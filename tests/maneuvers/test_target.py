"""What information is worth, in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.errors import UsageError
from gcs_sysid.maneuvers import information
from gcs_sysid.maneuvers import target as targets
from gcs_sysid.maneuvers.knowledge import Added
from tests.maneuvers.made_model import model, rows_of

BEFORE = {name: fit.covariance for name, fit in model().fits.items()}
NOTHING = information.nothing(model())


def more(added: np.ndarray) -> Added:
    """Information on the pitching moment's terms."""
    return rows_of(model(), {"Cm": added})


def test_halving_a_deviation_is_worth_the_logarithm_of_two() -> None:
    known = targets.derivative(model(), "Cm", "qhat")
    index = model().fits["Cm"].keys.index("qhat")
    added = NOTHING.of("Cm").information.copy()
    # Information three times as much as before: a quarter of the variance is left.
    added[index, index] = 3.0 / BEFORE["Cm"][index, index]
    assert known.worth(model(), NOTHING, more(added)) == pytest.approx(np.log(2.0))
    assert known.worth(model(), NOTHING, NOTHING.added) == pytest.approx(0.0)


def test_all_derivatives_count_alike_and_the_constant_does_not() -> None:
    known = targets.derivatives(model(), ("Cm",))
    assert len(known.questions["Cm"]) == 3
    added = np.diag(3.0 / np.diagonal(BEFORE["Cm"]))
    assert known.worth(model(), NOTHING, more(added)) == pytest.approx(3 * np.log(2.0))


def test_what_no_flight_changes_makes_a_maneuver_worth_no_less() -> None:
    """Inertia known to 30 %, noise of 5 %: hardly less is stated, much more is known."""
    fit = model().fits["Cm"]
    heavy = replace(
        fit,
        covariance=fit.covariance + np.outer(0.3 * fit.value, 0.3 * fit.value),
        deviations={**fit.deviations, "scale": 0.3 * np.abs(fit.value)},
    )
    unsure = replace(model(), fits={**model().fits, "Cm": heavy})
    known = targets.derivative(unsure, "Cm", "qhat")
    added = more(np.diag(3.0 / np.diagonal(fit.covariance)))
    assert known.worth(unsure, NOTHING, added) == pytest.approx(np.log(2.0), rel=0.05)
    stated = 0.5 * np.log((0.3**2 + 0.05**2) / (0.3**2 + 0.05**2 / 4.0))
    before = known.stated(unsure, NOTHING)
    found = known.stated_worth(unsure, NOTHING, added, before=before)
    assert found == pytest.approx(stated, rel=0.05)


def test_a_region_asks_where_it_is() -> None:
    """At high alpha the slope in alpha counts, at alpha near zero the constant does."""
    level = {"alpha": 0.05, "qhat": 0.0, "elevator": 0.0}
    far = targets.region(model(), ("Cm",), {"alpha": (0.18, 0.2)}, level)
    near = targets.region(model(), ("Cm",), {"alpha": (-0.002, 0.002)}, level)
    slope = NOTHING.of("Cm").information.copy()
    slope[1, 1] = 1e9
    constant = NOTHING.of("Cm").information.copy()
    constant[0, 0] = 1e9
    worth = [
        [known.worth(model(), NOTHING, more(added)) for added in (slope, constant)]
        for known in (far, near)
    ]
    assert worth[0][0] > worth[0][1]
    assert worth[1][1] > worth[1][0]


def test_worth_grows_with_information_as_its_slope_says() -> None:
    """Finite differences of the worth, for derivatives and for a region."""
    generator = np.random.default_rng(3)
    level = {"alpha": 0.05, "qhat": 0.0, "elevator": 0.0}
    size = len(NOTHING.believed)
    for asked in (
        targets.derivatives(model(), ("Cl", "Cm", "Cn")),
        targets.region(model(), ("Cm",), {"alpha": (0.1, 0.2)}, level),
    ):
        rows = generator.standard_normal((30, size)) * np.sqrt(np.diagonal(NOTHING.believed))
        known = NOTHING.with_more(Added(rows.T @ rows, 30.0))
        value, slope = asked.slope(model(), known)
        assert value == pytest.approx(-0.5 * sum(np.log(asked.variances(model(), known))))
        direction = 1e-4 * np.sqrt(np.diagonal(NOTHING.believed)) * generator.standard_normal(size)
        more = Added(np.outer(direction, direction), 0.0)
        grown = asked.worth(model(), known, more)
        assert np.sum(slope * more.information) == pytest.approx(grown, rel=1e-4)


def test_what_the_model_lacks_is_named() -> None:
    with pytest.raises(UsageError, match="no term `beta`"):
        targets.derivative(model(), "Cm", "beta")
    with pytest.raises(UsageError, match="no variable `mach`"):
        targets.region(model(), ("Cm",), {"mach": (0.0, 1.0)}, {"alpha": 0.0})
