"""A table of a TOML file, read key by key with a message for every mistake.

TOML's own parser accepts any key and any type. `Section` takes out one value at a time, checks
type, length and range, converts it to SI units, and says what is wrong in the words of the file.
"""

from __future__ import annotations

import difflib
import itertools
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gcs_sysid.errors import AircraftFileError

DEGREE = math.pi / 180.0
_TO_SI: Mapping[str, float] = {"deg": DEGREE, "deg/s": DEGREE}
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_SHOWN_LENGTH = 72


def to_si(value: float, unit: str) -> float:
    """A value as the file gives it in `unit`, in SI units and radians."""
    return value * _TO_SI[unit] if unit in _TO_SI else value


def quoted_key(key: str) -> str:
    """The key as TOML wants it: bare where that is legal, else quoted."""
    return key if _BARE_KEY.fullmatch(key) else quoted_text(key)


def quoted_text(text: str) -> str:
    """A TOML basic string. JSON's escapes are TOML's, except that JSON leaves DEL as it is."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def describe(value: object) -> str:
    """A value of a TOML file in the words of an error message."""
    if isinstance(value, str):
        shown = f"the text {quoted_text(value)}"
    elif isinstance(value, bool):
        shown = "true" if value else "false"
    elif isinstance(value, Mapping):
        shown = f"a table with {', '.join(map(str, value)) or 'nothing in it'}"
    elif isinstance(value, list):
        shown = "[" + ", ".join(_plain(entry) for entry in value) + "]"
    else:
        shown = str(value)
    return shown if len(shown) <= _SHOWN_LENGTH else shown[: _SHOWN_LENGTH - 3] + "..."


@dataclass(frozen=True)
class Section:
    """One table of an aircraft file.

    Attributes:
        file: name of the file, for messages.
        path: dotted place of the table, for instance `servos[1]`; empty for the top.
        data: the table as TOML's parser gives it.
        label: what a person calls this entry, for instance `elevator`; empty if it has no name.
        homes: where keys of other tables belong, for the message about a misplaced key.
    """

    file: str
    path: str
    data: Mapping[str, Any]
    label: str = ""
    homes: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def error(self, key: str, *, found: str, allowed: str, fix: str) -> AircraftFileError:
        """The error to raise for `key`."""
        place = f"{self.path}.{quoted_key(key)}" if self.path and key else self.path or key
        named = f"{found} ({self.label})" if self.label else found
        return AircraftFileError(self.file, key=place, found=named, allowed=allowed, fix=fix)

    def allow_only(self, *keys: str) -> None:
        """Refuse any key that is not among `keys`, with the likeliest right one."""
        for key in self.data:
            if key not in keys:
                raise self.error(
                    key,
                    found="an unknown key",
                    allowed=", ".join(keys),
                    fix=self._suggestion(key, keys),
                )

    def has(self, key: str) -> bool:
        """Whether the table holds `key`."""
        return key in self.data

    def number(
        self,
        key: str,
        unit: str,
        *,
        default: float | None = None,
        least: float = -math.inf,
        above: float = -math.inf,
        most: float = math.inf,
    ) -> float:
        """A number in SI units; `least`, `above` and `most` bound it in the file's unit.

        `default`, in SI units, stands in for an absent key.

        Raises:
            AircraftFileError: absent without `default`, no number, or out of bounds.
        """
        if key not in self.data and default is not None:
            return default
        allowed = _range_words(unit, least, above, most)
        value = self._number(key, self._required(key, allowed), allowed)
        if not (least <= value <= most and value > above):
            raise self.error(
                key, found=f"{value:g}", allowed=allowed, fix=f"give `{key}` a value in that range"
            )
        return to_si(value, unit)

    def optional_number(self, key: str, unit: str, *, least: float = -math.inf) -> float | None:
        """Like `number`, or None where the table has no such key."""
        return self.number(key, unit, least=least) if key in self.data else None

    def whole(self, key: str, *, least: int) -> int:
        """A whole number, at least `least`."""
        allowed = f"a whole number from {least}"
        value = self._required(key, allowed)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.error(
                key, found=describe(value), allowed=allowed, fix=f"for instance {key} = {least}"
            )
        return value

    def numbers(
        self,
        key: str,
        unit: str,
        *,
        count: int | None = None,
        at_least: int = 1,
        default: tuple[float, ...] | None = None,
    ) -> tuple[float, ...]:
        """A list of numbers in SI units, of exactly `count` or of `at_least` entries."""
        if key not in self.data and default is not None:
            return default
        many = f"{count}" if count is not None else f"at least {at_least}"
        allowed = f"a list of {many} numbers{_in_unit(unit)}"
        entries = self._list(key, self._required(key, allowed), allowed)
        wrong_count = len(entries) != count if count is not None else len(entries) < at_least
        if wrong_count:
            raise self.error(
                key,
                found=f"{len(entries)} entries",
                allowed=allowed,
                fix=f"give `{key}` {many} entries",
            )
        return tuple(to_si(self._number(key, entry, allowed), unit) for entry in entries)

    def rows(self, key: str, unit: str, *, shape: tuple[int, int]) -> tuple[tuple[float, ...], ...]:
        """A list of `shape[0]` rows with `shape[1]` numbers each."""
        allowed = f"{shape[0]} rows of {shape[1]} numbers{_in_unit(unit)}"
        rows = self._list(key, self._required(key, allowed), allowed)
        lengths = [len(self._list(key, row, allowed)) for row in rows]
        if len(rows) != shape[0] or any(length != shape[1] for length in lengths):
            found = f"{len(rows)} rows of {', '.join(map(str, dict.fromkeys(lengths))) or 'no'}"
            raise self.error(
                key,
                found=f"{found} numbers",
                allowed=allowed,
                fix=f"one row of `{key}` for each breakpoint of the first list, "
                "one column for each of the second",
            )
        return tuple(
            tuple(to_si(self._number(key, entry, allowed), unit) for entry in row) for row in rows
        )

    def text(self, key: str, *, allowed: Sequence[str] = (), default: str | None = None) -> str:
        """A text that is not blank; one of `allowed` if given."""
        if key not in self.data and default is not None:
            return default
        words = ", ".join(quoted_text(word) for word in allowed) or "a text in quotes"
        value = self._required(key, words)
        if not isinstance(value, str) or not value.strip() or (allowed and value not in allowed):
            same = [word for word in allowed if word.lower() == str(value).strip().lower()]
            example = quoted_text((*same, *allowed, f"my {key}")[0])
            raise self.error(
                key, found=describe(value), allowed=words, fix=f"for instance {key} = {example}"
            )
        return value

    def table(self, key: str) -> Section:
        """The table `key`, which must be there."""
        place = f"{self.path}.{quoted_key(key)}" if self.path else quoted_key(key)
        known = self.homes.get(f"[{place}]", ())
        allowed = f"a table [{place}]" + (f" with {', '.join(known)}" if known else "")
        value = self._required(key, allowed, fix=f"add a table [{place}]")
        if not isinstance(value, dict):
            raise self.error(
                key, found=describe(value), allowed=allowed, fix=f"write a table [{place}]"
            )
        return Section(self.file, place, value, homes=self.homes)

    def child(self, key: str) -> Section | None:
        """The table `key`, or None where there is none."""
        return self.table(key) if key in self.data else None

    def children(self, key: str, *, name_key: str = "") -> tuple[Section, ...]:
        """The tables `[[key]]` (one `[key]` counts as one), each labelled by its `name_key`."""
        value = self.data.get(key, [])
        single = isinstance(value, dict)
        entries = [value] if single else value
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise self.error(
                key,
                found=describe(value),
                allowed=f"tables [[{key}]]",
                fix=f"start each entry with a line [[{key}]]",
            )
        return tuple(
            Section(
                self.file,
                key if single else f"{key}[{index}]",
                entry,
                label=str(entry.get(name_key, "")),
                homes=self.homes,
            )
            for index, entry in enumerate(entries)
        )

    def _required(self, key: str, allowed: str, *, fix: str = "") -> Any:
        if key not in self.data:
            raise self.error(key, found="nothing", allowed=allowed, fix=fix or f"add `{key} = ...`")
        return self.data[key]

    def _number(self, key: str, value: object, allowed: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            fix = f"remove the quotes around {value}" if _is_number(value) else "write a number"
            raise self.error(key, found=describe(value), allowed=allowed, fix=fix)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.error(
                key, found=describe(value), allowed=allowed, fix="write a finite number"
            )
        return number

    def _list(self, key: str, value: object, allowed: str) -> list[Any]:
        if not isinstance(value, list):
            raise self.error(
                key, found=describe(value), allowed=allowed, fix="write a list in [ ] with commas"
            )
        return value

    def _suggestion(self, key: str, keys: Sequence[str]) -> str:
        by_lower = {known.lower(): known for known in keys}
        close = difflib.get_close_matches(key.lower(), by_lower, n=1)
        if close:
            return f"did you mean `{by_lower[close[0]]}`?"
        homes = [place for place, known in self.homes.items() if key in known]
        return f"`{key}` belongs in {' or '.join(homes)}" if homes else f"remove `{key}`"


def increasing(values: Iterable[float]) -> bool:
    """Whether each value is greater than the one before."""
    return all(later > earlier for earlier, later in itertools.pairwise(values))


def _is_number(value: object) -> bool:
    try:
        float(str(value))
    except ValueError:
        return False
    return isinstance(value, str)


def _plain(entry: object) -> str:
    return json.dumps(entry, default=str, ensure_ascii=False)


def _in_unit(unit: str) -> str:
    return "" if unit == "1" else f" in {unit}"


def _range_words(unit: str, least: float, above: float, most: float) -> str:
    words = f"a number{_in_unit(unit)}"
    if math.isfinite(above):
        words += f" above {above:g}"
    if math.isfinite(least):
        words += f" from {least:g}"
    if math.isfinite(most):
        words += f" up to {most:g}"
    return words
