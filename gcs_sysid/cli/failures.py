"""One line on stderr for whatever went wrong, and the exit status that goes with it."""

from __future__ import annotations

import os
import tempfile
import traceback
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import click

from gcs_sysid.errors import GcsSysidError, StoppedError, UsageError

DEBUG = "GCS_SYSID_DEBUG"
"""Environment variable: 1 shows tracebacks instead of filing them."""

UNUSABLE_INPUT, WRONG_USAGE, STOPPED = 1, 2, 130


@dataclass
class Status:
    """Exit status of the program, known once the work has ended."""

    code: int = 0


@contextmanager
def reported() -> Generator[Status, None, None]:
    """Reports any failure inside in one line on stderr; the yielded status then holds its code."""
    status = Status()
    try:
        yield status
    except click.exceptions.Exit as exit_:
        status.code = exit_.exit_code
    except (click.Abort, KeyboardInterrupt):
        status.code = _say("stopped", STOPPED)
    except StoppedError as error:
        status.code = _say(str(error), STOPPED)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        status.code = WRONG_USAGE
    except click.ClickException as error:
        status.code = _say(_usage(error), WRONG_USAGE)
    except UsageError as error:
        status.code = _say(str(error), WRONG_USAGE)
    except GcsSysidError as error:
        status.code = _say(str(error), UNUSABLE_INPUT)
    except OSError as error:
        status.code = _say(_system(error), UNUSABLE_INPUT)
    except Exception as error:  # noqa: BLE001 - the last line of defence: users never see a traceback
        status.code = _say(_unexpected(error), UNUSABLE_INPUT)


def _say(message: str, code: int) -> int:
    if os.environ.get(DEBUG) == "1":
        click.echo(traceback.format_exc(), err=True, nl=False)
    click.echo("gcs-sysid: " + " ".join(message.split()), err=True)
    return code


def _usage(error: click.ClickException) -> str:
    """What click found wrong, and the command that tells more."""
    message = error.format_message().rstrip(".")
    context = getattr(error, "ctx", None)
    return f"{message}; try '{context.command_path if context else 'gcs-sysid'} --help'"


def _system(error: OSError) -> str:
    """What the operating system refused, and of which file."""
    reason = error.strerror or str(error) or type(error).__name__
    return f"{error.filename}: {reason}" if error.filename else reason


def _unexpected(error: Exception) -> str:
    """A fault of the program itself: where its traceback went."""
    found = f"unexpected {type(error).__name__}: {error}"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="gcs-sysid-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            traceback.print_exc(file=file)
    except OSError:
        return f"{found}; {DEBUG}=1 shows where"
    return f"{found}; this is a fault of the program, please report it with {Path(file.name)}"
