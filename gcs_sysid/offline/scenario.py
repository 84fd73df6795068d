"""`scenario`: the program's own commands on flights whose truth is known, against what is expected.

`expected.toml` of a scenario, each table a tree of what a document must say (see `expectations`):

    schema = 1
    about = "an elevator a third weaker than the file says"

    [runs]                       # optional
    identify = ["first"]         # by default every flight that nothing else is done with
    prior = "none"               # by default the aircraft file's aerodynamics
    method = "filter-error"      # by default "equation-error", which takes seconds
    diagnose = ["first"]         # by default those of `identify`
    diagnosis = "filter"         # by default "coefficients", which takes seconds
    holdout = "second"           # a flight that takes no part in what `diagnose` fits

    [identify.derivatives.Cm]    # summary.json
    elevator = { value = -0.55, within = 0.03 }
    [predict.second.coefficients.Cm]  # summary.json of the second flight with that model
    relative_error = { most = 40 }
    [simulate.first.channels]    # simulate.json of the first flight with the aircraft file
    q = { pass = false }
    [diagnose]                   # diagnosis.json
    verdict = "effect"

    [[known_shortfall]]          # what does not hold yet, and why: it fails once it does
    run = "identify"
    place = "derivatives.Cm.elevator"
    reason = "the servo's lag is not estimated"
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.errors import InputError
from gcs_sysid.offline import documents, expectations
from gcs_sysid.offline.flight import Progress

SCHEMA = 1
PLAN, EXPECTED, DOCUMENT = "scenario.toml", "expected.toml", "scenario.json"

_DOCUMENTS = {
    "identify": "summary.json",
    "predict": "summary.json",
    "simulate": "simulate.json",
    "diagnose": "diagnosis.json",
}
"""What each command leaves."""

Command = Callable[[str, Sequence[str]], None]
"""Runs a command of this program with its arguments."""


@dataclass(frozen=True)
class Run:
    """One command and what its document must say.

    Attributes:
        name: of the run.
        command: of this program.
        arguments: of the command.
        document: what it leaves.
        expected: tree of expectations.
    """

    name: str
    command: str
    arguments: tuple[str, ...]
    document: Path
    expected: Section


def listed(folder: Path) -> Mapping[str, str]:
    """The scenarios in a folder by name, with what each is about."""
    found = sorted(path.parent for path in folder.glob(f"*/{PLAN}"))
    return {path.name: expected(path).text("about") for path in found}


def expected(folder: Path) -> Section:
    """What a scenario expects.

    Raises:
        InputError: there is no such file, or it is malformed.
    """
    path = folder / EXPECTED
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(str(path), "no such file", fix="write what must be found") from error
    except ValueError as error:
        raise InputError(str(path), f"no TOML ({error})", fix="correct it there") from error
    top = Section(str(path), "", data)
    top.allow_only("schema", "about", "runs", "known_shortfall", *_DOCUMENTS)
    if top.whole("schema", least=1) > SCHEMA:
        raise InputError(str(path), "was written for a newer version", fix="update gcs-sysid")
    return top


def plan(expected: Section, logs: Mapping[str, Path], aircraft: Path, out: Path) -> list[Run]:
    """The runs that a scenario asks for, in order.

    Args:
        expected: what it expects.
        logs: recording of each flight, by name.
        aircraft: file of the aircraft as believed.
        out: directory for the results, a folder a run.

    Raises:
        InputError: it names a flight that there is not.
    """
    runs = _section(expected, "runs")
    runs.allow_only("identify", "prior", "method", "diagnose", "diagnosis", "holdout")
    predicted = _section(expected, "predict")
    predicted.allow_only(*logs)
    holdout = runs.text("holdout", allowed=tuple(logs)) if runs.has("holdout") else None
    others = [name for name in logs if name not in predicted.data and name != holdout]
    fitted = _chosen(runs, "identify", logs, others)
    about = ["--aircraft", str(aircraft)]
    found = []
    if expected.has("identify") or predicted.data:
        prior = runs.text("prior", allowed=("file", "none"), default="file")
        methods = ("equation-error", "filter-error")
        method = runs.text("method", allowed=methods, default="equation-error")
        arguments = [*_paths(logs, fitted), *about, "--prior", prior, "--method", method]
        found.append(_run("identify", "identify", arguments, _section(expected, "identify"), out))
    for name in predicted.data:
        arguments = [str(logs[name]), "--model", str(out / "identify")]
        found.append(_run(f"predict-{name}", "predict", arguments, predicted.table(name), out))
    simulated = _section(expected, "simulate")
    simulated.allow_only(*logs)
    for name in simulated.data:
        arguments = [str(logs[name]), *about]
        found.append(_run(f"simulate-{name}", "simulate", arguments, simulated.table(name), out))
    if expected.has("diagnose"):
        held = [] if holdout is None else ["--holdout", str(logs[holdout])]
        ways = ("coefficients", "filter")
        way = ["--method", runs.text("diagnosis", allowed=ways, default="coefficients")]
        chosen = _chosen(runs, "diagnose", logs, fitted)
        arguments = [*_paths(logs, chosen), *about, *held, *way]
        found.append(_run("diagnose", "diagnose", arguments, expected.table("diagnose"), out))
    return found


def shortfalls(expected: Section) -> dict[tuple[str, str], str]:
    """What is known not to hold: the reason, by run and place.

    Raises:
        InputError: an entry is malformed.
    """
    found = {}
    for entry in expected.children("known_shortfall", name_key="place"):
        entry.allow_only("run", "place", "reason")
        found[entry.text("run"), entry.text("place")] = entry.text("reason")
    return found


def run(
    name: str,
    runs: Sequence[Run],
    known: Mapping[tuple[str, str], str],
    *,
    out: Path,
    command: Command,
    progress: Progress,
) -> dict[str, Any]:
    """Runs everything and compares; writes `scenario.json`, and a folder a run, to `out`.

    Args:
        name: of the scenario.
        runs: what to run.
        known: reason why it does not hold, by run and place. One that holds is a failure too, since
            the reason is then gone.
        out: directory for the results.
        command: runs a command of this program.
        progress: told what is being done.

    Returns:
        The document.

    Raises:
        InputError: a known shortfall is of nothing that is expected.
    """
    checks: list[dict[str, Any]] = []
    for index, one in enumerate(runs):
        progress(one.name, index / len(runs))
        command(one.command, one.arguments)
        found = expectations.compare(one.expected, json.loads(one.document.read_text("utf-8")))
        checks += [
            {"run": one.name, **asdict(check), "shortfall": known.get((one.name, check.place))}
            for check in found
        ]
    _demand_known(known, checks, runs)
    document = {
        "schema": SCHEMA,
        "program": f"gcs-sysid {version('gcs-sysid')}",
        "command": "scenario",
        "scenario": name,
        "passed": not any(map(_wrong, checks)),
        "checks": checks,
    }
    documents.write_json(out / DOCUMENT, document)
    return documents.plain(document)


def text(document: Mapping[str, Any]) -> str:
    """The table for a person."""
    rows = [("", "run", "what", "expected", "found")]
    rows += [
        (_mark(check), check["run"], check["place"], check["wanted"], check["found"])
        for check in document["checks"]
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    short = [check for check in document["checks"] if check["shortfall"]]
    lines += [f"short: {check['run']} {check['place']}: {check['shortfall']}" for check in short]
    held, total = sum(check["passed"] for check in document["checks"]), len(document["checks"])
    known = f", {len(short)} known not to" if short else ""
    lines.append(f"{document['scenario']}: {held} of {total} expectations hold{known}")
    return "\n".join(lines)


def demand(document: Mapping[str, Any], source: Path) -> None:
    """Nothing, where everything is as expected.

    Raises:
        InputError: something is not.
    """
    wrong = [check for check in document["checks"] if _wrong(check)]
    if not wrong:
        return
    better = sum(check["passed"] for check in wrong)
    said = []
    if better < len(wrong):
        said.append(f"{len(wrong) - better} of {len(document['checks'])} expectations do not hold")
    if better:
        said.append(f"{better} hold that are known not to")
    fix = "the table says which" + ("; take the entries out" if better else "")
    raise InputError(str(source), " and ".join(said), fix=fix)


def _wrong(check: Mapping[str, Any]) -> bool:
    """Whether a check is not as expected: failed, or held where it is known not to."""
    return check["passed"] == bool(check["shortfall"])


def _mark(check: Mapping[str, Any]) -> str:
    if check["shortfall"]:
        return "HOLDS" if check["passed"] else "short"
    return "ok" if check["passed"] else "FAIL"


def _demand_known(
    known: Mapping[tuple[str, str], str], checks: Sequence[Mapping[str, Any]], runs: Sequence[Run]
) -> None:
    expected = {(check["run"], check["place"]) for check in checks}
    for run, place in known:
        if (run, place) not in expected:
            raise InputError(
                runs[0].expected.file,
                f"known_shortfall: nothing is expected of `{place}` in the run `{run}`",
                fix="name a run and a place as the table does",
            )


def _chosen(
    runs: Section, key: str, logs: Mapping[str, Path], usual: Sequence[str]
) -> Sequence[str]:
    names = runs.data.get(key, usual)
    if not isinstance(names, Sequence) or not names or not set(names) <= set(logs):
        raise runs.error(
            key,
            found=", ".join(map(str, names)) or "no flight",
            allowed=f"a list of {', '.join(logs)}",
            fix="name flights of the scenario",
        )
    return names


def _paths(logs: Mapping[str, Path], names: Iterable[str]) -> tuple[str, ...]:
    return tuple(str(logs[name]) for name in names)


def _run(name: str, command: str, arguments: Sequence[str], expected: Section, out: Path) -> Run:
    folder = out / name
    document = folder / _DOCUMENTS[command]
    return Run(name, command, (*arguments, "--out", str(folder)), document, expected)


def _section(expected: Section, key: str) -> Section:
    return expected.child(key) or Section(expected.file, key, {})
