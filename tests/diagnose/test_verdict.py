"""Rankings of made-up information, and what may be said of them."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Control
from gcs_sysid.diagnose import extended, unlisted, verdict
from gcs_sysid.diagnose.catalogue import CAUSES, of_coefficients
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.evidence import Information, Posterior, information, posterior
from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.diagnose.ranking import deviations, rank
from gcs_sysid.diagnose.unknowns import Columns
from gcs_sysid.diagnose.unlisted import Term
from tests.offline.made_aircraft import small

EVERY = of_coefficients(("elevator",))
NAMES = ("mass", "cg.x", "airspeed", "effectiveness.elevator", "CZ.alpha")
COLUMNS = Columns(NAMES, np.array([0.01, 0.01, 0.01, 0.0, 1.0]), np.zeros((0, 6, 5)))


def data(*, truth: dict[str, float], alike: bool = False) -> Information:
    random = np.random.default_rng(11)
    columns = 30.0 * random.standard_normal((300, len(NAMES)))
    if alike:
        columns[:, 1] = columns[:, 0]
    wrong = np.array([truth.get(name, 0.0) for name in NAMES])
    return information(columns, columns @ wrong + random.standard_normal(300))


def judged(found: Information) -> tuple[verdict.Verdict, tuple[Ranked, ...]]:
    ranked = rank(found, COLUMNS, EVERY)
    return verdict.judge(
        ranked, verdict.would_show(EVERY, deviations(found, COLUMNS, EVERY), {"": 1.0})
    ), ranked


def test_every_control_has_its_own_effectiveness() -> None:
    many = of_coefficients(("elevator", "aileron"))
    controls = [item.about for item in many if item.cause.name == "surface_effectiveness"]
    assert controls == ["elevator", "aileron"]
    assert Candidate(CAUSES["surface_effectiveness"], "aileron").frees == ("effectiveness.aileron",)


def test_a_cause_is_named_with_its_size() -> None:
    answer, ranked = judged(data(truth={"effectiveness.elevator": -0.3}))
    assert answer.answer == "effect"
    assert answer.best.names == ("surface_effectiveness",)
    [[estimate]] = answer.best.estimates
    assert estimate.value == pytest.approx(0.7, abs=4.0 * estimate.deviation)
    assert sum(item.probability for item in ranked) == pytest.approx(1.0)


def test_two_at_once_are_both_named() -> None:
    answer, _ = judged(data(truth={"mass": 0.12, "airspeed": 0.08}))
    assert answer.answer == "effect"
    assert set(answer.best.names) == {"mass", "airspeed_scale"}


def test_nothing_wrong_is_called_so() -> None:
    answer, ranked = judged(data(truth={}))
    assert answer.answer == "no_effect"
    assert ranked[0].causes == ()


def test_causes_with_one_signature_cannot_be_told_apart() -> None:
    answer, _ = judged(data(truth={"mass": 0.1}, alike=True))
    assert answer.answer == "ambiguous"
    assert {name for item in answer.indistinguishable for name in item.names} >= {
        "mass",
        "cg_shift",
    }


@pytest.mark.parametrize("alike", [False, True])
def test_an_accusation_that_foretells_nothing_better_is_dropped(alike: bool) -> None:
    answer, _ = judged(data(truth={"mass": 0.1}, alike=alike))
    assert answer.answer == ("ambiguous" if alike else "effect")
    assert verdict.sustained(answer, 0.1) == answer
    dropped = verdict.sustained(answer, -0.1)
    assert dropped.answer == "insufficient_data"
    assert dropped.indistinguishable == ()


def test_silence_needs_nothing_to_be_foretold_better() -> None:
    answer, _ = judged(data(truth={}))
    assert verdict.sustained(answer, 0.0) == answer


def test_a_flight_that_shows_nothing_is_no_proof_of_nothing() -> None:
    found = data(truth={})
    faint = Information(1e-6 * found.gram, 1e-3 * found.score, found.count)
    answer, _ = judged(faint)
    assert answer.answer == "insufficient_data"


def test_what_the_file_is_unsure_of_accuses_nobody() -> None:
    """An aerodynamic value off by two of its sigmas, beside causes with other signatures."""
    answer, _ = judged(data(truth={"CZ.alpha": 2.0}))
    assert answer.answer == "no_effect"


def test_a_missing_term_is_found_by_its_evidence() -> None:
    """The gain of one more unknown is the difference of two full evidences."""
    random = np.random.default_rng(4)
    columns = random.standard_normal((200, 3))
    extra = random.standard_normal((200, 2))
    left = columns @ np.array([0.5, -0.2, 0.1]) + 0.8 * extra[:, 1] + random.standard_normal(200)
    sigma = np.array([1.0, 1.0, 1.0])
    found = posterior(information(columns, left), sigma)
    names = [Term("Cn", ("qhat",)), Term("Cn", ("qhat", "rudder"))]
    best = unlisted.strongest(found, columns, left, extra, np.array([0.7, 0.7]), names)
    wider = np.column_stack([columns, extra[:, 1]])
    whole = posterior(information(wider, left), np.append(sigma, 0.7))
    expected = whole.log_evidence - found.log_evidence + np.log(unlisted.PRIOR / 2)
    assert (best.coefficient, best.variables) == ("Cn", ("qhat", "rudder"))
    assert best.log_bayes_factor == pytest.approx(expected, rel=1e-9)


def test_the_extended_file_is_read_back_as_it_was_written(tmp_path) -> None:
    file = small()
    wrong = {"mass": (0.1, 0.01), "cg.x": (-0.05, 0.01), "airspeed": (0.07, 0.002)}
    made = extended.corrected(file, wrong | {"effectiveness.rudder": (-0.2, 0.05)})
    aircraft_file.save(made, tmp_path / "aircraft-extended.toml")
    read = aircraft_file.load(tmp_path / "aircraft-extended.toml")
    assert read.mass.mass == pytest.approx(1.1 * file.mass.mass)
    assert read.mass.cg[0] == pytest.approx(-0.05 * file.geometry.mean_chord)
    assert read.pitot.error.scale[0] == pytest.approx(0.07)
    assert {item.surface: item.effectiveness for item in read.servos}["rudder"] == pytest.approx(
        0.8
    )


def test_a_servo_of_two_controls_keeps_its_own_effectiveness() -> None:
    """An elevon moves the aileron too, which did nothing wrong."""
    file = small()
    shared = (
        Control("elevator", {"aileron": 0.5, "elevator": 0.5}),
        Control("aileron", {"aileron": 0.5, "elevator": -0.5}),
    )
    made = extended.corrected(
        type(file)(**{**file.__dict__, "controls": shared}), {"effectiveness.elevator": (-0.3, 0.1)}
    )
    assert made.controls[0].mix == pytest.approx({"aileron": 0.35, "elevator": 0.35})
    assert made.controls[1].mix == shared[1].mix
    assert all(servo.effectiveness == 1.0 for servo in made.servos)


def test_what_has_no_place_in_a_file_is_refused() -> None:
    with pytest.raises(ValueError, match="no place"):
        extended.corrected(small(), {"alpha": (0.1, 0.1)})


def test_only_values_of_the_file_are_called_strained() -> None:
    """A clean flight was denied its verdict over the bias of its own accelerometer."""
    names = ("mass", "CZ.alpha", "accelerometer.y #0", "effectiveness.elevator")
    sigma = np.array([0.02, 1.0, 0.01, 0.0])
    best = Ranked(
        causes=(),
        prior=0.5,
        probability=0.9,
        log_bayes_factor=0.0,
        estimates=(),
        posterior=Posterior(np.array([0.01, -3.5, 0.05, 0.0]), np.eye(4), 0.0),
    )
    columns = Columns(names, sigma, np.zeros((0, 6, 4)))
    assert verdict.strained(columns.names, columns.sigma, best) == {"CZ.alpha": -3.5}
