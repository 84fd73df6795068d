from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.estimate import surface_delay
from gcs_sysid.estimate.surface_delay import Delay
from tests.estimate import made_response
from tests.estimate.made_response import COUNT

EVERYTHING = np.ones(COUNT, dtype=bool)


def find(delay: float, seed: int, **air: float) -> Delay:
    samples, controls = made_response.flight(delay, seed, **air)
    return surface_delay.surface_delay(samples, controls, EVERYTHING)


DELAYS = (-0.02, 0.0, 0.02, 0.06, 0.1)


@pytest.mark.parametrize("delay", DELAYS)
def test_an_injected_delay_is_found_without_noise(delay: float) -> None:
    """Limited by the simulation's step of 5 ms: a tenth of a millisecond."""
    found = find(delay, 1)
    assert found.found
    assert found.value == pytest.approx(delay, abs=1e-4)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("delay", DELAYS)
def test_an_injected_delay_is_found_in_noise_within_its_deviation(delay: float, seed: int) -> None:
    found = find(delay, seed, noise=1.0, gust=0.005)
    assert found.found
    assert found.deviation < 0.01
    assert abs(found.value - delay) < 3.0 * found.deviation


def test_deviations_are_the_scatter_over_flights() -> None:
    """8 flights: 3σ of the mean square of 8 normal numbers is 1 ± 1.5."""
    errors = [
        (found.value - 0.06) / found.deviation
        for found in (find(0.06, seed, noise=1.0) for seed in range(10, 18))
    ]
    assert float(np.mean(np.square(errors))) < 2.5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_inputs_over_an_autopilot_that_answers_gusts_tell_the_delay(seed: int) -> None:
    found = find(0.06, seed, gust=0.02, feedback=0.1, noise=0.3)
    assert found.found
    assert abs(found.value - 0.06) < 3.0 * found.deviation


@pytest.mark.xfail(
    strict=True,
    reason="an autopilot alone, answering gusts that no sensor saw, makes the surface seem early: "
    "-5 ms is claimed where 60 ms are true",
)
def test_an_autopilot_alone_does_not_tell_the_delay() -> None:
    found = find(0.06, 1, amplitude=0.0, gust=0.02, feedback=0.15, noise=0.3)
    assert not found.found or abs(found.value - 0.06) < 3.0 * found.deviation


def test_surfaces_that_never_move_leave_what_was_stated() -> None:
    samples, controls = made_response.flight(0.06, 1, amplitude=0.0, gust=0.01, noise=0.3)
    found = surface_delay.surface_delay(
        samples, controls, EVERYTHING, stated=0.04, stated_sigma=0.01
    )
    assert found == Delay(0.04, 0.01, found=False)


def test_what_was_stated_and_what_was_found_are_weighed_by_their_precision() -> None:
    """Product of two normal densities, against a run whose statement is as good as none."""
    samples, controls = made_response.flight(0.06, 3, noise=1.0)

    def run(stated: float, sigma: float) -> Delay:
        return surface_delay.surface_delay(
            samples, controls, EVERYTHING, stated=stated, stated_sigma=sigma
        )

    alone = run(0.0, 1e6)
    both = run(0.05, 0.003)
    precision = 0.003**-2 + alone.deviation**-2
    mean = (0.05 * 0.003**-2 + alone.value * alone.deviation**-2) / precision
    assert both.value == pytest.approx(mean, rel=1e-6)
    assert both.deviation == pytest.approx(precision**-0.5, rel=1e-6)


def test_only_the_rows_given_count() -> None:
    """Rows whose moment is spoiled are left out: the answer is that of the others."""
    samples, controls = made_response.flight(0.06, 1)
    samples.measured["Cm"][3000:] = np.random.default_rng(1).standard_normal(COUNT - 3000)
    rows = np.arange(COUNT) < 3000
    assert surface_delay.surface_delay(samples, controls, rows).value == pytest.approx(
        0.06, abs=2e-4
    )
