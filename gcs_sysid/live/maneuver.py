"""The maneuver in progress: on which controls, what it teaches, and when it has taught enough.

A maneuver is on while a control moves far more than it does in the flight otherwise. What it has
taught is how far the derivatives of the moved control's own coefficients have come, from where they
stood when it began, towards one standard deviation of `WANTED` of their value; it is over when they
are there, when it teaches no more, or when the aircraft leaves the envelope of its file.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.live.regression import TermEstimate

WANTED = 0.1
"""One standard deviation over the value, at which a derivative counts as known."""
LEAST = 0.009
"""Root mean square of a control's motion that can be a test input [rad], half a degree."""
TIMES = 2.5
"""And so many times what is usual in this flight."""
QUIET_S = 2.0
"""A maneuver ends when no control moved so for this long: the aircraft's answer belongs to it."""
USUAL_S = 40.0
"""Memory of what is usual."""
LONG_ENOUGH_S, LITTLE = 8.0, 0.02
"""After so long a maneuver that gained less than this in its last third teaches no more."""
KEPT = 64
"""Maneuvers that are remembered."""
COEFFICIENTS: Mapping[str, tuple[str, ...]] = {
    "longitudinal": ("CZ", "Cm"),
    "lateral": ("CY", "Cl", "Cn"),
    "unknown": ("CZ", "Cl", "Cm", "Cn"),
}

Known = Mapping[str, Mapping[str, TermEstimate]]


@dataclass
class _Running:
    began: float
    last: float
    controls: dict[str, None]
    before: Known
    learned: list[tuple[float, float]] = field(default_factory=list)
    outside: str = ""


class ManeuverWatch:
    """Follows the maneuvers of a flight.

    Args:
        aircraft: its controls and envelope.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        self._aircraft = aircraft
        self._usual: dict[str, float] = {}
        self._running: _Running | None = None
        self._number = 0
        self._time = 0.0
        self.past: deque[dict[str, Any]] = deque(maxlen=KEPT)

    def take(self, samples: Samples, kept: slice, solved: Callable[[], Known]) -> None:
        """Looks at the rows `kept` of a window; `solved` gives the first model so far."""
        time = samples.time[kept]
        begun, self._time = float(time[0]), float(time[-1])
        moving = self._moving(samples, kept, self._time - begun)
        if moving and self._running is None:
            self._number += 1
            self._running = _Running(begun, self._time, {}, solved())
        running = self._running
        if running is None:
            return
        if moving:
            running.last = self._time
            running.controls |= dict.fromkeys(moving)
        running.outside = self._outside(samples, kept)
        known = solved()
        running.learned.append((self._time, _share(self._gauge(running, known))))
        if self._time - running.last > QUIET_S:
            told = self._told(running, known)
            self.past.append({name: value for name, value in told.items() if name != "gauge"})
            self._running = None

    def document(self, known: Known, epoch_us: int | None) -> dict[str, Any] | None:
        """The maneuver in progress; None where there is none."""
        if self._running is None:
            return None
        return _stamped(self._told(self._running, known), epoch_us)

    def legs(self, epoch_us: int | None) -> list[dict[str, Any]]:
        """Maneuvers flown, oldest first, without their gauges: the document stays small."""
        return [_stamped(one, epoch_us) for one in self.past]

    def _moving(self, samples: Samples, kept: slice, span: float) -> list[str]:
        """Controls that move as in a test; what is usual is learned from all others."""
        found = []
        for name in self._aircraft.control_names:
            values = samples.regressors[name]
            # Over the whole window: a slow sine looks still for half a second.
            size = float(np.std(values[: kept.stop]))
            usual = self._usual.get(name)
            if usual is not None and size > max(TIMES * usual, LEAST):
                found.append(name)
                continue
            share = min(span / USUAL_S, 1.0)
            self._usual[name] = size if usual is None else usual + share * (size - usual)
        return found

    def _outside(self, samples: Samples, kept: slice) -> str:
        limits = self._aircraft.envelope
        if limits is None:
            return ""
        for name, (low, high) in (
            ("V", limits.airspeed), ("alpha", limits.alpha), ("beta", limits.beta),
        ):  # fmt: skip
            values = samples.regressors[name][kept]
            if values.min() < low or values.max() > high:
                return {"V": "airspeed", "alpha": "angle of attack", "beta": "sideslip"}[name]
        return ""

    def _gauge(self, running: _Running, known: Known) -> list[dict[str, Any]]:
        """By derivative that the maneuver is for: deviation before, now, and wanted."""
        names = self._aircraft.control_names
        kinds = {regressors.control_kind(control) for control in running.controls}
        coefficients = dict.fromkeys(name for kind in kinds for name in COEFFICIENTS[kind])
        rows = []
        for name in coefficients:
            for key, term in known.get(name, {}).items():
                moved = set(regressors.parse(key, controls=names).variables)
                others = (moved & set(names)) - set(running.controls)
                if key == regressors.CONSTANT or others:
                    continue
                before = running.before.get(name, {}).get(key)
                rows.append(
                    {
                        "derivative": f"{name}_{key}",
                        "value": term.value,
                        "sd_before": None if before is None else before.deviation,
                        "sd": term.deviation,
                        "sd_wanted": WANTED * abs(term.value),
                    }
                )
        return rows

    def _told(self, running: _Running, known: Known) -> dict[str, Any]:
        gauge = self._gauge(running, known)
        return {
            "number": self._number,
            "controls": list(running.controls),
            "begin": running.began,
            "end": running.last,
            "learned": round(_share(gauge), 3),
            "gauge": gauge,
            "stop": self._stop(running, gauge),
        }

    def _stop(self, running: _Running, gauge: list[dict[str, Any]]) -> str:
        """Why the maneuver may end; empty while it should go on."""
        if running.outside:
            return f"{running.outside} leaves the envelope"
        if gauge and all(row["sd"] <= row["sd_wanted"] for row in gauge):
            return f"known to {100 * WANTED:.0f} %"
        flown = self._time - running.began
        if flown < LONG_ENOUGH_S or not running.learned:
            return ""
        then = [share for at, share in running.learned if at <= running.began + 2.0 * flown / 3.0]
        if then and running.learned[-1][1] - then[-1] < LITTLE:
            return "teaches no more: change amplitude, frequency or airspeed"
        return ""


def _share(gauge: list[dict[str, Any]]) -> float:
    """How far the deviations have come on the way to what is wanted, in logarithms: 0 to 1."""
    way = done = 0.0
    for row in gauge:
        # What was not known at all at the beginning counts from its own size.
        before = row["sd_before"] or abs(row["value"]) or 1.0
        if row["sd_wanted"] <= 0.0 or before <= row["sd_wanted"]:
            continue
        whole = math.log(before / row["sd_wanted"])
        way += whole
        done += min(max(math.log(before / max(row["sd"], 1e-12)), 0.0), whole)
    return 1.0 if not way and gauge else done / way if way else 0.0


def _stamped(told: dict[str, Any], epoch_us: int | None) -> dict[str, Any]:
    """With times on the log's clock."""
    begin, end = told["begin"], told["end"]
    stamped = {name: value for name, value in told.items() if name not in ("begin", "end")}
    since = None if epoch_us is None else epoch_us + round(begin * 1e6)
    return {**stamped, "since_us": since, "seconds": round(end - begin, 1)}
