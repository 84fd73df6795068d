"""Simulated windows against a motion that the same equations made, and against a changed one."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid import frames, regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, Value
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.model import aerodynamics, rigid_body
from gcs_sysid.model.rigid_body import Inputs, State
from gcs_sysid.offline import simulate, tolerances, windows
from gcs_sysid.offline.windows import CHANNELS, Windows
from tests.offline.made_aircraft import small

COUNT = 81


def aircraft() -> Aircraft:
    """Statically and dynamically stable, so that what is compared is not an instability."""
    made = small()
    models = dict(made.aerodynamics)
    more = {
        "CX": {"1": -0.04},
        "CY": {"beta": -0.9},
        "CZ": {"1": -0.3},
        "Cl": {"beta": -0.1},
        "Cn": {"rhat": -0.1},
    }
    for name, terms in more.items():
        old = models.get(name, models["Cl"])
        kept = old.terms if name in models else {}
        added = {key: Value(value, 0.1 * abs(value)) for key, value in terms.items()}
        models[name] = replace(old, terms={**kept, **added})
    return replace(made, aerodynamics=models)


def motion(made: Aircraft) -> Windows:
    """Two windows flown by the equations themselves, wind and moving controls included."""
    time = windows.STEP * np.arange(COUNT)
    euler = np.array([[0.1, 0.05, 0.3], [-0.4, 0.1, 3.1]])
    start = State(
        position=jnp.array([[0.0, 0.0, -100.0]] * 2),
        velocity=jnp.array([[20.0, 5.0, -1.0], [-21.0, 1.0, 0.5]]),
        attitude=frames.quaternion_from_euler(jnp.array(euler)),
        rate=jnp.array([[0.1, 0.0, 0.05], [0.0, 0.1, 0.0]]),
    )
    given = Inputs(
        controls={
            name: jnp.asarray(size * np.sin(3.0 * time)[None].repeat(2, 0))
            for name, size in (("aileron", 0.05), ("elevator", 0.04), ("rudder", 0.03))
        },
        settings=jnp.full((2, COUNT, 1), 0.5),
        wind=jnp.tile(jnp.array([1.0, -2.0, 0.2]), (2, COUNT, 1)),
        gust_rate=jnp.zeros((2, COUNT, 3)),
        density=jnp.full((2, COUNT), 1.2),
    )
    values = rigid_body.parameters(made)

    def one(first: State, inputs: Inputs) -> jax.Array:
        path = rigid_body.propagate(made, values, first, inputs, jnp.asarray(time))
        return jax.vmap(windows.channels_of)(path, inputs.wind)

    measured = np.array(jax.jit(jax.vmap(one))(start, given))
    measured[..., 6:] = np.unwrap(measured[..., 6:], axis=1)
    # A flight's heading is continuous over the whole flight, not within half a turn of zero.
    measured[1, :, 8] += 2.0 * np.pi
    return Windows(
        time=np.stack([10.0 + time, 20.0 + time]),
        piece=np.array([4, 7]),
        start=start,
        flow_sigma=np.full((2, 3), 0.01),
        inputs=given,
        measured=measured,
    )


@pytest.fixture(scope="module")
def flown() -> tuple[Aircraft, Windows]:
    made = aircraft()
    return made, motion(made)


def test_the_aircraft_that_flew_is_simulated_as_flown(flown) -> None:
    made, cut = flown
    found = windows.fly(made, cut)
    np.testing.assert_allclose(found.value, cut.measured, atol=1e-9)
    assert all(
        item["pass"] for item in simulate.channels(tolerances.usual(made), cut, found).values()
    )
    # At the beginning only the state's own deviation counts, one sigma of 0.01 of each.
    np.testing.assert_allclose(found.deviation[:, 0, :3], 0.01, rtol=1e-3)
    np.testing.assert_allclose(found.deviation[:, 0, 3:], 0.0, atol=1e-9)
    assert (found.deviation[:, 1:] > 0.0).all()


def test_another_aircraft_departs_in_its_own_channels(flown) -> None:
    made, cut = flown
    models = dict(made.aerodynamics)
    terms = dict(models["Cl"].terms)
    terms["aileron"] = replace(terms["aileron"], value=0.3 * terms["aileron"].value)
    models["Cl"] = replace(models["Cl"], terms=terms)
    found = windows.fly(replace(made, aerodynamics=models), cut)
    scores = simulate.channels(tolerances.usual(made), cut, found)
    assert not scores["p"]["pass"]
    assert scores["q"]["pass"]
    assert scores["p"]["rms"] > scores["p"]["tolerance"]


def test_theil_is_zero_for_equal_one_for_opposite_and_blind_to_a_common_mean() -> None:
    wave = np.sin(np.linspace(0.0, 9.0, 50))[None]
    assert simulate.theil(wave, wave) == 0.0
    assert simulate.theil(wave, -wave) == pytest.approx(1.0)
    assert simulate.theil(wave, 0.0 * wave) == pytest.approx(1.0)
    assert simulate.theil(100.0 + wave, 100.0 + 0.5 * wave) == pytest.approx(1.0 / 3.0)
    assert simulate.theil(np.zeros((1, 5)), np.zeros((1, 5))) == 0.0


def test_parts_of_theil_are_mean_size_and_course_and_add_up() -> None:
    wave = np.sin(np.linspace(0.0, 8.0 * np.pi, 400))[None]
    quarter = np.cos(np.linspace(0.0, 8.0 * np.pi, 400))[None] - 1.0
    larger = simulate.theil_parts(wave, 1.5 * wave)
    assert larger["variance"] == pytest.approx(1.0, abs=1e-6)
    moved = simulate.theil_parts(wave, wave + 0.3)
    assert moved["bias"] == pytest.approx(1.0)
    later = simulate.theil_parts(wave, quarter)
    # A quarter of a period late and lower by one: 1 of the mean square of 1 + 1 is the mean.
    assert later["bias"] == pytest.approx(0.5, abs=0.01)
    assert later["covariance"] == pytest.approx(0.5, abs=0.01)
    assert sum(later.values()) == pytest.approx(1.0)


def test_coefficients_are_scored_about_each_maneuver() -> None:
    """By hand: Cm as the file has it, once larger by half in a maneuver, once moved in another."""
    made, count = aircraft(), 400
    flow = {name: np.zeros(count) for name in regressors.VARIABLES}
    flow |= {name: np.zeros(count) for name in made.control_names}
    flow["alpha"] = np.sin(np.linspace(0.0, 8.0 * np.pi, count + 1)[:-1])
    file = np.asarray(aerodynamics.of_aircraft(made, flow))
    seen = dict(zip(COEFFICIENTS, file.T.copy(), strict=True))
    slope = made.aerodynamics["Cm"].terms["alpha"].value
    seen["Cm"][:200] += 0.5 * slope * flow["alpha"][:200]
    seen["CZ"][200:] -= 0.1
    seen["Cm"][250:260] = np.nan
    samples = Samples(
        time=0.02 * np.arange(count),
        qbar=np.full(count, 200.0),
        regressors=flow,
        regressor_variance={},
        measured=seen,
        noise={},
        mass_part={},
        thrust_part={},
        smoothing=1.0,
        refused={"CY": "not measured"},
    )
    found = simulate.coefficients(made, samples, np.repeat([1, 2], 200))
    assert set(found) == set(COEFFICIENTS) - {"CY"}
    share = np.sqrt(200.0 / 390.0)
    assert found["Cm"]["rms"] == pytest.approx(0.5 * abs(slope) * share / np.sqrt(2.0))
    assert found["Cm"]["bias"] == pytest.approx(0.0, abs=1e-12)
    assert found["CZ"]["bias"] == pytest.approx(0.05)
    assert found["CX"]["rms"] == found["CX"]["theil"] == 0.0
    nobody = simulate.coefficients(made, samples, np.full(count, -1))
    assert nobody == {}


def test_a_channel_goes_along_at_the_frequencies_flown(flown) -> None:
    _, cut = flown
    many = cut._replace(measured=np.tile(cut.measured, (4, 1, 1)))
    found = simulate.in_frequency(many, windows.Simulated(many.measured, many.measured))
    assert set(found) == set(CHANNELS)
    assert found["q"] is not None
    assert found["q"]["gain"] == pytest.approx(1.0)
    assert found["q"]["phase"] == pytest.approx(0.0, abs=1e-12)


def test_whole_maneuvers_end_where_they_were_flown_and_those_lost_are_told(flown) -> None:
    made, cut = flown
    measured = cut.measured.copy()
    measured[1, COUNT // 2 :] = np.nan
    found = simulate.free_run(made, cut._replace(measured=measured))
    assert found["count"] == 2
    assert found["longest_s"] == pytest.approx(COUNT * windows.STEP)
    assert found["lost"] == []
    assert max(item["rms"] for item in found["channels"].values()) < 1e-9
    models = dict(made.aerodynamics)
    terms = {
        key: replace(item, value=-3e4 * item.value) for key, item in models["Cm"].terms.items()
    }
    models["Cm"] = replace(models["Cm"], terms=terms)
    wild = simulate.free_run(replace(made, aerodynamics=models), cut)
    assert wild["lost"] == [4, 7]
    assert wild["channels"] == {}
    nothing = cut._replace(piece=np.zeros(0, dtype=int))
    assert simulate.free_run(made, nothing)["count"] == 0


def test_channels_are_those_of_the_interface() -> None:
    assert CHANNELS == ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi")
