"""The program's door: finds the command, runs it, turns any failure into one line.

Commands import the run they call inside their function: `--help`, completion and usage errors must
answer at once, and NumPy, JAX and the MAVLink dialects together take seconds to import.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

import click

from gcs_sysid.cli import failures, numerics

COMMANDS = (
    "init",
    "inspect",
    "identify",
    "predict",
    "evaluate",
    "simulate",
    "diagnose",
    "suggest",
    "listen",
    "dashboard",
    "export",
    "replay",
    "sitl",
    "scenario",
)


class Program(click.Group):
    """The commands in the order of a first session, each in a file of its own."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, imported now."""
        if cmd_name not in COMMANDS:
            return None
        return importlib.import_module(f"gcs_sysid.cli.commands.{cmd_name}").command


@click.group(cls=Program, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(
    package_name="gcs-sysid", prog_name="gcs-sysid", message="%(prog)s %(version)s"
)
def program() -> None:
    """Learn an aircraft's aerodynamics from its telemetry, and say how sure that is.

    A recorded flight and an aircraft file go in; states, aerodynamic coefficients, a model with
    honest uncertainty and a report come out. Start with `gcs-sysid inspect LOG`.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the program.

    Args:
        arguments: command line without the program's name; None takes this process's own.

    Returns:
        Exit status: 0 done, 1 the input cannot be used, 2 wrong usage, 130 stopped by the keyboard.
    """
    numerics.keep_linear_algebra_in_one_thread()
    with failures.reported() as status:
        program.main(
            args=None if arguments is None else list(arguments),
            prog_name="gcs-sysid",
            standalone_mode=False,
        )
    sys.stdout.flush()
    return status.code
