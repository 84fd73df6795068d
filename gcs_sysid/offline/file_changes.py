"""What one aircraft file says otherwise than another, as a patch."""

from __future__ import annotations

import difflib
from pathlib import PurePath

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft


def lines(before: Aircraft, after: Aircraft, *, source: str, to: str) -> list[str]:
    """The unified difference, line by line; nothing where the files say the same.

    Of the files as this program writes them: a person's own layout and comments are not kept in
    what it writes, and would show as changes.

    Args:
        before: the file as it was.
        after: the file as it is.
        source: file or folder that the first came from.
        to: name of the second.
    """
    old, new = (aircraft_file.dumps(one).splitlines() for one in (before, after))
    return list(difflib.unified_diff(old, new, PurePath(source).name, to, lineterm=""))
