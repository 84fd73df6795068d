"""The attitude hold that maneuvers are planned with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs_sysid import aircraft_file, atmosphere, frames
from gcs_sysid.maneuvers import holding
from gcs_sysid.model import trim

AIRCRAFT = Path(__file__).resolve().parents[2] / "data" / "aircraft"


@pytest.mark.parametrize(
    ("name", "airspeed"), [("skywalker_x8", 18.0), ("aerosonde", 25.0), ("ad1_00", 60.0)]
)
def test_bank_is_reached_as_fast_as_asked_however_much_rolling_damps(name, airspeed) -> None:
    aircraft = aircraft_file.load(AIRCRAFT / f"{name}.toml")
    level = trim.find(aircraft, airspeed, 100.0, float(atmosphere.density(np.array(100.0))))
    held = holding.linearised(aircraft, level).held
    rolling = [3, 6]
    slowest = np.abs(np.linalg.eigvals(held[np.ix_(rolling, rolling)])).min()
    asked = holding.ATTITUDE / (holding.lag(aircraft) + holding.PERIOD)
    # Poles of s² + (d + k) s + (d + k) a with k = 2 a: the slower is a where rolling damps much,
    # √2 a where it does not.
    assert asked <= slowest <= 1.45 * asked


def test_what_holds_heading_damps_the_dutch_roll_of_a_flying_wing() -> None:
    """Its aircraft file has it unstable, and an attitude that is held alone hardly damps it.

    The autopilot of `sitl` holds headings too: it flew the wing in gusts within 12° of sideslip.
    """
    aircraft = aircraft_file.load(AIRCRAFT / "skywalker_x8.toml")
    level = trim.find(aircraft, 18.0, 100.0, float(atmosphere.density(np.array(100.0))))
    found = holding.linearised(aircraft, level)
    attitude, lateral = [1, 3, 5, 6], [1, 3, 5, 6, 8]
    own = np.linalg.eigvals(found.dynamics[np.ix_(attitude, attitude)])
    assert own.real.max() > 0.2
    free = _least_damped(found.turning().held[np.ix_(attitude, attitude)])
    held = _least_damped(found.held[np.ix_(lateral, lateral)])
    assert 0.0 < free < 0.1
    assert held > 0.2


def _least_damped(dynamics: np.ndarray) -> float:
    """Damping ratio of the oscillation that is damped least."""
    roots = np.linalg.eigvals(dynamics)
    swinging = roots[np.abs(roots.imag) > 1e-3]
    return float((-swinging.real / np.abs(swinging)).min())


def test_heading_grows_with_the_yaw_rate() -> None:
    aircraft = aircraft_file.load(AIRCRAFT / "aerosonde.toml")
    level = trim.find(aircraft, 25.0, 100.0, float(atmosphere.density(np.array(100.0))))
    row = holding.linearised(aircraft, level).dynamics[8]
    pitch = float(frames.euler_from_quaternion(level.state.attitude)[1])
    assert row[5] == pytest.approx(1.0 / np.cos(pitch), rel=1e-6)
    np.testing.assert_allclose(np.delete(row, [4, 5]), 0.0, atol=1e-9)
