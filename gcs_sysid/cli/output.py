"""Where results go: the folder, the progress line, the JSON on stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from gcs_sysid.errors import InputError

Progress = Callable[[str, float], None]
"""Takes what is being done and which fraction of the whole is behind it, 0 to 1."""

DOCUMENTS = (
    *("inspect.json", "summary.json", "simulate.json", "diagnosis.json", "suggest.json"),
    *("live.json", "scenario.json"),
)
"""Files that name the program that wrote them, and so vouch for the others beside them."""


@contextmanager
def folder(
    chosen: Path | None, log: Path, command: str, writes: Sequence[str]
) -> Generator[Path, None, None]:
    """The folder to write to, made if need be, and gone again if the work inside left it empty.

    Args:
        chosen: what `--out` said; None takes `./LOG-COMMAND`, LOG without its suffix.
        log: the first input.
        command: name of the command.
        writes: names of the files and folders that the command will write.

    Yields:
        The folder; it exists.

    Raises:
        InputError: when a file of somebody else's would be overwritten.
    """
    out = chosen if chosen is not None else Path(f"{log.stem}-{command}")
    threatened = [name for name in writes if (out / name).exists()]
    if threatened and not any(_ours(out / name) for name in DOCUMENTS):
        raise InputError(
            str(out / threatened[0]),
            "exists, and nothing in its folder says that gcs-sysid wrote it",
            fix="name another folder with --out, or move it away",
        )
    found = out.is_dir()
    out.mkdir(parents=True, exist_ok=True)
    try:
        yield out
    finally:
        if not found and not any(out.iterdir()):
            out.rmdir()


def _ours(path: Path) -> bool:
    """Whether `path` is a document that this program wrote."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(document, dict) and str(document.get("program", "")).startswith("gcs-sysid")


@contextmanager
def progress(title: str) -> Generator[Progress, None, None]:
    """A progress line on stderr while a long job runs; silent where nobody watches a terminal."""
    if not sys.stderr.isatty():
        yield lambda _stage, _fraction: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda stage, fraction: bar.update(
            task, description=f"{title}: {stage}", completed=fraction
        )


def show(document: Mapping[str, Any], text: str, *, as_json: bool) -> None:
    """Prints the result: the document as JSON, or the words for a person."""
    from gcs_sysid.offline import documents

    click.echo(documents.dump_json(document) if as_json else text)
