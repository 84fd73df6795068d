"""What a flight brought against what its suggestion had promised."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from gcs_sysid.errors import InputError
from gcs_sysid.estimate.result import AeroModel


def compared(folder: Path, model: AeroModel) -> dict[str, Any]:
    """Deviations promised by a suggestion, and those of the model identified with its flight.

    Args:
        folder: that `suggest` wrote before the flight.
        model: identified from the flights before and the one suggested.

    Raises:
        InputError: the folder holds no suggestion.
    """
    path = folder / "suggest.json"
    try:
        promised = json.loads(path.read_text(encoding="utf-8"))["sortie"]["derivatives"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            str(path),
            f"holds no planned sortie ({error})",
            fix="give --flown the folder that `suggest` wrote before the flight",
        ) from error
    rows = [
        _row(name, key, item, model)
        for name, terms in promised.items()
        if name in model.fits
        for key, item in terms.items()
        if key in model.fits[name].keys
    ]
    ratios = [row["achieved_over_predicted"] for row in rows]
    return {
        "source": str(folder),
        "derivatives": rows,
        "achieved_over_predicted": float(np.median(ratios)) if ratios else math.nan,
    }


def _row(name: str, key: str, item: dict[str, float], model: AeroModel) -> dict[str, Any]:
    fit = model.fits[name]
    index = fit.keys.index(key)
    achieved = float(fit.deviation[index])
    return {
        "coefficient": name,
        "regressor": key,
        "sd_before": item["sd_before"],
        "sd_predicted": item["sd_after"],
        "sd_achieved": achieved,
        "achieved_over_predicted": achieved / max(item["sd_after"], 1e-300),
        "moved_by_sd": (float(fit.value[index]) - item["value"]) / max(item["sd_before"], 1e-300),
    }
