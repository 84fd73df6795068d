"""Which causes are named in flights with one hidden, with another hidden, and with none."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from gcs_sysid.cli import numerics  # noqa: E402 - the tests' helpers are found from ROOT
from tests.benchmarks import table  # noqa: E402
from tests.offline.test_diagnose import diagnosed  # noqa: E402

HIDDEN: tuple[tuple[str, dict[str, Any] | None], ...] = (
    ("nothing", None),
    ("mass +12 %", {"name": "mass", "mass_ratio": 1.12}),
    ("centre of gravity 0.10 forward", {"name": "cg_shift", "cg_x_chord": 0.10}),
    ("airspeed reads 7 % too much", {"name": "airspeed_scale", "airspeed_scale": 0.07}),
    (
        "elevator at 65 %",
        {"name": "surface_effectiveness", "control": "elevator", "ratio": 0.65},
    ),
    ("inertia in pitch +25 %", {"name": "inertia", "Iyy_ratio": 1.25}),
    (
        "elevator 0.15 s slower",
        {"name": "actuator_lag", "control": "elevator", "time_constant": 0.15},
    ),
    (
        "Cn off with rudder times pitch rate",
        {"name": "unlisted", "terms": {"Cn": {"rudder*qhat": 20.0}}},
    ),
)


def main() -> None:
    """A flight of a minute and a half each, in calm air with vanes, aerodynamics known to 10 %."""
    numerics.keep_linear_algebra_in_one_thread()
    numerics.enable()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for seed, (words, effect) in enumerate(HIDDEN, start=40):
            found = diagnosed(Path(folder), f"flight{seed}", [effect] if effect else [], seed)
            best = found["ranking"][0]
            size = ", ".join(
                f"{entry['value']:.3f} ± {entry['sd']:.3f}" for entry in best["parameters"].values()
            )
            rows.append(
                (
                    words,
                    found["verdict"],
                    ", ".join(found["effects"]) or "nobody",
                    size if found["effects"] else "",
                    f"{best['log_bayes_factor']:.1f}",
                )
            )
            print(*rows[-1], file=sys.stderr)
    table.show(
        "diagnose",
        "Named by coefficients in a minute and a half with one thing hidden (calm, vanes)",
        ("hidden", "verdict", "named", "size, one sd", "log Bayes factor of the best"),
        rows,
    )


if __name__ == "__main__":
    main()
