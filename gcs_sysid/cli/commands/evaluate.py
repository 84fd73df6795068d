"""`evaluate`: coefficients, their sd and derivatives at given regressors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from gcs_sysid.cli import numerics, options, output
from gcs_sysid.errors import InputError


@click.command("evaluate")
@options.model
@click.option(
    "--at",
    metavar="FILE",
    type=options.Existing("file"),
    required=True,
    help="Table of regressors (.csv or .parquet): alpha, beta, phat, …, controls; rad.",
)
@click.option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Table to write; ./FILE-evaluate beside its suffix unless given.",
)
@options.seed
@options.as_json
def command(model: Path, at: Path, out: Path | None, as_json: bool) -> None:
    """Evaluate a model at given regressors.

    Adds each coefficient, its sd and its derivatives to a table of regressors.
    """
    from gcs_sysid.offline import evaluate

    numerics.enable()
    destination = out if out is not None else Path(f"{at.stem}-evaluate{at.suffix}")
    if destination.resolve() == at.resolve():
        raise InputError(str(at), "is both read and written", fix="name another file with --out")
    document = evaluate.run(model, at, destination)
    output.show(document, _text(document), as_json=as_json)


def _text(document: Mapping[str, Any]) -> str:
    outside = document["extrapolated"]
    warning = f", {outside} of them outside what was flown" if outside else ""
    return f"{document['rows']} rows{warning}\n{document['file']}"
