from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import get_args

import numpy as np
import pytest

from gcs_sysid.figures.data import Role
from gcs_sysid.report.palette import DARK, LIGHT, token

PAPERS = pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])

DEUTERANOPE = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
PROTANOPE = np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]])
"""Linear RGB as seen by the fully colour blind: Machado, Oliveira and Fernandes 2009, "A
physiologically-based model for simulation of color vision deficiency", severity 1.0."""


def linear(colour: str) -> np.ndarray:
    part = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)


def contrast(one: str, other: str) -> float:
    """WCAG 2.2 contrast ratio."""
    bright, dim = sorted(
        (float(linear(colour) @ [0.2126, 0.7152, 0.0722]) for colour in (one, other)), reverse=True
    )
    return (bright + 0.05) / (dim + 0.05)


@PAPERS
def test_every_role_has_a_colour_that_shows_on_the_paper(palette: Mapping[str, str]) -> None:
    for role in get_args(Role):
        assert contrast(palette[role], palette["paper"]) >= 3.0, role


@PAPERS
def test_text_can_be_read(palette: Mapping[str, str]) -> None:
    for role in ("ink", "muted", "yes", "weak", "no"):
        for ground in ("paper", "raised"):
            assert contrast(palette[role], palette[ground]) >= 4.5, role


@PAPERS
@pytest.mark.parametrize("eye", [np.eye(3), DEUTERANOPE, PROTANOPE], ids=["full", "deut", "prot"])
def test_curves_are_told_apart_by_every_eye(palette: Mapping[str, str], eye: np.ndarray) -> None:
    curves = [eye @ linear(palette[role]) for role in ("first", "second", "third", "fourth")]
    pair = [eye @ linear(palette[role]) for role in ("measured", "predicted")]
    assert np.linalg.norm(pair[0] - pair[1]) > 0.3
    assert min(np.linalg.norm(a - b) for a, b in itertools.combinations(curves, 2)) > 0.1


def test_both_papers_know_the_same_roles() -> None:
    assert set(LIGHT) == set(DARK)
    assert token("measured", 0.25) == "@{measured/0.25}"
