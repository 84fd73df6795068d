"""The page that `identify` leaves: what a flight taught, how well, and what it cannot tell."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_sysid.figures.derivatives import derivatives
from gcs_sysid.report import page, tables
from gcs_sysid.report.content import content


def render(summary: Mapping, samples: Mapping[str, np.ndarray]) -> str:
    """The report of an identification as one self-contained HTML file.

    Args:
        summary: the summary document of `identify`.
        samples: the samples table, one array a column, one row a sample.
    """
    shown = content(summary, samples, unseen=False)
    return page.render(
        "identify.html.j2",
        shown.figures,
        {
            "page": shown,
            "summary": summary,
            "derivatives": derivatives(summary.get("derivatives") or {}),
            "modes": tables.modes(summary),
        },
    )
