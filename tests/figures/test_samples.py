from __future__ import annotations

from types import ModuleType

import numpy as np

from gcs_sysid.figures.samples import (
    column,
    end_to_end,
    flight_rows,
    maneuvers,
    normalised_residual,
    pieces,
)


def test_a_missing_column_is_not_a_number(samples: dict[str, np.ndarray]) -> None:
    assert np.isnan(column(samples, "nothing")).all()


def test_flights_are_told_apart_and_sorted(example: ModuleType) -> None:
    table = example.joined(example.flight(60.0), example.flight(60.0, number=1))
    mixed = np.random.default_rng(0).permutation(table["t"].size)
    shuffled = {name: values[mixed] for name, values in table.items()}
    rows = flight_rows(shuffled)
    assert list(rows) == [0, 1]
    for number, own in rows.items():
        assert (shuffled["flight"][own] == number).all()
        assert (np.diff(shuffled["t"][own]) > 0.0).all()


def test_maneuvers_carry_the_names_and_times_of_the_summary(
    samples: dict[str, np.ndarray], summary: dict
) -> None:
    found = maneuvers(samples, summary["maneuvers"])
    assert len(found) == len(summary["maneuvers"])
    for maneuver, listed in zip(found, summary["maneuvers"], strict=True):
        assert maneuver.held_out == listed["held_out"]
        assert maneuver.start == listed["start_s"]
        assert listed["kind"] in maneuver.name
        assert listed["controls"][0] in maneuver.name
        assert maneuver.span.role == ("held_out" if maneuver.held_out else "fitted")


def test_same_maneuver_ids_in_two_flights_stay_two(example: ModuleType) -> None:
    table = example.joined(example.flight(60.0), example.flight(60.0, number=1))
    found = maneuvers(table, example.summary(table)["maneuvers"])
    assert len({(item.flight, item.number) for item in found}) == len(found)
    assert {item.flight for item in found} == {0, 1}


def test_normalised_residual_is_the_ratio_to_both_deviations_together() -> None:
    table = {
        "t": np.arange(2.0),
        "CX_measured": np.array([5.0, 1.0]),
        "CX": np.zeros(2),
        "CX_measured_sd": np.array([3.0, 0.0]),
        "CX_sd": np.array([4.0, 0.0]),
    }
    scored = normalised_residual(table, "CX")
    assert scored[0] == 1.0
    assert np.isnan(scored[1])


def test_pieces_never_cross_a_gap_a_hole_or_the_border_of_the_fit() -> None:
    time = np.concatenate([np.arange(10) * 0.02, 5.0 + np.arange(10) * 0.02])
    values = np.ones(20)
    values[3] = np.nan
    held_out = np.zeros(20, dtype=bool)
    held_out[15:] = True
    runs = pieces({"t": time, "held_out": held_out}, values)
    assert [run.tolist() for run in runs] == [
        [0, 1, 2, 4, 5, 6, 7, 8, 9],
        list(range(10, 15)),
        list(range(15, 20)),
    ]


def test_flights_laid_end_to_end_start_where_the_last_ended(example: ModuleType) -> None:
    table = example.joined(example.flight(60.0), example.flight(60.0, number=1))
    clock, begins = end_to_end(table)
    assert begins[0] == 0.0
    assert clock.min() == 0.0
    assert begins[1] == clock[table["flight"] == 0].max()
