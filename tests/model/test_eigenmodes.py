"""Names and intervals of modes, on matrices whose modes are known."""

from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.model import eigenmodes
from gcs_sysid.model.eigenmodes import Mode, named
from gcs_sysid.model.linear import LATERAL, LONGITUDINAL, STATES

NOTHING = (np.zeros((8, 8, 1)), np.zeros((1, 1)))
U, G = 20.0, 9.80665


def matrix(
    *,
    lift: float = -5.0,
    stiffness: float = -80.0,
    damping: float = -8.0,
    roll: float = -15.0,
    side: float = -0.7,
    weathercock: float = 25.0,
    yaw: float = -1.5,
    dihedral: float = -40.0,
    roll_by_yaw: float = 3.0,
) -> np.ndarray:
    """A small aircraft's matrix in the classical form, motions apart from each other."""
    place = {name: index for index, name in enumerate(STATES)}
    entries = {
        ("V", "V"): -0.2, ("V", "alpha"): 5.0, ("V", "theta"): -G,
        ("alpha", "V"): -2.0 * G / U**2, ("alpha", "alpha"): lift, ("alpha", "q"): 1.0,
        ("q", "alpha"): stiffness, ("q", "q"): damping, ("theta", "q"): 1.0,
        ("beta", "beta"): side, ("beta", "r"): -1.0, ("beta", "phi"): G / U,
        ("p", "beta"): dihedral, ("p", "p"): roll, ("p", "r"): roll_by_yaw,
        ("r", "beta"): weathercock, ("r", "p"): 0.3, ("r", "r"): yaw, ("phi", "p"): 1.0,
    }  # fmt: skip
    found = np.zeros((8, 8))
    for (row, column), value in entries.items():
        found[place[row], place[column]] = value
    return found


def by_name(dynamics: np.ndarray) -> dict[str, Mode]:
    return {mode.name: mode for mode in named(dynamics, *NOTHING)}


def test_modes_of_an_ordinary_aircraft_are_near_their_closed_approximations() -> None:
    """Stevens, Lewis & Johnson 2015, section 4.2: short period ω² = Z_α M_q − M_α, phugoid
    ω = √2 g/U (Lanchester), roll −L_p, Dutch roll ω² ≈ N_β + Y_β N_r.
    """
    found = by_name(matrix())
    assert list(found) == ["short period", "phugoid", "roll", "dutch roll", "spiral"]
    short = found["short period"]
    assert short.frequency.value == pytest.approx(np.sqrt(5.0 * 8.0 + 80.0), rel=0.01)
    assert short.damping.value == pytest.approx(13.0 / (2.0 * np.sqrt(120.0)), rel=0.02)
    assert found["phugoid"].frequency.value == pytest.approx(np.sqrt(2.0) * G / U, rel=0.25)
    assert found["roll"].time_constants[0].value == pytest.approx(1.0 / 15.0, rel=0.1)
    assert found["dutch roll"].frequency.value == pytest.approx(np.sqrt(25.0 + 1.05), rel=0.1)
    assert all(found[name].stable for name in found if name != "spiral")


@pytest.mark.parametrize("roll_by_yaw", [1.0, 3.0])
def test_the_spiral_is_stable_where_its_criterion_says_so(roll_by_yaw: float) -> None:
    """L_β N_r > N_β L_r, of the same sign (Etkin & Reid 1996, section 6.8)."""
    stable = -40.0 * -1.5 > 25.0 * roll_by_yaw
    assert by_name(matrix(roll_by_yaw=roll_by_yaw))["spiral"].stable == stable


def test_every_eigenvalue_is_in_one_mode_whatever_the_units() -> None:
    dynamics = matrix()
    scale = np.diag([1.0, 57.3, 57.3, 57.3, 57.3, 57.3, 57.3, 57.3])
    plain, degrees = by_name(dynamics), by_name(scale @ dynamics @ np.linalg.inv(scale))
    roots = [root for mode in plain.values() for root in mode.roots]
    np.testing.assert_allclose(
        np.sort_complex(np.array(roots)), np.sort_complex(np.linalg.eigvals(dynamics))
    )
    for name, mode in plain.items():
        np.testing.assert_allclose(degrees[name].roots, mode.roots, rtol=1e-9)


def test_a_short_period_of_two_real_roots_keeps_its_name() -> None:
    short = by_name(matrix(stiffness=-1.0, damping=-12.0))["short period"]
    assert not short.oscillates
    assert short.damping.value > 1.0
    assert len(short.time_constants) == 2
    product = np.prod([1.0 / item.value for item in short.time_constants])
    assert short.frequency.value == pytest.approx(np.sqrt(product))


def test_an_unstable_pair_of_real_roots_has_no_frequency() -> None:
    found = by_name(matrix(stiffness=60.0, lift=-4.0))
    diverging = [mode for mode in found.values() if not mode.stable]
    assert diverging
    assert any(item.value < 0.0 for mode in diverging for item in mode.time_constants)


def test_a_root_of_short_period_and_one_of_phugoid_that_join_are_a_third_oscillation() -> None:
    """The centre of gravity at the neutral point and behind (Etkin & Reid 1996, section 6.5)."""
    names = {
        name
        for stiffness in np.linspace(0.0, 60.0, 61)
        for name in by_name(matrix(stiffness=stiffness))
    }
    assert {"short period root", "third oscillation", "phugoid root"} <= names


def test_roll_and_spiral_that_join_are_told_from_the_dutch_roll() -> None:
    found = by_name(matrix(roll=-0.3, roll_by_yaw=-1.0, dihedral=-10.0, weathercock=40.0))
    assert {"dutch roll", "roll and spiral"} <= set(found)
    assert found["dutch roll"].frequency.value == pytest.approx(np.sqrt(40.0), rel=0.2)


def test_a_dutch_roll_of_real_roots_leaves_roll_and_spiral_their_names() -> None:
    found = by_name(matrix(weathercock=0.2, yaw=-4.0, dihedral=-0.5, roll_by_yaw=0.5))
    assert {"roll", "dutch roll", "spiral"} <= set(found)
    assert found["roll"].time_constants[0].value == pytest.approx(1.0 / 15.0, rel=0.05)
    assert not found["dutch roll"].oscillates


@pytest.mark.parametrize("stiffness", [-80.0, -2.7])
def test_deviations_are_those_of_draws_also_where_an_oscillation_nearly_ends(stiffness) -> None:
    """−2.7: nearly a double root, whose own first-order deviation says nothing."""
    place = {name: index for index, name in enumerate(STATES)}
    entries = [
        *(("q", "alpha"), ("q", "q"), ("alpha", "alpha"), ("p", "p"), ("r", "beta")),
        *(("V", "V"), ("alpha", "V"), ("p", "beta"), ("r", "r")),
    ]
    dynamics = matrix(stiffness=stiffness)
    slopes = np.zeros((8, 8, len(entries)))
    for index, (row, column) in enumerate(entries):
        slopes[place[row], place[column], index] = 1.0
    spread = 0.03 * np.array([abs(dynamics[place[r], place[c]]) for r, c in entries])
    found = {mode.name: mode for mode in named(dynamics, slopes, np.diag(spread**2))}
    drawn = np.random.default_rng(4).standard_normal((500, len(entries))) * spread
    many = [by_name(dynamics + slopes @ move) for move in drawn]
    for name in ("short period", "phugoid", "dutch roll"):
        for quantity in ("frequency", "damping"):
            values = [getattr(one[name], quantity).value for one in many]
            stated = getattr(found[name], quantity).deviation
            assert np.std(values) == pytest.approx(stated, rel=0.1), (name, quantity)
    rolling = [one["roll"].time_constants[0].value for one in many]
    assert np.std(rolling) == pytest.approx(found["roll"].time_constants[0].deviation, rel=0.1)
    # A spiral is slow, and one over a root near zero no longer linear: its root is, and its time
    # constant over a third of the deviations.
    spiral = found["spiral"]
    roots = [one["spiral"].roots[0].real for one in many]
    assert np.std(roots) == pytest.approx(spiral.root_deviations[0][0], rel=0.1)
    near = [by_name(dynamics + slopes @ (move / 3.0))["spiral"] for move in drawn]
    lasting = [one.time_constants[0].value for one in near]
    assert np.std(lasting) == pytest.approx(spiral.time_constants[0].deviation / 3.0, rel=0.1)


def test_where_pitch_and_roll_do_not_come_apart_nothing_has_a_name() -> None:
    """Roll rate and pitch rate swing together; beside them yaw has three roots and pitch three."""
    place = {name: index for index, name in enumerate(STATES)}
    dynamics = np.diag([-0.1, -2.0, -0.5, -1.0, -1.0, -3.0, -0.5, -0.3])
    for one, other in (("p", "q"), ("beta", "phi")):
        dynamics[place[one], place[other]], dynamics[place[other], place[one]] = 4.0, -4.0
    assert named(dynamics, *NOTHING) == ()


def test_names_of_states_are_all_there_are() -> None:
    assert set(LONGITUDINAL) | set(LATERAL) == set(STATES)
    assert eigenmodes.REAL < 1e-6
