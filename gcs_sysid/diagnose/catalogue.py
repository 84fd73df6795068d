"""All causes by name."""

from __future__ import annotations

from collections.abc import Mapping

from gcs_sysid.diagnose.cause import Cause
from gcs_sysid.diagnose.causes import airspeed_scale, cg_shift, mass, surface_effectiveness

CAUSES: Mapping[str, Cause] = {
    item.CAUSE.name: item.CAUSE for item in (mass, cg_shift, airspeed_scale, surface_effectiveness)
}
"""In the order in which reports list them."""
