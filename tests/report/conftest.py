"""The made-up flight as fixtures."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from tests.report import example as made_up


@pytest.fixture(scope="session")
def example() -> ModuleType:
    return made_up


@pytest.fixture(scope="session")
def samples() -> dict[str, np.ndarray]:
    return made_up.flight(120.0)


@pytest.fixture(scope="session")
def summary(samples: dict[str, np.ndarray]) -> dict:
    return made_up.summary(samples)
