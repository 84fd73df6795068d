"""Where a diagnosis begins: what to do when a search loses what the file says of the airframe."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid.diagnose.aided.ranking import RIGHT
from gcs_sysid.errors import RefusedError
from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import settled
from gcs_sysid.offline.settled import Subject
from gcs_sysid.reconstruct.causal import Pass
from tests.estimate import made_flight

NAMES = (
    "aerodynamics.Cl.aileron",
    "aerodynamics.CZ.qhat",
    "departures.inertia.0",
    "departures.cg",
    "departures.thrust_tilt",
    "sensors.surface_delay",
)
MEAN = np.array([-0.16, -8.0, 0.0, 0.0, 0.0, 0.0])
SIGMA = np.array([0.016, 0.8, 0.05, 0.003, 0.02, 0.01])
SILENT = Prior(*[made_flight.unknowns(1.0).log_noise] * 2)
LOST = {"aerodynamics.Cl.aileron": -0.002}


def ended(off: dict[str, float], *, at_rest: bool = True) -> Settled:
    """A search that ended at the file's values but for some."""
    values = MEAN.copy()
    for name, value in off.items():
        values[NAMES.index(name)] = value
    last = Mock(spec=Pass, log_likelihood=np.zeros(3))
    fitted = np.ones(3, dtype=bool)
    rows = fitted, ~fitted
    return Settled(values, SILENT.mean, last, *rows, (0.0,), at_rest, 0.0 if at_rest else 900.0)


def begun(monkeypatch, *ends: Settled) -> tuple[Settled, list[Beliefs], list[str]]:
    """What `begin` makes of searches that end so, the beliefs that they had, and what it says."""
    left, asked, said = list(ends), list[Beliefs](), list[str]()

    def search(_model, _rows, _first, before: Beliefs, *_more, **_named) -> tuple[Settled, None]:
        asked.append(before)
        return left.pop(0), None

    monkeypatch.setattr(settled.settling, "begun", search)
    rows = Mock(rows=Mock(passing=np.full(3, 20.0)))
    monkeypatch.setattr(settled.flight_rows, "busiest", lambda *_: (rows, None))
    monkeypatch.setattr(settled.quantities, "names", lambda _means: NAMES)
    one = Mock(recording=Mock(source="flight.tlog"))
    subject = Mock(spec=Subject, rows=None, fitted=None, first=Mock(), one=one)
    before = Beliefs(MEAN, np.diag(SIGMA**2), SILENT)
    done = settled.begin(Mock(spec=FlightModel), subject, before, said.append)
    assert not left
    return done, asked, said


def test_an_aileron_without_effect_is_begun_anew_with_the_files_own(monkeypatch) -> None:
    again = ended({"sensors.surface_delay": 0.034})
    done, (first, held), (said,) = begun(monkeypatch, ended(LOST), again)
    assert done is again
    assert "aerodynamics.Cl.aileron went astray" in said
    np.testing.assert_allclose(first.covariance, np.diag(SIGMA**2))
    wanted = SIGMA * [RIGHT, RIGHT, 0.0, 0.0, 1.0, 1.0]
    np.testing.assert_allclose(np.sqrt(np.diagonal(held.covariance)), wanted)
    np.testing.assert_array_equal(held.mean, MEAN)


def test_where_that_finds_no_rest_the_first_search_stands(monkeypatch) -> None:
    first = ended(LOST)
    done, _, _ = begun(monkeypatch, first, ended({}, at_rest=False))
    assert done is first


@pytest.mark.parametrize(
    "off",
    [
        {"aerodynamics.Cl.aileron": -0.5 * 0.16, "departures.inertia.0": -0.4},
        {"departures.inertia.0": 2.0},
        # A damping in lift that nobody sees may be next to nothing; a tilt is no share of one.
        {"aerodynamics.CZ.qhat": -1.8},
        {"departures.thrust_tilt": -1.0, "sensors.surface_delay": -0.2},
    ],
)
def test_what_may_be_hidden_is_not_astray(monkeypatch, off: dict[str, float]) -> None:
    """Half of an aileron, three times an inertia: the search that ends there stands."""
    first = ended(off)
    done, _, said = begun(monkeypatch, first)
    assert done is first
    assert said == []


def test_an_inertia_of_nothing_is_astray(monkeypatch) -> None:
    again = ended({})
    done, _, said = begun(monkeypatch, ended({"departures.inertia.0": -0.96}), again)
    assert done is again
    assert len(said) == 1


def test_air_that_is_too_quick_is_refused_with_what_to_fly(monkeypatch) -> None:
    turbulence = SILENT.mean.turbulence
    quick = turbulence._replace(
        gust=np.log([1.0, 1.0, 1.5]), gust_length=np.asarray(turbulence.gust_length) - 3.0
    )
    done = replace(ended({}), log_noise=SILENT.mean._replace(turbulence=quick))
    with pytest.raises(RefusedError, match=r"vertical gusts of 1\.5 m/s.*SIM_WIND_TURB = 0"):
        begun(monkeypatch, done)
