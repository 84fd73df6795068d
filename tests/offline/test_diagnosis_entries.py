"""What a diagnosis says beside its verdict."""

from __future__ import annotations

from gcs_sysid.diagnose.verdict import INCREDIBLE
from gcs_sysid.offline import diagnosis_entries as entries


def test_a_size_that_nobody_would_believe_is_told() -> None:
    assert entries.incredible(0.0) == []
    assert entries.incredible(0.99 * INCREDIBLE) == []
    [told] = entries.incredible(4.61)
    assert "4.6" in told
    assert "no cause here" in told
