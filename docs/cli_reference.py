"""Writes `cli.md` from the program itself: `python docs/cli_reference.py`."""

from __future__ import annotations

from pathlib import Path

import click

from gcs_sysid.cli.entry import program

PAGE = Path(__file__).with_name("cli.md")

FORMAT = {"terminal_width": 80}
"""The page must not depend on the terminal it is written in."""

HEAD = """\
# Commands

One program, `gcs-sysid` (also `python -m gcs_sysid`). Exit status: 0 done; 1 the input cannot be
used, and one line on stderr says which file, where, why and what to do; 2 wrong usage.

A log is a MAVLink telemetry log (`.tlog`), an [onboard log](logs.md) of ArduPilot (`.bin`, `.log`)
or PX4 (`.ulg`), or a table (`.csv`, `.parquet`, `.mat`) with a [column map](tables.md). Results go
to `--out`, `./LOG-COMMAND` unless given; files of the same names that this program did not write
are never overwritten.

Environment: `GCS_SYSID_DEBUG=1` shows tracebacks; `GCS_SYSID_CACHE_DIR` is where compiled code and
the flights of scenarios are kept between runs instead of the platform's cache folder.
"""


def page() -> str:
    """The page as the program's own help has it."""
    context = click.Context(program, info_name="gcs-sysid", **program.context_settings, **FORMAT)
    parts = [HEAD]
    for name in program.list_commands(context):
        command = program.get_command(context, name)
        assert command is not None  # noqa: S101 - the program lists only what it has
        help_text = command.get_help(
            click.Context(command, info_name=name, parent=context, **FORMAT)
        )
        parts.append(f"## {name}\n\n```text\n{help_text}\n```\n")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
