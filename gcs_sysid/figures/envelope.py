"""Where the flight went: airspeed, flow angles and controls against the aircraft file's limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from gcs_sysid.figures.data import Axis, Figure, Interval, Mark, Panel, Role, Rule, Series, Strip
from gcs_sysid.figures.reduce import limits as shown_limits
from gcs_sysid.figures.reduce import thin_cloud
from gcs_sysid.figures.samples import Samples, column

Pair = tuple[float, float]
_CELLS = 110


def covered(
    samples: Samples, *, limits: Mapping[str, Sequence[float]], trim: Mapping | None
) -> tuple[Figure, ...]:
    """Angle of attack against airspeed and against sideslip.

    Args:
        samples: with `V` [m/s], `alpha`, `beta` [rad].
        limits: the aircraft file's envelope [SI, rad], as far as it has one: `V`, `alpha`, `beta`.
        trim: with `V` and `alpha`, or None.
    """
    alpha = np.degrees(column(samples, "alpha"))
    beta = np.degrees(column(samples, "beta"))
    at = (float(trim["V"]), float(np.degrees(trim["alpha"]))) if trim else None
    return (
        _cloud(
            "envelope-speed",
            "Angle of attack against airspeed",
            samples,
            x=(column(samples, "V"), "airspeed V", "m/s", _pair(limits, "V")),
            y=(alpha, "angle of attack α", "deg", _degrees(_pair(limits, "alpha"))),
            mark=at,
        ),
        _cloud(
            "envelope-flow",
            "Angle of attack against sideslip",
            samples,
            x=(beta, "sideslip β", "deg", _degrees(_pair(limits, "beta"))),
            y=(alpha, "angle of attack α", "deg", _degrees(_pair(limits, "alpha"))),
            mark=None,
        ),
    )


def control_strips(
    samples: Samples, controls: Sequence[str], *, trim: Mapping | None
) -> dict[str, Strip]:
    """How far each control went [deg]: full range, central 90 % and trim, on one common scale."""
    values = {name: np.degrees(column(samples, name)) for name in controls}
    values = {name: value[np.isfinite(value)] for name, value in values.items()}
    values = {name: value for name, value in values.items() if value.size}
    if not values:
        return {}
    everything = np.concatenate(list(values.values()))
    scale = (min(0.0, float(everything.min())), max(0.0, float(everything.max())))
    set_to = (trim or {}).get("controls") or {}
    return {name: _strip(value, scale, set_to.get(name)) for name, value in values.items()}


def _strip(value: Float[np.ndarray, " sample"], scale: Pair, trim: float | None) -> Strip:
    low, inner_low, inner_high, high = (float(v) for v in np.quantile(value, (0, 0.05, 0.95, 1)))
    marks = () if trim is None else (Mark(float(np.degrees(trim)), "reference"),)
    at = "" if trim is None else f", trim {_words(float(np.degrees(trim)))}"
    return Strip(
        limits=(
            min(scale[0], *(mark.value for mark in marks), low),
            max(scale[1], *(mark.value for mark in marks), high),
        ),
        intervals=(
            Interval(low, high, "measured", emphasis=False),
            Interval(inner_low, inner_high, "measured", emphasis=True),
        ),
        marks=marks,
        description=(
            f"{_words(low)} to {_words(high)} deg, "
            f"90 % within {_words(inner_low)} to {_words(inner_high)}{at}"
        ),
    )


def _words(value: float) -> str:
    return f"{value:.1f}".replace("-", "\u2212")


_Side = tuple[np.ndarray, str, str, "Pair | None"]


def _cloud(
    name: str, title: str, samples: Samples, *, x: _Side, y: _Side, mark: Pair | None
) -> Figure:
    series = [
        _points("in the fit", x[0], y[0], ~_held_out(samples), "fitted"),
        _points("held out", x[0], y[0], _held_out(samples), "held_out"),
    ]
    series = [item for item in series if item.x.size]
    if mark is not None:
        series.append(Series("trim", np.array(mark[:1]), np.array(mark[1:]), "reference", "cross"))
    rules = _rules("x", x[3]) + _rules("y", y[3])
    return Figure(
        name=name,
        title=title,
        caption=(
            "Every place the flight visited"
            + (" and the aircraft file's limits." if rules else ".")
        ),
        x=Axis(x[1], x[2], _whole(x)),
        panels=(Panel(y=Axis(y[1], y[2], _whole(y)), series=tuple(series), rules=rules),),
        size="small",
    )


def _points(
    name: str,
    x: Float[np.ndarray, " sample"],
    y: Float[np.ndarray, " sample"],
    which: Bool[np.ndarray, " sample"],
    role: Role,
) -> Series:
    x, y = x[which], y[which]
    kept = thin_cloud(x, y, cells=_CELLS)
    return Series(name, x[kept], y[kept], role, "points")


def _whole(side: _Side) -> Pair:
    return shown_limits(side[0], around=side[3] or ())


def _rules(axis: Literal["x", "y"], pair: Pair | None) -> tuple[Rule, ...]:
    if pair is None:
        return ()
    return tuple(Rule(axis, value, "limit", "limit") for value in pair)


def _pair(limits: Mapping[str, Sequence[float]], name: str) -> Pair | None:
    if name not in limits:
        return None
    low, high = limits[name]
    return float(low), float(high)


def _degrees(pair: Pair | None) -> Pair | None:
    if pair is None:
        return None
    return float(np.degrees(pair[0])), float(np.degrees(pair[1]))


def _held_out(samples: Samples) -> Bool[np.ndarray, " sample"]:
    if "held_out" not in samples:
        return np.zeros(samples["t"].size, dtype=bool)
    return np.asarray(samples["held_out"], dtype=bool)
