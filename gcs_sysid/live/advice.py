"""What to fly next: inputs that teach the derivatives of which the first model knows least."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.live.maneuver import WANTED
from gcs_sysid.live.regression import TermEstimate
from gcs_sysid.offline.advice import INPUT

MOST = 3
POOR = 0.25
"""One standard deviation over the value, above which a derivative is worth a maneuver."""


def suggestions(
    aircraft: Aircraft, known: Mapping[str, Mapping[str, TermEstimate]]
) -> list[dict[str, Any]]:
    """The inputs that most of the poorly known derivatives ask for, with these derivatives.

    Args:
        aircraft: its controls.
        known: the first model.
    """
    asked: dict[str, list[tuple[float, str]]] = {}
    for name, terms in known.items():
        for key, term in terms.items():
            share = term.deviation / max(abs(term.value), 1e-9)
            if key != regressors.CONSTANT and share > POOR:
                asked.setdefault(_input(key, aircraft), []).append((share, f"{name}_{key}"))
    ordered = sorted(asked.items(), key=lambda item: -len(item[1]))
    return [
        {
            "fly": fly,
            "for": [what for _, what in sorted(rows, reverse=True)],
            "wanted": WANTED,
        }
        for fly, rows in ordered[:MOST]
    ]


def _input(key: str, aircraft: Aircraft) -> str:
    names = aircraft.control_names
    variables = regressors.parse(key, controls=names).variables
    moved = [name for name in variables if name in names]
    if moved:
        return f"doublets and 3-2-1-1s on the {' and '.join(moved)}, added after the autopilot"
    found = [INPUT[name] for name in variables if name in INPUT]
    return found[0] if found else f"a flight on which {key} varies"
