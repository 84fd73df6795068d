"""What aerodynamics inside the filter do for the flow angles, and what they are found to be.

Long: run it apart. `--minutes M` fits the first M minutes only.
"""

from __future__ import annotations

import argparse
import sys
import time as clock
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file, frames  # noqa: E402 - found from ROOT
from gcs_sysid.aircraft import COEFFICIENTS, Aircraft  # noqa: E402
from gcs_sysid.estimate import filter_error  # noqa: E402
from gcs_sysid.estimate.filter_error import Fit, Flight  # noqa: E402
from gcs_sysid.model import rigid_body  # noqa: E402
from gcs_sysid.model.aided import State  # noqa: E402
from gcs_sysid.offline import aided_flight  # noqa: E402
from gcs_sysid.reconstruct import aided_smoother  # noqa: E402
from gcs_sysid.reconstruct.aided_smoother import FlightModel  # noqa: E402
from gcs_sysid.sources.registry import open_recording  # noqa: E402
from tests.benchmarks import table  # noqa: E402
from tests.reconstruct import truth  # noqa: E402

CASES = ROOT.parent / "shared" / "cases"
SETTLED = 5.0
"""Seconds at both ends that are not scored."""
WRONG = 0.3
Terms = dict[str, dict[str, float]]


def terms_of(aircraft: Aircraft, error: float) -> Terms:
    """The file's derivatives, each wrong by `error` of itself, up or down."""
    rng = np.random.default_rng(3)
    return {
        name: {
            key: item.value * (1.0 + error * rng.choice([-1.0, 1.0]))
            for key, item in model.terms.items()
        }
        for name, model in aircraft.aerodynamics.items()
    }


def known(case: Path) -> dict[str, np.ndarray]:
    """Truth by column, and `time` in seconds of the recording."""
    with np.load(case / "truth.npz") as file:
        columns = {str(name): file["rows"][:, i] for i, name in enumerate(file["cols"])}
        begun = int(file["t0_us"])
    epoch = open_recording(case / "flight.tlog").epoch_us
    return {**columns, "time": columns["t"] + (begun - epoch) * 1e-6}


def flow_errors(states: State, time: np.ndarray, true: dict[str, np.ndarray]) -> tuple[float, ...]:
    """Error of angle of attack and sideslip, rms [deg]."""
    through = states.velocity - states.air.wind - states.air.gust
    _, *angles = frames.flow_angles(frames.unrotate(states.attitude, through))
    inside = (time > time[0] + SETTLED) & (time < time[-1] - SETTLED)
    errors = [
        found - np.interp(time, true["time"], true[name])
        for name, found in zip(("alpha", "beta"), angles, strict=True)
    ]
    return tuple(float(np.rad2deg(np.sqrt(np.mean(error[inside] ** 2)))) for error in errors)


def model_errors(aircraft: Aircraft, fit: Fit, true: dict[str, np.ndarray]) -> dict[str, float]:
    """100·std(model − true)/std(true) at the true regressors of a flight."""
    shape, half = aircraft.geometry, 0.5 / true["V"]
    flow = {
        **{name: true[name] for name in ("alpha", "beta", "V", *aircraft.control_names)},
        "phat": true["p_air"] * shape.wing_span * half,
        "qhat": true["q_air"] * shape.mean_chord * half,
        "rhat": true["r_air"] * shape.wing_span * half,
    }
    flow = {name: jnp.asarray(values) for name, values in flow.items()}
    values = rigid_body.parameters(aircraft)
    wanted = rigid_body.coefficients(aircraft, values, flow)
    found = values._replace(aerodynamics=fit.unknowns.means.aerodynamics)
    off = rigid_body.coefficients(aircraft, found, flow) - wanted
    shares = 100.0 * np.std(np.asarray(off), axis=0) / np.std(np.asarray(wanted), axis=0)
    return dict(zip(COEFFICIENTS, map(float, shares), strict=True))


def within(fit: Fit, true: Terms) -> str:
    """How many intervals hold what flew."""
    deviation = np.sqrt(np.diagonal(fit.covariance))
    found = fit.unknowns.means.aerodynamics
    held = 0
    for (name, key), size in zip(fit.keys, deviation, strict=True):
        off = float(found[name][key]) - true[name][key]
        held += bool(abs(off) < 2.0 * size)
        print(
            f"{name}_{key}: {float(found[name][key]):.4g} +- {size:.2g}, flew {true[name][key]:.4g}"
        )
    return f"{held} of {len(fit.keys)}"


def shortened(flight: Flight, minutes: float) -> Flight:
    count = int(np.searchsorted(np.cumsum(flight.rows.step), 60.0 * minutes))

    def cut(values: np.ndarray) -> np.ndarray:
        return np.asarray(values)[:count]

    return Flight(
        jax.tree.map(cut, flight.rows), jax.tree.map(cut, flight.nominal), flight.beginning
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--fit", action="store_true")
    parser.add_argument("--save", action="store_true")
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    if not CASES.is_dir():
        print("filter error: no flights of known truth beside the checkout")
        return
    case = CASES / "clean"
    aircraft = aircraft_file.load(case / "aircraft.toml")
    recording = open_recording(case / "flight.tlog")
    states = truth.reconstructed(case / "flight.tlog", case / "aircraft.toml")
    true = known(case)
    flight = shortened(aided_flight.prepare(recording, aircraft, states), asked.minutes)
    time = states.time[0] + np.cumsum(flight.rows.step)
    rows = [("kinematic, no aerodynamics", *flow_errors(flight.nominal, time, true))]
    for error in (0.0, WRONG):
        terms = terms_of(aircraft, error)
        first = aided_flight.first_unknowns(flight, states, terms)
        model = FlightModel(aided_flight.with_structure(aircraft, terms))
        smoothed, _ = aided_smoother.iterated(
            model, *first, flight.rows, flight.nominal, flight.beginning, rounds=4
        )
        rows.append((f"derivatives {100 * error:.0f} % wrong", *flow_errors(smoothed, time, true)))
    if asked.fit:
        none = {name: dict.fromkeys(values, np.inf) for name, values in terms.items()}
        prior, sigma = aided_flight.beliefs(first, aircraft, vanes=False, known=none)
        begun = clock.perf_counter()
        fit = filter_error.fit(model, flight, first, prior, sigma, print)
        seconds = clock.perf_counter() - begun
        rows.append(("filter error, from there", *flow_errors(fit.states, time, true)))
        errors = model_errors(aircraft, fit, known(CASES / "clean_second"))
        table.show(
            "filter_error_models",
            f"Filter error on clean from derivatives {100 * WRONG:.0f} % wrong, no prior: error at "
            f"the true regressors of clean_second in % of the spread ({seconds:.0f} s, "
            f"{asked.minutes:g} minutes, {'converged' if fit.converged else 'not converged'})",
            (*COEFFICIENTS, "derivatives within 2 sd"),
            [
                [
                    *(f"{errors[name]:.1f}" for name in COEFFICIENTS),
                    within(fit, terms_of(aircraft, 0.0)),
                ]
            ],
        )
    table.show(
        "filter_error",
        "Flow angles on clean (gusts of 3 m/s, no vanes) with the aerodynamics inside the filter, "
        "before any fit",
        ("filter", "alpha rms [°]", "beta rms [°]"),
        [(name, f"{alpha:.2f}", f"{beta:.2f}") for name, alpha, beta in rows],
    )


if __name__ == "__main__":
    main()
