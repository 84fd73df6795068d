"""Flights of scenarios, flown when first asked for and kept in this user's cache folder.

The key of a flight is everything that makes it: the plan with all its numbers, the code that flies
it, and the versions of the packages that compute.
"""

from __future__ import annotations

import hashlib
import platform
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import gcs_sysid
from gcs_sysid.errors import InputError

if TYPE_CHECKING:
    from gcs_sysid.sitl.scenario import PlannedFlight, Scenario

FOLDER = "flights"
"""Name of the folder inside the cache folder."""

_PACKAGES = ("gcs-sysid", "jsbsim", "numpy", "pymavlink")
_CODE = ("sitl/**/*.py", "aircraft_toml/*.py", "aircraft*.py", "regressors.py")


@dataclass(frozen=True)
class Found:
    """Where the recording of a flight is, and whether it had to be flown for it."""

    log: Path
    flown: bool


def of(
    scenario: Scenario, cache: Path, progress: Callable[[str, float], None]
) -> Mapping[str, Found]:
    """The recordings of all flights of a scenario, by name.

    Args:
        scenario: its flights that have no recording yet are flown.
        cache: folder where such flights are kept.
        progress: told what is flown, and which fraction of it is done.

    Raises:
        InputError: a recording that the scenario names is not there.
    """
    found: dict[str, Found] = {}
    for name, log in scenario.logs.items():
        if not log.is_file():
            raise InputError(str(log), f"no such log (flight `{name}`)", fix="correct `log`")
        found[name] = Found(log, flown=False)
    for planned in scenario.flights:
        bundled = planned.record is not None and planned.record.is_file()
        found[planned.name] = (
            Found(planned.record, flown=False)
            if planned.record is not None and bundled
            else _kept(planned, cache, progress)
        )
    return found


def key(planned: PlannedFlight) -> str:
    """What tells this flight from any other: hexadecimal, 16 digits."""
    # The numbers of a plan are all plain data, whose text is exact.
    made_of = [repr(planned.flight), repr(planned.truth_rate), repr(planned.told), _code()]
    made_of += [f"{name} {version(name)}" for name in _PACKAGES]
    made_of.append(f"{platform.system()} {platform.machine()}")
    return hashlib.sha256("\n".join(made_of).encode()).hexdigest()[:16]


def _code() -> str:
    package = Path(gcs_sysid.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(path for pattern in _CODE for path in package.glob(pattern)):
        digest.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def _kept(planned: PlannedFlight, cache: Path, progress: Callable[[str, float], None]) -> Found:
    kept = cache / FOLDER / key(planned)
    log = kept / f"{planned.name}.tlog"
    if log.is_file():
        return Found(log, flown=False)
    from gcs_sysid.sitl import record

    kept.parent.mkdir(parents=True, exist_ok=True)
    # Flown aside and renamed whole: who finds the folder finds a complete flight in it.
    with tempfile.TemporaryDirectory(prefix=".flying-", dir=kept.parent) as aside:
        made = Path(aside) / "flight"
        made.mkdir()
        record.run(
            planned.flight,
            record=made / log.name,
            truth=made / f"{planned.name}_truth.npz",
            truth_rate=planned.truth_rate,
            told=planned.told,
            progress=lambda seconds: progress(
                f"flying {planned.name}", seconds / planned.flight.duration
            ),
        )
        try:
            made.rename(kept)
        except OSError:
            # Somebody else was faster, with the same flight.
            if not log.is_file():
                raise
    return Found(log, flown=True)
