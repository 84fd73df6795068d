from __future__ import annotations

import json
import math
import stat
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs_sysid.offline import documents

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=12,
)


def finite(value: object) -> object:
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


@settings(suppress_health_check=[HealthCheck.too_slow])  # a busy machine is no bad strategy
@given(st.dictionaries(st.text(), VALUES, max_size=4))
def test_json_holds_what_it_was_given_and_nothing_that_is_no_number(document: dict) -> None:
    text = documents.dump_json(document)
    assert json.loads(text, parse_constant=pytest.fail) == finite(document)


def test_arrays_and_numpy_numbers_become_json() -> None:
    document = {"a": np.array([[1.0, np.nan]]), "b": np.float64(2.5), "c": np.int64(3), 4: (True,)}
    assert json.loads(documents.dump_json(document)) == {
        "a": [[1.0, None]], "b": 2.5, "c": 3, "4": [True],
    }  # fmt: skip


def test_what_is_returned_is_what_is_read_back(tmp_path: Path) -> None:
    document = {"x": np.linspace(0.0, 1.0, 3), "inf": math.inf}
    documents.write_json(tmp_path / "deep" / "x.json", document)
    read = json.loads((tmp_path / "deep" / "x.json").read_text(encoding="utf-8"))
    assert read == documents.plain(document)


def test_a_failed_write_keeps_the_old_file_and_leaves_no_rubbish(tmp_path: Path) -> None:
    path = tmp_path / "summary.json"
    documents.write_text(path, "old")

    def fail(temporary: Path) -> None:
        temporary.write_text("half", encoding="utf-8")
        raise OSError("no space left on device")

    with pytest.raises(OSError, match="no space"):
        documents.write_atomic(path, fail)
    assert path.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_others_may_read_what_was_written(tmp_path: Path) -> None:
    documents.write_text(tmp_path / "x", "x")
    assert stat.S_IMODE((tmp_path / "x").stat().st_mode) == 0o644
