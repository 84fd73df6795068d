"""A report as findings and sections of tables and figures: for runs that answer one question."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath

from gcs_sysid.figures.data import Figure
from gcs_sysid.report import page
from gcs_sysid.report.findings import Finding

_LINES, _WARNINGS = 10, 2
"""Lines on a terminal, and warnings among them."""


@dataclass(frozen=True)
class Table:
    """Cells as people read them; the first column names the row."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Section:
    """A heading with what stands under it.

    Attributes:
        name: of the section in links.
        heading: as people read it.
        lead: what there is to know before.
        tables: in their order.
        text: lines shown as they are.
        figures: below them.
    """

    name: str
    heading: str
    lead: str
    tables: tuple[Table, ...] = ()
    text: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()


@dataclass(frozen=True)
class Sheet:
    """A whole report.

    Attributes:
        kind: what made it, in words.
        question: heading of the findings.
        summary: the run's document, for its aircraft, flights and program.
        findings: most important first.
        sections: below them.
        files: where the numbers are.
    """

    kind: str
    question: str
    summary: Mapping
    findings: tuple[Finding, ...]
    sections: tuple[Section, ...]
    files: str


def render(sheet: Sheet) -> str:
    """The report as one self-contained HTML file."""
    figures = [figure for section in sheet.sections for figure in section.figures]
    return page.render("sheet.html.j2", figures, {"sheet": sheet, "summary": sheet.summary})


def lines(
    findings: Sequence[Finding], warnings: Sequence[str], report_path: str | PathLike[str]
) -> str:
    """Findings and the first warnings for a terminal: at most ten lines, the last the report's."""
    warned = [Finding("Warning", text) for text in warnings[:_WARNINGS]]
    said = [*findings, *warned][: _LINES - 1]
    shown = [*said, Finding("Report", fspath(report_path))]
    width = max(len(finding.topic) for finding in shown)
    return "\n".join(
        f"{finding.topic:<{width}}  {' '.join(finding.text.split())}" for finding in shown
    )
