"""The simulation that a run puts to the test: an aircraft file's, or an identified model's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import Aircraft, CoefficientModel, Value
from gcs_sysid.errors import RefusedError, UsageError
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.estimate.surface_delay import Delay
from gcs_sysid.gp.aerodynamics import beyond
from gcs_sysid.offline import model_store


@dataclass(frozen=True)
class Tested:
    """An aircraft with aerodynamics, where they came from, and the surfaces' delay where known."""

    aircraft: Aircraft
    source: str
    delay: Delay | None

    def left_out(self, of: str) -> list[str]:
        """What a file of terms and tables cannot hold, for whoever reads it."""
        if self.aircraft.beyond is None:
            return []
        return [f"{of} has no place for the Gaussian processes of {self.source}: it lacks them"]


def load(aircraft: Path | None, model: Path | None) -> Tested:
    """The simulation to test.

    Args:
        aircraft: its file.
        model: folder of an identified model, instead.

    Raises:
        UsageError: both are given, or neither.
        InputError: it cannot be read, or has no aerodynamics.
    """
    if (aircraft is None) == (model is None):
        raise UsageError("give the simulation to test: either --aircraft FILE or --model DIR")
    if model is not None:
        stored = model_store.load(model)
        known = Delay(stored.surface_delay, 0.0, found=True)
        return Tested(with_model(stored.aircraft, stored.model), str(model), known)
    described = aircraft_file.load(str(aircraft))
    if not any(item.terms or item.tables for item in described.aerodynamics.values()):
        raise RefusedError(
            str(aircraft),
            "has no [aerodynamics], so there is no simulation to test",
            fix="add them, or identify them first and give --model DIR",
        )
    return Tested(described, str(aircraft), None)


def with_model(aircraft: Aircraft, model: AeroModel) -> Aircraft:
    """The aircraft with an identified model for its aerodynamics, processes beside it included.

    Correlations between the values are lost: an aircraft file holds one sigma a value.
    """
    aerodynamics: Mapping[str, CoefficientModel] = {
        name: CoefficientModel(
            {
                key: Value(float(value), float(deviation))
                for key, value, deviation in zip(fit.keys, fit.value, fit.deviation, strict=True)
            }
        )
        for name, fit in model.fits.items()
    }
    return replace(aircraft, aerodynamics=aerodynamics, beyond=beyond(model))
