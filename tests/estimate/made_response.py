"""A short-period aircraft in gusts, with test inputs, an autopilot, or both; surfaces late."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from gcs_sysid.estimate.coefficients import Samples
from gcs_sysid.reconstruct import rates
from tests.estimate.made_problems import coloured

STEP = 0.02
COUNT = 4000
"""80 s: one block of the smoother."""
SMOOTHING = 3e5
TIME = STEP * np.arange(COUNT)


def inputs(generator: np.random.Generator) -> np.ndarray:
    """Doublets and 3-2-1-1s as commanded deflections [rad], some second apart."""
    command = np.zeros(COUNT)
    start = 100
    while start < COUNT - 300:
        width = int(generator.integers(12, 30))
        pattern = [1, -1] if generator.random() < 0.5 else [1, 1, 1, -1, -1, 1, -1]
        for sign in pattern:
            command[start : start + width] = 0.05 * sign
            start += width
        start += int(generator.integers(80, 200))
    return command


def at(command: np.ndarray, delay: float) -> np.ndarray:
    """A command as the air feels it: late, and through a servo of 50 ms."""
    fine = np.interp(TIME - delay, TIME, command)
    out = np.empty_like(fine)
    out[0] = fine[0]
    share = 1.0 - np.exp(-STEP / 0.05)
    for i in range(1, COUNT):
        out[i] = out[i - 1] + share * (fine[i] - out[i - 1])
    return out


def flight(
    delay: float,
    seed: int,
    *,
    amplitude: float = 1.0,
    gust: float = 0.0,
    feedback: float = 0.0,
    noise: float = 0.0,
) -> tuple[Samples, Callable[[float], dict[str, np.ndarray]]]:
    """Pitch only: q̇ = M_α (α + gust) + M_q q + M_δ δ, α̇ = q + Z_α (α + gust).

    The reconstruction sees α but not the gust; the autopilot answers q.
    """
    generator = np.random.default_rng(seed)
    test = amplitude * inputs(generator)
    air = gust * coloured(generator, COUNT, 0.98)
    steps = 4
    alpha = np.zeros(COUNT)
    pitch = np.zeros(COUNT)
    turn = np.zeros(COUNT)
    command = np.zeros(COUNT)
    felt = 0.0
    share = 1.0 - np.exp(-STEP / steps / 0.05)
    late = round(delay / STEP * steps)
    history = np.zeros(COUNT * steps)
    for i in range(COUNT - 1):
        command[i] = test[i] + feedback * pitch[i]
        history[i * steps : (i + 1) * steps] = command[i]
        a, q = alpha[i], pitch[i]
        for sub in range(steps):
            when = i * steps + sub - late
            # A negative delay looks ahead, which only a planned input allows.
            asked = history[max(when, 0)] if late >= 0 else test[min(when // steps, COUNT - 1)]
            felt += share * (asked - felt)
            push = -40.0 * (a + air[i]) - 6.0 * q - 90.0 * felt
            if sub == 0:
                turn[i] = push
            a, q = (
                a + STEP / steps * (q - 5.0 * (a + air[i])),
                q + STEP / steps * push,
            )
        alpha[i + 1], pitch[i + 1] = a, q
    turn[-1] = turn[-2]
    moment = rates.smooth(TIME, turn[:, None], SMOOTHING).value[:, 0]
    moment = moment + noise * coloured(generator, COUNT, 0.8)
    nothing = np.zeros(COUNT)
    samples = Samples(
        time=TIME,
        qbar=np.full(COUNT, 180.0),
        regressors={
            "alpha": alpha, "beta": nothing, "phat": nothing, "qhat": pitch, "rhat": nothing,
            "elevator": nothing,
        },
        regressor_variance={},
        measured={"Cm": moment},
        noise={"Cm": np.full(COUNT, max(noise, 1e-3))},
        mass_part={},
        thrust_part={},
        smoothing=SMOOTHING,
        refused={name: "not simulated" for name in ("CX", "CY", "CZ", "Cl", "Cn")},
    )  # fmt: skip
    return samples, lambda late: {"elevator": held(command, late)}


def held(command: np.ndarray, delay: float) -> np.ndarray:
    """What the program assumes of the surface for a given delay, a quarter of a step fine."""
    steps = 4
    fine = np.repeat(command, steps)
    share = 1.0 - np.exp(-STEP / steps / 0.05)
    when = np.arange(COUNT * steps) * STEP / steps - delay
    asked = fine[np.clip(np.floor(when / STEP * steps + 1e-9).astype(int), 0, fine.size - 1)]

    out = lfilter([share], [1.0, -(1.0 - share)], asked)
    return out[::steps]
