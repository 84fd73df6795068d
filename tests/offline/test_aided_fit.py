"""Mass, inertia and thrust beside the derivatives: beliefs, and what becomes of the file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.estimate import in_common, inside_filter
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.estimate.in_common import Said
from gcs_sysid.estimate.inside_filter import Derivatives
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.offline import aided_fit
from gcs_sysid.offline.flight import Flight
from tests.offline.conftest import ROOT

BRUMBY: Path = ROOT / "data" / "aircraft" / "brumby_mk3.toml"
TERMS = {"Cm": {"elevator": -0.6}}


def test_what_the_file_says_of_the_body_is_believed_as_it_says() -> None:
    file = aircraft_file.load(BRUMBY)
    before = aided_fit._believed(TERMS, {"Cm": {"elevator": 1.0}}, file, body=True)
    assert before.keys[0] == ("Cm", "elevator")
    assert [name for _, name in before.keys[1:]] == list(in_common.PARTS)
    sigma = np.sqrt(np.diagonal(before.covariance))
    np.testing.assert_allclose(sigma, [1.0, 0.02, 0.2, 0.2, 0.2, 0.15])
    sure = replace(file, mass=replace(file.mass, mass_sigma=0.0))
    assert 0.0 < aided_fit._stated(sure)[0] < 1e-3


def test_what_was_found_of_the_body_goes_into_the_aircraft() -> None:
    file = aircraft_file.load(BRUMBY)
    before = aided_fit._believed(TERMS, {"Cm": {"elevator": 1.0}}, file, body=True)
    sure = np.array([0.1, 0.01, 0.02, 0.03, 0.01, 0.05])
    value, known_now = np.array([-0.6, 0.1, 0.2, -0.1, 0.0, 0.5]), np.diag(1.0 / sure**2)
    told = known_now @ value - before.precision @ before.believed
    said = Said(known_now - before.precision, told, np.zeros_like(value))
    found = before._replace(said=said)
    known = aided_fit._embodied(file, found)
    assert known.mass.mass == pytest.approx(1.1 * file.mass.mass)
    assert known.mass.Ixx == pytest.approx(1.2 * file.mass.Ixx)
    assert known.mass.Iyy == pytest.approx(0.9 * file.mass.Iyy)
    assert known.mass.Izz == pytest.approx(file.mass.Izz)
    assert known.mass.inertia_sigma == pytest.approx(0.03)
    assert known.propulsion[0].thrust[1][0] == pytest.approx(1.5 * file.propulsion[0].thrust[1][0])
    assert known.propulsion[0].thrust_sigma == pytest.approx(0.05 / 1.5)
    alone = aided_fit._believed(TERMS, {"Cm": {"elevator": 1.0}}, file, body=False)
    assert aided_fit._embodied(file, alone) == file


def test_the_share_of_the_body_in_a_deviation_is_told_apart() -> None:
    """d = m (1 + i) with m known to 1 % and i to 5 %: the rest of d's deviation is the body's."""
    file = aircraft_file.load(BRUMBY)
    keys = (("Cm", "elevator"), *((in_common.BODY, part) for part in in_common.PARTS))
    value = np.array([-0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    covariance = np.diag([0.006**2, 0.02**2, 0.2**2, 0.05**2, 0.2**2, 0.15**2])
    covariance[0, 0] += (0.6 * 0.05) ** 2
    covariance[0, 3] = covariance[3, 0] = -0.6 * 0.05**2
    believed = np.diag(1.0 / np.array([100.0, 0.02, 0.2, 0.2, 0.2, 0.15]) ** 2)
    information = np.linalg.inv(covariance) - believed
    told = information @ value
    said = Said(information, told, np.zeros_like(value))
    found = Derivatives(keys, np.zeros_like(value), believed, said, np.array([0.006]))
    alone = inside_filter._of_flight(found, {"Cm": ("elevator",)}, file)
    assert alone.body is not None
    assert np.sqrt(alone.noise[0]) == pytest.approx(0.006, rel=1e-6)
    assert np.sqrt(alone.body[0]) == pytest.approx(0.03, rel=1e-4)


def test_a_coarse_file_is_told_what_it_bends() -> None:
    file = aircraft_file.load(BRUMBY)
    (note,) = aided_fit._held(file)
    assert "mass to 2 %" in note
    assert "inertia to 20 %" in note
    assert "--mass-properties flight" in note
    sure = replace(file, mass=replace(file.mass, inertia_sigma=0.05))
    assert aided_fit._held(sure) == ()
    heavy = replace(file, mass=replace(file.mass, mass_sigma=0.08, inertia_sigma=0.05))
    assert "mass to 8 %" in aided_fit._held(heavy)[0]


def flights(*names: str) -> list[aided_fit._Prepared]:
    """Of which only where they come from is known."""
    return [
        aided_fit._Prepared(
            Mock(spec=Flight, recording=Mock(source=name)), Mock(), np.zeros(1, dtype=bool), Mock()
        )
        for name in names
    ]


def test_each_flight_is_fitted_beside_what_the_others_have_said(monkeypatch) -> None:
    """Alone, a weak one has to find its way to where the file would have it."""
    file = aircraft_file.load(BRUMBY)
    before = aided_fit._believed(TERMS, {"Cm": {"elevator": 1.0}}, file, body=False)
    sure = [100.0, 30.0, 1.0]
    scored = [
        Mock(
            spec=Fit,
            keys=before.keys,
            unknowns=None,
            bound=np.array([[1.0 / one]]),
            said=Said(np.array([[one]]), np.array([-0.5 * one]), np.zeros(1)),
        )
        for one in sure
    ]
    known: list[Derivatives] = []
    begun: list[Derivatives] = []

    def fit(_model: object, _item: object, _first: object, others: Derivatives, *_: object) -> Fit:
        known.append(others)
        return Mock(spec=Fit)

    monkeypatch.setattr(aided_fit, "_fit", fit)
    monkeypatch.setattr(aided_fit, "_with", lambda _unknowns, found: begun.append(found))
    model, told = Mock(spec=FlightModel), [lambda _: None] * 3
    aided_fit._of_all(model, flights("a", "b", "c"), scored, before, told)
    assert [float(one.said.information[0, 0]) for one in known] == [31.0, 101.0, 130.0]
    assert {float(one.said.information[0, 0]) for one in begun} == {131.0}
    assert all(one.precision == before.precision for one in known)


def test_a_search_that_did_not_end_is_named_with_what_was_missing_and_what_to_do() -> None:
    """The first flight of which that is so."""
    done = Mock(spec=Fit, converged=True, log_likelihood=(10.0, 11.0), moving=0.1)
    astray = Mock(spec=Fit, converged=False, log_likelihood=(100.0, 220.4), moving=3.26)
    alone = Mock(spec=Fit, converged=False, log_likelihood=(100.0,), moving=50.0)
    assert aided_fit._unsettled(flights("a.tlog"), [done]) == ""
    said = aided_fit._unsettled(flights("a.tlog", "b.tlog", "c.tlog"), [done, astray, alone])
    assert said == (
        "b.tlog: the search inside the filter did not end (the log-likelihood still changed by "
        "+120 a step, and a derivative was to move by 3.3 of its deviations): mass, inertia, signs "
        "of the controls or the thrust of the aircraft file may be far off: check them, or fly "
        "longer maneuvers of every axis"
    )
    assert "changed by +0 a step" in aided_fit._unsettled(flights("c.tlog"), [alone])


def test_a_lost_aircraft_is_named_with_what_to_do() -> None:
    (item,) = flights("a.tlog")
    assert aided_fit._lost(item.one) == (
        "a.tlog: the filter lost the aircraft: mass, inertia, signs of the controls or the thrust "
        "of the aircraft file may be far off: check them, or fly longer maneuvers of every axis"
    )
