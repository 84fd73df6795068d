"""Everything a page shows, made from a summary and its samples: figures and rows of tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.figures import coefficients, confidence, envelope, residuals, states
from gcs_sysid.figures.data import Figure, Strip
from gcs_sysid.figures.samples import Maneuver, Samples, flight_rows, has_coefficient, maneuvers
from gcs_sysid.report import tables
from gcs_sysid.report.findings import Finding, findings, refused

_BINS = 1000
"""Bins of one flight's time histories: about one a pixel on a wide screen, and under 3 MB for a
10-minute flight; several flights share them."""
_FEWEST_BINS = 250
_CLOSE_UPS = 6
_CLOSE_UP_BINS = 300
_RESIDUAL_BINS = 500


@dataclass(frozen=True)
class Flight:
    """One flight's own figures."""

    heading: str
    coefficients: Figure
    states: Figure


@dataclass(frozen=True)
class Residual:
    """One coefficient's residual figures, or why there are none."""

    name: str
    meaning: str
    figures: tuple[Figure, ...]
    refusal: str


@dataclass(frozen=True)
class Content:
    """What every report of a flight shows."""

    summary: Mapping
    findings: tuple[Finding, ...]
    scores: tuple[tables.Score, ...]
    close_ups: tuple[Figure, ...]
    left_out: int
    flights: tuple[Flight, ...]
    maneuvers: tuple[tables.Flown, ...]
    maneuver_columns: tuple[str, ...]
    envelope: tuple[Figure, ...]
    controls: Mapping[str, Strip]
    trim: tuple[tables.Item, ...]
    residuals: tuple[Residual, ...]
    channels: tuple[tables.Channel, ...]
    sensors: tuple[tables.Item, ...]
    delays: tuple[tables.Item, ...]
    dates: tuple[str, ...]

    @property
    def figures(self) -> tuple[Figure, ...]:
        """All figures of the page."""
        return (
            *self.close_ups,
            *(figure for flight in self.flights for figure in (flight.coefficients, flight.states)),
            *self.envelope,
            *(figure for residual in self.residuals for figure in residual.figures),
        )


def content(summary: Mapping, samples: Samples, *, unseen: bool) -> Content:
    """Gathers the page's content.

    Args:
        summary: the summary document.
        samples: the table of samples or predictions, one row a sample.
        unseen: whether the model saw none of it, so that every maneuver counts as held out.
    """
    found = maneuvers(samples, summary["maneuvers"])
    if unseen:
        found = tuple(replace(maneuver, held_out=True) for maneuver in found)
    reasons = refusals(summary, samples)
    present = tuple(name for name in COEFFICIENTS if name not in reasons)
    held_out = tuple(maneuver for maneuver in found if maneuver.held_out)
    limits = summary.get("limits") or {}
    trim = summary.get("trim")
    return Content(
        summary=summary,
        findings=findings(summary),
        scores=tables.scores(summary),
        close_ups=_close_ups(samples, held_out, present, several=len(summary["flights"]) > 1),
        left_out=max(len(held_out) - _CLOSE_UPS, 0),
        flights=_flights(summary, samples, found, reasons),
        maneuvers=tables.flown(samples, found, present),
        maneuver_columns=present,
        envelope=(
            *envelope.covered(samples, limits=limits, trim=trim),
            *confidence.maps(summary),
        ),
        controls=envelope.control_strips(samples, control_names(summary, samples), trim=trim),
        trim=tables.trim(summary),
        residuals=_residuals(samples, reasons),
        channels=tables.channels(summary),
        sensors=tables.sensors(summary),
        delays=tables.delays(summary),
        dates=tuple(tables.date(flight) for flight in summary["flights"]),
    )


def refusals(summary: Mapping, samples: Samples) -> dict[str, str]:
    """Why a coefficient has no curve: the summary's reason, or that the samples hold none."""
    reasons = refused(summary)
    for name in COEFFICIENTS:
        if name not in reasons and not has_coefficient(samples, name):
            reasons[name] = "no sample of this flight has both a measured and a predicted value"
    return reasons


def control_names(summary: Mapping, samples: Samples) -> tuple[str, ...]:
    """Controls that the summary knows (in its trim and its maneuvers) and the samples hold."""
    named = dict.fromkeys((summary.get("trim") or {}).get("controls") or {})
    for item in summary["maneuvers"]:
        named |= dict.fromkeys(item.get("controls") or ())
    return tuple(name for name in named if name in samples)


def _close_ups(
    samples: Samples, held_out: Sequence[Maneuver], names: Sequence[str], *, several: bool
) -> tuple[Figure, ...]:
    if not held_out or not names:
        return ()
    shown = coefficients.chosen(held_out, _CLOSE_UPS)
    frame = coefficients.common_frame(samples, shown, names)
    return tuple(
        coefficients.close_up(samples, maneuver, frame=frame, several=several, bins=_CLOSE_UP_BINS)
        for maneuver in shown
    )


def _flights(
    summary: Mapping, samples: Samples, found: Sequence[Maneuver], reasons: Mapping[str, str]
) -> tuple[Flight, ...]:
    rows = flight_rows(samples)
    bins = max(_BINS // max(len(rows), 1), _FEWEST_BINS)
    controls = control_names(summary, samples)
    sources = [str(flight["source"]) for flight in summary["flights"]]
    return tuple(
        Flight(
            heading=sources[number] if number < len(sources) else f"flight {number + 1}",
            coefficients=coefficients.history(
                samples, own, flight=number, maneuvers=found, refused=reasons, bins=bins
            ),
            states=states.states(
                samples, own, flight=number, maneuvers=found, controls=controls, bins=bins
            ),
        )
        for number, own in rows.items()
    )


def _residuals(samples: Samples, reasons: Mapping[str, str]) -> tuple[Residual, ...]:
    return tuple(
        Residual(
            name=name,
            meaning=tables.labels.meaning(name),
            figures=()
            if name in reasons
            else residuals.figures(samples, name, bins=_RESIDUAL_BINS),
            refusal=reasons.get(name, ""),
        )
        for name in COEFFICIENTS
    )
