"""Turbulence to try a maneuver in, drawn many times.

The forms of Dryden for low altitude (MIL-F-8785C, 1980, section 3.7.2; the rotation in roll after
MIL-STD-1797A, appendix A), carried past the aircraft at its airspeed: longitudinal gusts and
rotation in roll are first-order processes, the other two second-order; pitching and yawing gusts
are high-passed copies of the vertical and the lateral ones.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy import signal

FOOT = 0.3048
LOWEST, HIGHEST = 10.0, 300.0
"""Heights [m] between which these forms hold."""
SETTLE = 500
"""Samples drawn before the first that is used, so that it is as likely as any other."""


def vertical_share(height: float) -> float:
    """Vertical over horizontal intensity at a height [m]."""
    feet = np.clip(height, LOWEST, HIGHEST) / FOOT
    return float(min(1.0, (0.177 + 0.000823 * feet) ** 0.4))


def draw(
    count: int,
    samples: int,
    *,
    horizontal: float,
    airspeed: float,
    height: float,
    span: float,
    step: float,
    generator: np.random.Generator,
) -> Float[np.ndarray, "draw sample six"]:
    """Gusts along the flight, across and down [m/s], and their rotation [rad/s].

    Args:
        count: of independent draws.
        samples: of each.
        horizontal: intensity of each horizontal component, one standard deviation [m/s].
        airspeed: at which they are flown through [m/s].
        height: above ground [m].
        span: of the wing [m].
        step: between samples [s].
        generator: of the noise.
    """
    feet = np.clip(height, LOWEST, HIGHEST) / FOOT
    vertical = horizontal * vertical_share(height)
    along = feet / (0.177 + 0.000823 * feet) ** 1.2 * FOOT
    deep = feet * FOOT
    noise = generator.standard_normal((4, count, SETTLE + samples))
    forward = horizontal * _first(noise[0], along / airspeed, step)
    across = horizontal * _second(noise[1], along / airspeed, step)
    down = vertical * _second(noise[2], deep / airspeed, step)
    rolling = 1.9 * vertical / np.sqrt(deep * span)
    roll = rolling * _first(noise[3], np.sqrt(deep * span) / (2.6 * airspeed), step)
    pitch = _carried(down, 4.0 * span / np.pi, airspeed, step)
    yaw = -_carried(across, 3.0 * span / np.pi, airspeed, step)
    found = np.stack([forward, across, down, roll, pitch, yaw], axis=-1)
    return found[:, SETTLE:]


def _first(
    noise: Float[np.ndarray, "draw sample"], time_constant: float, step: float
) -> Float[np.ndarray, "draw sample"]:
    """Unit variance, correlation e^(−t/T)."""
    keep = np.exp(-step / time_constant)
    return signal.lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], noise, axis=-1)


def _second(
    noise: Float[np.ndarray, "draw sample"], time_constant: float, step: float
) -> Float[np.ndarray, "draw sample"]:
    """Unit variance, spectrum (1 + 3 (ωT)²)/(1 + (ωT)²)²."""
    root = np.sqrt(3.0)
    transfer = ([root * time_constant, 1.0], [time_constant**2, 2.0 * time_constant, 1.0])
    top, bottom, _ = signal.cont2discrete(transfer, step, method="bilinear")
    # The variance of the discrete filter by its impulse response, not by the continuous formula.
    impulse = np.zeros(round(20.0 * time_constant / step))
    impulse[0] = 1.0
    size = np.sqrt(np.sum(signal.lfilter(top[0], bottom, impulse) ** 2))
    return signal.lfilter(top[0] / size, bottom, noise, axis=-1)


def _carried(
    gust: Float[np.ndarray, "draw sample"], length: float, airspeed: float, step: float
) -> Float[np.ndarray, "draw sample"]:
    """s/V / (1 + s·length/V) of a gust: the rotation of a field that is carried past [rad/s]."""
    keep = np.exp(-step * airspeed / length)
    high = signal.lfilter([keep, -keep], [1.0, -keep], gust, axis=-1)
    return high / length
