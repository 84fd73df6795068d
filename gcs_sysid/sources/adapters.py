"""Adapters by name, imported when they are used.

Other packages add their own through entry points: group `gcs_sysid.logs`, named by a file's ending
(`.xyz`), a module with `open_log`; group `gcs_sysid.links`, named by an address' beginning
(`xyz:`), a class like `gcs_sysid.sources.link.Link`.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from importlib.metadata import entry_points
from typing import Any, Literal

from gcs_sysid.errors import SourceError

OWN: Mapping[Literal["logs", "links"], Mapping[str, str]] = {
    "logs": {
        ".tlog": "gcs_sysid.sources.tlog",
        ".bin": "gcs_sysid.sources.dataflash.recording",
        ".log": "gcs_sysid.sources.dataflash.recording",
        ".ulg": "gcs_sysid.sources.ulog.recording",
    },
    "links": {
        **dict.fromkeys(("udp:", "udpin:", "udpout:", "tcp:"), "gcs_sysid.sources.link:Link"),
        "mavsdk:": "gcs_sysid.sources.mavsdk_link:MavsdkLink",
        "can:": "gcs_sysid.sources.can.bus:CanLink",
        "file:": "gcs_sysid.sources.followed:FollowedLog",
    },
}
"""Kind of adapter -> name -> where it is: a module, or a module and what to take from it."""


def names(kind: Literal["logs", "links"]) -> tuple[str, ...]:
    """Names of all adapters of a kind, the program's own first."""
    others = entry_points(group=f"gcs_sysid.{kind}").names
    return (*OWN[kind], *sorted(set(others) - set(OWN[kind])))


def load(kind: Literal["logs", "links"], name: str, *, asked: str) -> Any:
    """An adapter, imported now.

    Args:
        kind: of adapter.
        name: one of `names`.
        asked: the file or address that needs it, for messages.

    Raises:
        SourceError: a package that it needs is not installed.
    """
    own = OWN[kind].get(name)
    try:
        if own is None:
            (point,) = entry_points(group=f"gcs_sysid.{kind}", name=name)
            return point.load()
        module, _, attribute = own.partition(":")
        found = importlib.import_module(module)
        return getattr(found, attribute) if attribute else found
    except ModuleNotFoundError as error:
        raise SourceError(
            asked,
            f"needs the package {error.name}, which is not installed",
            fix="pip install --force-reinstall gcs-sysid",
        ) from error
