"""The page that `predict` leaves: how a model does on a flight that it has not seen."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gcs_sysid.report import page
from gcs_sysid.report.content import content


def render(summary: Mapping, samples: Mapping[str, np.ndarray]) -> str:
    """The report of a prediction as one self-contained HTML file.

    Args:
        summary: the summary document of `predict`.
        samples: the predictions table, one array a column, one row a sample.
    """
    shown = content(summary, samples, unseen=True)
    return page.render("predict.html.j2", shown.figures, {"page": shown, "summary": summary})
