"""How much vanes and position sensors on a CAN bus tighten what a flight without any tells."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.offline import identify  # noqa: E402 - found from ROOT
from tests.benchmarks import table  # noqa: E402 - found from ROOT
from tests.sources.can.made_can import Bus  # noqa: E402 - found from ROOT

CASE = ROOT.parent / "shared/cases/clean"
BEHIND_S = 1234.5
"""By how much the clock of the bus is behind the flight's."""
VANE_NOISE = np.radians(0.25)
POSITION_NOISE = np.radians(0.1)
VANES = "\n[vanes]\nposition = [0.0, 0.0, 0.0]\n"
SURFACES = {1: "aileron", 2: "elevator", 4: "rudder"}
"""Output of the autopilot -> surface."""
SHOWN = ("CZ_alpha", "Cm_alpha", "Cm_qhat", "Cm_elevator", "CY_beta", "Cn_beta", "Cn_rudder",
         "Cl_phat", "Cl_aileron")  # fmt: skip


def truth() -> dict[str, np.ndarray]:
    """Every true state at 50 Hz, and the log time of the first [µs]."""
    found = np.load(CASE / "truth.npz")
    columns = {str(name): found["rows"][:, i] for i, name in enumerate(found["cols"])}
    return columns | {"time_us": int(found["t0_us"]) + np.round(1e6 * columns["t"])}


def bus(path: Path, *, surfaces: bool) -> Path:
    """Vanes at the centre of gravity, an inertial unit, and sensors at the surfaces, at 50 Hz."""
    true, chance, log = truth(), np.random.default_rng(11), Bus()
    for row in range(true["t"].size):
        one = {name: float(column[row]) for name, column in true.items()}
        t = one["t"] - BEHIND_S
        vane = VANE_NOISE * chance.normal(size=2)
        log.send(t, "air_data.AngleOfAttack", sensor_id=254, aoa=one["alpha"] + float(vane[0]))
        log.send(t, "air_data.Sideslip", sideslip_angle=one["beta"] + float(vane[1]))
        log.send(t, "ahrs.RawIMU", rate_gyro_latest=[one["p"], one["q"], one["r"]])
        for channel, name in SURFACES.items() if surfaces else ():
            position = one[name] + float(POSITION_NOISE * chance.normal())
            log.send(t, "actuator.Status", actuator_id=channel, position=position)
    return log.save(path)


def identified(folder: Path, name: str, can: Path | None) -> tuple[dict, dict[str, float]]:
    """Derivatives, and the errors of the flow angles in the flight [deg]."""
    out = folder / name
    out.mkdir()
    aircraft = folder / "aircraft.toml"
    aircraft.write_text((CASE / "aircraft.toml").read_text() + VANES)
    summary = identify.run(
        [CASE / "flight.tlog"],
        aircraft,
        prior="none",
        segments=None,
        vehicle=None,
        stepwise=False,
        out=out,
        progress=lambda _stage, _fraction: None,
        can=can,
        method="equation-error",
    )
    true = truth()
    samples = pq.read_table(out / "samples.parquet").to_pydict()
    errors = {}
    for angle in ("alpha", "beta"):
        there = np.interp(samples["time_us"], true["time_us"], true[angle])
        errors[angle] = np.degrees(np.array(samples[angle]) - there)
    return summary["derivatives"], errors


def rows() -> list[tuple[str, ...]]:
    """One a quantity, without a bus, with vanes, and with sensors at the surfaces too."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = [
            identified(folder, "without", None),
            identified(folder, "vanes", bus(folder / "vanes.blf", surfaces=False)),
            identified(folder, "both", bus(folder / "both.blf", surfaces=True)),
        ]
    result = [
        (f"{angle}, rms error [°]", *(f"{_rms(errors[angle]):.2f}" for _, errors in found))
        for angle in ("alpha", "beta")
    ]
    result += [
        (f"{angle}, its mean [°]", *(f"{np.mean(errors[angle]):+.2f}" for _, errors in found))
        for angle in ("alpha", "beta")
    ]
    for key in SHOWN:
        coefficient, term = key.split("_")
        terms = [derivatives[coefficient][term] for derivatives, _ in found]
        result.append((key, *(f"{one['value']:.3f} ± {1.96 * one['sd']:.3f}" for one in terms)))
    return result


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    if not CASE.is_dir():
        print("can: no flight with known truth beside the checkout")
        return
    jax.config.update("jax_enable_x64", True)
    table.show(
        "can",
        "Flow angles and derivatives (± 95 %, equation error) of a flight in gusts of 1.8 m/s, "
        "with sensors on CAN",
        ("", "telemetry alone", "vanes (0.25°)", "vanes and surfaces (0.1°)"),
        rows(),
    )


if __name__ == "__main__":
    main()
