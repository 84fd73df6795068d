"""The simulation under test, where it is an identified model with processes beside it."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.model import aerodynamics
from gcs_sysid.offline import tested
from tests.gp.test_fitting import asked, found, model, polynomial  # noqa: F401 - fixtures
from tests.offline.made_aircraft import small


def test_it_flies_what_was_learned(model, asked):  # noqa: F811
    flies = tested.with_model(small(), model)
    flow = {name: jnp.asarray(values) for name, values in asked.items()}
    six = np.asarray(aerodynamics.of_aircraft(flies, flow))
    for name, wanted in model.predict(asked, measured=True).items():
        np.testing.assert_allclose(six[:, COEFFICIENTS.index(name)], wanted.mean, atol=1e-9)


def test_a_file_that_lacks_the_processes_says_so(model):  # noqa: F811
    flies = tested.Tested(tested.with_model(small(), model), "out/model", None)
    (told,) = flies.left_out("plane.xml")
    assert told.startswith("plane.xml has no place for the Gaussian processes of out/model")
    plain = tested.Tested(tested.with_model(small(), polynomial()), "out/model", None)
    assert plain.left_out("plane.xml") == []
