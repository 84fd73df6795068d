"""What stands out where a search began, told where no set of causes found rest."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from gcs_sysid.estimate.intensities import Prior
from gcs_sysid.estimate.settling import Beliefs, Settled
from gcs_sysid.offline import diagnosis_entries as entries
from gcs_sysid.offline.leads import RestlessError, standing_out
from gcs_sysid.reconstruct.causal import Pass
from gcs_sysid.report import diagnose as report
from tests.estimate import made_flight

SILENT = Prior(*[made_flight.unknowns(1.0).log_noise] * 2)
NAMES = (
    "aerodynamics.Cm.alpha",
    "sensors.surface_delay",
    "sensors.vane_bias.1",
    "departures.offset.1",
    "departures.mass",
)
USUAL = np.array([0.1, 0.01, 0.005, 0.0, 0.02])


def settled(values: np.ndarray) -> Settled:
    every = np.ones(3, dtype=bool)
    return Settled(values, SILENT.mean, Mock(spec=Pass), every, ~every, (), ended=True)


def test_what_is_off_by_more_than_is_ordinary_stands_out_the_farthest_first() -> None:
    mean = np.array([-1.0, 0.0, 0.0, 0.0, 0.0])
    before = Beliefs(mean, np.diag(USUAL**2), SILENT)
    # The offset is held, and mass and Cm.alpha are within three of their deviations.
    done = settled(mean + np.array([0.29, 0.034, -0.05, 0.3, 0.05]))
    found = standing_out(NAMES, before, done)
    assert [(one.name, one.unit) for one in found] == [
        ("sensors.vane_bias.1", "rad"),
        ("sensors.surface_delay", "s"),
    ]
    assert found[1].off == pytest.approx(0.034)
    assert found[1].ordinary == pytest.approx(0.01)
    told = entries.stands_out(found, ("elevator", "aileron"))
    assert [one["label"] for one in told] == ["the vane bias (beta)", "the surface delay"]


def test_where_the_search_did_not_even_begin_well_nothing_stands_out() -> None:
    before = Beliefs(np.zeros(5), np.diag(USUAL**2), SILENT)
    lost = replace(settled(np.ones(5)), ended=False, left=600.0)
    assert lost.restless
    assert standing_out(NAMES, before, lost) == []


def test_a_derivative_is_off_by_a_number_and_a_mass_by_a_share() -> None:
    before = Beliefs(np.zeros(5), np.diag(USUAL**2), SILENT)
    found = standing_out(NAMES, before, settled(np.array([-0.44, 0.0, 0.0, 0.0, 0.1])))
    assert [(one.name, one.unit) for one in found] == [
        ("departures.mass", "1"),
        ("aerodynamics.Cm.alpha", ""),
    ]
    words = [report._off(one) for one in entries.stands_out(found, ())]
    assert words == [("+10 %", "2 %"), ("-0.44", "0.1")]


def test_a_refusal_says_which_flight_and_what_to_do() -> None:
    said = str(RestlessError("shaken.tlog", []))
    assert said.startswith("shaken.tlog: ")
    assert "no rest" in said
    assert "fly in calmer air" in said
