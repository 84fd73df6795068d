"""What tells two causes apart, by hand and by a regression of one direction on the other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.suspects import Direction, file_sigmas, named, suspects
from gcs_sysid.estimate.traces import traces
from gcs_sysid.maneuvers import information, separation
from gcs_sysid.maneuvers.knowledge import Added, Knowledge
from gcs_sysid.maneuvers.separation import Pair
from gcs_sysid.offline import suggestion_target
from gcs_sysid.offline.model_store import StoredModel
from tests.blind.draw import load
from tests.blind.pairs import PAIRS
from tests.blind.pairs import Pair as HardPair
from tests.maneuvers.made_model import aircraft, model, rows_of


def stored() -> StoredModel:
    return StoredModel(model(), aircraft(), 0.0, [])


def unflown() -> Values:
    raise AssertionError("nothing but the model's own terms is asked about")


def moved(made: Aircraft, label: str) -> Direction:
    return next(one.moves for one in suspects(made) if one.label == label)


def more(seed: int) -> Knowledge:
    """Rows at random, a few of each coefficient."""
    generator = np.random.default_rng(seed)
    found = {}
    for name, fit in model().fits.items():
        rows = generator.standard_normal((9, len(fit.keys))) / (0.05 * np.abs(fit.value))
        found[name] = rows.T @ rows
    return information.nothing(model()).with_more(rows_of(model(), found, 9.0))


def regressed(known: Knowledge, pair: Pair) -> float:
    """Square of what is left of one direction once all else has explained what it can.

    Rows are those of the flights, and one for each derivative that its file knows to its sigma.
    """
    roots, ones, others, sigmas = [], [], [], []
    for name, fit in model().fits.items():
        total = np.diag((0.05 * fit.value) ** -2.0) + known.of(name).information
        roots.append(np.linalg.cholesky(total).T)
        ones += [pair.first.get((name, key), 0.0) for key in fit.keys]
        others += [pair.second.get((name, key), 0.0) for key in fit.keys]
        sigmas += [pair.ordinary[name, key] for key in fit.keys]
    root, believed = linalg.block_diag(*roots), np.diag(1.0 / np.array(sigmas))
    nothing = np.zeros(len(ones))
    one = np.concatenate([root @ np.array(ones), nothing])
    rest = np.vstack([np.column_stack([root @ np.array(others), root]),
                      np.column_stack([nothing, believed])])  # fmt: skip
    share = np.linalg.lstsq(rest, one, rcond=None)[0]
    return float(np.sum((one - rest @ share) ** 2))


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("mass", "cg_shift"),
        ("surface_effectiveness elevator", "inertia Iyy"),
        ("airspeed_scale", "mass"),
    ],
)
def test_what_is_left_is_that_of_a_regression(first: str, second: str) -> None:
    made = aircraft()
    pair = Pair(moved(made, first), moved(made, second), file_sigmas(made))
    for known in (information.nothing(model()), more(1)):
        found = separation.apart(model(), known, pair)
        assert found == pytest.approx(regressed(known, pair), rel=1e-9)
    asked = separation.separation(model(), f"{first} or {second}", pair)
    start = information.nothing(model())
    expected = 0.5 * np.log(regressed(more(1), pair) / regressed(start, pair))
    assert asked.worth(model(), start, more(1).added) == pytest.approx(expected)


def test_worth_grows_with_information_as_its_slope_says() -> None:
    """Finite differences of the worth along a row that all coefficients share."""
    made, known = aircraft(), more(4)
    first = Pair(moved(made, "mass"), moved(made, "cg_shift"), file_sigmas(made))
    for pair in (first, Pair(moved(made, "mass"), {}, file_sigmas(made))):
        asked = separation.separation(model(), "mass or cg_shift", pair)
        value, slope = asked.slope(model(), known)
        assert value == pytest.approx(0.5 * np.log(separation.apart(model(), known, pair)))
        scale = 1e-3 * np.sqrt(np.diagonal(known.believed))
        row = scale * np.random.default_rng(7).standard_normal(len(known.believed))
        one = Added(np.outer(row, row), 0.0)
        grown = asked.worth(model(), known, one)
        assert np.sum(slope * one.information) == pytest.approx(grown, rel=1e-3)
        assert grown != 0.0


def test_what_is_like_itself_is_told_by_nothing() -> None:
    made = aircraft()
    mass = moved(made, "mass")
    alone = separation.apart(model(), more(2), Pair(mass, {}, file_sigmas(made)))
    both = separation.apart(model(), more(2), Pair(mass, mass, file_sigmas(made)))
    assert abs(both) < 1e-9 * alone


def test_what_the_file_may_have_wrong_says_nothing_of_a_cause() -> None:
    """However much is flown, of a mass no more is known than all forces of the file say."""
    made, much = aircraft(), {}
    for name, fit in model().fits.items():
        much[name] = 1e12 * np.diag(np.square(fit.value) ** -1.0)
    pair = Pair(moved(made, "mass"), {}, file_sigmas(made))
    count = sum(len(model().fits[name].keys) for name in ("CX", "CY", "CZ"))
    # Each derivative of the made file is known to a twentieth of itself.
    told = information.nothing(model()).with_more(rows_of(model(), much, 1e6))
    known = separation.apart(model(), told, pair)
    assert known == pytest.approx(count / 0.05**2, rel=1e-3)


def test_causes_are_named_as_diagnose_has_them() -> None:
    made = aircraft()
    text = "surface_effectiveness:elevator,cg_shift"
    pair = suggestion_target.causes(model(), made, text)
    asked, same = suggestion_target.separating(stored(), pair, unflown)
    assert same.fits.keys() == model().fits.keys()
    assert asked.words == "surface_effectiveness elevator or cg_shift"
    assert set(asked.coefficients) == {"Cm", "Cn"}
    assert asked.region == {}


@pytest.mark.parametrize("one", PAIRS, ids=lambda one: one.asked)
def test_the_hard_pairs_can_be_asked_about(one: HardPair) -> None:
    flown = load(one.aircraft)
    every = [*suspects(flown), *traces(flown)]
    names = one.asked.split(",")
    assert [len(named(every, name)) for name in names] == [1, 1]
    assert names[0].startswith(one.cause)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("mass", "give two causes"),
        ("mass,wind", "`wind` is not one cause; there are surface_effectiveness:"),
        ("mass,surface_effectiveness", "there are surface_effectiveness:aileron, surface_eff"),
        ("mass,surface_effectiveness:flap", "there are surface_effectiveness:aileron, surface_eff"),
        ("mass,mass", "move the coefficients alike"),
        ("inertia:Iyy,inertia:Iyy", "move the coefficients alike"),
    ],
)
def test_what_cannot_be_told_apart_is_refused(text: str, says: str) -> None:
    def asked() -> None:
        pair = suggestion_target.causes(model(), aircraft(), text)
        suggestion_target.separating(stored(), pair, unflown)

    with pytest.raises(UsageError, match=says):
        asked()
