"""What causes set free, as directions in the parameters of the flight model.

A quantity is a direction: by how much each parameter of the model moves for one unit of it. Most
are one parameter each. What changes the aerodynamics is a combination of terms, of which those that
the file does not have are added with the value 0: the effect of a control that grows with thrust or
dynamic pressure, a lift slope lost beyond an angle, the ground's share of the lift.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

import jax
import numpy as np
from jaxtyping import Float

from gcs_sysid import regressors
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft, CoefficientModel, StreamTiming, Value
from gcs_sysid.diagnose.cause import Candidate, Cause
from gcs_sysid.diagnose.causes import actuator_rate_limit, stall
from gcs_sysid.diagnose.extended import Direction
from gcs_sysid.model import servo_changes
from gcs_sysid.model.aided import Means

WASH = 4.0
"""Share of effectiveness that a unit of thrust coefficient adds at a gain of 1."""
SERVO = {"lag": 0.1, "backlash": 0.025}
"""Sizes [s, rad] at which the effect of a lag or of play is first taken: those that matter."""
SKEW = 0.07
"""Size [s] at which commands that come late, or early, are first taken: at a tenth of a second the
effect of a delay on quick inputs is no line."""
EARLY = 0.03
"""So much earlier than an inertial unit that low-pass filters its own a message may seem [s]."""
LEAST = 0.2
"""Share of these below which a servo's change is as good as a line."""
NEXT_TO_NONE = 0.9
"""Share of a servo's lag in the file by which it is less at most."""
HALF = 0.5
"""And at first: begun at next to none, 0.11 s less came out as 0.154, 31 nats below what is so."""
NEARLY = 0.02
"""Share within which the size at which a servo's change was taken is right."""
GROWS = {"lag": 1.8, "backlash": 1.0, "skew": 1.0}
"""Power of the share by which it is moved otherwise. What a lag does grows by less than it does:
inputs faster than it hardly feel that it is longer still. Taken at a wrong size, what is found goes
with that size to a power of 0.3 to 0.6. What play does is nearly a line."""
MORE = "more."
"""Quantity of what still more of a lag or delay does where it is."""
FURTHER = 0.1
"""Share of the size over which that is taken, towards later: what an autopilot commands answers
noise that comes before."""
KNOTS = (0.1, 0.3, 1.0)
"""Heights over span between which the ground's influence is a line."""
NEAR = 0.5
"""Height over span below which a flight may show the ground's influence."""
BLOWING = 2.0
"""Steady wind above which a flight may show that it grows with height [m/s]. In calm air what
seems to blow is what sensors are off by, and a wind that grows was named in it."""
SERVO_STREAM = "SERVO_OUTPUT_RAW"
MISSING = "missing"
"""Quantity of a term that nothing listed stands for."""
DELAYS: Mapping[str, str] = {
    "attitude": "sensors.attitude_delay",
    "velocity": "sensors.velocity_delay",
    "airspeed": "sensors.airspeed_delay",
    "vanes": "sensors.vane_delay",
}
"""Delay of each group of sensors; the stream that it comes in is the flight's."""


@dataclass(frozen=True)
class Flown:
    """What of a flight decides which quantities there are.

    Attributes:
        qbar: dynamic pressures flown [Pa].
        lowest: least height over span.
        rates: fastest motion of each control, all but the extremes [rad/s].
        streams: message behind each group of sensors, and behind `gyro`.
        wind: strongest steady wind of the flights [m/s].
    """

    qbar: Float[np.ndarray, " sample"]
    lowest: float
    rates: Mapping[str, float]
    streams: Mapping[str, str]
    wind: float


@dataclass(frozen=True)
class Quantities:
    """Directions by name, and the model that they are directions in.

    Attributes:
        aircraft: with every term that a direction needs.
        servos: the aircraft with one thing about its servos changed, and how much that is; their
            order is that of `Departures.actuators`.
        directions: change of the model's parameters by quantity.
        sizes: what shares refer to.
        has: what there is of what causes need.
        streams: whose times may be skewed, with the places where the effect of that is taken.
        least: what cannot be less, by quantity.
        either: pairs of which only one is ever free: two names for one thing.
        beside: parameter that is ordinarily off in the same way as a quantity that has its own.
        acting: sizes of the lags and delays that flights are searched with, by quantity.
        moving: the aircraft with all of these, of which it is told how surfaces move.
    """

    aircraft: Aircraft
    servos: tuple[tuple[Aircraft, float], ...]
    directions: Mapping[str, Direction]
    sizes: Mapping[str, float]
    has: frozenset[str]
    streams: Mapping[str, tuple[float | None, ...]]
    least: Mapping[str, float]
    either: frozenset[frozenset[str]]
    beside: Mapping[str, str]
    acting: Mapping[str, float]
    moving: Aircraft


@dataclass
class _Servos:
    """Changes of servos, to which more are added.

    Attributes:
        changes: aircraft with one thing changed, and how much that is.
        acting: names of quantities that flights are searched with.
        sizes: of these.
        moving: the aircraft with these.
    """

    changes: list[tuple[Aircraft, float]]
    acting: Collection[str]
    sizes: dict[str, float]
    moving: Aircraft

    def add(self, made: Aircraft, size: float) -> str:
        """The parameter of so much of a change."""
        self.changes.append((made, size))
        return f"departures.actuators.{len(self.changes) - 1}"

    def growing(
        self, name: str, change: Callable[[Aircraft, float], Aircraft], base: Aircraft, size: float
    ) -> dict[str, Direction]:
        """A quantity by what all of it does, from nothing to its size, and what still more does.

        With a(s) = (u(s) - u(0))/s of the surfaces u, what more does at s is, over s to (1 + ε) s,

            (u((1 + ε) s) - u(s))/(ε s) = ((1 + ε) a((1 + ε) s) - a(s))/ε
        """
        step = math.copysign(FURTHER, size)
        here = self.add(change(base, size), size)
        there = self.add(change(base, (1.0 + step) * size), (1.0 + step) * size)
        if name in self.acting:
            self.sizes[name] = size
            self.moving = change(self.moving, size)
        return {
            name: {here: 1.0},
            f"{MORE}{name}": {there: (1.0 + step) / step, here: -1.0 / step},
        }


@dataclass
class _Terms:
    """The aircraft's aerodynamic terms, to which more are added."""

    aircraft: Aircraft
    added: dict[str, dict[str, Value]] = field(default_factory=dict)

    def value(self, coefficient: str, key: str) -> float:
        model = self.aircraft.aerodynamics.get(coefficient, CoefficientModel())
        return model.terms[key].value if key in model.terms else 0.0

    def name(self, coefficient: str, text: str) -> str:
        """Of a term's parameter; the term is added where the file does not have it."""
        key = regressors.parse(text, controls=self.aircraft.control_names).key
        model = self.aircraft.aerodynamics.get(coefficient, CoefficientModel())
        if key not in model.terms:
            self.added.setdefault(coefficient, {})[key] = Value(0.0, 0.0)
        return f"aerodynamics.{coefficient}.{key}"

    def of(self, variable: str) -> Iterable[tuple[str, str, float]]:
        """Coefficient, key and value of every term in a variable."""
        controls = self.aircraft.control_names
        for coefficient, model in self.aircraft.aerodynamics.items():
            for key, item in model.terms.items():
                factors = regressors.parse(key, controls=controls).factors
                if variable in {factor.variable for factor in factors}:
                    yield coefficient, key, item.value

    def complete(self) -> Aircraft:
        models = dict(self.aircraft.aerodynamics)
        for coefficient, more in self.added.items():
            old = models.get(coefficient, CoefficientModel())
            models[coefficient] = replace(old, terms={**old.terms, **more})
        return replace(self.aircraft, aerodynamics=models)


def build(
    aircraft: Aircraft,
    flown: Flown,
    reached: Mapping[str, float] | None = None,
    acting: Collection[str] = (),
) -> Quantities:
    """Every quantity that an aircraft and a flight give sense to.

    Args:
        aircraft: the simulation.
        flown: what of the flights counts.
        reached: lags and play that are about right, by quantity: what they do is no line, and is
            taken where they are.
        acting: quantities that flights are searched with.
    """
    known = reached or {}
    terms = _Terms(aircraft)
    found: dict[str, Direction] = {
        "mass": {"departures.mass": 1.0},
        "cg.x": {"departures.cg": aircraft.geometry.mean_chord},
        "thrust": {"departures.thrust": 1.0},
        "thrust_drop": {"departures.thrust_drop": 1.0},
        "thrust_tilt": {"departures.thrust_tilt": 1.0},
        "torque": {terms.name("Cl", "Tc"): 1.0},
        "heading": {"departures.heading": 1.0},
        "shear": {"departures.shear": 1.0},
        "airspeed": {"sensors.airspeed_scale": 1.0},
        "airspeed_lag": {"sensors.airspeed_lag": 1.0},
        "wash": _wash(terms),
    }
    for axis in range(3):
        for name in ("inertia", "gyro_scale", "imu_tilt", "imu_position"):
            found[f"{name}.{axis}"] = {f"departures.{name}.{axis}": 1.0}
        found[f"accelerometer_bias.{axis}"] = {f"sensors.accelerometer_bias.{axis}": 1.0}
    for axis in range(2):
        found[f"vane_bias.{axis}"] = {f"sensors.vane_bias.{axis}": 1.0}
    for coefficient, key in (
        *(("CX", "1"), ("Cl", "1"), ("Cn", "1")),
        *(("Cm", "beta"), ("Cl", "alpha")),
    ):
        found[f"term.{coefficient}.{key}"] = {terms.name(coefficient, key): 1.0}
    for coefficient in COEFFICIENTS:
        terms.name(coefficient, regressors.CONSTANT)
    late: dict[str, dict[str, float]] = {}
    for group, delay in DELAYS.items():
        if group in flown.streams:
            late.setdefault(flown.streams[group], {})[delay] = 1.0
    # All else is early when the inertial unit is late.
    early = {delay: -1.0 for delays in late.values() for delay in delays}
    early["sensors.surface_delay"] = -1.0
    found |= {f"skew.{stream}": delays for stream, delays in late.items()}
    found.setdefault(f"skew.{flown.streams['gyro']}", early)
    streams: dict[str, tuple[float | None, ...]] = {
        name.partition(".")[2]: (None,) for name in found if name.startswith("skew.")
    }
    streams[SERVO_STREAM] = (SKEW, -SKEW)
    servos, least = _Servos([], acting, {}, aircraft), _least(aircraft, late)
    beside: dict[str, str] = {}
    for place in (SKEW, -SKEW):
        name = f"skew.{SERVO_STREAM}.{place:.4g}"
        found |= servos.growing(name, _late, aircraft, known.get(name, place))
        beside[name] = "sensors.surface_delay"
    for index, control in enumerate(aircraft.control_names):
        own = list(terms.of(control))
        found[f"offset.{control}"] = {f"departures.offset.{index}": 1.0}
        found[f"effectiveness.{control}"] = {
            f"aerodynamics.{coefficient}.{key}": value for coefficient, key, value in own
        }
        found[f"aeroelastic.{control}"] = _aeroelastic(terms, own, flown.qbar)
        same = servo_changes.together(aircraft, control)
        rate = max(flown.rates[name] for name in same)
        lag, play = (
            _possible(known.get(f"{kind}.{control}", usual), usual, least[f"{kind}.{control}"])
            for kind, usual in SERVO.items()
        )
        kinds = {
            "backlash": (servo_changes.backlash(play), play),
            **{
                f"rate_limit.{{}}.{share:.4g}": (
                    servo_changes.rate_limit(share * max(rate, 1e-3)),
                    1.0,
                )
                for share in actuator_rate_limit.CAUSE.places
            },
        }
        # What servos do that two controls share is told of the first.
        told = control == same[0]
        name = f"lag.{control}"
        found |= servos.growing(name, _lagging(control), aircraft, lag) if told else {name: {}}
        for kind, (change, size) in kinds.items():
            name = kind.format(control) if "{}" in kind else f"{kind}.{control}"
            changed = servo_changes.changed(aircraft, control, change)
            found[name] = {servos.add(changed, size): 1.0} if told else {}
    for coefficient, model in aircraft.aerodynamics.items():
        for key, item in model.terms.items():
            if key != regressors.CONSTANT and item.value != 0.0:
                name = f"aerodynamics.{coefficient}.{key}"
                found[f"derivative.{coefficient}.{key}"] = {name: item.value}
    slope = terms.value("CZ", "alpha")
    for knot in stall.CAUSE.places:
        name = terms.name("CZ", f"max(0, alpha - {knot:.4g})")
        found[f"stall.{knot:.4g}"] = {name: -slope}
    has = {"engine"} if aircraft.propulsion else set()
    has |= {"vanes"} if "vanes" in flown.streams else set()
    has |= {"wind"} if flown.wind > BLOWING else set()
    if flown.lowest < NEAR:
        has.add("ground")
        found |= _ground(terms)
    sizes = {
        "": 1.0,
        "span": aircraft.geometry.wing_span,
        "CX0": abs(terms.value("CX", "1")) or 0.03,
        "Cm_alpha": abs(terms.value("Cm", "alpha")) or 0.5,
        **{f"rate of {name}": value for name, value in flown.rates.items()},
    }
    # An airspeed that lags is told late; nobody asks for the one beyond the other.
    lagging = {f"skew.{flown.streams[name]}" for name in ("airspeed",) if name in flown.streams}
    return Quantities(
        terms.complete(),
        tuple(servos.changes),
        found,
        sizes,
        frozenset(has),
        streams,
        least,
        frozenset(frozenset({"airspeed_lag", name}) for name in lagging),
        beside,
        servos.sizes,
        servos.moving,
    )


def _least(aircraft: Aircraft, sensed: Iterable[str]) -> dict[str, float]:
    """What is less than nothing.

    A message before its time, the lag of a tube or servo or its play below zero, a lift slope that
    grows where the wing stalls, a propeller's stream that takes the tail's effect away.

    Args:
        aircraft: what its file states already.
        sensed: streams of measurements.
    """
    stated = {name: aircraft.streams.get(name, StreamTiming()).delay for name in sensed}
    least = {f"skew.{name}": -EARLY - delay for name, delay in stated.items()}
    least["airspeed_lag"] = -aircraft.pitot.error.lag
    for control in aircraft.controls:
        own = [one.time_constant for one in aircraft.servos if one.surface in control.mix]
        least[f"lag.{control.name}"] = -max(own, default=0.0)
        play = [one.backlash for one in aircraft.servos if one.surface in control.mix]
        least[f"backlash.{control.name}"] = -max(play, default=0.0)
    return least | {"wash": 0.0} | {f"stall.{knot:.4g}": 0.0 for knot in stall.CAUSE.places}


def with_term(found: Quantities, coefficient: str, text: str, *, sigma: float) -> Quantities:
    """With one more term, that the quantity `MISSING` is; `sigma` is what is believed of it."""
    terms = _Terms(found.aircraft)
    directions = {**found.directions, MISSING: {terms.name(coefficient, text): 1.0}}
    sizes = {**found.sizes, MISSING: sigma}
    return replace(found, aircraft=terms.complete(), directions=directions, sizes=sizes)


def servo_sizes(
    values: Mapping[str, float],
    before: Mapping[str, float],
    within: float = NEARLY,
    acting: Collection[str] = (),
    least: Mapping[str, float] | None = None,
) -> dict[str, float] | None:
    """Lags, play and delays among values of quantities, where they are not what was reckoned with.

    Where more was found than was reckoned with, there is more yet.

    Args:
        values: by name.
        before: what was reckoned with.
        within: share within which that is right.
        acting: what was told by what more of it does where it is: it is as much as was found.
        least: what cannot be less, by quantity: a servo may lag by less than its file says; None
            where nothing can.

    Returns:
        What to reckon with, as `reached` of `build`; None if what it was is near enough.
    """
    wanted = {}
    for name, value in values.items():
        usual = _usual(name)
        if usual is None:
            continue
        known = before.get(name, usual)
        lowest = (least or {}).get(name, 0.0)
        possible = _possible(value, usual, lowest)
        share = possible / known
        if share < 0.0 and possible * usual < 0.0:
            # From where a lag is longer, what a shorter one does is overrated.
            wanted[name] = max(possible, min(HALF * lowest, -LEAST * usual))
        elif share < 0.0:
            wanted[name] = possible
        elif abs(share - 1.0) > within:
            line = name in acting or possible * usual < 0.0
            grown = share if line else share ** GROWS[name.partition(".")[0]]
            size = known * min(max(grown, 0.25), 2.0)
            wanted[name] = LEAST * usual if 0.0 < size / usual < LEAST else size
    return {**before, **wanted} if wanted else None


def servo_doubt(
    name: str, value: float, reached: Mapping[str, float], acting: Collection[str] = ()
) -> float:
    """How far it may be off since its change was taken at another size; else 0.

    Args:
        name: of the quantity.
        value: found.
        reached: what was reckoned with.
        acting: what was told by what more of it does where it is, off by the square only.
    """
    usual = _usual(name)
    if usual is None:
        return 0.0
    size = reached.get(name, usual)
    off = min(abs(value - size), abs(value))
    return off * min(off / abs(size), 1.0) if name in acting else off


def _possible(size: float, usual: float, least: float) -> float:
    """At which size the change of a servo's quantity is taken, where one is found.

    Where there is little of it, or would be less than nothing, at a small one: that is as good as a
    line. Of a lag that is less than the file's some is always left.
    """
    slight = LEAST * usual
    if size / usual >= LEAST:
        return size
    there = max(size, NEXT_TO_NONE * least)
    return there if there < 0.0 < usual and there <= -slight else slight


def _usual(name: str) -> float | None:
    """Size at which the change of a servo's quantity is first taken; None for other quantities."""
    kind, _, which = name.partition(".")
    place = which.partition(".")[2]
    if kind == "skew" and place:
        return float(place)
    return SERVO.get(kind)


def _late(aircraft: Aircraft, delay: float) -> Aircraft:
    """The aircraft whose servo commands come later than its file says [s]."""
    stated = aircraft.streams.get(SERVO_STREAM, StreamTiming())
    timing = replace(stated, delay=stated.delay + delay)
    return replace(aircraft, streams={**aircraft.streams, SERVO_STREAM: timing})


def _lagging(control: str) -> Callable[[Aircraft, float], Aircraft]:
    """An aircraft into one with so much more lag [s] of a control."""
    return lambda one, more: servo_changes.changed(one, control, servo_changes.lag(more))


def _strongest(terms: _Terms, coefficient: str, other_than: str | None = None) -> str | None:
    """The control with the greatest slope in a coefficient."""
    sizes = {
        name: abs(terms.value(coefficient, name))
        for name in terms.aircraft.control_names
        if name != other_than
    }
    best = max(sizes, key=sizes.__getitem__, default=None)
    return best if best is not None and sizes[best] > 0.0 else None


def _wash(terms: _Terms) -> Direction:
    """Effect of the tail, the controls for pitch and yaw, that grows with thrust."""
    roll = _strongest(terms, "Cl")
    tail = {_strongest(terms, "Cm"), _strongest(terms, "Cn", other_than=roll)} - {None}
    return {
        terms.name(coefficient, f"{key}*Tc"): WASH * value
        for control in sorted(name for name in tail if name)
        for coefficient, key, value in terms.of(control)
    }


def _aeroelastic(
    terms: _Terms,
    own: Iterable[tuple[str, str, float]],
    qbar: Float[np.ndarray, " sample"],
) -> Direction:
    """1 + loss·log2(q̄/q̄ref) as a parabola in q̄ over the dynamic pressures flown.

    A line is off by up to 0.08 of the loss where the highest speed is 1.5 times the lowest, a
    parabola by 0.01.
    """
    middle = float(np.median(qbar))
    relative = qbar / middle
    powers = np.stack([np.ones_like(qbar), relative, relative**2], axis=1)
    level, slope, bend = np.linalg.lstsq(powers, np.log2(relative), rcond=None)[0]
    direction: dict[str, float] = {}
    for coefficient, key, value in own:
        direction[f"aerodynamics.{coefficient}.{key}"] = float(level) * value
        direction[terms.name(coefficient, f"{key}*qbar")] = float(slope) / middle * value
        direction[terms.name(coefficient, f"{key}*qbar^2")] = float(bend) / middle**2 * value
    return direction


def influence(height_over_span: np.ndarray) -> np.ndarray:
    """Share of the induced drag that the ground takes away, exp(-2.48·(2h/b)^0.768).

    Torenbeek, *Synthesis of Subsonic Airplane Design*, 1982, appendix G-7.
    """
    return np.exp(-2.48 * (2.0 * height_over_span) ** 0.768)


def _ground(terms: _Terms) -> dict[str, Direction]:
    """Lift, drag and moment that come with the ground's influence, as lines between `KNOTS`."""
    heights = np.linspace(0.01, 1.2, 120)
    columns = np.stack([np.maximum(0.0, knot - heights) for knot in KNOTS], axis=1)
    weights = np.linalg.lstsq(columns, influence(heights), rcond=None)[0]
    shape = terms.aircraft.geometry
    aspect = math.pi * shape.wing_span**2 / shape.wing_area
    level, slope = terms.value("CZ", "1"), terms.value("CZ", "alpha")
    square = (level**2 / aspect, 2.0 * level * slope / aspect, slope**2 / aspect)
    wanted = {
        "lift": ("CZ", (level, slope)),
        "drag": ("CX", square),
        "moment": ("Cm", (level, slope)),
    }
    powers = ("", "*alpha", "*alpha^2")
    return {
        f"ground.{name}": {
            terms.name(coefficient, f"max(0, {knot:g} - h_over_b){power}"): float(weight) * value
            for knot, weight in zip(KNOTS, weights, strict=True)
            for power, value in zip(powers, values, strict=False)
        }
        for name, (coefficient, values) in wanted.items()
    }


def candidates(causes: Mapping[str, Cause], found: Quantities) -> tuple[Candidate, ...]:
    """Every cause that these quantities give sense to, once for all that it may be about.

    Of a single derivative only where nothing else is the same: where a control moves one
    coefficient alone, that derivative is the control's effect.
    """

    def there(candidate: Candidate) -> bool:
        return any(any(found.directions[name].values()) for name in candidate.frees)

    listed = []
    for cause in causes.values():
        if cause.needs and cause.needs not in found.has:
            continue
        for about, places in _abouts(cause, found).items():
            same = ()
            if cause.about == "control":
                same = servo_changes.together(found.aircraft, about)
            for at in places:
                if there(Candidate(cause, about, at)):
                    also = [one for one in same if not there(Candidate(cause, one, at))]
                    listed.append(Candidate(cause, about, at, tuple(also)))
    others = [
        found.directions[one.frees[0]]
        for one in listed
        if one.cause.about != "derivative" and len(one.frees) == 1
    ]

    def told_already(one: Candidate) -> bool:
        moved = {name for name, weight in found.directions[one.frees[0]].items() if weight}
        same = ({name for name, weight in other.items() if weight} == moved for other in others)
        return one.cause.about == "derivative" and any(same)

    return tuple(one for one in listed if not told_already(one))


def _abouts(cause: Cause, found: Quantities) -> Mapping[str, tuple[float | None, ...]]:
    """What a cause may be about, and the places where its effect is taken."""
    places = cause.places or (None,)
    match cause.about:
        case "control":
            return dict.fromkeys(found.aircraft.control_names, places)
        case "derivative":
            prefix = "derivative."
            named = (name for name in found.directions if name.startswith(prefix))
            return {name.removeprefix(prefix): places for name in named}
        case "stream":
            return found.streams
        case _:
            return {"": places}


def names(means: Means) -> tuple[str, ...]:
    """Of the model's parameters, in the order of `ravel_pytree`."""
    listed: list[str] = []
    for path, leaf in jax.tree_util.tree_flatten_with_path(means)[0]:
        base = ".".join(str(getattr(part, "name", getattr(part, "key", ""))) for part in path)
        shape = np.shape(leaf)
        listed += [base] if not shape else [f"{base}.{index}" for index in range(shape[0])]
    return tuple(listed)
