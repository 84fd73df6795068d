"""`export`: linear models for python-control and MATLAB."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy import io

from gcs_sysid.offline import documents, linear_models


def linear(
    aircraft: Path | None,
    model: Path | None,
    to: Literal["control", "matlab"],
    *,
    airspeeds: Sequence[float],
    height: float,
    bank: float,
    climb: float,
    out: Path,
) -> dict[str, Any]:
    """Writes linear models to `out`.

    Args:
        aircraft: file whose aerodynamics are used.
        model: folder of an identified model, instead.
        to: `control` writes JSON for `control.ss`, `matlab` a .mat file.
        airspeeds: true airspeeds [m/s]; empty takes one from the envelope.
        height: above sea level [m].
        bank: of a coordinated turn [rad]; 0 flies straight.
        climb: angle of the flight path above level [rad].
        out: file to write.

    Returns:
        What was written, with `models` in the order of the airspeeds.

    Raises:
        UsageError: both or neither source is given, or steady flight there is impossible.
        InputError: what is given cannot be used.
    """
    described, found = linear_models.models(
        aircraft, model, airspeeds=airspeeds, height=height, bank=bank, climb=climb
    )
    document = documents.plain(
        {
            "program": f"gcs-sysid {version('gcs-sysid')}",
            "command": "export",
            "aircraft": described.name,
            "source": str(model or aircraft),
            "models": [linear_models.document(one) for one in found],
        }
    )
    write(document, to, out)
    return document


def write(document: Mapping[str, Any], to: Literal["control", "matlab"], out: Path) -> None:
    """Writes a document of linear models in one of the formats."""
    if to == "control":
        documents.write_json(out, document)
        return
    content = _matlab(document)
    documents.write_atomic(
        out, lambda path: io.savemat(path, content, appendmat=False, oned_as="column")
    )


def _matlab(document: Mapping[str, Any]) -> dict[str, Any]:
    """The same as MATLAB has it: matrices, cell arrays of names, a struct array of models."""
    return {
        **{name: document[name] for name in ("program", "aircraft", "source")},
        "models": _structs(document["models"]),
    }


def _structs(items: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """A struct array; fields that some items lack a value for are NaN there."""
    names = list(items[0])
    out = np.empty((1, len(items)), dtype=[(name, object) for name in names])
    for place, item in enumerate(items):
        out[0, place] = tuple(_matlab_value(item[name]) for name in names)
    return out


def _matlab_value(value: Any) -> Any:
    if value is None:
        return np.nan
    if isinstance(value, Mapping):
        return _structs([value])
    if not isinstance(value, list):
        return value
    if all(isinstance(item, str) for item in value):
        cells = np.empty((1, len(value)), dtype=object)
        cells[0, :] = value
        return cells
    if all(isinstance(item, Mapping) for item in value):
        return _structs(value)
    return np.array(value, dtype=np.float64)
