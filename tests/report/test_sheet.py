"""What a run that answers one question says on a terminal."""

from __future__ import annotations

from gcs_sysid.report import sheet
from gcs_sysid.report.findings import Finding


def test_the_terminal_shows_findings_two_warnings_and_the_report() -> None:
    found = [Finding("Verdict", "mass,\nprobability 97 %.")]
    text = sheet.lines(found, ["first", "second", "third"], "out/report.html")
    assert text.splitlines() == [
        "Verdict  mass, probability 97 %.",
        "Warning  first",
        "Warning  second",
        "Report   out/report.html",
    ]


def test_the_terminal_shows_ten_lines_at_most() -> None:
    lines = sheet.lines([Finding("Else", "x")] * 12, ["left out"], "report.html").splitlines()
    assert len(lines) == 10
    assert lines[-1] == "Report  report.html"
