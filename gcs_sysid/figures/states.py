"""The reconstructed flight over time: airspeed, flow angles, rates, attitude, wind, controls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.figures.coefficients import TIME, band
from gcs_sysid.figures.data import Axis, Band, Figure, Panel, Role, Series
from gcs_sysid.figures.reduce import broken_at_holes, extreme_indices, limits
from gcs_sysid.figures.samples import Maneuver, Samples, column

KEYS: tuple[Role, ...] = ("first", "second", "third", "fourth")


@dataclass(frozen=True)
class _Quantity:
    """A panel: heading, unit for people, factor from SI, and the columns with their names."""

    label: str
    unit: str
    factor: float
    columns: tuple[tuple[str, str], ...]
    wraps: bool = False


_DEGREES = float(np.degrees(1.0))
_WITH_BANDS = (
    _Quantity("airspeed V", "m/s", 1.0, (("V", "V"),)),
    _Quantity("angle of attack α", "deg", _DEGREES, (("alpha", "α"),)),
    _Quantity("sideslip β", "deg", _DEGREES, (("beta", "β"),)),
)
_PLAIN = (
    _Quantity("rates", "deg/s", _DEGREES, (("p", "roll"), ("q", "pitch"), ("r", "yaw"))),
    _Quantity("attitude", "deg", _DEGREES, (("phi", "bank"), ("theta", "pitch"))),
    _Quantity("heading", "deg", _DEGREES, (("psi", "heading"),), wraps=True),
    _Quantity(
        "wind toward",
        "m/s",
        1.0,
        (("wind_north", "north"), ("wind_east", "east"), ("wind_down", "down")),
    ),
)
_THRUST = (
    _Quantity("thrust", "N", 1.0, (("thrust", "thrust"),)),
    _Quantity("thrust coefficient T/q̄S", "1", 1.0, (("thrust_coefficient", "thrust"),)),
)


def states(
    samples: Samples,
    rows: Int[np.ndarray, " sample"],
    *,
    flight: int,
    maneuvers: Sequence[Maneuver],
    controls: Sequence[str],
    bins: int,
) -> Figure:
    """States and controls over one flight; a quantity that was never measured has no panel.

    Args:
        samples: the table.
        rows: the flight's rows, in the order of time.
        flight: its number.
        maneuvers: all maneuvers; those of this flight are marked.
        controls: names of the columns that are controls [rad].
        bins: bins that the drawing is reduced to.
    """
    plain = (*_PLAIN, *_controls(controls), *_THRUST)
    panels = [_banded(samples, rows, quantity, bins) for quantity in _WITH_BANDS]
    panels += [_plain(samples, rows, quantity, bins) for quantity in plain]
    time = column(samples, "t")[rows]
    return Figure(
        name=f"states-{flight}",
        title="States, wind and controls",
        caption="As reconstructed; airspeed and flow angles with their 95 % band.",
        x=Axis(TIME, "s", (float(time[0]), float(time[-1]))),
        panels=tuple(panel for panel in panels if panel is not None),
        spans=tuple(maneuver.span for maneuver in maneuvers if maneuver.flight == flight),
        link=f"flight-{flight}",
    )


def _controls(names: Sequence[str]) -> list[_Quantity]:
    """Panels for the controls, as many to a panel as there are colours."""
    groups = [names[at : at + len(KEYS)] for at in range(0, len(names), len(KEYS))]
    return [
        _Quantity("controls", "deg", _DEGREES, tuple((name, name) for name in group))
        for group in groups
    ]


def _banded(
    samples: Samples, rows: Int[np.ndarray, " sample"], quantity: _Quantity, bins: int
) -> Panel | None:
    name = quantity.columns[0][0]
    value = column(samples, name)[rows] * quantity.factor
    sd = column(samples, f"{name}_sd")[rows] * quantity.factor
    if not np.isfinite(value).any():
        return None
    time = column(samples, "t")[rows]
    mean, around = band("estimate", time, value, sd, role="first", bins=bins)
    bands: tuple[Band, ...] = (around,) if np.isfinite(around.lower).any() else ()
    return Panel(
        y=Axis(quantity.label, quantity.unit, limits(value, mean.y)), series=(mean,), bands=bands
    )


def _plain(
    samples: Samples, rows: Int[np.ndarray, " sample"], quantity: _Quantity, bins: int
) -> Panel | None:
    time = column(samples, "t")[rows]
    values = {
        label: column(samples, name)[rows] * quantity.factor for name, label in quantity.columns
    }
    values = {label: value for label, value in values.items() if np.isfinite(value).any()}
    if not values:
        return None
    if quantity.wraps:
        values = {label: _heading(value) for label, value in values.items()}
    keyed = len(values) > 1
    series = tuple(
        _reduced(label if keyed else "estimate", time, value, role, bins)
        for (label, value), role in zip(values.items(), KEYS[: len(values)], strict=True)
    )
    shown = (0.0, 360.0) if quantity.wraps else limits(*values.values())
    return Panel(y=Axis(quantity.label, quantity.unit, shown), series=series, keyed=keyed)


def _heading(value: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
    """Heading from 0 to 360 deg, not-a-number where it passes north so that no line crosses."""
    turned = np.mod(value, 360.0)
    passes = np.abs(np.diff(turned, prepend=turned[:1])) > 180.0
    return np.where(passes, np.nan, turned)


def _reduced(
    name: str,
    time: Float[np.ndarray, " sample"],
    value: Float[np.ndarray, " sample"],
    role: Role,
    bins: int,
) -> Series:
    time, (value,) = broken_at_holes(time, (value,))
    kept = extreme_indices((value,), bins=bins)
    return Series(name, time[kept], value[kept], role)
