"""Directions of causes: all there, and what they stand for, against the simulator's own effects.

`sitl` hides effects by its own code in an aircraft that flies; what `extended` writes into the file
for the same cause must be that aircraft.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from gcs_sysid import aircraft_file, regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, CoefficientModel
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.diagnose import extended
from gcs_sysid.diagnose.aided import beliefs, quantities
from gcs_sysid.diagnose.aided.quantities import Flown, Quantities
from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.model import actuators, aerodynamics, departures, servo_changes
from gcs_sysid.model.aided import Means, Sensors
from gcs_sysid.offline import diagnosis_entries
from gcs_sysid.sitl import plan, scenario
from gcs_sysid.sitl.effects import catalogue
from gcs_sysid.sitl.flight import Flight

DATA = Path(__file__).resolve().parents[3] / "data" / "aircraft"


@pytest.fixture(scope="module", params=["ultra_stick_25e", "aerosonde"])
def aircraft(request) -> Aircraft:
    return aircraft_file.load(DATA / f"{request.param}.toml")


def built(
    aircraft: Aircraft,
    *,
    low: bool = True,
    wind: float = 3.0,
    reached: dict[str, float] | None = None,
    acting: Collection[str] = (),
) -> Quantities:
    rates = dict.fromkeys(aircraft.control_names, 2.0)
    lowest = 0.1 if low else 5.0
    streams = {
        "gyro": "RAW_IMU",
        "attitude": "ATTITUDE",
        "velocity": "GLOBAL_POSITION_INT",
        "airspeed": "SCALED_PRESSURE",
    }
    if aircraft.vanes is not None:
        streams["vanes"] = "AOA_SSA"
    flown = Flown(np.linspace(150.0, 350.0, 50), lowest, rates, streams, wind)
    return quantities.build(aircraft, flown, reached, acting)


def means(found: Quantities) -> Means:
    values = {
        name: {key: jnp.asarray(item.value) for key, item in model.terms.items()}
        for name, model in found.aircraft.aerodynamics.items()
    }
    zero, pair = jnp.zeros(()), jnp.zeros(2)
    sensors = Sensors(jnp.zeros(3), jnp.zeros(3), zero, zero, pair, pair, *[zero] * 6, pair)
    return Means(values, sensors, departures.none(found.aircraft, len(found.servos)))


def test_what_takes_lift_or_gives_play_cannot_do_less_than_nothing(aircraft) -> None:
    """A lift slope that grew by 0.73 beyond 0.1 rad was named a stall, beside late commands."""
    stiff = built(aircraft)
    first, *others = aircraft.servos
    loose = built(replace(aircraft, servos=(replace(first, backlash=0.01), *others)))
    moved = {one.name for one in aircraft.controls if first.surface in one.mix}
    assert moved
    for each in quantities.candidates(CAUSES, stiff):
        for name in each.frees:
            if each.cause.name in ("stall", "propwash"):
                assert stiff.least[name] == 0.0
            elif name.startswith("backlash."):
                own = 0.01 if name.removeprefix("backlash.") in moved else 0.0
                assert (stiff.least[name], loose.least[name]) == (0.0, -own)


def test_a_wind_that_hardly_blows_grows_with_nothing(aircraft) -> None:
    def named(wind: float) -> set[str]:
        return {one.cause.name for one in quantities.candidates(CAUSES, built(aircraft, wind=wind))}

    assert named(3.0) - named(1.5) == {"wind_shear"}
    calm = quantities.candidates(CAUSES, built(aircraft, wind=1.5))
    assert "2 m/s" in diagnosis_entries.not_asked(calm)["wind_shear"]


def test_names_are_those_of_the_flat_vector(aircraft) -> None:
    found = built(aircraft)
    tree = means(found)
    flat, unravel = ravel_pytree(tree)
    names = quantities.names(tree)
    assert len(names) == flat.size
    moved = unravel(flat.at[names.index("departures.imu_tilt.1")].add(0.3))
    np.testing.assert_allclose(moved.departures.imu_tilt, [0.0, 0.3, 0.0])
    index = names.index("aerodynamics.Cm.alpha")
    assert float(flat[index]) == aircraft.aerodynamics["Cm"].terms["alpha"].value


def test_every_cause_frees_something_that_the_model_has(aircraft) -> None:
    found = built(aircraft)
    names = quantities.names(means(found))
    every = quantities.candidates(CAUSES, found)
    wanted = set(CAUSES) - (set() if "vanes" in found.has else {"vane_bias"})
    assert {candidate.cause.name for candidate in every} == wanted
    for candidate in every:
        for name in candidate.frees:
            assert set(found.directions[name]) <= set(names)
        for parameter in candidate.cause.parameters:
            assert found.sizes[parameter.per] > 0.0
    aloft = quantities.candidates(CAUSES, built(aircraft, low=False))
    assert "ground_effect" not in {candidate.cause.name for candidate in aloft}


def test_what_only_causes_free_is_held_otherwise(aircraft) -> None:
    found = built(aircraft)
    names = quantities.names(means(found))
    sigma = beliefs.ordinary(names, found.aircraft, vanes=False)
    by_name = dict(zip(names, sigma, strict=True))
    assert by_name["departures.actuators.0"] == 0.0
    assert by_name["sensors.vane_bias.0"] == 0.0
    assert by_name["departures.mass"] == aircraft.mass.mass_sigma
    term = aircraft.aerodynamics["Cm"].terms["alpha"]
    assert by_name["aerodynamics.Cm.alpha"] == term.sigma > 0.0
    added = set(found.aircraft.aerodynamics["Cm"].terms) - set(aircraft.aerodynamics["Cm"].terms)
    assert all(by_name[f"aerodynamics.Cm.{key}"] == 0.0 for key in added)


FLOWN = (
    ({"name": "mass", "mass_ratio": 1.1}, {"mass": 0.1}),
    ({"name": "cg_shift", "cg_x_chord": -0.05}, {"cg.x": -0.05}),
    ({"name": "inertia", "Iyy_ratio": 1.2, "Izz_ratio": 0.9},
     {"inertia.1": 0.2, "inertia.2": -0.1}),
    ({"name": "airspeed_scale", "airspeed_scale": 0.06}, {"airspeed": 0.06}),
    ({"name": "pitot_lag", "pitot_lag": 0.2}, {"airspeed_lag": 0.2}),
    ({"name": "accelerometer_bias", "bias_y": 0.4}, {"accelerometer_bias.1": 0.4}),
    ({"name": "gyro_scale", "scale_z": 0.03}, {"gyro_scale.2": 0.03}),
    ({"name": "imu_misalignment", "tilt_y": 0.05}, {"imu_tilt.1": 0.05}),
    ({"name": "imu_position", "dx": 0.1, "dz": -0.05},
     {"imu_position.0": 0.1, "imu_position.2": -0.05}),
    ({"name": "actuator_lag", "control": "elevator", "time_constant": 0.15},
     {"lag.elevator": 0.15}),
    ({"name": "actuator_backlash", "control": "elevator", "width": 0.02},
     {"backlash.elevator": 0.02}),
    (
        {"name": "actuator_rate_limit", "control": "elevator", "rate_limit": 0.6},
        {"rate_limit.elevator.0.35": 1.0},
    ),
    ({"name": "surface_offset", "control": "elevator", "offset": 0.04}, {"offset.elevator": 0.04}),
    ({"name": "thrust_scale", "ratio": 0.8}, {"thrust": -0.2}),
    ({"name": "thrust_offset", "z": 0.03, "tilt": 0.05, "torque": 0.01},
     {"thrust_drop": 0.03, "thrust_tilt": 0.05, "torque": 0.01}),
    ({"name": "drag_increase", "CX0": -0.012}, {"term.CX.1": -0.012}),
    ({"name": "stall", "alpha_break": 0.12, "slope_loss": 0.6}, {"stall.0.12": 0.6}),
    ({"name": "asymmetry", "Cl0": 0.008, "Cn0": -0.002}, {"term.Cl.1": 0.008, "term.Cn.1": -0.002}),
    ({"name": "cross_coupling", "Cm_beta": 0.2, "Cl_alpha": 0.1},
     {"term.Cm.beta": 0.2, "term.Cl.alpha": 0.1}),
    ({"name": "aero_derivative", "derivative": "Cm.alpha", "ratio": 0.8},
     {"derivative.Cm.alpha": -0.2}),
)  # fmt: skip


@pytest.mark.parametrize(("effect", "wrong"), FLOWN, ids=lambda item: item.get("name", ""))
def test_the_extended_file_is_the_aircraft_that_flew(aircraft, effect, wrong) -> None:
    legs = plan.standard(aircraft)[:1]
    flight = Flight(
        believed=aircraft,
        flown=aircraft,
        legs=legs,
        start=scenario.start(legs[0]),
        wind=scenario.wind(0.0, 0.0, 0.0),
        seed=1,
    )
    flew = catalogue.hide(flight, [Section("effect.toml", "", effect)]).flown
    found = built(aircraft)
    sizes = {name: (value, 0.0) for name, value in wrong.items()}
    made = extended.corrected(aircraft, sizes, found.directions, {"elevator": 0.6})
    flat, wanted = (_numbers(one) for one in (made, flew))
    assert flat.keys() == wanted.keys()
    for name, value in wanted.items():
        np.testing.assert_allclose(flat[name], value, rtol=1e-9, atol=1e-12, err_msg=name)


def test_late_commands_are_taken_where_they_are(aircraft) -> None:
    """The change of the controls is that of a delay of the size, later or earlier."""
    reached = {"skew.SERVO_OUTPUT_RAW.0.07": 0.11}
    found = built(aircraft, reached=reached)
    for name, size in (
        ("skew.SERVO_OUTPUT_RAW.0.07", 0.11),
        ("skew.SERVO_OUTPUT_RAW.-0.07", -0.07),
    ):
        ((parameter, weight),) = found.directions[name].items()
        other, unit = found.servos[int(parameter.rpartition(".")[2])]
        assert (weight, unit) == (1.0, size)
        assert other.streams["SERVO_OUTPUT_RAW"].delay == pytest.approx(size)
    every = quantities.candidates(CAUSES, found)
    skews = [one for one in every if one.about == "SERVO_OUTPUT_RAW"]
    assert {one.frees for one in skews} == {
        ("skew.SERVO_OUTPUT_RAW.0.07",),
        ("skew.SERVO_OUTPUT_RAW.-0.07",),
    }
    assert quantities.servo_sizes({"skew.SERVO_OUTPUT_RAW.0.07": 0.111}, reached) is None
    moved = quantities.servo_sizes({"skew.SERVO_OUTPUT_RAW.-0.07": -0.1}, reached)
    assert moved == pytest.approx({**reached, "skew.SERVO_OUTPUT_RAW.-0.07": -0.1})
    # What is off by a twentieth stays where that is near enough.
    late = {"skew.SERVO_OUTPUT_RAW.0.07": 0.083}
    assert quantities.servo_sizes(late, {next(iter(late)): 0.08}, 0.05) is None
    # One of the other sign has next to nothing to take.
    moved = quantities.servo_sizes({"skew.SERVO_OUTPUT_RAW.-0.07": 0.1}, {})
    assert moved == pytest.approx({"skew.SERVO_OUTPUT_RAW.-0.07": -0.0175})


def test_a_late_stream_is_told_by_the_message_that_carried_it(aircraft) -> None:
    found = built(aircraft)
    made = extended.corrected(
        aircraft, {"skew.SCALED_PRESSURE": (0.08, 0.01)}, found.directions, {}
    )
    assert {name: timing.delay for name, timing in made.streams.items()} == {
        "SCALED_PRESSURE": 0.08
    }
    for place, early in ((0.07, 0.09), (-0.07, -0.04)):
        name = f"skew.SERVO_OUTPUT_RAW.{place}"
        made = extended.corrected(aircraft, {name: (early, 0.01)}, found.directions, {})
        assert {key: timing.delay for key, timing in made.streams.items()} == {
            "SERVO_OUTPUT_RAW": early
        }
    made = extended.corrected(aircraft, {"skew.RAW_IMU": (0.05, 0.01)}, found.directions, {})
    others = {"SERVO_OUTPUT_RAW", "ATTITUDE", "GLOBAL_POSITION_INT", "SCALED_PRESSURE"}
    others |= {"AOA_SSA"} if aircraft.vanes is not None else set()
    assert {name: timing.delay for name, timing in made.streams.items()} == dict.fromkeys(
        others, -0.05
    )


def _numbers(aircraft: Aircraft) -> dict[str, np.ndarray]:
    """Every number of an aircraft but for sigmas, which only the finding side has."""
    paths = jax.tree_util.tree_flatten_with_path(_plain(aircraft))[0]
    return {
        str(path): np.asarray(leaf, dtype=float)
        for path, leaf in paths
        if isinstance(leaf, (int, float)) and "sigma" not in str(path)
    }


def _plain(value: object) -> object:
    if isinstance(value, (tuple, list)):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in sorted(value.items())}
    if hasattr(value, "__dataclass_fields__"):
        return {key: _plain(getattr(value, key)) for key in value.__dataclass_fields__}
    return value


def coefficients(found: Quantities, along: dict[str, float], flow: dict[str, float]) -> np.ndarray:
    """CX…Cn with the terms moved along quantities."""
    models = {}
    for name, model in found.aircraft.aerodynamics.items():
        terms = dict(model.terms)
        for quantity, size in along.items():
            for path, weight in found.directions[quantity].items():
                kind, coefficient, key = path.split(".", 2)
                if kind == "aerodynamics" and coefficient == name:
                    terms[key] = replace(terms[key], value=terms[key].value + size * weight)
        models[name] = CoefficientModel(terms, model.tables)
    return acting(replace(found.aircraft, aerodynamics=models), flow)


def acting(aircraft: Aircraft, flow: Mapping[str, float | np.ndarray]) -> np.ndarray:
    """CX…Cn of an aircraft."""
    values = {key: jnp.asarray(value) for key, value in flow.items()}
    return np.asarray(aerodynamics.of_aircraft(aircraft, values))


def at(aircraft: Aircraft, **given: float) -> dict[str, float]:
    flow = dict.fromkeys(("alpha", "beta", "phat", "qhat", "rhat", "alphadot_hat", "Tc"), 0.0)
    flow |= {
        "qbar": 230.0,
        "V": 19.0,
        "h_over_b": 9.0,
        **dict.fromkeys(aircraft.control_names, 0.0),
    }
    return {**flow, **given}


def test_propeller_wash_multiplies_the_tails_effect(aircraft) -> None:
    found = built(aircraft)
    flow = at(aircraft, Tc=0.1, elevator=0.1)
    still = coefficients(found, {}, {**flow, "elevator": 0.0})
    plain = coefficients(found, {}, flow) - still
    washed = coefficients(found, {"wash": 0.5}, flow) - still
    np.testing.assert_allclose(washed, plain * (1.0 + 4.0 * 0.5 * 0.1), rtol=1e-9, atol=1e-12)


def test_bending_follows_the_logarithm_of_the_pressures_flown(aircraft) -> None:
    found = built(aircraft)
    reference = float(np.median(np.linspace(150.0, 350.0, 50)))
    for qbar in (160.0, 240.0, 340.0):
        flow = at(aircraft, elevator=0.1, qbar=qbar)
        still = coefficients(found, {}, {**flow, "elevator": 0.0})
        plain = coefficients(found, {}, flow) - still
        bent = coefficients(found, {"aeroelastic.elevator": -0.3}, flow) - still
        wanted = 1.0 - 0.3 * np.log2(qbar / reference)
        large = np.abs(plain) > 1e-9
        np.testing.assert_allclose(bent[large] / plain[large], wanted, atol=0.005)


def test_what_bends_is_put_right_by_level_and_loss_together(aircraft) -> None:
    """Added, as they were found: not one times the other."""
    found = built(aircraft)
    bent = {"aeroelastic.elevator": -0.3, "effectiveness.elevator": -0.1}
    wrong = {name: (value, 0.01) for name, value in bent.items()}
    made = extended.corrected(aircraft, wrong, found.directions)
    for qbar in (160.0, 340.0):
        flow = at(aircraft, elevator=0.1, alpha=0.03, qbar=qbar)
        np.testing.assert_allclose(acting(made, flow), coefficients(found, bent, flow), atol=1e-12)
    assert made.servos == aircraft.servos


def test_the_ground_lifts_by_its_influence(aircraft) -> None:
    found = built(aircraft)
    names = list(found.aircraft.aerodynamics)
    terms = aircraft.aerodynamics["CZ"].terms
    for height in (0.05, 0.2, 0.5, 1.1):
        flow = at(aircraft, alpha=0.05, h_over_b=height)
        plain = coefficients(found, {}, flow)[names.index("CZ")]
        near = coefficients(found, {"ground.lift": 0.3}, flow)[names.index("CZ")]
        wing = terms["1"].value + 0.05 * terms["alpha"].value
        share = float(quantities.influence(np.array([height]))[0])
        assert near - plain == pytest.approx(0.3 * share * wing, abs=0.3 * 0.05 * abs(wing))


def test_lags_are_taken_where_they_are_and_more_is_looked_for_where_more_was_found() -> None:
    assert quantities.servo_sizes({"mass": 1.0}, {}) is None
    assert quantities.servo_sizes({"lag.elevator": 0.101}, {}) is None
    first = quantities.servo_sizes({"lag.elevator": 0.11}, {}) or {}
    assert first["lag.elevator"] > 0.11
    # It is as long as what more of it does says.
    there = quantities.servo_sizes({"lag.elevator": 0.11}, {}, acting=("lag.elevator",))
    assert there == {"lag.elevator": pytest.approx(0.11)}
    assert quantities.servo_sizes(first, first) is None
    twice = quantities.servo_sizes({"backlash.rudder": 0.1}, first)
    assert twice == pytest.approx({**first, "backlash.rudder": 0.05})


def test_a_lag_is_less_than_the_files_as_far_as_that_has_one() -> None:
    name, stated = "lag.elevator", {"lag.elevator": -0.14}
    sizes = partial(quantities.servo_sizes, least=stated)
    assert sizes({name: -0.05}, {}) == {name: pytest.approx(-0.05)}
    assert sizes({name: -0.06}, {name: -0.05}) == {name: pytest.approx(-0.06)}
    assert sizes({name: -0.05}, {name: -0.05}) is None
    assert sizes({name: -0.5}, {name: -0.1}) == {name: pytest.approx(-0.126)}
    # From where it is longer, what a shorter one does is overrated: half of it goes at first.
    assert sizes({name: -0.5}, {}) == {name: pytest.approx(-0.07)}
    short = quantities.servo_sizes({name: -0.5}, {}, least={name: -0.03})
    assert short == {name: pytest.approx(-0.02)}
    # Slightly less is as good as a line, and more after all is taken where it is.
    assert sizes({name: -0.01}, {name: 0.03}) == {name: pytest.approx(0.02)}
    assert sizes({name: 0.08}, {name: -0.05}) == {name: pytest.approx(0.08)}
    # A servo that does not lag cannot lag less.
    assert quantities.servo_sizes({name: -0.05}, {name: 0.03}) == {name: pytest.approx(0.02)}


@pytest.mark.parametrize(
    ("change", "name", "true"),
    [
        (servo_changes.lag, "lag.elevator", 0.2),
        (servo_changes.lag, "lag.elevator", 0.06),
        (servo_changes.lag, "lag.elevator", -0.08),
        (servo_changes.backlash, "backlash.elevator", 0.035),
        (servo_changes.backlash, "backlash.elevator", 0.012),
    ],
)
def test_a_few_rounds_find_a_servo_as_it_is(change, name: str, true: float) -> None:
    """Least squares on what the elevator did, with the change taken where the last round ended."""
    plain = aircraft_file.load(DATA / "aerosonde.toml")
    slow = [replace(one, time_constant=0.14) if true < 0.0 else one for one in plain.servos]
    aircraft = replace(plain, servos=tuple(slow))
    time = 0.02 * np.arange(3000)
    swing = sum(np.sin(2.0 * np.pi * rate * time + 3.0 * rate**2) for rate in (0.2, 0.7, 1.3, 2.1))
    pulses = {servo.channel: 1500.0 + 45.0 * swing for servo in aircraft.servos}

    def moved(made: Aircraft) -> np.ndarray:
        return np.asarray(actuators.controls(made, pulses, time)["elevator"])

    still = moved(aircraft)
    did = moved(servo_changes.changed(aircraft, "elevator", change(true))) - still
    reached: dict[str, float] = {}
    for _ in range(3):
        size = reached.get(name, quantities.SERVO[name.partition(".")[0]])
        along = moved(servo_changes.changed(aircraft, "elevator", change(size))) - still
        found = {name: size * (along @ did) / (along @ along)}
        reached = quantities.servo_sizes(found, reached, least={name: -0.14}) or {name: size}
    assert reached[name] == pytest.approx(true, rel=0.05)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("lag.elevator", 0.2),
        ("skew.SERVO_OUTPUT_RAW.0.07", 0.1),
        ("skew.SERVO_OUTPUT_RAW.-0.07", -0.1),
    ],
)
def test_what_more_of_a_lag_does_is_its_derivative_where_it_is(name: str, size: float) -> None:
    """Against the first-order lag's and the delay's own derivatives, in closed form.

    The stream may be told late, so that the aircraft begins with a delay of its own.
    """
    plain = aircraft_file.load(DATA / "aerosonde.toml")
    plain = replace(plain, servos=tuple(replace(one, delay=0.0) for one in plain.servos))
    found = built(plain, reached={name: size}, acting=(name,))
    assert found.acting == {name: size}
    time, rate, begun = 0.002 * np.arange(5000), 3.0, 4000
    pulses = {servo.channel: 1500.0 + 45.0 * np.sin(rate * time) for servo in plain.servos}

    def moved(made: Aircraft) -> np.ndarray:
        late = made.streams["SERVO_OUTPUT_RAW"].delay if made.streams else 0.0
        at = time[begun:] - 0.5
        return np.asarray(
            actuators.controls(made, pulses, time, at=at, extra_delay=late)["elevator"]
        )

    still = moved(plain)
    more = sum(
        weight * (moved(made) - still) / unit
        for parameter, weight in found.directions[f"more.{name}"].items()
        for made, unit in [found.servos[int(parameter.rpartition(".")[2])]]
    )
    own = next(servo.time_constant for servo in plain.servos if servo.surface == "elevator")
    lag = own + (size if name.startswith("lag") else 0.0)
    angle = rate * (time[begun:] - 0.5 - (0.0 if name.startswith("lag") else size))
    size_of = np.abs(still).max() * np.hypot(1.0, rate * own)
    # 1/(1 + iωτ) by τ, or e^(-iωs)/(1 + iωτ) by s.
    by = -1j * rate / (1.0 + 1j * rate * lag)
    by = by / (1.0 + 1j * rate * lag) if name.startswith("lag") else by
    np.testing.assert_allclose(
        more, size_of * np.imag(by * np.exp(1j * angle)), atol=0.12 * size_of
    )
    # Of the aircraft that is searched with it is told how surfaces move.
    here = moved(found.moving) - moved(plain)
    (parameter,) = found.directions[name]
    made, unit = found.servos[int(parameter.rpartition(".")[2])]
    assert unit == size
    np.testing.assert_allclose(here, moved(made) - moved(plain), atol=1e-9)


def test_a_lag_reckoned_with_is_the_change_of_an_aircraft_with_that_lag() -> None:
    aircraft = aircraft_file.load(DATA / "ultra_stick_25e.toml")
    usual, longer = built(aircraft), built(aircraft, reached={"lag.elevator": 0.2})
    names = [name for name in usual.directions if name.startswith("lag.")]
    assert names == [name for name in longer.directions if name.startswith("lag.")]
    sizes = {size for _, size in longer.servos} - {size for _, size in usual.servos}
    assert sorted(sizes) == pytest.approx([0.2, 0.22])


def test_a_lag_found_away_from_where_it_was_taken_is_less_sure() -> None:
    reached = {"lag.elevator": 0.16}
    assert quantities.servo_doubt("lag.elevator", 0.142, reached) == pytest.approx(0.018)
    assert quantities.servo_doubt("lag.rudder", 0.002, reached) == pytest.approx(0.002)
    assert quantities.servo_doubt("mass", 1.1, reached) == 0.0
    # Told by what more of it does where it is, it is off by the square.
    doubt = quantities.servo_doubt("lag.elevator", 0.142, reached, reached)
    assert doubt == pytest.approx(0.018**2 / 0.16)


def test_what_nobody_sees_is_a_percent_of_what_a_coefficient_does(aircraft) -> None:
    """Put into the file, it changes its coefficient by a hundredth of the spread in flight."""
    found = built(aircraft)
    rng = np.random.default_rng(2)
    variables = ("alpha", "beta", "phat", "qhat", "rhat", "Tc", "qbar", "h_over_b")
    controls = found.aircraft.control_names
    flow = {name: 0.05 * rng.standard_normal(500) for name in (*variables, *controls)}
    flow["qhat"] *= 0.1
    names = quantities.names(means(found))
    sizes = dict(zip(names, beliefs.negligible(names, found.aircraft, flow), strict=True))
    assert all(size == 0.0 for name, size in sizes.items() if not name.startswith("aero"))
    for coefficient in ("CZ", "Cm"):
        model = found.aircraft.aerodynamics[coefficient]
        column = COEFFICIENTS.index(coefficient)
        value = acting(found.aircraft, flow)[:, column]
        for key in ("1", "alpha", "qhat"):
            term = model.terms[key]
            off = sizes[f"aerodynamics.{coefficient}.{key}"]
            moved = replace(term, value=term.value + off)
            other = replace(model, terms={**model.terms, key: moved})
            every = {**found.aircraft.aerodynamics, coefficient: other}
            flies = acting(replace(found.aircraft, aerodynamics=every), flow)[:, column]
            change = flies - value
            size = np.abs(change).mean() if key == "1" else change.std()
            assert size == pytest.approx(0.01 * value.std(), rel=1e-6)


def test_a_missing_term_is_one_more_quantity(aircraft) -> None:
    found = built(aircraft)
    control = aircraft.control_names[0]
    wider = quantities.with_term(found, "Cn", f"alpha*{control}", sigma=0.3)
    key = regressors.parse(f"alpha*{control}", controls=aircraft.control_names).key
    assert wider.directions[quantities.MISSING] == {f"aerodynamics.Cn.{key}": 1.0}
    assert wider.aircraft.aerodynamics["Cn"].terms[key].value == 0.0
    assert wider.sizes[quantities.MISSING] == 0.3
    assert quantities.MISSING not in found.directions


def test_where_the_file_is_right_about_what_bends_is_left_open(aircraft) -> None:
    """A loss from another dynamic pressure on is the same loss with another level."""
    control = aircraft.control_names[0]
    bent = Candidate(CAUSES["aeroelastic"], control)
    assert bent.frees == (f"aeroelastic.{control}", f"effectiveness.{control}")


def test_what_servos_do_that_two_controls_share_is_told_of_one() -> None:
    """Both elevons play or none: no flight tells the elevator's lag from the aileron's."""
    wing = aircraft_file.load(DATA / "brumby_mk3.toml")
    assert servo_changes.together(wing, "aileron") == ("elevator", "aileron")
    assert servo_changes.together(wing, "rudder") == ("rudder",)
    found = built(wing)
    listed = quantities.candidates(CAUSES, found)
    for cause in ("actuator_lag", "actuator_backlash", "actuator_rate_limit"):
        told = {one.about: one.also for one in listed if one.cause.name == cause}
        assert told == {"elevator": ("aileron",), "rudder": ()}
    weak = {one.about: one.also for one in listed if one.cause.name == "surface_effectiveness"}
    assert weak == {"elevator": (), "aileron": (), "rudder": ()}
    plain = quantities.candidates(CAUSES, built(aircraft_file.load(DATA / "ultra_stick_25e.toml")))
    assert not any(one.also for one in plain)


def test_a_derivative_that_is_all_of_another_cause_is_told_as_that() -> None:
    """An aileron that only rolls: its derivative and its effect are one number."""
    plane = aircraft_file.load(DATA / "ultra_stick_25e.toml")

    def without(coefficient: str) -> CoefficientModel:
        terms = plane.aerodynamics[coefficient].terms
        return CoefficientModel({key: one for key, one in terms.items() if key != "aileron"})

    only = {name: without(name) for name in plane.aerodynamics if name != "Cl"}
    rolls = replace(plane, aerodynamics={**plane.aerodynamics, **only})

    def told(one: Aircraft, cause: str) -> set[str]:
        every = quantities.candidates(CAUSES, built(one))
        return {each.about for each in every if each.cause.name == cause}

    assert "Cl.aileron" in told(plane, "aero_derivative")
    assert "Cl.aileron" not in told(rolls, "aero_derivative")
    assert told(rolls, "surface_effectiveness") == told(plane, "surface_effectiveness")
    assert told(rolls, "aero_derivative") >= {"Cl.phat", "Cm.elevator", "CZ.alpha"}
