"""Coefficients over time: measured against predicted, whole flights and single maneuvers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.figures.data import SIGMAS_95, Axis, Band, Figure, Panel, Role, Series
from gcs_sysid.figures.reduce import broken_at_holes, extreme_indices, limits
from gcs_sysid.figures.samples import Maneuver, Samples, column

TIME = "time since the log started"


def history(
    samples: Samples,
    rows: Int[np.ndarray, " sample"],
    *,
    flight: int,
    maneuvers: Sequence[Maneuver],
    refused: Mapping[str, str],
    bins: int,
) -> Figure:
    """All six coefficients over one flight.

    Args:
        samples: the table.
        rows: the flight's rows, in the order of time.
        flight: its number.
        maneuvers: all maneuvers; those of this flight are marked.
        refused: reasons by coefficient that was refused.
        bins: bins that the drawing is reduced to.
    """
    spans = tuple(maneuver.span for maneuver in maneuvers if maneuver.flight == flight)
    fitted = any(span.role == "fitted" for span in spans)
    return Figure(
        name=f"coefficients-{flight}",
        title="Coefficients over the whole flight",
        caption=(
            "Measured from accelerations and rates against what the model predicts, each with its "
            "95 % band. Maneuvers that took no part in the fit are shaded and named"
            + ("; grey bars on top mark those that were fitted." if fitted else ".")
        ),
        x=Axis(TIME, "s", _reach(column(samples, "t")[rows])),
        panels=tuple(
            Panel(y=Axis(name, "1", (-1.0, 1.0)), refusal=refused[name])
            if name in refused
            else _panel(samples, rows, name, bins=bins, shown=None)
            for name in COEFFICIENTS
        ),
        spans=spans,
        link=f"flight-{flight}",
    )


def close_up(
    samples: Samples,
    maneuver: Maneuver,
    *,
    frame: Mapping[str, tuple[float, float]],
    several: bool,
    bins: int,
) -> Figure:
    """Coefficients during one maneuver.

    Args:
        samples: the table.
        maneuver: which.
        frame: the coefficients to show with their ranges, so that maneuvers side by side compare.
        several: whether the table holds several flights, so that this one has to be named.
        bins: bins that the drawing is reduced to.
    """
    length = maneuver.end - maneuver.start
    where = f"flight {maneuver.flight + 1}, " if several else ""
    return Figure(
        name=f"maneuver-{maneuver.flight}-{maneuver.number}",
        title=maneuver.name,
        caption=f"{where}from {maneuver.start:.1f} s, {length:.1f} s long",
        x=Axis(TIME, "s", (maneuver.start, maneuver.end)),
        panels=tuple(
            _panel(samples, maneuver.rows, name, bins=bins, shown=shown)
            for name, shown in frame.items()
        ),
        size="small",
    )


def common_frame(
    samples: Samples, maneuvers: Sequence[Maneuver], names: Sequence[str]
) -> dict[str, tuple[float, float]]:
    """The range of each coefficient of `names` over all `maneuvers`, measured and predicted."""
    rows = np.concatenate([maneuver.rows for maneuver in maneuvers])
    return {
        name: limits(column(samples, f"{name}_measured")[rows], column(samples, name)[rows])
        for name in names
    }


def chosen(maneuvers: Sequence[Maneuver], count: int) -> tuple[Maneuver, ...]:
    """At most `count` maneuvers worth a close look: one of each sort first, then the longest.

    A sort is the name without its number ("elevator doublet").
    """
    longest = sorted(maneuvers, key=lambda maneuver: maneuver.start - maneuver.end)
    sorts: dict[str, Maneuver] = {}
    for maneuver in longest:
        sorts.setdefault(maneuver.name.rsplit(" ", 1)[0], maneuver)
    first = list(sorts.values())[:count]
    taken = {(maneuver.flight, maneuver.number) for maneuver in first}
    rest = [maneuver for maneuver in longest if (maneuver.flight, maneuver.number) not in taken]
    both = first + rest[: count - len(first)]
    return tuple(sorted(both, key=lambda maneuver: (maneuver.flight, maneuver.start)))


def band(
    name: str,
    time: Float[np.ndarray, " sample"],
    mean: Float[np.ndarray, " sample"],
    sd: Float[np.ndarray, " sample"],
    *,
    role: Role,
    bins: int,
) -> tuple[Series, Band]:
    """A mean and its 95 % band at the same reduced times, so that the band contains the mean."""
    time, (mean, lower, upper) = broken_at_holes(
        time, (mean, mean - SIGMAS_95 * sd, mean + SIGMAS_95 * sd)
    )
    kept = extreme_indices((mean, lower, upper), bins=bins)
    return (
        Series(name, time[kept], mean[kept], role),
        Band(f"{name}, 95 %", time[kept], lower[kept], upper[kept], role),
    )


def _panel(
    samples: Samples,
    rows: Int[np.ndarray, " sample"],
    name: str,
    *,
    bins: int,
    shown: tuple[float, float] | None,
) -> Panel:
    time = column(samples, "t")[rows]
    measured = column(samples, f"{name}_measured")[rows]
    predicted = column(samples, name)[rows]
    measured_sd = column(samples, f"{name}_measured_sd")[rows]
    predicted_sd = column(samples, f"{name}_sd")[rows]
    curve, around = band("measured", time, measured, measured_sd, role="measured", bins=bins)
    model, sure = band("predicted", time, predicted, predicted_sd, role="predicted", bins=bins)
    reach = limits(measured, predicted) if shown is None else shown
    return Panel(y=Axis(name, "1", reach), series=(curve, model), bands=(around, sure))


def _reach(time: Float[np.ndarray, " sample"]) -> tuple[float, float]:
    return float(time[0]), float(time[-1])
