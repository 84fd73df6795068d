"""The rigid aircraft as a model for output error: its free flight in still air."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jaxtyping import Float

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.errors import UsageError
from gcs_sysid.estimate.output_error import Model
from gcs_sysid.frames import Array
from gcs_sysid.model import linear, rigid_body
from gcs_sysid.model.rigid_body import Parameters


def simulated(
    aircraft: Aircraft, free: Sequence[tuple[str, str]], *, height: float, density: float
) -> Model:
    """Flight of an aircraft as a function of some of its aerodynamic values.

    States are those of `linear.STATES`, outputs those of `linear.OUTPUTS`; inputs are the controls
    [rad], then the engines' settings. Height and density stay as they are.

    Args:
        aircraft: with aerodynamics; values that are not free are its own.
        free: coefficient and regressor of each parameter.
        height: [m].
        density: of the air [kg/m³].

    Raises:
        UsageError: a free value is none of the aircraft's.
    """
    base = rigid_body.parameters(aircraft)
    for name, key in free:
        if key not in base.aerodynamics.get(name, {}):
            raise UsageError(f"{aircraft.name} has no term `{key}` in {name} that could be free")
    held, air = jnp.asarray(height), jnp.asarray(density)

    def moved(values: Float[Array, " parameter"]) -> Parameters:
        terms = {name: dict(entries) for name, entries in base.aerodynamics.items()}
        for (name, key), value in zip(free, values, strict=True):
            terms[name][key] = value
        return base._replace(aerodynamics=terms)

    def rate(values: Array, state: Array, inputs: Array) -> Array:
        return linear.rate(aircraft, moved(values), state, inputs, held, air)[0]

    def output(values: Array, state: Array, inputs: Array) -> Array:
        felt = linear.rate(aircraft, moved(values), state, inputs, held, air)[1]
        return jnp.concatenate([state, felt])

    return Model(rate, output)
