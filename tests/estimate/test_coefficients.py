from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs_sysid.aircraft import COEFFICIENTS, FORCES, MOMENTS, Aircraft, Geometry
from gcs_sysid.estimate import coefficients, equation_error
from gcs_sysid.estimate.coefficients import Samples, Thrust
from tests.estimate import made_motion
from tests.estimate.made_motion import TRUE, Motion

MIRRORED = ("CY", "Cl", "Cn")
OTHER_SIDE = np.array([1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def motion() -> Motion:
    return made_motion.fly()


def measure(
    motion: Motion,
    aircraft: Aircraft,
    refused: dict[str, str] | None = None,
    *,
    exactly: bool = False,
) -> Samples:
    """Coefficients through the smoother, or from the exact angular motion."""
    return coefficients.measure(
        motion.states,
        aircraft,
        controls=motion.controls,
        thrust=motion.thrust,
        refused=refused or {},
        motion=motion.angular if exactly else None,
    )


def test_the_flight_is_lively_enough_to_prove_anything(motion: Motion) -> None:
    """Every coefficient and every product-of-inertia term moves well beyond the tolerances used."""
    assert np.abs(motion.states.rate).max(axis=0).min() > 0.2
    assert np.ptp(motion.states.alpha) > 0.1
    assert min(np.ptp(values) for values in motion.true.values()) > 0.003


@pytest.mark.parametrize("name", COEFFICIENTS)
def test_exact_motion_gives_the_coefficients_that_made_it(motion: Motion, name: str) -> None:
    """The integrator's relative tolerance of 1e-10 is the limit; 1e-6 leaves room for it."""
    measured = measure(motion, made_motion.aircraft(), exactly=True).measured[name]
    assert measured == pytest.approx(motion.true[name], abs=1e-6 * np.ptp(motion.true[name]))


@pytest.mark.parametrize(
    "change",
    [
        {"Ixy": 0.0},
        {"Iyz": 0.0},
        {"Ixz": 0.0},
        {"cg": (0.0, 0.006, 0.021)},
        {"cg": (-0.012, 0.0, 0.021)},
        {"cg": (-0.012, 0.006, 0.0)},
    ],
    ids=str,
)
def test_each_mass_property_matters(motion: Motion, change: dict[str, object]) -> None:
    """Leaving any of them out moves some moment by more than a thousand tolerances."""
    right = made_motion.aircraft()
    wrong = replace(right, mass=replace(right.mass, **change))
    measured = measure(motion, wrong, exactly=True).measured
    worst = max(
        np.abs(measured[name] - motion.true[name]).max() / np.ptp(motion.true[name])
        for name in MOMENTS
    )
    assert worst > 1e-3


def test_through_the_smoother_the_moments_lose_only_its_lag_free_rounding(motion: Motion) -> None:
    """Noise-free rates at 100 Hz: the spline's own curvature error limits it to 1 %.

    The ends of the flight, where a spline has neighbours on one side only, are left out.
    """
    measured = measure(motion, made_motion.aircraft()).measured
    inside = slice(50, -50)
    for name in COEFFICIENTS:
        error = (measured[name] - motion.true[name])[inside]
        assert np.sqrt(np.mean(error**2)) < 0.01 * np.std(motion.true[name][inside]), name


def test_derivatives_survive_the_smoother(motion: Motion) -> None:
    """Both sides of the moment equation go through the same filter, so its parameters stay.

    What is left, up to 0.5 % of a derivative's part in its coefficient, is the product of rates in
    ω × Iω, which is made of smoothed rates instead of being smoothed as a product.
    """
    samples = measure(motion, made_motion.aircraft())
    piece = np.zeros(samples.time.size, dtype=int)
    piece[:50] = piece[-50:] = -1
    model = equation_error.fit(
        [samples], made_motion.aircraft(), {name: tuple(TRUE[name]) for name in TRUE}, [piece]
    )
    for name, fit in model.fits.items():
        size = {**samples.regressors, "1": np.ones(samples.time.size)}
        for key, value in zip(fit.keys, fit.value, strict=True):
            part = max(float(np.std(size[key])), 1e-3 if key == "1" else 0.0)
            assert abs(value - TRUE[name][key]) * part < 0.005 * np.std(motion.true[name]), (
                name,
                key,
            )


def scaled(motion: Motion, *, length: float, mass: float, time: float) -> tuple[Motion, Aircraft]:
    """The same flight written down in other units of length, mass and time."""
    states, aircraft = motion.states, made_motion.aircraft()
    body, shape = aircraft.mass, aircraft.geometry
    inertia = {
        key: getattr(body, key) * mass * length**2
        for key in ("Ixx", "Iyy", "Izz", "Ixz", "Ixy", "Iyz")
    }
    force, moment = mass * length / time**2, mass * length**2 / time**2
    return (
        replace(
            motion,
            states=replace(
                states,
                time=states.time * time,
                density=states.density * mass / length**3,
                height=states.height * length,
                airspeed=states.airspeed * length / time,
                rate=states.rate / time,
                force=states.force * length / time**2,
                lever=states.lever * length,
            ),
            angular=made_motion.exact(
                motion.angular.rate / time, motion.angular.acceleration / time**2
            ),
            thrust=Thrust(motion.thrust.force * force, motion.thrust.moment * moment, 0.1),
        ),
        replace(
            aircraft,
            mass=replace(
                body, mass=body.mass * mass, cg=tuple(x * length for x in body.cg), **inertia
            ),
            geometry=Geometry(
                shape.wing_area * length**2, shape.wing_span * length, shape.mean_chord * length
            ),
        ),
    )


def test_units_do_not_matter(motion: Motion) -> None:
    """Feet, slugs and half seconds give the same coefficients and regressors."""
    usual = measure(motion, made_motion.aircraft(), exactly=True)
    other, aircraft = scaled(motion, length=3.28, mass=0.0685, time=2.0)
    strange = measure(other, aircraft, exactly=True)
    for name in COEFFICIENTS:
        assert strange.measured[name] == pytest.approx(usual.measured[name], rel=1e-9, abs=1e-12)
        assert strange.mass_part[name] == pytest.approx(usual.mass_part[name], rel=1e-9, abs=1e-12)
    for name in ("phat", "qhat", "rhat", "Tc", "h_over_b"):
        assert strange.regressors[name] == pytest.approx(
            usual.regressors[name], rel=1e-9, abs=1e-12
        )


def mirrored(motion: Motion) -> tuple[Motion, Aircraft]:
    """The same flight seen in a mirror: left is right."""
    states, aircraft = motion.states, made_motion.aircraft()
    body = aircraft.mass
    x, y, z = body.cg
    return (
        replace(
            motion,
            states=replace(
                states,
                rate=-states.rate * OTHER_SIDE,
                force=states.force * OTHER_SIDE,
                beta=-states.beta,
                lever=states.lever * OTHER_SIDE,
            ),
            thrust=Thrust(
                motion.thrust.force * OTHER_SIDE, -motion.thrust.moment * OTHER_SIDE, 0.1
            ),
        ),
        replace(aircraft, mass=replace(body, Ixy=-body.Ixy, Iyz=-body.Iyz, cg=(x, -y, z))),
    )


def test_a_mirror_turns_the_lateral_coefficients_round(motion: Motion) -> None:
    """Smoother included: it must treat both signs alike."""
    usual = measure(motion, made_motion.aircraft())
    other = measure(*mirrored(motion))
    for name in COEFFICIENTS:
        sign = -1.0 if name in MIRRORED else 1.0
        scale = float(np.ptp(motion.true[name]))
        assert other.measured[name] == pytest.approx(sign * usual.measured[name], abs=1e-9 * scale)
        assert other.noise[name] == pytest.approx(usual.noise[name], rel=1e-6)


STEP = 1e-4


def test_the_mass_part_is_what_a_heavier_aircraft_adds(motion: Motion) -> None:
    aircraft = made_motion.aircraft()
    usual = measure(motion, aircraft, exactly=True)
    heavier = replace(aircraft, mass=replace(aircraft.mass, mass=aircraft.mass.mass * (1 + STEP)))
    for name in FORCES:
        slope = (
            measure(motion, heavier, exactly=True).measured[name] - usual.measured[name]
        ) / STEP
        assert usual.mass_part[name] == pytest.approx(slope, abs=1e-8)


def test_the_inertia_part_is_what_a_larger_inertia_adds(motion: Motion) -> None:
    aircraft = made_motion.aircraft()
    usual = measure(motion, aircraft, exactly=True)
    body = aircraft.mass
    larger = {
        key: getattr(body, key) * (1 + STEP) for key in ("Ixx", "Iyy", "Izz", "Ixz", "Ixy", "Iyz")
    }
    wider = replace(aircraft, mass=replace(body, **larger))
    for name in MOMENTS:
        slope = (measure(motion, wider, exactly=True).measured[name] - usual.measured[name]) / STEP
        assert usual.mass_part[name] == pytest.approx(slope, abs=1e-8)


def test_the_thrust_part_is_what_more_thrust_adds(motion: Motion) -> None:
    usual = measure(motion, made_motion.aircraft(), exactly=True)
    more = replace(
        motion,
        thrust=Thrust(motion.thrust.force * (1 + STEP), motion.thrust.moment * (1 + STEP), 0.1),
    )
    stronger = measure(more, made_motion.aircraft(), exactly=True)
    for name in COEFFICIENTS:
        slope = (stronger.measured[name] - usual.measured[name]) / STEP
        assert usual.thrust_part[name] == pytest.approx(slope, abs=1e-8)


def test_stated_noise_is_the_scatter_that_accelerometer_noise_makes(motion: Motion) -> None:
    """1600 samples know a standard deviation to 2 %: 6 % is three sigmas."""
    sigma = float(motion.states.noise.accelerometer)
    generator = np.random.default_rng(1)
    force = motion.states.force
    noisy = replace(
        motion,
        states=replace(motion.states, force=force + sigma * generator.standard_normal(force.shape)),
    )
    samples = measure(noisy, made_motion.aircraft(), exactly=True)
    for name in FORCES:
        ratio = (samples.measured[name] - motion.true[name]) / samples.noise[name]
        assert float(np.std(ratio)) == pytest.approx(1.0, rel=0.06)


def test_stated_noise_of_the_moments_is_the_scatter_that_gyro_noise_makes(motion: Motion) -> None:
    """Never too small by more than a fifth, nor too large by more than three times.

    The smoother's variance is that of a motion rougher than these sinusoids, hence the large side;
    off-diagonal inertia and the offset centre of gravity, which `noise` leaves out, the small one.
    """
    generator = np.random.default_rng(2)
    rate = motion.states.rate
    noisy = replace(
        motion,
        states=replace(motion.states, rate=rate + 0.004 * generator.standard_normal(rate.shape)),
    )
    samples = measure(noisy, made_motion.aircraft())
    for name in MOMENTS:
        ratio = ((samples.measured[name] - motion.true[name]) / samples.noise[name])[50:-50]
        assert 0.33 < float(np.sqrt(np.mean(ratio**2))) < 1.2, name


def test_an_uncertain_airspeed_counts_twice_in_every_coefficient(motion: Motion) -> None:
    """q̄ is a square: one per cent of airspeed is two of the coefficient."""
    states = motion.states
    covariance = np.array(states.flow_covariance)
    covariance[:, 0, 0] = (0.01 * states.airspeed) ** 2
    sure = measure(motion, made_motion.aircraft(), exactly=True)
    unsure = measure(
        replace(motion, states=replace(states, flow_covariance=covariance)),
        made_motion.aircraft(),
        exactly=True,
    )
    for name in COEFFICIENTS:
        added = np.sqrt(unsure.noise[name] ** 2 - sure.noise[name] ** 2)
        assert added == pytest.approx(0.02 * np.abs(sure.measured[name]), abs=1e-7)


def test_refused_coefficients_are_not_computed(motion: Motion) -> None:
    samples = measure(motion, made_motion.aircraft(), {"CX": "no accelerometer"})
    assert set(samples.measured) == set(COEFFICIENTS) - {"CX"}
    assert "CX" not in samples.noise
    assert samples.refused == {"CX": "no accelerometer"}


def test_gusts_turn_the_air_as_the_military_specification_says(motion: Motion) -> None:
    """MIL-F-8785C, 3.7.2: σ_p = 1.9 σ_w/√(L b), σ_q = √(π/(2 L b)) σ_w, σ_r = √(2π/(3 L b)) σ_v."""
    states = made_motion.states(
        np.arange(200) / 50.0,
        np.zeros((200, 3)),
        np.zeros((200, 3)),
        {"V": np.full(200, 20.0), "alpha": np.zeros(200), "beta": np.zeros(200)},
        lever=np.zeros(3),
        gust=1.5,
        flow_sigma=(0.2, 0.03, 0.02),
    )
    variance = coefficients._regressor_variance(states, made_motion.aircraft())
    length, span, chord = 3.0 * 20.0, 1.27, 0.25
    roll = 1.9 * 1.5 / np.sqrt(length * span) * span / 40.0
    pitch = np.sqrt(np.pi / (2 * length * span)) * 1.5 * chord / 40.0
    yaw = np.sqrt(2 * np.pi / (3 * length * span)) * 1.5 * span / 40.0
    assert np.sqrt(variance["phat"]) == pytest.approx(roll)
    assert np.sqrt(variance["qhat"]) == pytest.approx(pitch)
    assert np.sqrt(variance["rhat"]) == pytest.approx(yaw)
    assert np.sqrt(variance["alpha"]) == pytest.approx(0.03)
    assert np.sqrt(variance["beta"]) == pytest.approx(0.02)


def test_the_rate_of_alpha_is_its_derivative(motion: Motion) -> None:
    """Against central differences of the exact angle; both are good to a per cent at 100 Hz."""
    samples = measure(motion, made_motion.aircraft())
    states = motion.states
    slope = np.gradient(states.alpha, states.time) * 0.25 / (2.0 * states.airspeed)
    error = (samples.regressors["alphadot_hat"] - slope)[50:-50]
    assert float(np.std(error)) < 0.01 * float(np.std(slope))
