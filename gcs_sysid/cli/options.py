"""Options that several commands share, so that they are called and explained alike."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from gcs_sysid.errors import InputError

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class Existing(click.Path):
    """A file or folder that must be there; a missing one is an unusable input, not wrong usage."""

    def __init__(self, kind: str) -> None:
        super().__init__(path_type=Path)
        self.kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, known to exist."""
        path = Path(str(super().convert(value, param, ctx)))
        if not path.exists():
            raise InputError(str(path), f"no such {self.kind}", fix="check the path")
        return path


log = click.argument("log", type=Existing("log"))
logs = click.argument("logs", type=Existing("log"), nargs=-1, required=True)
model = click.option(
    "--model", "model", metavar="DIR", type=Existing("folder"), required=True,
    help="Model to use: what identify wrote, or model/ in it.",
)  # fmt: skip
model_instead = click.option(
    "--model", "model", metavar="DIR", type=Existing("folder"),
    help="Identified model to test instead of the aircraft file's aerodynamics.",
)  # fmt: skip
segments = click.option(
    "--segments", metavar="FILE", type=Existing("file"),
    help="Maneuvers to use, as inspect writes them; edit the list and give it here.",
)  # fmt: skip
vehicle = click.option(
    "--vehicle", metavar="SYSID", type=click.IntRange(1, 255),
    help="Which vehicle of the log, by MAVLink system id; needed when there are several.",
)  # fmt: skip
columns = click.option(
    "--columns", metavar="MAP", type=Existing("file"),
    help="What the columns of a table are (TOML); needed for .csv, .parquet, .mat.",
)  # fmt: skip
can = click.option(
    "--can", metavar="CANLOG", type=Existing("file"),
    help="CAN log of the same flight (.asc, .blf, .log, .mf4) with DroneCAN sensors.",
)  # fmt: skip
seed = click.option(
    "--seed", metavar="N", type=int, expose_value=False,
    help="Seed of random choices; this command makes none, so N changes nothing.",
)  # fmt: skip
as_json = click.option(
    "--json", "as_json", is_flag=True,
    help="Main JSON on stdout; everything else goes to stderr.",
)  # fmt: skip


def aircraft(*, required: bool = True) -> Decorator:
    """The aircraft file."""
    return click.option(
        "--aircraft", metavar="FILE", type=Existing("file"), required=required,
        help="Aircraft file (TOML): mass, geometry, servos, thrust, and any aerodynamics.",
    )  # fmt: skip


def out(command: str) -> Decorator:
    """Where results go."""
    return click.option(
        "--out", metavar="DIR", type=click.Path(path_type=Path, file_okay=False),
        help=f"Folder for the results; ./LOG-{command} unless given.",
    )  # fmt: skip
