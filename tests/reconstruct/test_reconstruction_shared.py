"""Reconstruction of simulated flights with truth, and of real ones, where these lie beside us."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.reconstruct import compatibility, measurements
from gcs_sysid.reconstruct.airborne import airborne
from gcs_sysid.reconstruct.reconstruction import Reconstruction, reconstruct
from gcs_sysid.sources.registry import open_recording
from tests.reconstruct import kinematic_flights, truth
from tests.reconstruct.truth import Compared

pytestmark = [pytest.mark.shared, pytest.mark.slow]
LENGTH = 75.0
"""So much of a real flight [s] is enough to see that it is understood."""


@functools.cache
def clean(folder: Path) -> Compared:
    return truth.compare(folder / "flight.tlog", folder / "aircraft.toml", folder / "truth.npz")


@functools.cache
def flown(log: Path, aircraft: Path | None = None) -> Reconstruction:
    """The middle of the longest wing-borne part of a real flight."""
    believed = (
        kinematic_flights.aircraft(vanes=False)
        if aircraft is None
        else aircraft_file.load(aircraft)
    )
    recording = open_recording(log)
    start, end = max(airborne(recording, believed), key=lambda one: one[1] - one[0])
    begin = max(start, 0.5 * (start + end - LENGTH))
    data = measurements.select(recording, believed, (begin, min(end, begin + LENGTH)))
    return reconstruct(data, believed)


def test_wind_and_attitude_are_found_and_alpha_stays_within_its_band(shared: Path) -> None:
    """Moderate turbulence, no vanes: alpha cannot be found, but the band must say so."""
    found = clean(shared / "cases" / "clean")
    assert np.rad2deg(found.rms("phi")) < 1.5
    assert np.rad2deg(found.rms("theta")) < 1.5
    assert np.rad2deg(found.rms("psi")) < 4.0
    for axis in ("wind_north", "wind_east"):
        mean = abs(float(np.mean(found.errors[axis])))
        assert mean < 1.0
    for name in ("V", "alpha", "beta"):
        # Turbulence is no first-order process and the band's own width is estimated.
        assert 0.85 < found.coverage(name) <= 1.0, name
        assert found.stated(name) < 2.5 * found.rms(name), name


def test_a_clean_case_is_called_consistent(shared: Path) -> None:
    states = clean(shared / "cases" / "clean").states
    verdict = compatibility.check(states)
    assert verdict.channels["airspeed"].verdict == "consistent"
    scale = verdict.channels["airspeed"].scale
    assert scale is not None
    assert abs(scale.value) < 3.0 * scale.deviation + 0.02


def test_thor_is_understood_with_its_vanes(shared: Path) -> None:
    folder = shared / "data" / "umn_thor"
    states = flown(folder / "thor_flight75.tlog", folder / "aircraft.toml")
    plausible(states)
    assert "vanes" in states.data.used
    assert np.rad2deg(np.sqrt(states.flow_covariance[:, 1, 1]).mean()) < 1.5


def test_solarsurfer_is_understood(shared: Path) -> None:
    plausible(flown(shared / "data" / "solarsurfer" / "flight3.tlog"))


def test_a_flight_without_accelerometer_is_reconstructed_with_wide_bands(shared: Path) -> None:
    states = flown(shared / "data" / "proto_flt09" / "proto_flt09.tlog")
    plausible(states)
    assert not states.data.has_accelerometer
    channels = compatibility.check(states).channels
    assert not any(name.startswith("accelerometer") for name in channels)


def plausible(states: Reconstruction) -> None:
    """What holds for every small aircraft that flies."""
    measured = states.data.measured
    seen = measured.valid[:, 0]
    off = states.airspeed[seen] - measured.airspeed[seen, 0]
    assert np.std(off) < 2.5
    assert abs(np.median(np.rad2deg(states.alpha))) < 12.0
    assert np.isfinite(states.flow_covariance).all()
    assert np.linalg.norm(np.median(states.wind, axis=0)) < 15.0
