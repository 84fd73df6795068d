"""An aircraft as a JSBSim model: XML text with the file's own coefficients in body axes.

The coefficients become functions of JSBSim's flow quantities at the centre of gravity (alpha, beta,
speed and rotation against the air, turbulence included); their moments act about the airframe
point, and JSBSim moves them to the centre of gravity. Its structural frame is x aft, y right, z up.

References:
    JSBSim reference manual: metrics, mass balance, external reactions, aerodynamics (body-axis
    forces by axis names X, Y, Z); FGAerodynamics.cpp and FGExternalForce.cpp, version 1.3.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, Propulsion, TableTerm, Vector
from gcs_sysid.errors import UsageError
from gcs_sysid.regressors import Factor, Regressor
from gcs_sysid.sitl import units
from gcs_sysid.sitl.motor import settings

Node = ElementTree.Element

_AXES = {"CX": "X", "CY": "Y", "CZ": "Z", "Cl": "ROLL", "Cm": "PITCH", "Cn": "YAW"}
_SPEED = "velocities/vt-fps"
_QBAR = "aero/qbar-psf"
_VARIABLES = {
    "alpha": "aero/alpha-rad",
    "beta": "aero/beta-rad",
    "phat": "sitl/phat",
    "qhat": "sitl/qhat",
    "rhat": "sitl/rhat",
    "alphadot_hat": "sitl/alphadot-hat",
    "Tc": "sitl/thrust-coefficient",
    "qbar": "sitl/qbar-pascal",
    "V": "sitl/speed-mps",
    "h_over_b": "sitl/height-over-span",
}


@dataclass(frozen=True)
class Feel:
    """The share of a control's deflection that the air feels.

    gain·(1 + wash·Tc)·(1 + loss·log2(q̄/qbar_ref)), never negative: its own effectiveness, the
    propeller's wash over a tail, and a structure that gives way.
    """

    gain: float = 1.0
    wash: float = 0.0
    loss: float = 0.0
    qbar_ref: float = 1.0


@dataclass(frozen=True)
class Fuel:
    """Fuel in the centre of gravity.

    Attributes:
        mass: at the start, a part of the aircraft's [kg].
        burn: at full throttle of all engines, in proportion at less [kg/s].
    """

    mass: float
    burn: float


def control_property(name: str) -> str:
    """Property that holds a control [rad]."""
    return f"sitl/control/{name}"


def felt_property(name: str) -> str:
    """Property that holds what the air feels of a control [rad]."""
    return f"sitl/felt/{name}"


def late_property(knot: int) -> str:
    """Property that holds how far alpha was beyond a knot, late [rad]."""
    return f"sitl/late/knot-{knot}"


def knots(aircraft: Aircraft) -> tuple[float, ...]:
    """Angles of attack beyond which something of the aircraft changes, in order [rad]."""
    found = {
        factor.knot
        for model in aircraft.aerodynamics.values()
        for key in model.terms
        for factor in regressors.parse(key, controls=aircraft.control_names).factors
        if _stalls(factor)
    }
    return tuple(sorted(found))


def throttle_property(thruster: int) -> str:
    """Property that holds a thruster's lagged throttle, 0 to 1."""
    return f"sitl/throttle/thruster-{thruster}"


def thrust_property(thruster: int) -> str:
    """Property that holds a thruster's thrust [N]."""
    return f"sitl/thrust/thruster-{thruster}"


def weight(mass: float) -> float:
    """Weight [lbf] that JSBSim gives a mass [kg]."""
    return mass / units.SLUG * units.JSBSIM_SLUG_WEIGHT


def coefficient_property(name: str) -> str:
    """Property that holds a coefficient about the airframe point."""
    return f"sitl/coefficient/{name}"


def model_xml(
    aircraft: Aircraft,
    *,
    feel: Mapping[str, Feel] | None = None,
    late_stall: bool = False,
    fuel: Fuel | None = None,
) -> str:
    """The JSBSim model of an aircraft.

    Args:
        aircraft: with `aerodynamics`; everything in SI and radians.
        feel: what the air feels of a control, by control; all of it by default.
        late_stall: what lies beyond a knot of alpha is the late angle of `late_property`, which
            somebody keeps up, and not the present one.
        fuel: a part of the mass that can become less.

    Returns:
        Text of an `fdm_config` document.

    Raises:
        UsageError: the aircraft holds nothing to fly with.
    """
    if not aircraft.aerodynamics:
        raise UsageError(
            f"{aircraft.name}: `[aerodynamics]` is empty, so there is nothing to fly; "
            "write the coefficients into the aircraft file"
        )
    root = Node("fdm_config", name="sitl", version="2.0", release="ALPHA")
    root.append(_metrics(aircraft))
    root.append(_mass_balance(aircraft, fuel))
    ElementTree.SubElement(root, "ground_reactions")
    root.append(_aerodynamics(aircraft, feel or {}, late_stall=late_stall))
    root.append(_external_reactions(aircraft))
    return ElementTree.tostring(root, encoding="unicode")


def _metrics(aircraft: Aircraft) -> Node:
    geometry = aircraft.geometry
    metrics = Node("metrics")
    _leaf(metrics, "wingarea", geometry.wing_area / units.FOOT**2, unit="FT2")
    _leaf(metrics, "wingspan", geometry.wing_span / units.FOOT, unit="FT")
    _leaf(metrics, "chord", geometry.mean_chord / units.FOOT, unit="FT")
    for name in ("AERORP", "EYEPOINT", "VRP"):
        _location(metrics, (0.0, 0.0, 0.0), name=name)
    return metrics


def _mass_balance(aircraft: Aircraft, fuel: Fuel | None) -> Node:
    mass = aircraft.mass
    # JSBSim takes products of inertia in its structural frame and negates the one of x and z.
    inertia = {
        "ixx": mass.Ixx,
        "iyy": mass.Iyy,
        "izz": mass.Izz,
        "ixy": mass.Ixy,
        "ixz": -mass.Ixz,
        "iyz": mass.Iyz,
    }
    balance = Node("mass_balance")
    for name, value in inertia.items():
        _leaf(balance, name, value / units.SLUG_FOOT2, unit="SLUG*FT2")
    empty = mass.mass - (0.0 if fuel is None else fuel.mass)
    _leaf(balance, "emptywt", weight(empty), unit="LBS")
    _location(balance, mass.cg, name="CG")
    if fuel is not None:
        tank = ElementTree.SubElement(balance, "pointmass", name="fuel")
        _leaf(tank, "weight", weight(fuel.mass), unit="LBS")
        _location(tank, mass.cg, name="POINTMASS")
    return balance


def _aerodynamics(aircraft: Aircraft, feel: Mapping[str, Feel], *, late_stall: bool) -> Node:
    aerodynamics = Node("aerodynamics")
    inputs = [control_property(name) for name in aircraft.control_names]
    inputs += [throttle_property(i) for i in range(len(aircraft.propulsion))]
    late = {knot: late_property(i) for i, knot in enumerate(knots(aircraft))} if late_stall else {}
    inputs += late.values()
    for name in inputs:
        ElementTree.SubElement(aerodynamics, "property", value="0.0").text = name
    # Evaluated in this order before the axes, once a step, and held: so what is read after a step
    # is what acted in it.
    for name, expression in _flow(aircraft):
        _function(aerodynamics, name).append(expression)
    for name in aircraft.control_names:
        _function(aerodynamics, felt_property(name)).append(_felt(name, feel.get(name, Feel())))
    for name in COEFFICIENTS:
        for function in _coefficient(aircraft, name, late):
            aerodynamics.append(function)
    for name in COEFFICIENTS:
        axis = ElementTree.SubElement(aerodynamics, "axis", name=_AXES[name])
        _function(axis, f"sitl/axis/{name}").append(_dimensional(aircraft, name))
    return aerodynamics


def _flow(aircraft: Aircraft) -> Iterable[tuple[str, Node]]:
    geometry = aircraft.geometry
    half_span = 0.5 * geometry.wing_span / units.FOOT
    half_chord = 0.5 * geometry.mean_chord / units.FOOT
    for name, rate, length in (
        ("phat", "velocities/p-aero-rad_sec", half_span),
        ("qhat", "velocities/q-aero-rad_sec", half_chord),
        ("rhat", "velocities/r-aero-rad_sec", half_span),
        ("alphadot_hat", "aero/alphadot-rad_sec", half_chord),
    ):
        yield _VARIABLES[name], _operation("product", length, _quotient(rate, _SPEED))
    yield _VARIABLES["qbar"], _operation("product", units.PSF, _QBAR)
    yield _VARIABLES["V"], _operation("product", units.FOOT, _SPEED)
    height = _operation("product", units.FOOT / geometry.wing_span, "position/h-agl-ft")
    yield _VARIABLES["h_over_b"], height
    for i, thruster in enumerate(aircraft.propulsion):
        yield thrust_property(i), _thrust(thruster, throttle_property(i), thruster.thrust)
    thrusts = [thrust_property(i) for i in range(len(aircraft.propulsion))]
    force = _operation("product", geometry.wing_area, _VARIABLES["qbar"])
    yield _VARIABLES["Tc"], _quotient(_operation("sum", 0.0, 0.0, *thrusts), force)


def _felt(name: str, feel: Feel) -> Node:
    wash = _operation("sum", 1.0, _operation("product", feel.wash, _VARIABLES["Tc"]))
    ratio = _operation("quotient", _VARIABLES["qbar"], feel.qbar_ref)
    # The logarithm of nothing, before the first step, is not asked for.
    doublings = _operation("log2", _operation("max", 1e-6, ratio))
    bent = _operation("sum", 1.0, _operation("product", feel.loss, doublings))
    share = _operation("product", _operation("max", 0.0, wash), _operation("max", 0.0, bent))
    return _operation("product", feel.gain, control_property(name), share)


def _coefficient(aircraft: Aircraft, name: str, late: Mapping[float, str]) -> Iterable[Node]:
    model = aircraft.aerodynamics.get(name)
    terms: list[Node | str | float] = []
    for key, value in model.terms.items() if model else ():
        factors = _factors(regressors.parse(key, controls=aircraft.control_names), late)
        terms.append(_operation("product", 1.0, value.value, *factors))
    for i, table in enumerate(model.tables if model else ()):
        axes = [f"sitl/table/{name}-{i}-{axis}" for axis in range(len(table.regressors))]
        for axis, key in zip(axes, table.regressors, strict=True):
            function = Node("function", name=axis)
            factors = _factors(regressors.parse(key, controls=aircraft.control_names), late)
            function.append(_operation("product", 1.0, 1.0, *factors))
            yield function
        terms.append(_aerodynamic_table(table, axes))
    function = Node("function", name=coefficient_property(name))
    function.append(_operation("sum", 0.0, 0.0, *terms))
    yield function


def _dimensional(aircraft: Aircraft, name: str) -> Node:
    geometry = aircraft.geometry
    span, chord = geometry.wing_span / units.FOOT, geometry.mean_chord / units.FOOT
    length = {"Cl": span, "Cm": chord, "Cn": span}.get(name, 1.0)
    reference = geometry.wing_area / units.FOOT**2 * length
    return _operation("product", reference, _QBAR, coefficient_property(name))


def _external_reactions(aircraft: Aircraft) -> Node:
    reactions = Node("external_reactions")
    for i, thruster in enumerate(aircraft.propulsion):
        force = ElementTree.SubElement(reactions, "force", name=f"thruster-{i}", frame="BODY")
        magnitude = _operation("product", 1.0 / units.POUND_FORCE, thrust_property(i))
        ElementTree.SubElement(force, "function").append(magnitude)
        _location(force, thruster.position)
        _direction(force, thruster.axis)
    for i, thruster in enumerate(aircraft.propulsion):
        if thruster.torque is None:
            continue
        moment = ElementTree.SubElement(reactions, "moment", name=f"torque-{i}", frame="BODY")
        torque = _thrust(thruster, throttle_property(i), thruster.torque)
        magnitude = _operation("product", 1.0 / (units.POUND_FORCE * units.FOOT), torque)
        ElementTree.SubElement(moment, "function").append(magnitude)
        _direction(moment, thruster.axis)
    return reactions


def _thrust(thruster: Propulsion, throttle: str, values: Sequence[Sequence[float]]) -> Node:
    """Table over throttle and airspeed, scaled by the density ratio to 1.225 kg/m³ (ICAO)."""
    table = _table((throttle, _VARIABLES["V"]), (settings(thruster), thruster.airspeed), values)
    density = _operation("product", units.SLUG_FOOT3 / 1.225, "atmosphere/rho-slugs_ft3")
    return _operation("product", table, density)


def _aerodynamic_table(table: TableTerm, axes: Sequence[str]) -> Node:
    rows = np.asarray(table.values, dtype=float).reshape(len(table.breakpoints[0]), -1)
    return _table(axes, table.breakpoints, rows.tolist())


def _table(
    properties: Sequence[str],
    breakpoints: Sequence[Sequence[float]],
    values: Sequence[Sequence[float]],
) -> Node:
    node = Node("table")
    for name, lookup in zip(properties, ("row", "column"), strict=False):
        ElementTree.SubElement(node, "independentVar", lookup=lookup).text = name
    lines = [" ".join(map(repr, breakpoints[1]))] if len(properties) == 2 else []
    lines += [" ".join(map(repr, (x, *row))) for x, row in zip(breakpoints[0], values, strict=True)]
    ElementTree.SubElement(node, "tableData").text = "\n" + "\n".join(lines) + "\n"
    return node


def _factors(regressor: Regressor, late: Mapping[float, str]) -> list[Node | str]:
    return [
        part for factor in regressor.factors for part in [_factor(factor, late)] * factor.exponent
    ]


def _factor(factor: Factor, late: Mapping[float, str]) -> Node | str:
    if _stalls(factor) and factor.knot in late:
        return late[factor.knot]
    name = _VARIABLES.get(factor.variable) or felt_property(factor.variable)
    if factor.side == 0:
        return name
    operands = (name, factor.knot) if factor.side > 0 else (factor.knot, name)
    return _operation("max", 0.0, _operation("difference", *operands))


def _stalls(factor: Factor) -> bool:
    return factor.variable == "alpha" and factor.side > 0


def _quotient(numerator: Node | str, denominator: Node | str) -> Node:
    return _operation("quotient", numerator, denominator)


# JSBSim wants at least two operands of a sum or a product: neutral ones make up for missing ones.
def _operation(name: str, *operands: Node | str | float) -> Node:
    node = Node(name)
    for operand in operands:
        if isinstance(operand, Node):
            node.append(operand)
        elif isinstance(operand, str):
            ElementTree.SubElement(node, "property").text = operand
        else:
            ElementTree.SubElement(node, "value").text = repr(float(operand))
    return node


def _function(parent: Node, name: str) -> Node:
    return ElementTree.SubElement(parent, "function", name=name)


def _location(parent: Node, position: Vector, *, name: str | None = None) -> None:
    x, y, z = position
    attributes = {"unit": "IN"} | ({"name": name} if name else {})
    location = ElementTree.SubElement(parent, "location", attributes)
    for axis, value in (("x", -x), ("y", y), ("z", -z)):
        _leaf(location, axis, value / units.INCH)


def _direction(parent: Node, axis: Vector) -> None:
    direction = ElementTree.SubElement(parent, "direction")
    for name, value in zip("xyz", axis, strict=True):
        _leaf(direction, name, value)


def _leaf(parent: Node, tag: str, value: float, **attributes: str) -> None:
    ElementTree.SubElement(parent, tag, attributes).text = repr(float(value))
