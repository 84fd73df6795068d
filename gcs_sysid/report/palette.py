"""Colours by meaning, on light and on dark paper.

The hues are those of Okabe and Ito (2008, "Color universal design"), told apart with every common
kind of colour blindness; darkened on light paper and lightened on dark paper until each contrasts
with it by 3:1 or better (those of text by 4.5:1, WCAG 2.2).
"""

from __future__ import annotations

from collections.abc import Mapping

LIGHT: Mapping[str, str] = {
    "paper": "#ffffff",
    "raised": "#f4f5f7",
    "ink": "#16191d",
    "muted": "#59626d",
    "line": "#d6dade",
    "grid": "#e9ebee",
    "measured": "#0067a5",
    "predicted": "#d04a02",
    "file": "#6f7682",
    "fitted": "#7b8490",
    "held_out": "#a9760a",
    "first": "#0067a5",
    "second": "#d04a02",
    "third": "#00805c",
    "fourth": "#a04a83",
    "reference": "#3a4149",
    "limit": "#a8324a",
    "yes": "#00704f",
    "weak": "#8f5a00",
    "no": "#b02a30",
}

DARK: Mapping[str, str] = {
    "paper": "#121518",
    "raised": "#1b1f24",
    "ink": "#e7e9eb",
    "muted": "#a0a8b1",
    "line": "#333a42",
    "grid": "#252b31",
    "measured": "#58b4ee",
    "predicted": "#f58a3c",
    "file": "#98a1ac",
    "fitted": "#8b949e",
    "held_out": "#e3b341",
    "first": "#58b4ee",
    "second": "#f58a3c",
    "third": "#3ec79d",
    "fourth": "#dc8cc0",
    "reference": "#c4cad1",
    "limit": "#f07a8d",
    "yes": "#46c79b",
    "weak": "#e3a23a",
    "no": "#f2777a",
}


def token(role: str, opacity: float = 1.0) -> str:
    """Placeholder for a colour that the page fills in for light or dark paper."""
    return f"@{{{role}/{opacity:g}}}"
