"""An aircraft as compiled code takes it: its numbers are arguments, its form is compiled for.

Aircraft of one form (the same controls, terms, engines and sizes of tables) share what was
compiled, whatever their numbers: a file with another mass does not wait for the compiler again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import PyTreeDef

from gcs_sysid.aircraft import Aircraft, Control, Imu, Pitot, SensorError, Value, Vanes


@jax.tree_util.register_pytree_node_class
class FlightModel:
    """An aircraft as the filter looks it up.

    Args:
        aircraft: of which the equations of motion and of the sensors are kept. The values of its
            terms come from elsewhere (`aided.Means`); which terms there are is its.
    """

    def __init__(self, aircraft: Aircraft) -> None:
        numbers: list[np.ndarray] = []
        self._form = _form(_looked_up(aircraft), numbers)
        self._numbers: Sequence[Any] = [jnp.asarray(each) for each in numbers]

    @cached_property
    def aircraft(self) -> Aircraft:
        """What is kept of the aircraft, arrays in place of numbers and tuples of them."""
        return _made(self._form, iter(self._numbers))

    def tree_flatten(self) -> tuple[Sequence[Any], Any]:
        """Numbers, and the form that they have."""
        return self._numbers, self._form

    @classmethod
    def tree_unflatten(cls, form: Any, numbers: Sequence[Any]) -> FlightModel:
        """The model of a form with these numbers."""
        model = object.__new__(cls)
        model._form, model._numbers = form, numbers
        return model


def _looked_up(aircraft: Aircraft) -> Aircraft:
    """The aircraft without what no equation reads: names, servos, timing, sigmas, envelope."""
    pitot, vanes, none = aircraft.pitot, aircraft.vanes, Value(0.0, 0.0)
    return Aircraft(
        name="",
        mass=replace(aircraft.mass, mass_sigma=0.0, inertia_sigma=0.0),
        geometry=aircraft.geometry,
        imu=Imu(position=aircraft.imu.position),
        pitot=Pitot(position=pitot.position, error=SensorError(lag=pitot.error.lag)),
        vanes=None if vanes is None else Vanes(position=vanes.position),
        controls=tuple(Control(name, {}) for name in aircraft.control_names),
        propulsion=tuple(
            replace(each, throttle_channel=0, pwm=(), time_constant=0.0, rpm_channel=None)
            for each in aircraft.propulsion
        ),
        aerodynamics={
            name: replace(model, terms=dict.fromkeys(model.terms, none))
            for name, model in aircraft.aerodynamics.items()
        },
        beyond=aircraft.beyond,
    )


def _form(value: Any, numbers: list[np.ndarray]) -> Any:
    """What is left of a value when its numbers are taken out, in order; can be compared."""
    if callable(value):
        leaves, tree = jax.tree.flatten(value)
        numbers.extend(np.asarray(leaf) for leaf in leaves)
        return PyTreeDef, tree
    if is_dataclass(value) and not isinstance(value, Value):
        parts = [(each.name, getattr(value, each.name)) for each in fields(value)]
        return type(value), tuple((name, _form(part, numbers)) for name, part in parts)
    if isinstance(value, Mapping):
        return dict, tuple((key, _form(part, numbers)) for key, part in value.items())
    if isinstance(value, tuple) and value and not _is_array(value):
        return tuple, tuple((None, _form(part, numbers)) for part in value)
    if isinstance(value, float) or (isinstance(value, tuple) and value):
        numbers.append(np.asarray(value, dtype=float))
        return float, ()
    return None, value


def _is_array(value: tuple[Any, ...]) -> bool:
    """Whether a tuple holds numbers only, or rows of them that are all as long."""
    if all(isinstance(part, tuple) for part in value):
        return len({len(part) for part in value}) == 1 and all(_is_array(part) for part in value)
    return all(isinstance(part, int | float) for part in value)


def _made(form: Any, numbers: Iterator[Any]) -> Any:
    kind, parts = form
    if kind is None:
        return parts
    if kind is float:
        return next(numbers)
    if kind is PyTreeDef:
        return jax.tree.unflatten(parts, [next(numbers) for _ in range(parts.num_leaves)])
    made = [(name, _made(part, numbers)) for name, part in parts]
    if kind is dict:
        return dict(made)
    if kind is tuple:
        return tuple(part for _, part in made)
    # Past the constructor, which promises floats.
    instance = object.__new__(kind)
    for name, part in made:
        object.__setattr__(instance, name, part)
    return instance
