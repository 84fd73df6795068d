"""A made-up flight with realistic numbers, for looking at reports and for testing them.

`python tests/report/example.py OUT.html` writes its page.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

DERIVATIVES = {
    "CX": {"1": -0.045, "alpha": 0.21, "alpha^2": 2.7, "elevator": -0.014},
    "CY": {"beta": -0.46, "phat": -0.03, "rhat": 0.17, "rudder": 0.18},
    "CZ": {"1": -0.11, "alpha": -4.4, "qhat": -9.1, "elevator": -0.13},
    "Cl": {"beta": -0.051, "phat": -0.43, "rhat": 0.10, "aileron": -0.158, "rudder": 0.012},
    "Cm": {"1": -0.027, "alpha": -0.93, "qhat": -12.4, "elevator": -0.81},
    "Cn": {"beta": 0.075, "phat": 0.05, "rhat": -0.17, "aileron": 0.02, "rudder": -0.165},
}
NOISE = {"CX": 0.004, "CY": 0.004, "CZ": 0.014, "Cl": 0.0018, "Cm": 0.005, "Cn": 0.0014}
RATE = 50.0


def flight(duration: float = 300.0, *, number: int = 0, seed: int = 3) -> dict[str, np.ndarray]:
    """Samples of one flight of `duration` s: doublets and multisines, every third held out."""
    rng = np.random.default_rng(seed + number)
    count = int(duration * RATE)
    t = 40.0 + np.arange(count) / RATE
    maneuver, controls = _controls(t, rng)
    alpha = (
        np.radians(3.0)
        + _smooth(rng, count, 0.6, np.radians(0.9))
        - 0.6 * _lag(controls["elevator"], 8)
    )
    beta = _smooth(rng, count, 0.8, np.radians(0.9)) + 0.5 * _lag(controls["rudder"], 12)
    V = 17.5 + _smooth(rng, count, 5.0, 1.6)
    p = -4.5 * _lag(controls["aileron"], 4) + _smooth(rng, count, 0.3, 0.1)
    q = np.gradient(alpha, 1.0 / RATE) * 0.8 + _smooth(rng, count, 0.3, 0.04)
    r = -np.gradient(beta, 1.0 / RATE) * 0.7 + _smooth(rng, count, 0.6, 0.05)
    table = {
        "t": t,
        "time_us": (1_758_000_000_000_000 + t * 1e6).astype(np.int64),
        "flight": np.full(count, number),
        "V": V,
        "V_sd": np.full(count, 0.25),
        "qbar": 0.5 * 1.2 * V**2,
        "alpha": alpha,
        "alpha_sd": np.full(count, np.radians(0.35)),
        "beta": beta,
        "beta_sd": np.full(count, np.radians(0.5)),
        "phat": p * 1.27 / (2 * V),
        "qhat": q * 0.25 / (2 * V),
        "rhat": r * 1.27 / (2 * V),
        "p": p,
        "q": q,
        "r": r,
        "phi": _smooth(rng, count, 3.0, 0.3),
        "theta": alpha + _smooth(rng, count, 4.0, 0.05),
        "psi": np.cumsum(np.full(count, 0.12 / RATE)) + _smooth(rng, count, 5.0, 0.2),
        "wind_north": 2.0 + _smooth(rng, count, 20.0, 0.3),
        "wind_east": -3.1 + _smooth(rng, count, 20.0, 0.3),
        "wind_down": _smooth(rng, count, 10.0, 0.1),
        "thrust": 4.0 + _smooth(rng, count, 8.0, 0.8),
        **controls,
        "maneuver": maneuver,
        "held_out": (maneuver >= 0) & (np.isin(maneuver % 7, (2, 4))),
        "region": np.zeros(count, dtype=int),
    }
    return table | _coefficients(table, rng)


def _controls(t: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    controls = {
        name: _smooth(rng, t.size, 0.8, 0.006) for name in ("elevator", "aileron", "rudder")
    }
    maneuver = np.full(t.size, -1)
    start, number = t[0] + 8.0, 0
    while start + 16.0 < t[-1]:
        name = tuple(controls)[number % 3]
        length = 4.0 if number % 4 else 14.0
        inside = (t >= start) & (t < start + length)
        local = t[inside] - start
        if number % 4:
            shape = np.where(local < 1.0, 1.0, np.where(local < 2.0, -1.0, 0.0)) * 0.09
        else:
            shape = sum(np.sin(2 * np.pi * f * local + f) for f in (0.4, 0.9, 1.5, 2.1)) * 0.03
        controls[name][inside] += shape
        maneuver[inside] = number
        start += length + rng.uniform(4.0, 9.0)
        number += 1
    return maneuver, controls


def _coefficients(table: dict[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
    made = {}
    for name, terms in DERIVATIVES.items():
        true = sum(value * _regressor(key, table) for key, value in terms.items())
        count = table["t"].size
        unmodelled = _smooth(rng, count, 0.25, 0.8 * NOISE[name])
        bend = (NOISE[name] * 60.0 if name == "CX" else 0.0) * (table["alpha"] - 0.05) ** 2 * 40
        made[f"{name}_measured"] = (
            true + unmodelled + bend + rng.normal(0, 0.6 * NOISE[name], count)
        )
        made[f"{name}_measured_sd"] = np.full(count, NOISE[name])
        made[name] = sum(v * 0.985 * _regressor(k, table) for k, v in terms.items())
        made[f"{name}_sd"] = NOISE[name] * (0.35 + 4.0 * np.abs(table["alpha"] - np.radians(3)))
    return made


def _regressor(key: str, table: dict[str, np.ndarray]) -> np.ndarray:
    if key == "1":
        return np.ones(table["t"].size)
    name, _, power = key.partition("^")
    return table[name] ** int(power or 1)


def _smooth(rng: np.random.Generator, count: int, seconds: float, sd: float) -> np.ndarray:
    width = max(int(seconds * RATE), 1)
    kernel = np.hanning(4 * width + 1)
    raw = np.convolve(rng.normal(size=count + 4 * width), kernel, mode="valid")
    return raw / raw.std() * sd


def _lag(values: np.ndarray, samples: int) -> np.ndarray:
    kernel = np.exp(-np.arange(8 * samples) / samples)
    return np.convolve(values, kernel / kernel.sum())[: values.size]


def joined(*flights: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Several flights in one table."""
    return {name: np.concatenate([table[name] for table in flights]) for name in flights[0]}


def summary(samples: dict[str, np.ndarray], *, command: str = "identify") -> dict:
    """A summary document that goes with `samples`."""
    numbers = np.unique(samples["flight"])
    return {
        "schema": 1,
        "program": "gcs-sysid 0.1.0",
        "command": command,
        "aircraft": "Example (Ultra Stick 25e)",
        "prior": "none",
        "flights": [_flight(samples, int(number)) for number in numbers],
        "coefficients": {name: _score(samples, name) for name in DERIVATIVES},
        "derivatives": {name: _table(name) for name in DERIVATIVES},
        "reconstruction": {
            "wind_ned": {"value": [2.0, -3.1, 0.02], "sd": [0.12, 0.11, 0.05], "unit": "m/s"},
            "gust_sd": {"value": 0.62, "sd": 0.08, "unit": "m/s"},
            "sensor": {
                "airspeed_scale": {"value": 0.031, "sd": 0.006, "unit": "1"},
                "accelerometer_bias_x": {"value": 0.11, "sd": 0.03, "unit": "m/s²"},
                "accelerometer_bias_z": {"value": -0.052, "sd": 0.02, "unit": "m/s²"},
                "gyro_bias_x": {"value": 0.0021, "sd": 0.0003, "unit": "rad/s"},
                "vane_alpha_bias": {"value": -0.061, "sd": 0.004, "unit": "rad"},
            },
            "delays": {
                "SERVO_OUTPUT_RAW": {"value": 0.066, "sd": 0.003, "unit": "s"},
                "GPS_RAW_INT": {"value": 0.18, "sd": 0.03, "unit": "s"},
            },
        },
        "compatibility": {
            "verdict": "Accelerometers, gyros, GPS and pitot agree; the airspeed reads 3 % high "
            "and has been corrected.",
            "channels": _channels(),
        },
        "maneuvers": _maneuvers(samples),
        "envelope": {
            name: [float(samples[name].min()), float(samples[name].max())]
            for name in ("V", "alpha", "beta")
        },
        "limits": {
            "V": [11.0, 28.0],
            "alpha": [float(np.radians(-6)), float(np.radians(14))],
            "beta": [float(np.radians(-15)), float(np.radians(15))],
        },
        "trim": {
            "V": 17.4,
            "alpha": 0.052,
            "theta": 0.061,
            "throttle": 0.48,
            "controls": {"elevator": -0.021, "aileron": 0.004, "rudder": 0.0},
        },
        "modes": {
            "airspeed": 17.4,
            "density": 1.21,
            "reason": None,
            "modes": [
                _mode("short period", [(-12.1, 8.0, 0.5), (-12.1, -8.0, 0.5)], 14.5, 0.836),
                _mode("roll", [(-18.1, 0.0, 2.2)]),
                _mode("spiral", [(0.0174, 0.0, 0.0109)]),
                _mode("phugoid", [(0.03, 0.5, 0.004), (0.03, -0.5, 0.004)], 0.501, -0.06),
            ],
        },
        "warnings": [
            "alpha and elevator are correlated (-0.93) in Cm: their effects are told apart poorly.",
            "SERVO_OUTPUT_RAW arrives at 10 Hz; commands between messages are not seen.",
        ],
        "cannot_tell": [
            {
                "what": "Cn_phat from Cn_aileron",
                "why": "roll rate follows the ailerons (correlation -0.96) at one speed",
                "fly": "rudder doublets with ailerons still, and ailerons at 14 and 22 m/s",
            },
            {
                "what": "thrust from drag",
                "why": "throttle stayed between 44 and 52 %",
                "fly": "throttle doublets of ±20 % at constant height, and a 20 s glide",
            },
            {
                "what": "anything beyond 9° angle of attack",
                "why": "the flight did not go there",
                "fly": "two slow decelerations to 12 m/s above 100 m",
            },
        ],
        "timing": {"read_s": 1.21, "reconstruct_s": 6.4, "fit_s": 2.05, "total_s": 10.3},
    }


def _flight(samples: dict[str, np.ndarray], number: int) -> dict:
    t = samples["t"][samples["flight"] == number]
    return {
        "source": f"thor_flight{75 + number}.tlog",
        "sha256": f"{number + 1:x}"
        + "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"[1:],
        "vehicle": 1,
        "epoch_us": 1_758_000_000_000_000,
        "duration_s": float(t[-1]) + 30.0,
        "airborne_s": float(t[-1] - t[0]),
    }


def _score(samples: dict[str, np.ndarray], name: str) -> dict:
    held_out = samples["held_out"]
    measured, mean = samples[f"{name}_measured"][held_out], samples[name][held_out]
    sd = np.hypot(samples[f"{name}_measured_sd"], samples[f"{name}_sd"])[held_out]
    left = measured - mean
    share = float(np.var(left) / np.var(measured))
    return {
        "relative_error": 100.0 * float(np.sqrt(np.mean(left**2)) / np.std(measured)),
        "coverage95": float(np.mean(np.abs(left) < 1.96 * sd)),
        "nlpd": float(np.mean(0.5 * (left / sd) ** 2 + np.log(sd) + 0.919)),
        "r2": 1.0 - share,
        "samples": int(held_out.sum()),
        "refused": None,
    }


def _table(name: str) -> dict:
    rng = np.random.default_rng(len(name) + ord(name[1]))
    rows = {}
    for key, value in DERIVATIVES[name].items():
        weak = key in ("phat", "rudder") and name in ("CY", "Cn", "Cl") and abs(value) < 0.06
        relative = rng.uniform(0.4, 0.9) if weak else rng.uniform(0.02, 0.12)
        sd = abs(value) * relative
        file = value * rng.uniform(0.75, 1.3)
        rows[key] = {
            "value": value,
            "sd": sd,
            "sd_noise": 0.8 * sd,
            "sd_scale": 0.5 * sd,
            "sd_regressor": 0.3 * sd,
            "file": None if key == "alpha^2" else file,
            "file_sigma": None if key == "alpha^2" else 0.1 * abs(file),
            "verdict": "no"
            if weak and name == "Cn"
            else "weak"
            if weak or relative > 0.1
            else "yes",
            "reason": "correlated -0.96 with aileron" if weak else "",
        }
    return rows


def _mode(
    name: str,
    roots: list[tuple[float, float, float]],
    frequency: float | None = None,
    damping: float | None = None,
) -> dict:
    """Roots: real and imaginary part, sd of the real one."""
    real = roots[0][0]
    return {
        "name": name,
        "frequency": None if frequency is None else {"value": frequency, "sd": 0.04 * frequency},
        "damping": None if damping is None else {"value": damping, "sd": 0.03},
        "time_constants": [{"value": -1.0 / real, "sd": roots[0][2] / real**2}],
        "roots": [
            {"real": one, "imag": other, "real_sd": sd, "imag_sd": sd} for one, other, sd in roots
        ],
        "stable": real < 0.0,
    }


def _channels() -> dict:
    entry = {
        "bias": 0.05,
        "bias_sd": 0.03,
        "scale": 0.002,
        "scale_sd": 0.004,
        "delay": 0.01,
        "delay_sd": 0.008,
        "nis": 1.02,
        "nis_band": [0.95, 1.05],
        "whiteness": 0.06,
        "whiteness_limit": 0.04,
        "rms": 0.31,
        "unit": "m/s",
        "verdict": "consistent",
    }
    return {
        "airspeed": entry
        | {
            "scale": 0.031,
            "scale_sd": 0.006,
            "lag": 0.21,
            "lag_sd": 0.01,
            "nis": 1.12,
            "verdict": "reads 3 % high, corrected; innovations a little large",
        },
        "gps velocity": entry | {"delay": 0.18, "delay_sd": 0.015},
        "roll": entry | {"unit": "rad", "bias": 0.004, "bias_sd": 0.001, "rms": 0.012},
        "pitch": entry | {"unit": "rad", "bias": -0.011, "bias_sd": 0.001, "rms": 0.011},
        "alpha vane": entry
        | {
            "unit": "rad",
            "bias": -0.061,
            "bias_sd": 0.004,
            "rms": 0.02,
            "scale": None,
            "scale_sd": None,
            "nis": None,
            "nis_band": None,
            "verdict": "offset of −3.5° removed",
        },
    }


def _maneuvers(samples: dict[str, np.ndarray]) -> list[dict]:
    listed = []
    for number in np.unique(samples["flight"]):
        own = samples["flight"] == number
        for identity in np.unique(samples["maneuver"][own]):
            if identity < 0:
                continue
            rows = own & (samples["maneuver"] == identity)
            t = samples["t"][rows]
            listed.append(
                {
                    "id": int(identity),
                    "flight": int(number),
                    "kind": "doublet" if identity % 4 else "multisine",
                    "controls": [("elevator", "aileron", "rudder")[identity % 3]],
                    "start_us": int(samples["time_us"][rows][0]),
                    "end_us": int(samples["time_us"][rows][-1]),
                    "start_s": float(t[0]),
                    "duration_s": float(t[-1] - t[0]),
                    "airspeed_mean": float(samples["V"][rows].mean()),
                    "held_out": bool(samples["held_out"][rows].any()),
                }
            )
    return listed


if __name__ == "__main__":
    from gcs_sysid.report import identify

    made = flight()
    Path(sys.argv[1]).write_text(identify.render(summary(made), made), encoding="utf-8")
