"""What is set free when a favourite is put to the test."""

from __future__ import annotations

from gcs_sysid.diagnose.catalogue import CAUSES
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.offline import investigation


def listed(name: str, about: str = "") -> list[Candidate]:
    cause = CAUSES[name]
    return [Candidate(cause, about, place) for place in cause.places or (None,)]


def test_a_stall_is_tried_wherever_it_may_begin() -> None:
    stalls, mass = listed("stall"), listed("mass")
    found = investigation.wherever((stalls[3], mass[0]), [*mass, *stalls])
    assert set(found) == {*stalls, *mass}


def test_a_rate_limit_is_tried_where_it_was_found() -> None:
    """Each of its places is all of its effect: two at once would be twice that."""
    limits = [*listed("actuator_rate_limit", "elevator"), *listed("actuator_rate_limit", "aileron")]
    assert investigation.wherever((limits[1],), limits) == (limits[1],)
