"""How much the filter's innovations tell of each coefficient, by frequency.

About level flight the filter of `reconstruct.causal` becomes a stationary linear system. A
coefficient that is off by x(t) adds to the innovations, whitened by the root of their covariance,

    e(f) = T_c(f) x_c(f)

and a flight in which derivative i takes the part x_i,c(t) in coefficient c tells

    H_ij = Σ_f x_i,c*(f) W_cd(f) x_j,d(f),    W_cd = T_c* T_d

of derivatives i and j: `causal`'s H = Σ Jᵀ S⁻¹ J by Parseval's theorem. Gusts that nobody sees make
slow and quick motion count unlike, and what is unknown of the flow angles ties coefficients to each
other: both are in W, and nothing in it is fitted.

Errors of the sensors take part, of which some bend what derivatives seem to be: an airspeed that is
off by a share ε makes all forces and moments seem (1 + 2ε) times as large, those of rates and flow
angles (1 + ε) times, since these seem so much smaller themselves; surfaces that come late by τ are
off by τ·dδ/dt, and a vane that shows too much by a share ε is off by ε·α.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Complex, Float, Int

from gcs_sysid import regressors
from gcs_sysid.aircraft import Aircraft, CoefficientModel, Value
from gcs_sysid.estimate import basis, in_common
from gcs_sysid.estimate.basis import Values
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.model import aided
from gcs_sysid.model.aided import Means, Noise, Row, Sensors, State
from gcs_sysid.model.air import Air
from gcs_sysid.model.flight_model import FlightModel
from gcs_sysid.model.kinematics import Measurements
from gcs_sysid.model.trim import Trim
from gcs_sysid.reconstruct import aided_smoother, causal
from gcs_sysid.reconstruct.aided_smoother import CHUNK, Chunk

GROUPS = ("airspeed", "velocity", "attitude", "vanes")
"""Rows of the innovation that do not come with every row of the inertial unit."""
CONSTANT = ("gyro_bias", "accelerometer_bias", "airspeed_scale", "vane_bias")
"""Errors of the sensors that add to the innovations of level flight."""
ERRORS = (*CONSTANT, "vane_scale", "surface_delay")
"""All that take part, in this order behind the derivatives."""
CONSTANTS, AIRSPEED, VANES, VANE_SCALES, DELAY = 9, 6, 7, 9, 11
"""How many of them are constant, and where some lie."""
SETTLED = 60.0
"""Of flight after which the filter's gains are looked at [s]. Begun from a state that is known, or
from one that nobody knows, they make densities that differ by 1 % at most, at frequency zero."""
SLOWEST, FREQUENCIES = 1e-3, 200
"""Lowest frequency but zero [Hz], and how many there are up to half the rate of the rows."""
INSIDE = 5
"""Row of the chunk that is looked at: all are the same but the first, which has no step."""
LEAST_GUST = 0.01
"""Air is never calmer [m/s]."""
CHANGE = 1e-4
"""Relative change of the airspeed, and delay of the surfaces [s], from which slopes are taken."""
INVERSE = ("alpha", "beta", "phat", "qhat", "rhat", "alphadot_hat")
"""Variables that go with one over the airspeed where the motion is as it is."""


class Sensing(NamedTuple):
    """What a filter had to go by in a flight.

    Attributes:
        step: between rows, samples of the inertial unit [s].
        shares: of the rows that came with each of `GROUPS`.
        log_noise: intensities.
        deviation: one standard deviation of what it found of the sensors' errors.
    """

    step: float
    shares: Float[np.ndarray, " group"]
    log_noise: Noise
    deviation: Sensors

    def in_gusts(self, horizontal: float) -> Sensing:
        """The same in gusts of another horizontal intensity [m/s]."""
        air = self.log_noise.turbulence
        by = np.log(max(horizontal, LEAST_GUST)) - float(air.gust[0])
        air = air._replace(gust=air.gust + by, spin=air.spin + by)
        return self._replace(log_noise=self.log_noise._replace(turbulence=air))


def sensing(rows: Row, log_noise: Noise, deviation: Sensors) -> Sensing:
    """What a filter had to go by in one flight."""
    shares = np.asarray(rows.measured.valid, dtype=float)[np.asarray(rows.inertial)].mean(axis=0)
    noise, deviation = jax.tree.map(np.asarray, (log_noise, deviation))
    return Sensing(float(np.median(np.asarray(rows.step))), shares, noise, deviation)


def usual(flights: Sequence[Sensing]) -> Sensing:
    """What it had to go by on the whole: intensities are averaged as logarithms."""
    return jax.tree.map(lambda *parts: np.mean(np.stack(parts), axis=0), *flights)._replace(
        step=float(np.mean([one.step for one in flights]))
    )


@dataclass(frozen=True)
class Spectrum:
    """W of the module, and how well the errors beside the derivatives are known.

    Attributes:
        step: between rows [s].
        frequency: from zero to half their rate [Hz].
        density: W a row, channels being coefficients and then the errors that are constant.
        coefficients: of the first channels.
        precision: of `ERRORS`, one over variance.
        values: of the derivatives, by coefficient and regressor.
        controls: of the aircraft.
    """

    step: float
    frequency: Float[np.ndarray, " frequency"]
    density: Complex[np.ndarray, "frequency channel channel"]
    coefficients: tuple[str, ...]
    precision: Float[np.ndarray, " error"]
    values: Mapping[str, Mapping[str, float]]
    controls: tuple[str, ...]

    def information(
        self, model: AeroModel, flown: Values, step: float
    ) -> Float[np.ndarray, "unknown unknown"]:
        """What a flight tells of a model's derivatives and, behind them, errors.

        Args:
            model: whose terms are asked about, in the order of its fits.
            flown: every variable along it, `traces.names` among them; it begins and ends in the
                same level flight.
            step: between these samples [s].
        """
        parts = list(self._parts(model, flown))
        count = next(iter(flown.values())).size
        size = sum(len(fit.keys) for fit in model.fits.values()) + self.precision.size
        weight = np.full(count // 2, 2.0)
        if count % 2 == 0:
            weight[-1] = 1.0
        weight *= step / (count * self.step)
        density = self._at(np.fft.rfftfreq(count, step)[1:])
        waves = [np.fft.rfft(part.columns, axis=0) for part in parts]
        found = np.zeros((size, size))
        for one, wave in zip(parts, waves, strict=True):
            turned = (wave[1:].conj() * weight[:, None]).T
            for other, with_ in zip(parts, waves, strict=True):
                both = density[:, one.channel, other.channel, None] * with_[1:]
                found[np.ix_(one.unknowns, other.unknowns)] += (turned @ both).real
        # What does not change through the flight: there constant errors take part.
        total = np.zeros((size, self.density.shape[-1]))
        for part, wave in zip(parts, waves, strict=True):
            total[part.unknowns, part.channel] = wave[0].real
        for number in range(CONSTANTS):
            place = size - self.precision.size + number
            total[place, len(self.coefficients) + number] = count
        still = total @ self.density[0].real @ total.T
        return found + step / (count * self.step) * still

    def by_line(
        self, model: AeroModel, flown: Values, step: float, lines: Int[np.ndarray, " line"]
    ) -> Float[np.ndarray, "line unknown unknown"]:
        """What single harmonics of a motion that repeats itself tell, each in one period.

        Args:
            model: whose terms are asked about, as for `information`.
            flown: every variable along one period.
            step: between these samples [s].
            lines: harmonics.
        """
        count = next(iter(flown.values())).size
        size = sum(len(fit.keys) for fit in model.fits.values()) + self.precision.size
        waves = np.zeros((lines.size, self.density.shape[-1], size), dtype=complex)
        for part in self._parts(model, flown):
            waves[:, part.channel, part.unknowns] += np.fft.rfft(part.columns, axis=0)[lines]
        density = self._at(lines / (count * step))
        found = waves.conj().transpose(0, 2, 1) @ density @ waves
        return 2.0 * step / (count * self.step) * found.real

    def _at(
        self, frequency: Float[np.ndarray, " other"]
    ) -> Complex[np.ndarray, "other channel channel"]:
        """W between the frequencies at which it was found; above them as it is there."""
        after = np.clip(np.searchsorted(self.frequency, frequency), 1, self.frequency.size - 1)
        low, high = self.frequency[after - 1], self.frequency[after]
        share = np.clip((frequency - low) / (high - low), 0.0, 1.0)[:, None, None]
        return (1.0 - share) * self.density[after - 1] + share * self.density[after]

    def _parts(self, model: AeroModel, flown: Values) -> Iterator[_Part]:
        """What derivatives and errors are a part of, coefficient by coefficient."""
        first, errors = 0, sum(len(fit.keys) for fit in model.fits.values())
        rates = {name: flown[f"{name}_rate"] for name in self.controls}

        def later(by: float) -> Values:
            return {**flown, **{name: flown[name] + by * rates[name] for name in self.controls}}

        for name, fit in model.fits.items():
            numbers = np.arange(first, first + len(fit.keys))
            first += len(fit.keys)
            if name not in self.coefficients:
                continue
            own = self.values[name]
            value = np.array(list(own.values()))

            def total(at: Values, own: Mapping = own, value: np.ndarray = value) -> np.ndarray:
                return basis.columns(tuple(own), self.controls, at) @ value

            late = (total(later(-CHANGE)) - total(later(CHANGE))) / (2.0 * CHANGE)
            fast, slow = ((1.0 + by) ** 2 * total(_quicker(flown, by)) for by in (CHANGE, -CHANGE))
            grown = (fast - slow) / (2.0 * CHANGE)
            columns = basis.columns(fit.keys, model.controls, flown)
            yield _Part(
                self.coefficients.index(name),
                np.append(numbers, [errors + AIRSPEED, errors + DELAY]),
                np.column_stack([columns, grown[0] - grown, late]),
            )
        for number, angle in enumerate(("alpha", "beta")):
            yield _Part(
                len(self.coefficients) + VANES + number,
                np.array([errors + VANE_SCALES + number]),
                flown[angle][:, None],
            )


class _Part(NamedTuple):
    """What some unknowns are a part of in one channel, along a flight."""

    channel: int
    unknowns: Int[np.ndarray, " part"]
    columns: Float[np.ndarray, "sample part"]


def _quicker(flown: Values, by: float) -> dict[str, Float[np.ndarray, " sample"]]:
    """What variables would be were the airspeed larger by a share, and the motion what it is."""
    scaled = {name: flown[name] / (1.0 + by) for name in INVERSE if name in flown}
    return {**flown, **scaled}


def spectrum(
    aircraft: Aircraft, level: Trim, sensed: Sensing, coefficients: Sequence[str]
) -> Spectrum:
    """W about one level flight.

    Args:
        aircraft: its aerodynamics are those that the filter believes.
        level: the flight.
        sensed: what the filter has to go by.
        coefficients: asked about.
    """
    terms = {
        name: {regressors.CONSTANT: 0.0, **{key: one.value for key, one in model.terms.items()}}
        for name, model in aircraft.aerodynamics.items()
    }
    models = {
        name: CoefficientModel({key: Value(value, 0.0) for key, value in some.items()})
        for name, some in terms.items()
    }
    model = FlightModel(replace(aircraft, aerodynamics=models, beyond=None))
    sensors = jax.tree.map(lambda part: np.zeros(np.shape(part)), sensed.deviation)
    means = jax.tree.map(lambda part: jnp.asarray(part, jnp.float64), Means(terms, sensors))
    noise = jax.tree.map(lambda part: jnp.asarray(part, jnp.float64), sensed.log_noise)
    chunk = _level(aircraft, level, sensed)
    rows = aided_smoother.linearised(model, means, noise, chunk)
    asked = [
        in_common.derivative_keys(means.aerodynamics).index((name, regressors.CONSTANT))
        for name in coefficients
    ]
    asked += _places(means, CONSTANT)
    motion, seen = causal.sensitivities(model, means, noise, chunk, rows, np.asarray(asked))
    present = np.concatenate([np.ones(6, dtype=bool), np.repeat(sensed.shares > 0.0, _widths())])
    rare = np.concatenate([np.ones(6), np.repeat(np.maximum(sensed.shares, 1e-9), _widths())])
    frequency = np.concatenate([[0.0], np.geomspace(SLOWEST, 0.5 / sensed.step, FREQUENCIES)])
    transfer = _transfer(
        np.asarray(rows.transition[INSIDE]),
        np.asarray(rows.process[INSIDE]),
        np.asarray(rows.sensitivity[INSIDE])[present],
        (np.asarray(rows.variance[INSIDE]) / rare)[present],
        np.asarray(motion[INSIDE]),
        np.asarray(seen[INSIDE])[present],
        np.exp(2j * np.pi * frequency * sensed.step),
        rows=round(SETTLED / sensed.step),
    )
    known = [np.ravel(getattr(sensed.deviation, name)) for name in ERRORS]
    return Spectrum(
        step=sensed.step,
        frequency=frequency,
        density=np.einsum("fra,frb->fab", transfer.conj(), transfer),
        coefficients=tuple(coefficients),
        precision=np.maximum(np.concatenate(known), 1e-9) ** -2.0,
        values=terms,
        controls=tuple(aircraft.control_names),
    )


def _widths() -> list[int]:
    return [aided.ROWS[name].stop - aided.ROWS[name].start for name in GROUPS]


def _places(means: Means, names: Sequence[str]) -> list[int]:
    """Where errors of the sensors lie in the flat vector."""
    flat = np.arange(ravel_pytree(means)[0].size)
    numbered = ravel_pytree(means)[1](jnp.asarray(flat, jnp.float64)).sensors
    return [int(place) for name in names for place in np.ravel(getattr(numbered, name))]


def _level(aircraft: Aircraft, level: Trim, sensed: Sensing) -> Chunk:
    """Level flight as rows of the filter, in still air, everything measured."""
    none = np.zeros(3)
    state = State(
        attitude=np.asarray(level.state.attitude),
        velocity=np.asarray(level.state.velocity),
        rate=none,
        tube=np.array([level.airspeed]),
        air=Air(none, none, none, none),
        attitude_error=none,
        push=np.zeros(1),
        velocity_error=none,
        airspeed_error=np.zeros(1),
        gyro_error=none,
    )
    height = -float(level.state.position[2])
    thrice = np.ones((3, 1))
    row = Row(
        step=np.asarray(sensed.step),
        controls=thrice * np.asarray(level.controls),
        control_slopes=np.zeros((3, len(level.controls))),
        control_changes=np.zeros((3, len(level.controls), 0)),
        settings=thrice * np.asarray(level.settings),
        setting_changes=np.zeros((3, len(level.settings), 0)),
        density=np.asarray(level.density),
        height=np.asarray(height),
        climbed=np.asarray(0.0),
        passing=np.asarray(level.airspeed),
        gyro=none,
        accelerometer=none,
        inertial=np.asarray(True),
        modelled=np.asarray(True),
        measured=Measurements(
            airspeed=np.array([level.airspeed]),
            velocity=np.asarray(level.state.velocity),
            attitude=np.asarray(level.state.attitude),
            vanes=np.zeros(2),
            valid=np.ones(len(GROUPS), dtype=bool),
            age=np.zeros(len(GROUPS)),
        ),
    )
    every = jax.tree.map(
        lambda part: jnp.asarray(np.stack([np.asarray(part)] * CHUNK)), (state, row)
    )
    return Chunk(every[0], every[0], every[1])


def _transfer(
    transition: Float[np.ndarray, "state state"],
    process: Float[np.ndarray, "state state"],
    sensitivity: Float[np.ndarray, "row state"],
    variance: Float[np.ndarray, " row"],
    motion: Float[np.ndarray, "state channel"],
    seen: Float[np.ndarray, "row channel"],
    unit: Complex[np.ndarray, " frequency"],
    *,
    rows: int,
) -> Complex[np.ndarray, "frequency row channel"]:
    """T of the module: whitened innovations for each channel, by the filter's gains.

    A deviation s of the believed state follows s ← (1 − K H)(Φ s + B x) + K D x, and the innovation
    is D x − H(Φ s + B x).
    """
    belief = process
    for _ in range(rows):
        predicted = transition @ belief @ transition.T + process
        across = sensitivity @ predicted
        spread = across @ sensitivity.T + np.diag(variance)
        gain = np.linalg.solve(spread, across).T
        belief = predicted - gain @ across
        belief = 0.5 * (belief + belief.T)
    left = np.eye(len(transition)) - gain @ sensitivity
    inner = unit[:, None, None] * np.eye(len(transition)) - left @ transition
    added = left @ motion + gain @ seen
    believed = np.linalg.solve(inner, np.broadcast_to(added, (unit.size, *added.shape)))
    found = seen - sensitivity @ motion - sensitivity @ transition @ believed
    return np.linalg.solve(np.linalg.cholesky(spread), found)
