from __future__ import annotations

import numpy as np
import pytest

from gcs_sysid.figures import coefficients, states
from gcs_sysid.figures.data import SIGMAS_95, Figure
from gcs_sysid.figures.samples import flight_rows, maneuvers

CONTROLS = ("elevator", "aileron", "rudder")


@pytest.fixture(scope="module")
def history(samples: dict[str, np.ndarray], summary: dict) -> Figure:
    return coefficients.history(
        samples,
        flight_rows(samples)[0],
        flight=0,
        maneuvers=maneuvers(samples, summary["maneuvers"]),
        refused={"CX": "no accelerometer"},
        bins=300,
    )


@pytest.fixture(scope="module")
def flown(samples: dict[str, np.ndarray], summary: dict) -> Figure:
    return states.states(
        samples,
        flight_rows(samples)[0],
        flight=0,
        maneuvers=maneuvers(samples, summary["maneuvers"]),
        controls=CONTROLS,
        bins=300,
    )


def test_bands_contain_their_means(history: Figure, flown: Figure) -> None:
    for panel in (*history.panels, *flown.panels):
        for band in panel.bands:
            mean = next(item for item in panel.series if band.name.startswith(item.name))
            np.testing.assert_array_equal(band.x, mean.x)
            valid = np.isfinite(mean.y)
            assert (band.lower[valid] <= mean.y[valid]).all()
            assert (mean.y[valid] <= band.upper[valid]).all()


def test_band_is_the_95_percent_interval_of_the_samples(
    samples: dict[str, np.ndarray], history: Figure
) -> None:
    panel = next(item for item in history.panels if item.y.label == "Cm")
    band = next(item for item in panel.bands if item.name.startswith("predicted"))
    at = np.searchsorted(samples["t"], band.x)
    expected = samples["Cm"][at] + SIGMAS_95 * samples["Cm_sd"][at]
    np.testing.assert_allclose(band.upper, expected, rtol=1e-12)


def test_limits_are_finite_and_units_are_there(history: Figure, flown: Figure) -> None:
    for figure in (history, flown):
        assert figure.x.unit == "s"
        for panel in figure.panels:
            assert np.isfinite(panel.y.limits).all()
            assert panel.y.limits[0] < panel.y.limits[1]
            assert panel.y.unit


def test_held_out_maneuvers_are_marked_and_named(history: Figure, summary: dict) -> None:
    listed = [item for item in summary["maneuvers"] if item["held_out"]]
    marked = [span for span in history.spans if span.role == "held_out"]
    assert [span.start for span in marked] == [item["start_s"] for item in listed]
    assert all(item["kind"] in span.name for item, span in zip(listed, marked, strict=True))


def test_a_refused_coefficient_shows_its_reason_and_nothing_else(history: Figure) -> None:
    refused = history.panels[0]
    assert refused.refusal == "no accelerometer"
    assert not refused.series
    assert all(panel.refusal is None and panel.series for panel in history.panels[1:])


def test_close_ups_share_the_frame_that_holds_them_all(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    found = [item for item in maneuvers(samples, summary["maneuvers"]) if item.held_out]
    frame = coefficients.common_frame(samples, found, ("CX", "Cn"))
    shown = [
        coefficients.close_up(samples, item, frame=frame, several=True, bins=5000) for item in found
    ]
    assert len({panel.y.limits for figure in shown for panel in figure.panels[:1]}) == 1
    for figure, item in zip(shown, found, strict=True):
        assert [panel.y.label for panel in figure.panels] == ["CX", "Cn"]
        assert figure.caption.startswith("flight 1, ")
        assert figure.title == item.name
        assert figure.panels[0].series[0].x.size == item.rows.size


def test_chosen_maneuvers_show_every_sort_before_a_second_of_one(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    found = maneuvers(samples, summary["maneuvers"])
    sorts = {item.name.rsplit(" ", 1)[0] for item in found}
    picked = coefficients.chosen(found, len(sorts))
    assert {item.name.rsplit(" ", 1)[0] for item in picked} == sorts
    assert list(picked) == sorted(picked, key=lambda item: item.start)
    assert len(coefficients.chosen(found, 2)) == 2
    assert coefficients.chosen(found, 10_000) == found


def test_states_are_in_the_units_people_fly_in(
    samples: dict[str, np.ndarray], flown: Figure
) -> None:
    alpha = next(item for item in flown.panels if "attack" in item.y.label)
    assert alpha.y.unit == "deg"
    highest = np.degrees(samples["alpha"].max())
    assert np.nanmax(alpha.series[0].y) == pytest.approx(highest, rel=1e-12)


def test_heading_breaks_where_it_passes_north() -> None:
    time = np.arange(6.0)
    table = {"t": time, "psi": np.radians([350.0, 355.0, 2.0, 8.0, 359.0, 357.0])}
    figure = states.states(table, np.arange(6), flight=0, maneuvers=(), controls=(), bins=100)
    (panel,) = figure.panels
    assert np.isnan(panel.series[0].y).nonzero()[0].tolist() == [2, 4]
    assert panel.y.limits == (0.0, 360.0)


def test_what_was_never_measured_has_no_panel() -> None:
    table = {"t": np.arange(4.0), "V": np.full(4, 17.0)}
    figure = states.states(
        table, np.arange(4), flight=0, maneuvers=(), controls=("elevator",), bins=10
    )
    assert [panel.y.label for panel in figure.panels] == ["airspeed V"]
    assert figure.panels[0].bands == ()


def test_many_controls_are_spread_over_panels_and_none_is_lost() -> None:
    names = tuple(f"flap_{number}" for number in range(6))
    table = {"t": np.arange(4.0)} | {name: np.arange(4.0) for name in names}
    figure = states.states(table, np.arange(4), flight=0, maneuvers=(), controls=names, bins=10)
    shown = [series.name for panel in figure.panels for series in panel.series]
    assert shown == list(names)
