"""Data of the figures of `simulate`, `diagnose` and `suggest`."""

from __future__ import annotations

import numpy as np

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.figures import diagnosis, maneuver, simulation
from gcs_sysid.figures.data import SIGMAS_95


def simulated() -> dict[str, np.ndarray]:
    """Two windows of five instants."""
    time = np.concatenate([10.0 + 0.1 * np.arange(5), 13.0 + 0.1 * np.arange(5)])
    table = {"t": time, "window": np.repeat([0, 1], 5)}
    for name in (*simulation.CHANNELS, "psi"):
        table |= {
            f"{name}_measured": np.linspace(0.0, 0.1, 10),
            name: np.linspace(0.0, 0.2, 10),
            f"{name}_sd": np.full(10, 0.01),
        }
    return table


def test_windows_are_not_joined_and_bands_are_of_95_percent() -> None:
    figure = simulation.history(simulated(), bins=100)
    assert len(figure.panels) == len(simulation.CHANNELS)
    panel = figure.panels[1]
    assert (panel.y.label, panel.y.unit) == ("angle of attack α", "deg")
    measured, shown = panel.series
    assert (measured.role, shown.role) == ("measured", "predicted")
    assert np.isnan(measured.y[5])
    assert np.isfinite(np.delete(measured.y, 5)).all()
    assert shown.y[-1] == np.degrees(0.2)
    [band] = panel.bands
    np.testing.assert_allclose(band.upper[0] - shown.y[0], np.degrees(SIGMAS_95 * 0.01))


def residual_table() -> dict[str, np.ndarray]:
    table = {"t": 0.02 * np.arange(200), "flight": np.zeros(200, dtype=int)}
    for name in COEFFICIENTS:
        table[f"{name}_before"] = np.full(200, np.nan if name == "CX" else 0.2)
        table[f"{name}_after"] = np.full(200, np.nan if name == "CX" else 0.0)
    return table


def test_residuals_are_shown_before_and_after_where_a_cause_was_named() -> None:
    named = diagnosis.residuals(residual_table(), flight=0, spans=(), changed=True, bins=300)
    assert [panel.y.label for panel in named.panels] == list(COEFFICIENTS[1:])
    names = [series.name for series in named.panels[0].series]
    assert names == ["before", "after", "signature"]
    before, after, signature = named.panels[0].series
    np.testing.assert_allclose(signature.y, before.y - after.y)
    np.testing.assert_allclose(signature.y[20:-20], 0.2)
    np.testing.assert_allclose(named.panels[0].series[0].y[20:-20], 0.2)
    silent = diagnosis.residuals(residual_table(), flight=0, spans=(), changed=False, bins=300)
    assert [series.name for series in silent.panels[0].series] == ["before"]


def test_of_several_flights_each_is_called_by_its_name() -> None:
    asked = {"flight": 0, "spans": (), "changed": False, "bins": 300}
    one = diagnosis.residuals(residual_table(), **asked)
    many = diagnosis.residuals(residual_table(), **asked, source="second.tlog")
    assert (one.title, many.title) == (
        "Measured less predicted",
        "Measured less predicted: second.tlog",
    )


def test_a_probability_is_a_bar_with_the_name_of_its_explanation() -> None:
    ranking = [{"probability": 0.7}, {"probability": 0.2}]
    figure = diagnosis.probabilities(ranking, ["mass", "nothing"])
    [panel] = figure.panels
    [series] = panel.series
    assert series.style == "rows"
    assert (series.x.tolist(), series.y.tolist()) == ([0.7, 0.2], [1.0, 2.0])
    assert panel.y.names == ("mass", "nothing")
    low, high = panel.y.limits
    assert low > high, "the first on top"


def test_a_maneuver_shows_input_motion_and_limits() -> None:
    count = 20
    table = {
        "maneuver": np.repeat([0, 1], count),
        "t": np.tile(0.02 * np.arange(count), 2),
        "input_0": np.full(2 * count, 0.1),
        "input_1": np.full(2 * count, np.nan),
    }
    for name in maneuver.CHANNELS:
        table |= {
            name: np.full(2 * count, 0.05),
            f"{name}_low": np.full(2 * count, 0.04),
            f"{name}_high": np.full(2 * count, 0.06),
        }
    entry = {
        "name": "elevator_doublet",
        "controls": ["elevator"],
        "abort": {"alpha": [-0.1, 0.2]},
    }
    figure = maneuver.maneuver(table, 1, entry)
    assert figure.name == "maneuver-elevator_doublet"
    inputs, _, alpha = figure.panels[:3]
    assert [series.name for series in inputs.series] == ["elevator"]
    np.testing.assert_allclose(inputs.series[0].y, np.degrees(0.1))
    assert [rule.value for rule in alpha.rules] == list(np.degrees([-0.1, 0.2]))
    assert figure.panels[1].rules == ()
