"""Elevator inputs for the short period beside those that aeroid designs: information, CPU time.

Both are asked for an elevator input that tells the short period of an aircraft of data/aircraft.
aeroid is given the linear model with its true values and designs a chirp and a doublet; ours gets
the model of a weak flight in gusts, and tries every input that it has for the elevator on 64
aircraft drawn of it. All are flown in the linear model, at the same largest elevator or angle of
attack, and told by aeroid's own Fisher information.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time as clock
import warnings
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.cli import numerics  # noqa: E402 - found from ROOT

numerics.keep_linear_algebra_in_one_thread()
numerics.enable()

import aeroid  # noqa: E402
import numpy as np  # noqa: E402

from gcs_sysid.aircraft import Aircraft  # noqa: E402
from gcs_sysid.maneuvers import (  # noqa: E402
    design,
    flown,
    information,
    recipes,
    sortie,
    target,
    tuned,
)
from gcs_sysid.maneuvers.design import Maneuver  # noqa: E402
from gcs_sysid.maneuvers.flown import LANES, Simulator  # noqa: E402
from gcs_sysid.maneuvers.recipes import SAMPLED  # noqa: E402
from gcs_sysid.offline import model_store, suggest  # noqa: E402
from gcs_sysid.offline.model_store import StoredModel  # noqa: E402
from gcs_sysid.sitl.slopes import Slopes, slopes  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.benchmarks.bench_suggest_cost import identified  # noqa: E402

AIRCRAFT = "ultra_stick_25e"
TURN = 2.0 * math.pi
STEP = 0.02
SECONDS = 15.0
"""Of what aeroid designs: as long as a multisine of ours."""
TAIL = 3.0
"""Answer after the input that is measured too [s]."""
NOISE = {"alpha": 0.003, "q": 0.006}
"""Of what is measured [rad, rad/s]."""
LARGEST = {"elevator": math.radians(5.0), "alpha": math.radians(5.0)}
STEPS = 40
"""Of its optimizer at most, a fifth of what it takes by itself: so, too, a chirp costs minutes."""
PARAMETERS = ("Z_alpha", "M_alpha", "M_q", "M_delta")


class Designed(NamedTuple):
    """An elevator input and what designing it cost.

    Attributes:
        name: of the maneuver.
        elevator: every `STEP`, of any size.
        seconds: of CPU time.
    """

    name: str
    elevator: np.ndarray
    seconds: float


def main() -> None:
    """Both designs for one aircraft."""
    with tempfile.TemporaryDirectory() as place:
        stored = model_store.load(identified(AIRCRAFT, Path(place)))
    believed = suggest._aircraft(stored, Path(place))
    airspeed = _airspeed(believed)
    short = slopes(believed, airspeed)
    linear = model(short)
    ours(stored, believed, airspeed, short.pitch_name)  # compiles
    designed = [
        *(("ours", one) for one in ours(stored, believed, airspeed, short.pitch_name)),
        *(("aeroid 0.5.0", one) for one in theirs(linear, short)),
    ]
    table.show(
        "design",
        f"Elevator inputs for the short period of {AIRCRAFT} ({short.short_period / TURN:.1f} Hz): "
        "information a second (root of the determinant, in units of the values) where each is as "
        "large as lets the elevator or the angle of attack move by 5°; ours in the order in which "
        "`suggest` would take them, the CPU time that of all of them",
        ("input", "by elevator", "by angle of attack", "CPU"),
        [
            (
                f"{who}: {one.name.replace('_', ' ')}",
                *(f"{_information(linear, one, limit):.3g}" for limit in LARGEST),
                f"{one.seconds:.1f} s",
            )
            for who, one in designed
        ],
    )


def _airspeed(aircraft: Aircraft) -> float:
    assert aircraft.envelope is not None
    low, high = aircraft.envelope.airspeed
    return low + suggest.SPEEDS[1] * (high - low)


def ours(stored: StoredModel, aircraft: Aircraft, airspeed: float, elevator: str) -> list[Designed]:
    """Elevator inputs that are safe, that with the most worth for its flight time first."""
    begun = clock.process_time()
    generator = np.random.default_rng(0)
    drawn = flown.draws(aircraft, stored.model, generator, LANES * design.TRIALS)
    at = design.condition(
        aircraft,
        stored.model,
        Simulator(aircraft),
        drawn,
        suggest._trim(aircraft, airspeed),
        gust=0.5,
        generator=generator,
    )
    asked = target.derivatives(stored.model, ("Cm",))
    start = information.nothing(stored.model)
    made = tuned.recipe(at, tuned.probed(at).on((elevator,)), asked, start, SECONDS)
    ready = [one for one in recipes.every(at.place()) if one.moved == (elevator,)]
    tried = [design.sized(at, one) for one in (*ready, made) if one is not None]
    safe = [one for one in tried if isinstance(one, Maneuver)]
    ranked = sortie.ranked(asked, stored.model, start, safe)
    seconds = clock.process_time() - begun
    column = at.place().names.index(elevator)
    return [Designed(one.recipe.name, one.added[:, column], seconds) for _, one in ranked]


def model(short: Slopes) -> aeroid.Model:
    """The short period, with true values."""

    def dynamics(t, state, inputs, parameters):
        alpha, q = state
        return np.array(
            [
                parameters["Z_alpha"] * alpha + q,
                parameters["M_alpha"] * alpha
                + parameters["M_q"] * q
                + parameters["M_delta"] * inputs[0],
            ]
        )

    values = (-short.lift, short.pitch_stiffness, short.pitch_damping, short.pitch_control)
    return aeroid.Model(
        states=["alpha", "q"],
        controls=["elevator"],
        parameters=dict(zip(PARAMETERS, values, strict=True)),
        dynamics=dynamics,
    )


def theirs(linear: aeroid.Model, short: Slopes) -> list[Designed]:
    """aeroid's designs by the quicker of its two optimizers.

    Its multisines are left out: within bounds of every line's amplitude each is as large as may be.
    """
    most, natural = LARGEST["elevator"], short.short_period / TURN
    size = (0.1 * most, most)
    width = (0.1 / natural, 1.0 / natural)
    families = {
        f"chirp, up to {SAMPLED:.0f} Hz": aeroid.Chirp(
            "elevator", size, (0.05, 0.5 * SAMPLED), (0.1, 0.5 * SAMPLED)
        ),
        "doublet": aeroid.Doublet("elevator", size, width),
    }
    return [_designed(linear, name, family) for name, family in families.items()]


def _designed(linear: aeroid.Model, name: str, family: Any) -> Designed:
    begun = clock.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        made = aeroid.design_experiment(
            *(linear, family, list(PARAMETERS)),
            duration=SECONDS,
            sample_rate=1.0 / STEP,
            noise=NOISE,
            optimizer="nelder-mead",
            optimizer_options={"maxiter": STEPS},
        )
    return Designed(name, made.controls["elevator"], clock.process_time() - begun)


def _information(linear: aeroid.Model, one: Designed, limit: str) -> float:
    """Root of the determinant of the information a second, at the largest size."""
    rest = np.zeros(round(TAIL / STEP))
    elevator = np.concatenate([one.elevator, rest])
    data = aeroid.FlightData(time=STEP * np.arange(elevator.size), channels={"elevator": elevator})
    peak = np.abs(one.elevator).max()
    if limit == "alpha":
        moved = linear.simulate_data(data, dict(linear.parameters), x0=[0.0, 0.0])
        peak = np.abs(moved.outputs[:, 0]).max()
    told = aeroid.sensitivities(linear, data, list(PARAMETERS), noise=NOISE, x0=[0.0, 0.0])
    size = LARGEST[limit] / peak
    values = np.array([linear.parameters[name] for name in PARAMETERS])
    scaled = told.fisher_information * np.outer(values, values) * size**2
    root = np.linalg.det(scaled) ** (1.0 / len(PARAMETERS))
    return float(root / (elevator.size * STEP))


if __name__ == "__main__":
    main()
