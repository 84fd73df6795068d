"""Engines that push harder, elsewhere or askew, and what their stream does to a tail."""

from __future__ import annotations

import math
from dataclasses import replace

from gcs_sysid.aircraft import Propulsion
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.sitl.effects import changes
from gcs_sysid.sitl.flight import Flight
from gcs_sysid.sitl.slopes import slopes

_WASH = 4.0


def thrust_scale(flight: Flight, entry: Section) -> Flight:
    """`ratio`: true over believed thrust."""
    entry.allow_only("name", "ratio")
    ratio = entry.number("ratio", "1", least=0.0)
    return _thrusters(flight, entry, lambda thruster: _scaled(thruster, ratio))


def thrust_offset(flight: Flight, entry: Section) -> Flight:
    """`z`: thrust acts this far lower [m], which pitches up; `tilt`: it points up by that [rad].

    `torque`: rolling moment over thrust and span, positive rolls right [1].
    """
    entry.allow_only("name", "z", "tilt", "torque")
    sizes = changes.numbers(entry, {"z": "m", "tilt": "rad", "torque": "1"})
    tilted = _thrusters(flight, entry, lambda t: _moved(t, sizes["z"], sizes["tilt"]))
    if sizes["torque"] == 0.0:
        return tilted
    # Tc is over q̄·S, and Cl over q̄·S·b.
    terms = {"Cl": {"Tc": sizes["torque"]}}
    return changes.flying(tilted, changes.add_terms(tilted.flown, terms))


def propwash(flight: Flight, entry: Section) -> Flight:
    """`gain`: the tail acts with the share 1 + 4·gain·Tc.

    The tail is the control for pitch and the one for yaw, or only `control`.
    """
    entry.allow_only("name", "control", "gain")
    gain = entry.number("gain", "1")
    if entry.has("control"):
        names = (changes.control(entry, flight.flown),)
    else:
        slope = slopes(flight.flown, flight.start.airspeed)
        names = tuple(name for name in (slope.pitch_name, slope.yaw_name) if name)
    return changes.feeling(flight, names, wash=_WASH * gain)


def _thrusters(flight: Flight, entry: Section, changed: changes.Rework) -> Flight:
    if not flight.flown.propulsion:
        raise entry.error(
            "name",
            found="an aircraft without engine",
            allowed="an aircraft file with `[propulsion]`",
            fix="hide something else",
        )
    propulsion = tuple(changed(thruster) for thruster in flight.flown.propulsion)
    return changes.flying(flight, replace(flight.flown, propulsion=propulsion))


def _scaled(thruster: Propulsion, ratio: float) -> Propulsion:
    thrust = tuple(tuple(ratio * value for value in row) for row in thruster.thrust)
    return replace(thruster, thrust=thrust)


def _moved(thruster: Propulsion, lower: float, tilt: float) -> Propulsion:
    x, y, z = thruster.axis
    up = (x * math.cos(tilt) + z * math.sin(tilt), y, z * math.cos(tilt) - x * math.sin(tilt))
    return replace(thruster, axis=up, position=changes.plus(thruster.position, (0.0, 0.0, lower)))
