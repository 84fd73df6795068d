"""Tables of what the filter found beside the truth; see `bench_filter_error.py`.

The lag of the moments is found, and believed to a millisecond at best (`scoring.TIMING`), which in
many derivatives is the larger part of one deviation. Whether intervals hold without it is told
apart: the rest of the deviation must answer for all that is off, and intervals that hold only with
the millisecond owe it to that alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gcs_sysid.aircraft import COEFFICIENTS, FORCES, MOMENTS
from tests.benchmarks import table

Z95 = 1.96
Results = Sequence[Mapping[str, Any]]


class Off(NamedTuple):
    """How a derivative does over the flights.

    Attributes:
        z: (found − true)/sd of each flight.
        wider: sd over the Cramér–Rao bound, median of the flights.
    """

    z: np.ndarray
    wider: float

    @property
    def hold(self) -> float:
        """Share of 95 % intervals that hold the truth."""
        return float(np.mean(np.abs(self.z) < Z95)) if self.z.size else np.nan

    @property
    def spread(self) -> float:
        """Root mean square about the mean; 1 where deviations are right."""
        return float(self.z.std()) if self.z.size else np.nan


def shown(
    name: str,
    title: str,
    every: Results,
    *,
    at_once: int = 1,
    assumed: Mapping[str, float],
    bound: str = "bound",
) -> None:
    """Prints errors beside bounds, flow angles, and how many intervals hold.

    Args:
        name: of the tables, before what each tells.
        title: before what each tells.
        every: what was kept of each fit, those without a number too.
        at_once: flights of each.
        assumed: mass and inertias over true ones as they were told, where they were to be found.
        bound: what the bound is called.
    """
    results = [result for result in every if "unsettled" not in result]
    _models(name, title, results, bound)
    with_lag = {key: _off(results, key, 1.0) for key in results[0]["derivatives"]}
    timed = [
        result
        for result in results
        if np.all(np.isfinite([*result.get("timing", {"": np.nan}).values()]))
    ]
    without = {key: _off(timed, key, 0.0) for key in with_lag}
    _intervals(name, title, every, at_once, with_lag, without, len(timed))
    _gusts(name, title, results)
    _derivatives(name, title, with_lag, without, at_once * len(timed), bound)
    _lacking(name, title, results)
    if results[0].get("body"):
        _body(name, title, results, assumed)


def _off(results: Results, key: str, lag: float) -> Off:
    """A derivative over the flights, with so much of what the lag adds to its deviation."""
    z, wider = [], [np.nan]
    for result in results:
        found, size, true, least = result["derivatives"][key]
        late = (1.0 - lag) * result["timing"][key] if lag < 1.0 else 0.0
        rest = np.sqrt(size**2 - late**2)
        z.append((found - true) / rest)
        wider.append(rest / least)
    known = [each for each in wider if np.isfinite(each)]
    return Off(np.array(z), float(np.median(known)) if known else np.nan)


def _models(name: str, title: str, results: Results, called: str) -> None:
    """Errors on another flight, coefficient by coefficient.

    What a mean is off is told apart, rms over the flights: a constant of the angle of attack and a
    constant vertical wind are one freedom.
    """
    rows = []
    for coefficient in COEFFICIENTS:
        each = [result["coefficients"][coefficient] for result in results]
        off = np.sqrt(np.mean([item["mean"] ** 2 for item in each]))
        rows.append((coefficient, *_beside(each), f"{off:.1f}"))
    for words, names in (("forces", FORCES), ("moments", MOMENTS)):
        each = [result["coefficients"][one] for result in results for one in names]
        rows.append((words, *_beside(each), ""))
    table.show(
        f"{name}_models",
        f"{title}: error on another flight in % of the spread, beside the Cramér–Rao {called}",
        ("", "error", "bound", "ratio", "mean off"),
        rows,
    )


def _beside(each: Sequence[Mapping[str, float]]) -> tuple[str, str, str]:
    """Mean error and bound, and their ratio over the flights whose bound is known."""
    error = np.mean([item["error"] for item in each])
    bounded = [item for item in each if np.isfinite(item["bound"])]
    if not bounded:
        return f"{error:.1f}", _known(np.nan), _known(np.nan)
    bound = np.mean([item["bound"] for item in bounded])
    ratio = np.mean([item["error"] for item in bounded]) / bound
    return f"{error:.1f}", _known(bound), _known(ratio)


def _intervals(
    name: str,
    title: str,
    every: Results,
    at_once: int,
    with_lag: Mapping[str, Off],
    without: Mapping[str, Off],
    timed: int,
) -> None:
    results = [result for result in every if "unsettled" not in result]
    alpha, beta = np.mean([result["flow"] for result in results], axis=0)
    cores = sorted({result["cores"] for result in results})
    table.show(
        f"{name}_intervals",
        f"{title}: flow angles, intervals, spread of (found − true)/sd (rms), and time",
        (
            "flights",
            "with a number",
            "alpha [°]",
            "beta [°]",
            "95 % intervals that hold",
            "fewest",
            "spread",
            "hold, without the lag's millisecond",
            "fewest without it",
            "spread without it",
            "flights without it",
            f"s a fit, cores: {', '.join(map(str, cores))}",
        ),
        [
            (
                at_once * len(every),
                at_once * len(results),
                f"{alpha:.2f}",
                f"{beta:.2f}",
                *_holding(with_lag),
                _rms(with_lag),
                *_holding(without),
                _rms(without),
                at_once * timed,
                f"{np.median([result['seconds'] for result in results]):.0f}",
            )
        ],
    )


def _rms(off: Mapping[str, Off]) -> str:
    """Of (found − true)/sd over all derivatives and flights; 1 where deviations are right."""
    pooled = _pooled(off)
    return f"{np.sqrt(np.mean(pooled**2)):.2f}" if pooled.size else "–"


def _pooled(off: Mapping[str, Off]) -> np.ndarray:
    return np.concatenate([one.z for one in off.values()])


def _holding(off: Mapping[str, Off]) -> tuple[str, str]:
    """Share of intervals that hold, and that of the derivative where fewest do."""
    pooled = _pooled(off)
    if not pooled.size:
        return "–", "–"
    fewest, at = min((one.hold, key) for key, one in off.items())
    return f"{100.0 * np.mean(np.abs(pooled) < Z95):.0f} %", f"{100.0 * fewest:.0f} % ({at})"


def _gusts(name: str, title: str, results: Results) -> None:
    table.show(
        f"{name}_gusts",
        f"{title}: rotation of the air by passing gusts, times the span, about the axis",
        ("axis", "found", "sd", "MIL-F-8785C"),
        [
            (
                axis,
                *(
                    f"{np.mean([r['turning'][axis][part] for r in results]):.3f}"
                    for part in (0, 1, 2)
                ),
            )
            for axis in results[0]["turning"]
        ],
    )


def _derivatives(
    name: str,
    title: str,
    with_lag: Mapping[str, Off],
    without: Mapping[str, Off],
    timed: int,
    called: str,
) -> None:
    largest = (_most(one.wider for one in off.values()) for off in (with_lag, without))
    table.show(
        f"{name}_derivatives",
        f"{title}: mean and spread of (found − true)/sd, share within 95 %, sd over the {called}; "
        f"and the last three without a millisecond of the moments' lag, {timed} flights",
        (
            "derivative",
            "mean",
            "spread",
            "hold",
            "sd",
            "without lag",
            "hold, without the lag's millisecond",
            "spread without it",
        ),
        [
            *(
                (
                    key,
                    f"{one.z.mean():+.2f}",
                    f"{one.spread:.2f}",
                    _percent(one.hold),
                    _known(one.wider, 2),
                    _known(without[key].wider, 2),
                    _percent(without[key].hold),
                    _known(without[key].spread, 2),
                )
                for key, one in with_lag.items()
            ),
            ("largest", "", "", "", *(_known(each, 2) for each in largest), "", ""),
        ],
    )


def _lacking(name: str, title: str, results: Results) -> None:
    asked = [result["lacking"] for result in results if "lacking" in result]
    if not asked:
        return
    shares = [share for each in asked for *_, share in each]
    table.show(
        f"{name}_lacking",
        f"{title}: terms asked for of which the aircraft has none",
        ("flights", "where a term was asked for", "the largest would move"),
        [
            (
                len(asked),
                sum(bool(each) for each in asked),
                f"{100.0 * max(shares, default=0.0):.0f} %",
            )
        ],
    )


def _body(name: str, title: str, results: Results, assumed: Mapping[str, float]) -> None:
    table.show(
        f"{name}_body",
        f"{title}: mass and inertias over true ones, mean of the flights",
        ("part", "told", "found", "spread", "sd"),
        [
            (
                part,
                f"{assumed[part]:.2f}",
                *(f"{number:.3f}" for number in (each[:, 0].mean(), each[:, 0].std())),
                f"{each[:, 1].mean():.3f}",
            )
            for part in results[0]["body"]
            for each in [np.array([result["body"][part] for result in results])]
        ],
    )


def _most(numbers: Iterable[float]) -> float:
    return max((one for one in numbers if np.isfinite(one)), default=np.nan)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if np.isfinite(share) else "–"


def _known(number: float, digits: int = 1) -> str:
    return f"{number:.{digits}f}" if np.isfinite(number) else "–"
