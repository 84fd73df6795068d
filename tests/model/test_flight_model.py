"""An aircraft as compiled code takes it."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import frames
from gcs_sysid.aircraft import COEFFICIENTS, CoefficientModel, Value
from gcs_sysid.model import rigid_body
from gcs_sysid.model.flight_model import FlightModel
from tests.estimate import made_flight as made

AIRCRAFT = made.AIRCRAFT
AT = rigid_body.State(
    jnp.array([0.0, 0.0, -100.0]),
    jnp.array([20.0, 1.0, 2.0]),
    jnp.array([0.9, 0.1, 0.2, np.sqrt(1.0 - 0.86)]),
    jnp.array([0.3, -0.2, 0.1]),
)
INPUTS = rigid_body.Inputs(
    controls={name: jnp.asarray(0.05) for name in AIRCRAFT.control_names},
    settings=jnp.full(len(AIRCRAFT.propulsion), 0.6),
    wind=jnp.array([3.0, 1.0, 0.0]),
    gust_rate=jnp.zeros(3),
    density=jnp.asarray(1.1),
)


def derivative(model, terms):
    values = rigid_body.parameters(model.aircraft)._replace(aerodynamics=terms)
    return rigid_body.derivative(model.aircraft, values, AT, INPUTS)


def compiled():
    """The derivative, and a list that grows with each compilation of it."""
    calls = []

    @jax.jit
    def traced(model, terms):
        calls.append(1)
        return derivative(model, terms)

    return traced, calls


def terms_of(aircraft):
    return rigid_body.parameters(aircraft).aerodynamics


def heavier(aircraft):
    engines = tuple(
        replace(each, thrust=tuple(tuple(1.3 * n for n in row) for row in each.thrust))
        for each in aircraft.propulsion
    )
    mass = replace(aircraft.mass, mass=2.0 * aircraft.mass.mass, Ixz=0.02, cg=(0.01, 0.0, 0.02))
    return replace(aircraft, name="another", mass=mass, propulsion=engines)


@pytest.mark.parametrize("aircraft", [AIRCRAFT, heavier(AIRCRAFT)])
def test_it_moves_as_the_aircraft_does(aircraft):
    values = rigid_body.parameters(aircraft)
    expected = rigid_body.derivative(aircraft, values, AT, INPUTS)
    found = jax.jit(derivative)(FlightModel(aircraft), terms_of(aircraft))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-14)


def test_other_numbers_are_not_compiled_again():
    traced, calls = compiled()
    first = traced(FlightModel(AIRCRAFT), terms_of(AIRCRAFT))
    second = traced(FlightModel(heavier(AIRCRAFT)), terms_of(AIRCRAFT))
    assert len(calls) == 1
    assert not np.allclose(first.velocity, second.velocity)


def test_another_term_is_another_form():
    name = COEFFICIENTS[2]
    old = AIRCRAFT.aerodynamics[name]
    terms = {**old.terms, "beta^2": Value(0.1, 0.1)}
    more = {**AIRCRAFT.aerodynamics, name: CoefficientModel(terms, old.tables)}
    wider = FlightModel(replace(AIRCRAFT, aerodynamics=more))
    assert jax.tree.structure(wider) != jax.tree.structure(FlightModel(AIRCRAFT))
    assert jax.tree.structure(FlightModel(heavier(AIRCRAFT))) == jax.tree.structure(
        FlightModel(AIRCRAFT)
    )


def bent(slopes, flow):
    """CX…Cn that are no polynomial."""
    return jnp.tanh(flow["alpha"])[..., None] * slopes


def test_what_was_learned_beyond_the_terms_is_any_function_of_the_flow():
    slopes = jnp.array([0.1, 0.0, -0.7, 0.0, 0.3, 0.2])
    learned = replace(AIRCRAFT, beyond=jax.tree_util.Partial(bent, slopes))
    other = replace(AIRCRAFT, beyond=jax.tree_util.Partial(bent, 2.0 * slopes))
    traced, calls = compiled()
    plain = traced(FlightModel(AIRCRAFT), terms_of(AIRCRAFT))
    one = traced(FlightModel(learned), terms_of(AIRCRAFT))
    two = traced(FlightModel(other), terms_of(AIRCRAFT))
    assert len(calls) == 2  # other numbers of the same function wait for no compiler
    values = rigid_body.parameters(AIRCRAFT)
    felt = rigid_body.flow(AIRCRAFT, values, AT, INPUTS)
    area = felt["qbar"] * AIRCRAFT.geometry.wing_area
    wanted = frames.rotate(AT.attitude, area * bent(slopes, felt)[:3] / values.mass)
    np.testing.assert_allclose(one.velocity - plain.velocity, wanted, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(two.rate - plain.rate, 2.0 * (one.rate - plain.rate), rtol=1e-9)
