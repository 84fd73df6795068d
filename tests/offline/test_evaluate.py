from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.parquet as pq
import pytest

from gcs_sysid.errors import InputError
from gcs_sysid.offline import evaluate, model_store
from tests.offline import made_models

VARIABLES = ("alpha", "elevator", "beta", "phat", "aileron", "qhat")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("identified")
    model_store.save(folder / "model", made_models.stored())
    return folder


def write(path: Path, columns: dict[str, object]) -> Path:
    table = pa.table(columns)
    if path.suffix == ".parquet":
        pq.write_table(table, path)
    else:
        pacsv.write_csv(table, path)
    return path


def read(path: Path) -> pa.Table:
    return pq.read_table(path) if path.suffix == ".parquet" else pacsv.read_csv(path)


@pytest.mark.parametrize("entry", ["at.csv", "at.parquet", "AT.PARQUET"])
@pytest.mark.parametrize("leaving", ["to.csv", "to.parquet"])
def test_tables_in_and_out(folder: Path, tmp_path: Path, entry: str, leaving: str) -> None:
    values = made_models.conditions(3, 40)
    named = {"label": [f"row {i}" for i in range(40)], **values}
    path = tmp_path / entry
    if path.suffix == ".PARQUET":
        pq.write_table(pa.table(named), path)
    else:
        write(path, named)
    answer = evaluate.run(folder, path, tmp_path / "out" / leaving)
    table = read(tmp_path / "out" / leaving)
    expected = made_models.model().predict(values, measured=False)
    assert answer["rows"] == table.num_rows == 40
    assert table.column_names == [*named, *answer["added"]]
    assert table["label"].to_pylist() == named["label"]
    for name, prediction in expected.items():
        # CSV keeps the shortest digits that give the number back: bit for bit.
        assert table[name].to_numpy() == pytest.approx(prediction.mean, rel=1e-15)
        assert table[f"{name}_sd"].to_numpy() == pytest.approx(prediction.deviation, rel=1e-15)


def test_derivative_columns_are_finite_differences(folder: Path, tmp_path: Path) -> None:
    """Through the files: central differences of 1e-4; second derivatives make no error there."""
    values = made_models.conditions(4, 25)
    step = 1e-4

    def at(**moved: float) -> pa.Table:
        changed = {name: column + moved.get(name, 0.0) for name, column in values.items()}
        source = write(tmp_path / "at.parquet", changed)
        evaluate.run(folder, source, tmp_path / "to.parquet")
        return read(tmp_path / "to.parquet")

    table = at()
    for name, variable in (
        ("CZ", "alpha"), ("CZ", "elevator"), ("Cm", "alpha"), ("Cm", "elevator"), ("Cm", "qhat"),
        ("Cl", "aileron"), ("Cl", "phat"),
    ):  # fmt: skip
        difference = (
            at(**{variable: step})[name].to_numpy() - at(**{variable: -step})[name].to_numpy()
        ) / (2.0 * step)
        assert table[f"{name}_{variable}"].to_numpy() == pytest.approx(difference, rel=1e-8)
        assert np.all(table[f"{name}_{variable}_sd"].to_numpy() > 0.0)


def test_only_variables_of_a_coefficient_get_a_derivative(folder: Path, tmp_path: Path) -> None:
    source = write(tmp_path / "at.csv", made_models.conditions(5, 3))
    added = evaluate.run(folder, source, tmp_path / "to.csv")["added"]
    assert "Cl_alpha" not in added
    assert {name for name in added if name.startswith("Cl")} == {
        "Cl", "Cl_sd", "Cl_beta", "Cl_beta_sd", "Cl_phat", "Cl_phat_sd", "Cl_aileron",
        "Cl_aileron_sd",
    }  # fmt: skip


def test_uncertainty_grows_and_is_counted_beyond_the_data(folder: Path, tmp_path: Path) -> None:
    far = {name: np.zeros(4) for name in VARIABLES} | {"alpha": np.array([0.0, 0.1, 0.5, 1.0])}
    answer = evaluate.run(folder, write(tmp_path / "at.csv", far), tmp_path / "to.csv")
    deviation = read(tmp_path / "to.csv")["Cm_sd"].to_numpy()
    assert np.all(np.diff(deviation) > 0.0)
    assert deviation[3] > 5.0 * deviation[0]
    assert answer["extrapolated"] == 2


def test_columns_already_there_are_renewed(folder: Path, tmp_path: Path) -> None:
    values = made_models.conditions(6, 5)
    source = write(tmp_path / "at.csv", {**values, "CZ": np.full(5, 99.0)})
    evaluate.run(folder, source, tmp_path / "to.csv")
    table = read(tmp_path / "to.csv")
    assert table.column_names.count("CZ") == 1
    assert np.all(table["CZ"].to_numpy() < 90.0)


def test_whole_numbers_are_numbers(folder: Path, tmp_path: Path) -> None:
    source = write(tmp_path / "at.csv", {name: [0, 0] for name in VARIABLES})
    evaluate.run(folder, source, tmp_path / "to.csv")
    assert read(tmp_path / "to.csv")["CZ"].to_numpy() == pytest.approx(
        np.full(2, made_models.model().fits["CZ"].value[0])
    )


def refusal(folder: Path, source: Path) -> str:
    with pytest.raises(InputError) as caught:
        evaluate.run(folder, source, source.parent / "never.csv")
    assert not (source.parent / "never.csv").exists()
    message = str(caught.value)
    assert "\n" not in message
    assert source.name in message
    return message


def test_missing_columns_are_named_with_all_that_are_needed(folder: Path, tmp_path: Path) -> None:
    values = made_models.conditions(7, 3)
    del values["alpha"], values["qhat"]
    message = refusal(folder, write(tmp_path / "at.csv", values))
    assert "has no column alpha, qhat" in message
    assert ", ".join(VARIABLES) in message


@pytest.mark.parametrize("bad", [np.nan, np.inf, None])
def test_empty_and_infinite_values_are_named(
    folder: Path, tmp_path: Path, bad: float | None
) -> None:
    values = {name: list(column) for name, column in made_models.conditions(8, 3).items()}
    values["beta"][1] = bad
    message = refusal(folder, write(tmp_path / "at.parquet", values))
    assert "empty or infinite values in beta" in message


def test_words_are_no_numbers(folder: Path, tmp_path: Path) -> None:
    values = {**made_models.conditions(9, 2), "beta": ["left", "right"]}
    assert "no numbers" in refusal(folder, write(tmp_path / "at.csv", values))


@pytest.mark.parametrize(
    ("name", "data"),
    [("at.parquet", b"not parquet"), ("at.csv", b"a,b\n1,2\n3\n"), ("at.csv", b"")],
    ids=["parquet", "ragged", "empty"],
)
def test_files_that_are_no_tables(folder: Path, tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    assert "cannot be read as a table" in refusal(folder, tmp_path / name)


def test_a_file_that_is_not_there(folder: Path, tmp_path: Path) -> None:
    assert "cannot be read as a table" in refusal(folder, tmp_path / "absent.csv")
