"""What the summary tells of a fit inside the filter."""

from __future__ import annotations

from unittest.mock import Mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import aircraft_file
from gcs_sysid.estimate.filter_error import Fit
from gcs_sysid.model import aided
from gcs_sysid.offline import aided_summary
from gcs_sysid.offline.flight import Flight
from tests.estimate import made_flight as made
from tests.offline.conftest import ROOT

FILE = aircraft_file.load(ROOT / "data" / "aircraft" / "aerosonde.toml")


def test_what_the_autopilot_calls_level_is_told_with_its_deviation() -> None:
    known = made.unknowns(1.0)
    sensors = known.means.sensors._replace(attitude_tilt=jnp.array([0.004, -0.002]))
    fit = Mock(
        spec=Fit,
        unknowns=known._replace(means=known.means._replace(sensors=sensors)),
        deviation=jax.tree.map(lambda part: jnp.full_like(part, 1e-3), known),
        states=Mock(),
        smoothed=Mock(covariance=np.tile(np.eye(aided.SIZE), (3, 1, 1))),
        moved=np.full((aided.SIZE, 2), 2.0),
        parameters=np.diag([1.0, 0.0]),
    )
    fit.states.air.wind = np.zeros((3, 3))
    flight = Mock(spec=Flight, aircraft=FILE, reconstruction=Mock())
    flight.reconstruction.data.used = {}
    document = {"sensor": {}, "delays": {}}
    aided_summary.put_reconstruction(document, fit, flight)
    # What is not known of the parameters is added to the smoother's own variance.
    np.testing.assert_allclose(document["wind_ned"]["sd"], np.sqrt(1.0 + 4.0))
    for axis, value in (("roll", 0.004), ("pitch", -0.002)):
        told = document["sensor"][f"attitude_{axis}_tilt"]
        assert told["value"] == pytest.approx(value)
        assert told["sd"] == pytest.approx(1e-3)
        assert told["unit"] == "rad"
