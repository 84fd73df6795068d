"""Everything that can go wrong for a user, as one tree.

    GcsSysidError
    ├── StoppedError          stopped by the keyboard, with part of the work kept (exit status 130)
    ├── UsageError            the command line is wrong (exit status 2)
    │   └── RegressorError        text that is no product of known regressors
    └── InputError            an input cannot be used (exit status 1)
        ├── AircraftFileError     one key of an aircraft file is wrong
        ├── SourceError           a log or a link cannot be read as telemetry
        ├── ModelFileError        a saved model is damaged, foreign or too new
        └── RefusedError          readable, but it cannot answer the question asked

Each message is one line a flight-test engineer can act on: where, what was found, why it matters,
what to do.
"""

from __future__ import annotations


class GcsSysidError(Exception):
    """Base of all errors this program raises on purpose; never raised itself."""


class StoppedError(GcsSysidError):
    """Raised when the keyboard stopped a run that had kept what it knew.

    A run that had nothing to keep passes the `KeyboardInterrupt` on.
    """


class UsageError(GcsSysidError, ValueError):
    """Raised when a call or a command line asks for something that does not exist."""


class RegressorError(UsageError):
    """Raised when a text is no product of known regressors.

    Args:
        found: what stands there, and where in the text.
        allowed: what may stand there.
        fix: what to write instead.
    """

    def __init__(self, found: str, *, allowed: str, fix: str) -> None:
        super().__init__(f"found {found}, allowed: {allowed}; {fix}")
        self.found = found
        self.allowed = allowed
        self.fix = fix


class InputError(GcsSysidError, ValueError):
    """Raised when an input cannot be used.

    Args:
        where: file, link or stream, with the position inside it when known.
        what: what was found there.
        fix: what to do about it.
    """

    def __init__(self, where: str, what: str, *, fix: str) -> None:
        super().__init__(f"{where}: {what}; {fix}")
        self.where = where
        self.what = what
        self.fix = fix


class AircraftFileError(InputError):
    """Raised when a key of an aircraft file is wrong.

    Args:
        file: name of the aircraft file.
        key: dotted key, for instance `servos[1].pwm`.
        found: what stands there.
        allowed: what may stand there.
        fix: the change that makes the file valid.
    """

    def __init__(self, file: str, *, key: str, found: str, allowed: str, fix: str) -> None:
        super().__init__(f"{file}: {key}", f"found {found}, allowed: {allowed}", fix=fix)
        self.key = key
        self.found = found
        self.allowed = allowed


class SourceError(InputError):
    """Raised when a log or a link cannot be read as telemetry."""


class ModelFileError(InputError):
    """Raised when a saved model is damaged, foreign, or written by a newer version."""


class RefusedError(InputError):
    """Raised when a flight is readable but cannot answer the question asked of it.

    `fix` says what to change before the next flight: which message, at which rate.
    """
