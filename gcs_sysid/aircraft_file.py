"""Aircraft files: TOML that an engineer writes, read strictly into an `Aircraft`, and back.

Angles are degrees in the file, except in `[aerodynamics]`, which is in radians throughout. Every
mistake is answered with the key, what was found, what is allowed and a fix. Quantities are refused
as being in the wrong unit only where no aircraft could have them.
"""

from __future__ import annotations

import difflib
import re
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.aircraft_toml.aerodynamics import read_aerodynamics
from gcs_sysid.aircraft_toml.body import (
    read_envelope,
    read_geometry,
    read_mass,
    read_propulsion,
)
from gcs_sysid.aircraft_toml.keys import KEYS, TOP
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.aircraft_toml.sensors import read_imu, read_pitot, read_streams, read_vanes
from gcs_sysid.aircraft_toml.surfaces import read_controls, read_servos
from gcs_sysid.aircraft_toml.writer import dumps as dumps
from gcs_sysid.errors import AircraftFileError, InputError

SCHEMA = 1


def load(path: Path | str) -> Aircraft:
    """Read an aircraft file.

    Args:
        path: the TOML file.

    Returns:
        The aircraft, in SI units and radians.

    Raises:
        AircraftFileError: a key is wrong, or the file is no TOML.
        InputError: the file is missing or cannot be read.
    """
    path = Path(path)
    try:
        # Editors on Windows begin UTF-8 files with a byte order mark, which TOML does not know.
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError as error:
        raise InputError(str(path), "no such file", fix=_nearby(path)) from error
    except OSError as error:
        raise InputError(
            str(path),
            f"cannot be read ({error.strerror})",
            fix="give the path of a readable TOML file",
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            str(path),
            f"byte {error.start} is no UTF-8 text",
            fix="an aircraft file is a TOML text file; give a log as LOG",
        ) from error
    return loads(text, name=str(path))


def loads(text: str, *, name: str = "aircraft file") -> Aircraft:
    """Read an aircraft from TOML text.

    Args:
        text: the file's content.
        name: what messages call the file.

    Returns:
        The aircraft, in SI units and radians.

    Raises:
        AircraftFileError: a key is wrong, or the text is no TOML.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise _syntax_error(text, str(error), name) from error
    return from_table(data, name=name)


def from_table(data: Mapping[str, Any], *, name: str = "aircraft file") -> Aircraft:
    """Read an aircraft from a TOML document that is parsed already.

    Args:
        data: the document as TOML's parser gives it.
        name: what messages call it.

    Returns:
        The aircraft, in SI units and radians.

    Raises:
        AircraftFileError: a key is wrong.
    """
    _refuse_unfilled(data, name)
    return _read_aircraft(Section(name, "", data, homes=KEYS))


def save(aircraft: Aircraft, path: Path | str) -> None:
    """Write an aircraft file, whole or not at all.

    Raises:
        InputError: the folder cannot be written to.
    """
    path = Path(path)
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as folder:
            whole = Path(folder) / path.name
            whole.write_text(dumps(aircraft), encoding="utf-8")
            whole.replace(path)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written ({error.strerror})", fix="choose a writable folder"
        ) from error


UNFILLED = "?"
"""What stands where only a person can know the number, in files that `init` wrote."""


def _refuse_unfilled(data: Mapping[str, Any], name: str) -> None:
    """Refuses a file in which something is still to be filled in, naming all of it at once."""
    keys = [
        f"{table}.{key}"
        for table, content in data.items()
        if isinstance(content, Mapping)
        for key, value in content.items()
        if value == UNFILLED
    ]
    if keys:
        raise AircraftFileError(
            name,
            key=", ".join(keys),
            found=f'"{UNFILLED}" still to be filled in',
            allowed="numbers",
            fix="the comment beside each tells the unit and how to measure it",
        )


def _read_aircraft(top: Section) -> Aircraft:
    top.allow_only(*KEYS[TOP])
    schema = top.whole("schema", least=1) if top.has("schema") else SCHEMA
    if schema != SCHEMA:
        raise top.error(
            "schema",
            found=str(schema),
            allowed=f"{SCHEMA}",
            fix="the file is for a newer gcs-sysid: update the program, or write schema = 1",
        )
    name = top.text("name")
    geometry = read_geometry(top.table("geometry"))
    servos = read_servos(top)
    controls = read_controls(top, servos)
    return Aircraft(
        name=name,
        mass=read_mass(top.table("mass"), geometry),
        geometry=geometry,
        imu=read_imu(top.child("imu"), geometry),
        pitot=read_pitot(top.child("pitot"), geometry),
        vanes=read_vanes(top.child("vanes"), geometry),
        streams=read_streams(top.child("streams")),
        servos=servos,
        controls=controls,
        propulsion=read_propulsion(top, geometry, servos),
        envelope=read_envelope(top.child("envelope")),
        aerodynamics=read_aerodynamics(
            top.child("aerodynamics"), tuple(control.name for control in controls)
        ),
    )


def _nearby(path: Path) -> str:
    beside = [other.name for other in path.parent.glob("*.toml")] if path.parent.is_dir() else []
    close = difflib.get_close_matches(path.name, beside, n=1)
    if close:
        return f"did you mean {path.with_name(close[0])}?"
    return "check the path, or write a first file with `gcs-sysid init LOG --out DIR`"


def _syntax_error(text: str, message: str, name: str) -> AircraftFileError:
    place = re.search(r"\s*\(at (line (\d+), column \d+|end of document)\)", message)
    lines = text.split("\n")
    line = lines[int(place[2]) - 1].strip() if place and place[2] else ""
    if re.match(r"[^\"'\[#=]*[\^*( ][^\"'\[#=]*[^\s\"'\[#=]\s*=", line):
        fix = f'put the key in quotes: "{line.split("=")[0].strip()}" = ...'
    elif line.startswith("[["):
        fix = f"something of that name stands above; begin each entry with `{line}`"
    elif re.search(r"overwrite|declare|Duplicate|mutate", message):
        fix = f"`{line}` stands in the file twice; keep one" if line else "it is there twice"
    else:
        fix = f"correct the line `{line}`" if line else "close the last bracket or quote"
    return AircraftFileError(
        name,
        key=place[1] if place else "the file",
        found=message[: place.start()] if place else message,
        allowed="TOML",
        fix=fix,
    )
