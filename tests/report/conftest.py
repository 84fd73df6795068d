"""The made-up flight as fixtures."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

EXAMPLE = Path(__file__).parent / "example.py"


@pytest.fixture(scope="session")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("report_example", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def samples(example: ModuleType) -> dict[str, np.ndarray]:
    return example.flight(120.0)


@pytest.fixture(scope="session")
def summary(example: ModuleType, samples: dict[str, np.ndarray]) -> dict:
    return example.summary(samples)
