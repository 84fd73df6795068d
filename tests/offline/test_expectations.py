"""Expectations hold and fail where arithmetic says so."""

from __future__ import annotations

import tomllib

import pytest

from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.errors import InputError
from gcs_sysid.offline import expectations
from gcs_sysid.offline.expectations import Check

DOCUMENT = {
    "verdict": "effect",
    "effects": ["mass", "cg_shift"],
    "ranking": [{"parameters": {"mass_ratio": {"value": 1.1, "sd": 0.01, "unit": "1"}}}],
    "wind_ned": {"value": [1.0, -2.0, 0.0], "sd": [0.1, 0.1, 0.2]},
    "score": 12.5,
    "nothing": None,
}


def checks(text: str) -> list[Check]:
    tree = Section("expected.toml", "", tomllib.loads(text))
    return expectations.compare(tree, DOCUMENT)


def holds(text: str) -> bool:
    [check] = checks(text)
    return check.passed


@pytest.mark.parametrize(
    ("text", "passed"),
    [
        ('verdict = "effect"', True),
        ('verdict = "no_effect"', False),
        ('verdict = { one_of = ["effect", "ambiguous"] }', True),
        ('verdict = { one_of = ["ambiguous"] }', False),
        ('effects = { holds = ["mass"] }', True),
        ('effects = { holds = ["mass", "inertia"] }', False),
        ('effects = ["mass", "cg_shift"]', True),
        ('effects = ["mass"]', False),
        ("ranking.0.parameters.mass_ratio = { value = 1.12, within = 0.021 }", True),
        ("ranking.0.parameters.mass_ratio = { value = 1.12, within = 0.019 }", False),
        ("ranking.0.parameters.mass_ratio = { value = 1.12, sds = 2.1 }", True),
        ("ranking.0.parameters.mass_ratio = { value = 1.12, sds = 1.9 }", False),
        ("ranking.0.parameters.mass_ratio = { value = 1.12, sds = 9, within = 0.01 }", False),
        ("ranking.1.parameters.mass_ratio = { value = 1.1, within = 1.0 }", False),
        ("ranking.0.parameters.mass_ratio = { least = 1.05, most = 1.15 }", True),
        ("wind_ned = { value = [1.1, -2.1, 0.0], within = 0.11 }", True),
        ("wind_ned = { value = [1.1, -2.1, 0.3], within = 0.11 }", False),
        ("wind_ned = { value = [1.1, -2.1, 0.3], sds = 1.6 }", True),
        ("wind_ned = { value = [1.1, -2.1], within = 0.11 }", False),
        ("score = { most = 12.5 }", True),
        ("score = { least = 12.6 }", False),
        ("score = { value = 12.0, sds = 100 }", False),
        ("nothing = { most = 1 }", False),
        ("no.such.place = { value = 1, within = 1 }", False),
    ],
)
def test_an_expectation_holds_or_not(text, passed):
    assert holds(text) == passed


def test_what_was_wanted_and_found_is_told_in_words():
    [check] = checks("ranking.0.parameters.mass_ratio = { value = 1.12, within = 0.01, sds = 3 }")
    assert check.place == "ranking.0.parameters.mass_ratio"
    assert check.wanted == "1.12 ± 0.01, ± 3 sd"
    assert check.found == "1.1 (sd 0.01)"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("score = { value = 1 }", "say how near"),
        ("score = { value = 1, withni = 2 }", "did you mean `within`"),
        ('score = { value = 1, within = "2" }', "remove the quotes"),
    ],
)
def test_a_malformed_expectation_is_named(text, words):
    with pytest.raises(InputError, match=words):
        checks(text)
