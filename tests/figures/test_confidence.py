"""The map of confidence as a figure: cells by what they lack."""

from __future__ import annotations

import numpy as np

from gcs_sysid.figures import confidence

SUMMARY = {
    "confidence": {
        "level": 0.1,
        "alpha": [0.0, 0.1, 0.2],
        "beta": [-0.1, 0.0, 0.1],
        "coefficients": {
            "CZ": {"reason": [["", "noisy data"], ["no data", "no data"]]},
            "Cm": {"reason": [["", ""], ["", ""]]},
        },
        "low": [
            {"coefficient": "CZ", "derivative": None, "reason": "no data", "share_of_cells": 0.5},
            {
                "coefficient": "Cm",
                "derivative": "alpha",
                "reason": "no data",
                "share_of_cells": 1.0,
            },
        ],
    }
}


def test_each_cell_stands_at_its_middle_under_what_it_lacks():
    (figure,) = confidence.maps(SUMMARY)
    lift, pitch = figure.panels
    assert [series.name for series in lift.series] == ["known", "noisy data", "no data"]
    np.testing.assert_allclose(lift.series[2].x, np.degrees([0.15, 0.15]))
    np.testing.assert_allclose(lift.series[2].y, np.degrees([-0.05, 0.05]))
    assert [series.name for series in pitch.series] == ["known"]
    assert sum(series.x.size for series in pitch.series) == 4


def test_the_caption_names_the_coefficient_known_least():
    (figure,) = confidence.maps(SUMMARY)
    assert "Least is known of CZ: 50 % of the cells are low in confidence for no data." in (
        figure.caption
    )


def test_the_caption_names_the_derivatives_known_least():
    (figure,) = confidence.maps(SUMMARY)
    assert "Derivatives low in confidence, by share of the cells: Cm_alpha (100 %)." in (
        figure.caption
    )
    many = [
        {"coefficient": "Cn", "derivative": name, "reason": reason, "share_of_cells": 0.2}
        for name in "abcdefghij"
        for reason in ("no data", "noisy data")
    ]
    found = {**SUMMARY["confidence"], "low": [*SUMMARY["confidence"]["low"], *many]}
    (figure,) = confidence.maps({"confidence": found})
    assert "Cm_alpha (100 %), Cn_a (40 %), Cn_b (40 %)" in figure.caption
    assert figure.caption.endswith("Cn_g (40 %) and 3 more.")
    known = {**SUMMARY["confidence"], "low": []}
    (figure,) = confidence.maps({"confidence": known})
    assert figure.caption.endswith("All of them are known throughout. So are their derivatives.")


def test_a_summary_without_a_map_has_no_figure():
    assert confidence.maps({}) == ()
