"""Reading the table of samples: one flight's rows, the maneuvers in them, residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.figures.data import Span
from gcs_sysid.figures.reduce import holes

Samples = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class Maneuver:
    """A maneuver as it lies in the samples.

    Attributes:
        flight: which flight, counted from zero.
        number: its id.
        name: for a reader, for instance "elevator doublet 7".
        start: s after the log's start.
        end: s after the log's start.
        held_out: whether it took no part in the fit.
        rows: its rows in the table.
    """

    flight: int
    number: int
    name: str
    start: float
    end: float
    held_out: bool
    rows: Int[np.ndarray, " sample"]

    @property
    def span(self) -> Span:
        """The maneuver as a stretch of the time axis."""
        return Span(self.name, self.start, self.end, "held_out" if self.held_out else "fitted")


def column(samples: Samples, name: str) -> Float[np.ndarray, " sample"]:
    """A column as float64; not-a-number throughout where the table does not have it."""
    if name not in samples:
        return np.full(samples["t"].size, np.nan)
    return np.asarray(samples[name], dtype=float)


def flight_rows(samples: Samples) -> dict[int, Int[np.ndarray, " sample"]]:
    """Rows of each flight in the order of time, by flight number."""
    count = samples["t"].size
    flight = np.asarray(samples.get("flight", np.zeros(count, dtype=int)))
    time = column(samples, "t")
    found = {}
    for number in np.unique(flight):
        rows = np.flatnonzero(flight == number)
        found[int(number)] = rows[np.argsort(time[rows], kind="stable")]
    return found


def maneuvers(samples: Samples, listed: Sequence[Mapping]) -> tuple[Maneuver, ...]:
    """The maneuvers found in the samples, in the order of flight and time.

    Args:
        samples: with `t`, `maneuver`, `held_out` and, for several flights, `flight`.
        listed: the summary's maneuvers, for their names: `id`, `kind`, `controls` and, for several
            flights, `flight`.
    """
    names = {(int(item.get("flight", 0)), int(item["id"])): _name(item) for item in listed}
    identity = np.asarray(samples.get("maneuver", np.full(samples["t"].size, -1)))
    held_out = np.asarray(samples.get("held_out", np.zeros(samples["t"].size, dtype=bool)))
    time = column(samples, "t")
    found = []
    for flight, rows in flight_rows(samples).items():
        for number in np.unique(identity[rows]):
            if number < 0:
                continue
            own = rows[identity[rows] == number]
            found.append(
                Maneuver(
                    flight=flight,
                    number=int(number),
                    name=names.get((flight, int(number)), f"maneuver {number}"),
                    start=float(time[own[0]]),
                    end=float(time[own[-1]]),
                    held_out=bool(held_out[own].any()),
                    rows=own,
                )
            )
    return tuple(sorted(found, key=lambda maneuver: (maneuver.flight, maneuver.start)))


def _name(item: Mapping) -> str:
    controls = "+".join(item.get("controls", ()))
    return f"{controls} {item['kind']} {item['id']}".strip()


def has_coefficient(samples: Samples, name: str) -> bool:
    """Whether `name` was both measured and predicted at neighbouring samples at least once."""
    return any(run.size > 1 for run in pieces(samples, residual(samples, name)))


def residual(samples: Samples, name: str) -> Float[np.ndarray, " sample"]:
    """Measured minus predicted coefficient."""
    return column(samples, f"{name}_measured") - column(samples, name)


def normalised_residual(samples: Samples, name: str) -> Float[np.ndarray, " sample"]:
    """Residual over the standard deviation claimed for it, measured and predicted together."""
    claimed = np.hypot(column(samples, f"{name}_measured_sd"), column(samples, f"{name}_sd"))
    return residual(samples, name) / np.where(claimed > 0.0, claimed, np.nan)


def pieces(samples: Samples, values: Float[np.ndarray, " sample"]) -> list[np.ndarray]:
    """Runs of finite `values` without a hole in time, in one flight and one maneuver state.

    A run never mixes samples that were fitted with samples that were held out.
    """
    time = column(samples, "t")
    held_out = np.asarray(samples.get("held_out", np.zeros(time.size, dtype=bool)))
    runs = []
    for rows in flight_rows(samples).values():
        own = rows[np.isfinite(values[rows])]
        if own.size < 2:
            continue
        cut = holes(time[own]) | (np.diff(held_out[own].astype(int)) != 0)
        runs.extend(np.split(own, np.flatnonzero(cut) + 1))
    return runs


def end_to_end(samples: Samples) -> tuple[Float[np.ndarray, " sample"], list[float]]:
    """A time axis with all flights one behind the other, and where each begins [s]."""
    time = column(samples, "t")
    shifted = np.full(time.size, np.nan)
    begins: list[float] = []
    offset = 0.0
    for rows in flight_rows(samples).values():
        first, last = time[rows[0]], time[rows[-1]]
        begins.append(offset)
        shifted[rows] = time[rows] - first + offset
        offset += float(last - first)
    return shifted, begins
