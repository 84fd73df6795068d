from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import jax
import numpy as np
import pytest

from gcs_sysid.errors import ModelFileError
from gcs_sysid.estimate.result import CoefficientFit
from gcs_sysid.offline import documents, model_store
from tests.estimate.made_sensing import sensing
from tests.offline import made_models

IDENTIFY = "gcs-sysid identify"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    model_store.save(tmp_path / "model", made_models.stored())
    return tmp_path / "model"


def refusal(folder: Path) -> str:
    with pytest.raises(ModelFileError) as caught:
        model_store.load(folder)
    message = str(caught.value)
    assert "\n" not in message
    assert str(folder) in message
    return message


def same(one: CoefficientFit, other: CoefficientFit) -> bool:
    for field in fields(CoefficientFit):
        left, right = getattr(one, field.name), getattr(other, field.name)
        if field.name == "deviations":
            if set(left) != set(right) or not all(np.array_equal(left[k], right[k]) for k in left):
                return False
        elif not np.array_equal(left, right):
            return False
    return True


def test_a_model_comes_back_to_the_last_bit(folder: Path) -> None:
    saved, loaded = made_models.stored(), model_store.load(folder)
    assert loaded.model.controls == saved.model.controls
    assert list(loaded.model.fits) == list(saved.model.fits)
    assert all(same(loaded.model.fits[name], fit) for name, fit in saved.model.fits.items())
    assert loaded.aircraft == saved.aircraft
    assert loaded.surface_delay == saved.surface_delay
    assert loaded.provenance == saved.provenance


def test_what_its_filter_had_to_go_by_comes_back_too(folder: Path) -> None:
    saved = replace(made_models.stored(), inside_filter=True, sensing=sensing())
    model_store.save(folder, saved)
    loaded = model_store.load(folder)
    assert loaded.inside_filter
    jax.tree.map(np.testing.assert_array_equal, loaded.sensing, saved.sensing)
    assert model_store.load(folder).sensing is not None
    edit(folder, lambda header: header.pop("sensing"))
    assert model_store.load(folder).sensing is None


def test_it_is_found_from_the_folder_that_identify_wrote(folder: Path) -> None:
    assert model_store.load(folder.parent).surface_delay == model_store.load(folder).surface_delay


def test_it_holds_no_pickle_and_a_version(folder: Path) -> None:
    header = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    assert (header["format"], header["version"]) == ("gcs-sysid model", 2)
    with np.load(folder / "arrays.npz", allow_pickle=False) as arrays:
        assert all(arrays[name].dtype == np.float64 for name in arrays)


def test_nothing_there_is_said_to_be_nothing(tmp_path: Path) -> None:
    assert "holds no model.json" in refusal(tmp_path / "nowhere")


def edit(folder: Path, change: Callable[[dict], None]) -> None:
    path = folder / "model.json"
    header = json.loads(path.read_text(encoding="utf-8"))
    change(header)
    path.write_text(json.dumps(header), encoding="utf-8")


def test_a_newer_version_is_refused_with_both_numbers(folder: Path) -> None:
    edit(folder, lambda header: header.update(version=3))
    assert "has version 3, this program reads version 2" in refusal(folder)


@pytest.mark.parametrize(
    "text", ['{"format": "other"}', "[1, 2]", "null", '"gcs-sysid model"'], ids=str
)
def test_foreign_json_is_refused(folder: Path, text: str) -> None:
    (folder / "model.json").write_text(text, encoding="utf-8")
    assert "is not a model of gcs-sysid" in refusal(folder)


@pytest.mark.parametrize("data", [b"{", b"", b"\xff\xfe\x00", b"not json"], ids=repr)
def test_broken_json_is_refused(folder: Path, data: bytes) -> None:
    (folder / "model.json").write_bytes(data)
    assert IDENTIFY in refusal(folder)


@pytest.mark.parametrize(
    "change",
    [
        lambda header: header.pop("fits"),
        lambda header: header.update(fits=[1]),
        lambda header: header["fits"]["Cm"].pop("regressors"),
        lambda header: header["fits"].update(CX=header["fits"]["Cm"]),
        lambda header: header.update(surface_delay=None),
        lambda header: header.update(controls=None),
        lambda header: header["fits"]["Cm"].update(regressors=["1", "alpha"]),
        lambda header: header["fits"]["Cm"].update(regressors=["1", "flux", "a", "b", "c"]),
    ],
    ids=[
        "no fits", "a list of fits", "no regressors", "no such arrays",
        "no delay", "no controls", "too few regressors", "unknown regressors",
    ],
)  # fmt: skip
def test_a_header_with_something_missing_is_refused(
    folder: Path, change: Callable[[dict], None]
) -> None:
    edit(folder, change)
    assert "the model is damaged" in refusal(folder)


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9, 0.999])
def test_truncated_arrays_are_refused(folder: Path, keep: float) -> None:
    """A zip file cut short used to end in a traceback: its error is no OSError."""
    path = folder / "arrays.npz"
    data = path.read_bytes()
    path.write_bytes(data[: int(keep * len(data))])
    assert "the model is damaged" in refusal(folder)


def test_a_flipped_byte_in_the_arrays_is_refused(folder: Path) -> None:
    path = folder / "arrays.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(bytes(data))
    assert "the model is damaged" in refusal(folder)


def test_missing_arrays_are_refused(folder: Path) -> None:
    (folder / "arrays.npz").unlink()
    assert "the model is damaged" in refusal(folder)


class Trap:
    """Something that must never be brought to life."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return pytest.fail, ("a pickle was opened",)


def test_a_model_of_before_spreads_were_kept_is_read(folder: Path) -> None:
    path = folder / "arrays.npz"
    with np.load(path) as arrays:
        older = {
            name: value
            for name, value in arrays.items()
            if name.partition(".")[2] not in model_store.LATER
        }
    assert len(older) < len(np.load(path).files)
    np.savez(path, **older)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    edit(folder, lambda header: header.update(arrays_sha256=digest))
    for fit in model_store.load(folder).model.fits.values():
        np.testing.assert_allclose(fit.spread, (fit.highest - fit.lowest) / model_store.RANGES)
        np.testing.assert_array_equal(fit.late, fit.deviations.get("lag", np.zeros(fit.late.size)))


def test_a_pickle_inside_is_not_opened(folder: Path) -> None:
    path = folder / "arrays.npz"
    with np.load(path) as arrays:
        plain = dict(arrays)
    plain["Cm.value"] = np.array([Trap()], dtype=object)
    np.savez(path, **plain)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    edit(folder, lambda header: header.update(arrays_sha256=digest))
    assert "allow_pickle" in refusal(folder)


class InterruptedWriteError(Exception):
    """Stands for a full disk or a power cut."""


def broken_after(monkeypatch: pytest.MonkeyPatch, writes: int) -> None:
    """Lets `writes` files be written, and fails in the midst of the next."""
    whole = documents.write_atomic
    count = iter(range(1000))

    def write_atomic(path: Path, write: Callable[[Path], None]) -> None:
        def half(temporary: Path) -> None:
            temporary.write_bytes(b"half")
            raise InterruptedWriteError

        whole(path, write if next(count) < writes else half)

    monkeypatch.setattr(documents, "write_atomic", write_atomic)


@pytest.mark.parametrize("writes", [0, 1, 2])
def test_a_failure_midway_leaves_no_model_and_no_rubbish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    broken_after(monkeypatch, writes)
    with pytest.raises(InterruptedWriteError):
        model_store.save(tmp_path / "model", made_models.stored())
    assert "holds no model.json" in refusal(tmp_path / "model")
    assert not list((tmp_path / "model").glob(".*"))


@pytest.mark.parametrize("writes", [0, 1, 2])
def test_a_failure_midway_over_an_older_model_never_mixes_the_two(
    folder: Path, monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    """New arrays beside the old header used to load as if they belonged together."""
    old, newer = model_store.load(folder), made_models.stored()
    fit = newer.model.fits["Cm"]
    changed = {**newer.model.fits, "Cm": replace(fit, value=2.0 * fit.value)}
    newer = replace(newer, model=replace(newer.model, fits=changed), surface_delay=0.09)
    broken_after(monkeypatch, writes)
    with pytest.raises(InterruptedWriteError):
        model_store.save(folder, newer)
    if writes == 0:
        left = model_store.load(folder)
        assert left.surface_delay == old.surface_delay
        assert same(left.model.fits["Cm"], old.model.fits["Cm"])
    else:
        assert "not the file that model.json was written with" in refusal(folder)
