from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.figures import envelope

TRIM = {"V": 17.0, "alpha": 0.05, "controls": {"elevator": -0.02}}


def test_limits_of_the_aircraft_file_are_inside_the_picture(
    samples: dict[str, np.ndarray],
) -> None:
    allowed = {"V": [11.0, 28.0], "alpha": [-0.1, 0.25], "beta": [-0.26, 0.26]}
    speed, flow = envelope.covered(samples, limits=allowed, trim=TRIM)
    assert {rule.value for rule in speed.panels[0].rules if rule.axis == "x"} == {11.0, 28.0}
    assert speed.x.limits[0] < 11.0 < 28.0 < speed.x.limits[1]
    angles = sorted(rule.value for rule in flow.panels[0].rules if rule.axis == "x")
    np.testing.assert_allclose(angles, np.degrees([-0.26, 0.26]))
    assert (speed.x.unit, flow.x.unit) == ("m/s", "deg")


def test_without_limits_and_trim_there_are_only_the_samples(
    samples: dict[str, np.ndarray],
) -> None:
    for figure in envelope.covered(samples, limits={}, trim=None):
        assert figure.panels[0].rules == ()
        assert [series.name for series in figure.panels[0].series] == ["in the fit", "held out"]


def test_the_trim_is_marked_in_degrees(samples: dict[str, np.ndarray]) -> None:
    speed = envelope.covered(samples, limits={}, trim=TRIM)[0]
    mark = speed.panels[0].series[-1]
    assert (mark.name, mark.style) == ("trim", "cross")
    np.testing.assert_allclose([mark.x[0], mark.y[0]], [17.0, np.degrees(0.05)])


def test_control_strips_hold_the_range_flown(samples: dict[str, np.ndarray]) -> None:
    strips = envelope.control_strips(samples, ("elevator", "flap"), trim=TRIM)
    assert list(strips) == ["elevator"]
    whole, central = strips["elevator"].intervals
    assert whole.low == pytest.approx(np.degrees(samples["elevator"].min()))
    assert whole.low < central.low < central.high < whole.high
    assert strips["elevator"].marks[0].value == pytest.approx(np.degrees(-0.02))
    assert envelope.control_strips(samples, (), trim=None) == {}
