"""Air that changes as quickly as an aircraft yields to it is refused, and no other."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from gcs_sysid.estimate import quick_air
from gcs_sysid.estimate.quick_air import QuickAirError
from gcs_sysid.model.aided import Noise
from gcs_sysid.model.air import scale_lengths
from tests.model import made_aided

PASSING = np.full(5, 22.0)


def blown(strength: float, length: float) -> Noise:
    """Logarithms of intensities with vertical gusts like these [m/s, m]."""
    noise = made_aided.NOISE
    turbulence = noise.turbulence._replace(
        gust=jnp.log(noise.turbulence.gust.at[2].set(strength)),
        gust_length=jnp.log(noise.turbulence.gust_length.at[2].set(length)),
    )
    return noise._replace(turbulence=turbulence)


BELIEVED = blown(1.0, scale_lengths(120.0)[1])


def test_gusts_of_a_quarter_of_a_second_are_refused_with_their_size() -> None:
    """What the filter makes of ArduPlane's turbulence of 42 ms, on its flight B."""
    with pytest.raises(QuickAirError, match=r"1\.5 m/s that last 0\.26 s.*ArduPlane") as found:
        quick_air.check(blown(1.5, 5.74), BELIEVED, PASSING)
    assert found.value.lasting == pytest.approx(5.74 / 22.0)
    assert found.value.strength == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("strength", "length"),
    [
        pytest.param(2.3, 40.0, id="a third of the specification's, strong"),
        pytest.param(1.0, 400.0, id="longer"),
        pytest.param(0.01, 0.5, id="calm, so that a length is anything"),
        pytest.param(np.nan, 0.5, id="lost, which others tell"),
    ],
)
def test_other_air_is_not(strength: float, length: float) -> None:
    quick_air.check(blown(strength, length), BELIEVED, PASSING)


def test_a_third_of_the_height_is_no_quick_air_near_the_ground() -> None:
    """The specification's vertical length is the height: 10 m at 30 m are not a tenth of it."""
    near = blown(1.0, scale_lengths(30.0)[1])
    quick_air.check(blown(1.5, 10.0), near, PASSING)
    with pytest.raises(QuickAirError):
        quick_air.check(blown(1.5, 2.9), near, PASSING)
