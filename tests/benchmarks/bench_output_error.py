"""Output error beside aeroid's: clean short-period flights, and gusts that neither model knows."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import aeroid  # noqa: E402 - needs the path above
import jax  # noqa: E402 - likewise
import numpy as np  # noqa: E402 - likewise

from gcs_sysid.estimate.output_error import OutputError, Records  # noqa: E402 - likewise
from tests.benchmarks import table  # noqa: E402 - likewise
from tests.estimate.made_short_period import (  # noqa: E402 - likewise
    NAMES,
    NOISE,
    STEP,
    TRUE,
    elevator,
    flights,
    flown,
    model,
)

FAR = 0.6 * TRUE
CLEAN = range(10)
GUSTY = range(300, 340)
GUST = 0.017
"""One degree, as an angle of attack."""


@dataclass(frozen=True)
class Answer:
    """What a code says of one flight, and the CPU time that it took [s]."""

    value: np.ndarray
    deviation: np.ndarray
    seconds: float


Code = Callable[[Records], Answer]


def ours() -> Code:
    """This program: compiled in the first call."""
    estimator = OutputError(model(), free_start=(0, 1))

    def answer(records: Records) -> Answer:
        begun = time.process_time()
        found = estimator.fit(records, FAR)
        assert found.status == "converged", found.status
        return Answer(found.value, found.deviation, time.process_time() - begun)

    return answer


def theirs(gradient: str) -> Code:
    """aeroid with its own defaults and the noise's true weights."""

    def dynamics(t, state, inputs, parameters):
        alpha, q = state
        xp = np if gradient == "fd" else jax.numpy
        return xp.array(
            [
                parameters["Z_alpha"] * alpha + q,
                parameters["M_alpha"] * alpha
                + parameters["M_q"] * q
                + parameters["M_delta"] * inputs[0],
            ]
        )

    start = {name: float(value) for name, value in zip(NAMES, FAR, strict=True)}
    known = aeroid.Model(
        states=["alpha", "q"], controls=["elevator"], parameters=start, dynamics=dynamics
    )
    weights = {name: 1.0 / float(size) for name, size in zip(("alpha", "q"), NOISE, strict=True)}

    def answer(records: Records) -> Answer:
        measured = records.measured[0]
        data = aeroid.FlightData(
            time=STEP * np.arange(len(measured)),
            channels={
                "alpha": measured[:, 0],
                "q": measured[:, 1],
                "elevator": records.inputs[0, :, 0],
            },
        )
        begun = time.process_time()
        found = aeroid.identify(known, data, list(NAMES), weights=weights, gradient=gradient)
        seconds = time.process_time() - begun
        return Answer(
            np.array([found.parameters[name] for name in NAMES]),
            np.array([found.stderr[name] for name in NAMES]),
            seconds,
        )

    return answer


def held_out(value: np.ndarray) -> float:
    """Error on another maneuver, in percent of the motion's spread: the mean of both outputs."""
    command = np.convolve(elevator(20.0, 0.04)[::-1, 0], np.ones(9) / 9.0, "same")[:, None]
    start = np.array([0.0, 0.0])
    truth, said = flown(command, start), flown(command, start, truth=value)
    return float(100.0 * np.mean((said - truth).std(axis=0) / truth.std(axis=0)))


def gusty(seed: int) -> Records:
    """A minute of 3-2-1-1s in gusts."""
    return flights(seed, seconds=(60.0,), gust=GUST)


def main() -> None:
    """Both codes on the same flights, in this order in the same run."""
    jax.config.update("jax_enable_x64", True)
    codes = {
        "gcs-sysid": ours(),
        "aeroid 0.5.0": theirs("fd"),
        "aeroid 0.5.0, its JAX gradient": theirs("jax"),
    }
    clean_rows, gust_rows = [], []
    for name, code in codes.items():
        exact = code(flights(0, noise=0.0))
        clean = [code(flights(seed)) for seed in CLEAN]
        clean_rows.append(
            (
                name,
                f"{held_out(exact.value):.2g} %",
                f"{np.mean([held_out(one.value) for one in clean]):.2f} %",
                f"{max(held_out(one.value) for one in clean):.2f} %",
                f"{exact.seconds:.2f} s",
                f"{np.median([one.seconds for one in clean]):.3f} s",
            )
        )
    table.show(
        "output_error_clean",
        f"Output error, short period of 20 s at 50 Hz: held-out error, {len(CLEAN)} noisy flights",
        ("code", "no noise", "noise", "worst", "CPU, first fit", "CPU, each further"),
        clean_rows,
    )
    # By finite differences it finds the same in a quarter of an hour.
    del codes["aeroid 0.5.0"]
    for name, code in codes.items():
        found = [code(gusty(seed)) for seed in GUSTY]
        ratio = np.array([(one.value - TRUE) / one.deviation for one in found])
        gust_rows.append(
            (
                name,
                f"{np.sqrt(np.mean(ratio**2)):.1f}",
                f"{np.abs(ratio).max():.1f}",
                f"{100.0 * np.mean(np.abs(ratio) < 1.96):.0f} %",
                f"{np.mean([held_out(one.value) for one in found]):.1f} %",
            )
        )
    table.show(
        "output_error_gust",
        f"A minute in gusts of 1° that the model does not know, {len(GUSTY)} flights: "
        "errors in stated deviations",
        ("code", "rms", "largest", "95 % intervals hold", "held-out error"),
        gust_rows,
    )


if __name__ == "__main__":
    main()
