"""Servos and surfaces that do not do what they are told.

Sizes are those of the control named; each servo behind it takes the share that makes the control,
by the pseudo-inverse of the mix. A servo behind two controls moves both of them wrongly, as it
would.
"""

from __future__ import annotations

from dataclasses import replace

from gcs_sysid.aircraft import Servo
from gcs_sysid.aircraft_toml.section import Section
from gcs_sysid.sitl.effects import changes
from gcs_sysid.sitl.flight import Flight


def actuator_lag(flight: Flight, entry: Section) -> Flight:
    """`time_constant`: added to the first-order lag of the servos behind `control` [s]."""
    entry.allow_only("name", "control", "time_constant")
    more = entry.number("time_constant", "s", least=0.0)

    def slower(servo: Servo, share: float) -> Servo:
        return replace(servo, time_constant=servo.time_constant + more)

    return changes.change_servos(flight, changes.control(entry, flight.flown), slower)


def actuator_rate_limit(flight: Flight, entry: Section) -> Flight:
    """`rate_limit`: fastest motion of `control` [rad/s]."""
    entry.allow_only("name", "control", "rate_limit")
    limit = entry.number("rate_limit", "rad/s", above=0.0)

    def limited(servo: Servo, share: float) -> Servo:
        return replace(servo, rate_limit=limit * abs(share))

    return changes.change_servos(flight, changes.control(entry, flight.flown), limited)


def actuator_backlash(flight: Flight, entry: Section) -> Flight:
    """`width`: full play of `control` [rad]."""
    entry.allow_only("name", "control", "width")
    width = entry.number("width", "rad", least=0.0)

    def loose(servo: Servo, share: float) -> Servo:
        return replace(servo, backlash=servo.backlash + width * abs(share))

    return changes.change_servos(flight, changes.control(entry, flight.flown), loose)


def surface_offset(flight: Flight, entry: Section) -> Flight:
    """`offset`: where `control` stands when told to stand at zero [rad]; other controls stay."""
    entry.allow_only("name", "control", "offset")
    offset = entry.number("offset", "rad")

    def rigged(servo: Servo, share: float) -> Servo:
        return replace(servo, offset=servo.offset + offset * share)

    return changes.change_servos(flight, changes.control(entry, flight.flown), rigged)


def surface_effectiveness(flight: Flight, entry: Section) -> Flight:
    """`ratio`: true over believed effect of `control`, in all its terms."""
    entry.allow_only("name", "control", "ratio")
    name, ratio = changes.control(entry, flight.flown), entry.number("ratio", "1", least=0.0)
    return changes.feeling(flight, (name,), gain=ratio)


def aeroelastic(flight: Flight, entry: Section) -> Flight:
    """`loss`: `control` acts with the share 1 + loss·log2(q̄/qbar_ref), in all its terms.

    `qbar_ref` [Pa] is that of the first leg unless given.
    """
    entry.allow_only("name", "control", "loss", "qbar_ref")
    name, loss = changes.control(entry, flight.flown), entry.number("loss", "1")
    of_first_leg = 0.5 * 1.225 * flight.start.airspeed**2
    reference = entry.number("qbar_ref", "Pa", default=of_first_leg, above=0.0)
    return changes.feeling(flight, (name,), loss=loss, qbar_ref=reference)
