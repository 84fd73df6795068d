"""A real flight, derivative by derivative, beside both published models of its aircraft.

UMN's Thor is an Ultra Stick 25e. Its wind-tunnel model is that of the flight's aircraft file. The
other is of VSPAERO (UASLab/OpenFlightSim, `UltraStick25e/Aero.xml`, angle of attack 2°), brought to
the file's reference area, span and chord, to its aileron (half the difference of both surfaces) and
to body axes. The two differ by a factor of two in several derivatives, so that they are a band of
what is plausible and not truth. `--method` is that of `identify`; by default as it decides itself.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid import aircraft_file  # noqa: E402 - found from ROOT
from tests.benchmarks import table  # noqa: E402

THOR = ROOT.parent / "shared" / "data" / "umn_thor"
AREA, SPAN, CHORD = 0.3093, 1.2573, 0.2286
"""Of VSPAERO's model [m², m, m]."""
DRAG = 0.05
"""Its coefficient at 2°, roughly: a hundredth of the lift slope."""
OTHER: dict[str, dict[str, float]] = {
    "CY": {"beta": -0.106, "rhat": 0.173, "rudder": 0.080},
    "CZ": {"alpha": -(4.117 + DRAG), "qhat": -10.17, "elevator": -0.605},
    "Cl": {"beta": -0.0084, "phat": -0.387, "rhat": 0.0166, "aileron": -2.0 * 0.1049},
    "Cm": {"alpha": -1.322, "qhat": -14.41, "elevator": -1.548},
    "Cn": {
        "beta": 0.0784,
        "phat": 0.333,
        "rhat": -0.086,
        "aileron": 2.0 * 0.0042,
        "rudder": -0.0398,
    },
}
TOLD = 0.5
"""A derivative is told where one deviation is below this share of the wind tunnel's value."""
Z95 = 1.96


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--method", default="auto")
    parser.add_argument("--summary", type=Path, help="of a run that was done before")
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    asked = parser.parse_args()
    if not THOR.is_dir():
        print("Thor: the flight is not beside the checkout")
        return
    summary = _identified(asked.method) if asked.summary is None else _read(asked.summary)
    tunnel = {
        name: {key: one.value for key, one in model.terms.items()}
        for name, model in aircraft_file.load(THOR / "aircraft.toml").aerodynamics.items()
    }
    other = _brought_over()
    rows = []
    for name, terms in summary["derivatives"].items():
        for key, one in terms.items():
            known = tunnel.get(name, {}).get(key)
            if known is None or key == "1":
                continue
            second = other.get(name, {}).get(key)
            rows.append((f"{name}_{key}", *_row(one["value"], one["sd"], known, second)))
    told = sum(row[-1] != "not told" for row in rows)
    table.show(
        f"thor_{asked.method}",
        f"UMN Thor, a real flight, `identify --prior none --method {asked.method}`, answered by "
        f"{summary['method']['name'].replace('_', ' ')}: {told} of {len(rows)} derivatives told, "
        "beside both published models",
        ("derivative", "found ± 95 %", "wind tunnel", "VSPAERO", "the flight"),
        rows,
    )


def _row(value: float, sd: float, tunnel: float, second: float | None) -> tuple[str, ...]:
    band = Z95 * sd
    published = [tunnel] if second is None else [tunnel, second]
    near = [abs(value - one) < band for one in published]
    inside = min(published) - band <= value <= max(published) + band
    if sd > TOLD * abs(tunnel):
        verdict = "not told"
    elif all(near):
        verdict = "agrees with both" if second is not None else "agrees"
    elif any(near):
        verdict = "agrees with the wind tunnel" if near[0] else "agrees with VSPAERO"
    else:
        verdict = "between both" if inside else "departs"
    cells = (f"{value:.3g} ± {band:.2g}", f"{tunnel:.3g}")
    return *cells, "" if second is None else f"{second:.3g}", verdict


def _brought_over() -> Mapping[str, Mapping[str, float]]:
    """VSPAERO's derivatives for the reference sizes of the aircraft file."""
    shape = aircraft_file.load(THOR / "aircraft.toml").geometry
    area, span, chord = AREA / shape.wing_area, SPAN / shape.wing_span, CHORD / shape.mean_chord
    arm = {"CY": 1.0, "CZ": 1.0, "Cl": span, "Cm": chord, "Cn": span}
    rate = {"phat": span, "qhat": chord, "rhat": span}
    return {
        name: {key: area * arm[name] * rate.get(key, 1.0) * one for key, one in terms.items()}
        for name, terms in OTHER.items()
    }


def _identified(method: str) -> dict[str, Any]:
    program = Path(sys.executable).with_name("gcs-sysid")
    with tempfile.TemporaryDirectory() as folder:
        words = ["identify", THOR / "thor_flight75.tlog", "--aircraft", THOR / "aircraft.toml"]
        words += ["--prior", "none", "--method", method, "--out", folder]
        subprocess.run([str(part) for part in (program, *words)], check=True, capture_output=True)
        return _read(Path(folder) / "summary.json")


def _read(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
