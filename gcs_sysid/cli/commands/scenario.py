"""`scenario`: flights whose truth is known, and whether the program finds it."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

import gcs_sysid
from gcs_sysid.cli import needs, numerics, options, output
from gcs_sysid.errors import InputError, UsageError

SCENARIOS = Path(gcs_sysid.__file__).parents[1] / "replay"
"""The scenarios that come with the source."""


@click.command("scenario")
@click.argument("name", required=False)
@click.option(
    "--cache",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    help="Where flights are kept once flown, instead of this user's cache folder.",
)
@options.out("scenario")
@options.as_json
def command(name: str | None, cache: Path | None, out: Path | None, as_json: bool) -> None:
    """Run a scenario of replay/ and compare with what it expects.

    NAME is one of them, or the path of a folder with a scenario.toml and an expected.toml; without
    it they are listed. Flights that are not there yet are flown, and kept. The exit status is 1
    where an expectation does not hold.
    """
    from gcs_sysid.offline import scenario

    if name is None:
        listed = scenario.listed(SCENARIOS)
        output.show({"scenarios": listed}, _list(listed), as_json=as_json)
        return
    folder = _folder(name)
    needs.jsbsim()
    numerics.enable()
    document = _run(folder, out, cache or numerics.cache_folder())
    output.show(document, scenario.text(document), as_json=as_json)
    scenario.demand(document, folder / scenario.EXPECTED)


def _folder(name: str) -> Path:
    from gcs_sysid.offline import scenario

    for folder in (Path(name), SCENARIOS / name):
        if (folder / scenario.PLAN).is_file():
            return folder
    known = ", ".join(scenario.listed(SCENARIOS)) or "none: they come with the source"
    raise InputError(
        name, f"no scenario of that name, and no folder with a {scenario.PLAN}",
        fix=f"there are {known}",
    )  # fmt: skip


def _run(folder: Path, out: Path | None, cache: Path) -> Mapping[str, Any]:
    from gcs_sysid.cli import flights
    from gcs_sysid.offline import scenario
    from gcs_sysid.sitl import scenario as plans

    expected = scenario.expected(folder)
    planned = plans.load(folder / scenario.PLAN)
    with (
        output.folder(out, folder, "scenario", [scenario.DOCUMENT]) as destination,
        output.progress(f"scenario {folder.name}") as progress,
    ):
        found = flights.of(planned, cache, progress)
        logs = {name: flight.log for name, flight in found.items()}
        return scenario.run(
            folder.name,
            scenario.plan(expected, logs, planned.aircraft, destination),
            scenario.shortfalls(expected),
            out=destination,
            command=_command,
            progress=progress,
        )


def _command(name: str, arguments: Sequence[str]) -> None:
    """Run another command of this program, without what it says on stdout."""
    from gcs_sysid.cli import entry

    with contextlib.redirect_stdout(io.StringIO()):
        entry.program.main([name, *arguments], prog_name="gcs-sysid", standalone_mode=False)


def _list(listed: Mapping[str, str]) -> str:
    if not listed:
        raise UsageError("no scenario came with this program; give the path of a folder")
    width = max(map(len, listed))
    return "\n".join(f"{name.ljust(width)}  {about}" for name, about in listed.items())
