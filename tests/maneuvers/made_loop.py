"""A made-up flight in gusts under an autopilot's hold of known gains."""

from __future__ import annotations

import numpy as np
from scipy import signal

from gcs_sysid.maneuvers.flown_hold import Flight

STEP, SECONDS, AIRSPEED, GRAVITY = 0.02, 60.0, 20.0, 9.81
PRESSURE = 0.5 * 1.2 * AIRSPEED**2
GAIN = {"p": 0.05, "phi": 0.4, "psi": 0.5}


def flown(*, seed: int = 0, pulses: int = 8, size: float = 0.1) -> Flight:
    """Rolls in gusts under `GAIN`, pulses of a second on top; pitch follows a target nobody tells.

    The servos are those of the made-up aircraft: 20 ms of delay, 40 ms of lag.
    """
    generator = np.random.default_rng(seed)
    count = round(SECONDS / STEP)
    added = np.zeros(count)
    for begin in np.linspace(2.0, SECONDS - 4.0, pulses):
        first = round(begin / STEP)
        added[first : first + 25], added[first + 25 : first + 50] = size, -size
    push = 4.0 * generator.standard_normal(count)
    target = 0.1 * np.cumsum(generator.standard_normal(count)) * np.sqrt(STEP)
    turned, moved = np.zeros((count, 6)), np.zeros((count, 2))
    roll = pitch = np.zeros(2)
    heading, yaw = 0.0, signal.lfilter([0.1], [1.0, -0.9], 0.1 * generator.standard_normal(count))
    asked = [np.zeros(2), np.zeros(2)]
    surfaces = np.zeros(2)
    for row in range(count):
        turning = GRAVITY / AIRSPEED * roll[1] + yaw[row]
        turned[row] = roll[0], pitch[0], turning, roll[1], pitch[1], heading
        moved[row] = surfaces
        answer = GAIN["p"] * roll[0] + GAIN["phi"] * roll[1] + GAIN["psi"] * heading
        elevator = 0.1 * pitch[0] + 0.3 * (pitch[1] - target[row])
        asked.append(np.array([elevator, added[row] - answer]))
        surfaces = surfaces + (1.0 - np.exp(-STEP / 0.04)) * (asked[row + 1] - surfaces)
        heading += STEP * turning
        roll = roll + STEP * np.array([-8.0 * roll[0] + 60.0 * surfaces[1] + push[row], roll[0]])
        pitch = pitch + STEP * np.array([-6.0 * pitch[0] - 40.0 * surfaces[0], pitch[0]])
    controls = {"elevator": moved[:, 0], "aileron": moved[:, 1], "rudder": np.zeros(count)}
    return Flight(STEP * np.arange(count), np.full(count, PRESSURE), controls, turned)
