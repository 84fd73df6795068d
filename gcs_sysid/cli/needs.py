"""Packages that only some commands need."""

from __future__ import annotations

from gcs_sysid.errors import UsageError


def jsbsim() -> None:
    """Nothing, where JSBSim is installed.

    Raises:
        UsageError: it is not.
    """
    try:
        import jsbsim  # noqa: F401 - only to see whether it is there
    except ModuleNotFoundError as error:
        raise UsageError("JSBSim is not installed; pip install 'gcs-sysid[sitl]'") from error
