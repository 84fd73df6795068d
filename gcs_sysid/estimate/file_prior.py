"""What an aircraft file says of the aerodynamics, as beliefs to start from."""

from __future__ import annotations

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.result import Prior


def file_prior(aircraft: Aircraft) -> dict[str, Prior]:
    """The file's aerodynamics as values believed beforehand."""
    return {
        name: Prior(
            value={key: item.value for key, item in model.terms.items()},
            sigma={key: item.sigma for key, item in model.terms.items()},
        )
        for name, model in aircraft.aerodynamics.items()
    }
