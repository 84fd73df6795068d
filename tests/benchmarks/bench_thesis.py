"""`make bench-thesis`: the published comparison on flights whose truth is known.

One flight to learn from, three to foretell (scenario `brumby`: gusts in winds of 8 to 15 kt, no
flow vanes, mass and inertia only coarsely known), and the AD-1 at four sweep angles. With `--out
DIR` the runs stay in DIR, and those that are there are not repeated; `--method` goes to `identify`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import jax  # noqa: E402
import numpy as np  # noqa: E402

from gcs_sysid import aircraft_file  # noqa: E402
from gcs_sysid.aircraft import COEFFICIENTS  # noqa: E402
from gcs_sysid.gp import exact, fitting, inducing, posterior, refresh, samples, selection  # noqa: E402
from gcs_sysid.gp.fitting import Effort, Fitted  # noqa: E402
from gcs_sysid.gp.learning import Structure  # noqa: E402
from gcs_sysid.gp.refresh import Settings  # noqa: E402
from gcs_sysid.offline import model_store  # noqa: E402
from tests.benchmarks import table, thesis_figure  # noqa: E402
from tests.benchmarks import thesis_data as flights  # noqa: E402 - needs the path above

jax.config.update("jax_enable_x64", True)

BRUMBY = ROOT / "data" / "aircraft" / "brumby_mk3.toml"
TESTED = ("4", "5", "6")
DRAWN = "5"
PUBLISHED = {
    "4": (19.195, 23.278, 18.365, 23.364, 22.265, 28.173),
    "5": (20.792, 24.733, 19.925, 28.432, 19.891, 23.714),
    "6": (17.127, 19.847, 15.174, 24.691, 17.730, 26.245),
}
"""Hemakumara, *UAV Parameter Estimation with Gaussian Process Approximations*, Univ. of Sydney,
table 5.4: flight against the combined approximation, against measured coefficients [%]."""
SWEEPS = ("00", "30", "45", "60")
SIZES = (25, 50, 100, 150, 200, 250, 300)
EFFORT = Effort(
    settings=Settings(
        structure=Structure(latents=2), points=250, rows=600, scaffold=25, starts=2, steps=60
    ),
    always=True,
)
Row = tuple[object, ...]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--method", help="of identify")
    parser.add_argument("--only", choices=("brumby", "ad1"))
    parser.add_argument("--save", action="store_true", help="see tests/benchmarks/table.py")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gcs-sysid-thesis-") as folder:
        out = given.out or Path(folder)
        if given.only != "ad1":
            brumby(out / "brumby", given.method)
        if given.only != "brumby":
            oblique_wing(out / "ad1", given.method)


def brumby(out: Path, method: str | None) -> None:
    """Table 5.4 and what stands beside it."""
    extra = [] if method is None else ["--method", method]
    if not (out / "flight_6_truth.npz").exists():
        flights.run("sitl", "--scenario", ROOT / "replay/brumby/scenario.toml", "--out", out)
    model = out / "identify"
    if not (model / "samples.parquet").exists():
        flights.run(
            "identify",
            out / "flight_1.tlog",
            "--aircraft",
            BRUMBY,
            "--prior",
            "none",
            "--out",
            model,
            *extra,
        )
    for number in TESTED:
        if not (out / f"predict_{number}" / "predictions.parquet").exists():
            flights.run(
                "predict",
                out / f"flight_{number}.tlog",
                "--model",
                model,
                "--out",
                out / f"predict_{number}",
            )
    first = flights.load(model / "samples.parquet", out / "flight_1_truth.npz", BRUMBY)
    tested = {
        number: flights.load(
            out / f"predict_{number}" / "predictions.parquet",
            out / f"flight_{number}_truth.npz",
            BRUMBY,
        )
        for number in TESTED
    }
    described = aircraft_file.load(BRUMBY)
    inputs = flights.names(described)
    learned = {
        "combined": flights.learned(first, inputs, EFFORT),
        "independent GPs": flights.learned(first, inputs, _with(EFFORT, latents=0, local=False)),
        "combined, true regressors in training": flights.learned(first, inputs, EFFORT, truth=True),
    }
    learned["global only"] = replace(
        learned["combined"], use_local=np.zeros(6, dtype=bool), local=None
    )
    learned["full dependent GP, 250 places"] = _full(learned["combined"], first, inputs)
    mean = first.measured.mean(axis=0)
    methods = {
        name: lambda where, one=one: _asked(one, where, mean) for name, one in learned.items()
    }
    methods["least squares, straight line"] = _line(first.inputs(inputs), first.measured)
    stored = model_store.load(model).model
    methods["identify (the file's terms, no prior)"] = lambda where: _stored(stored, inputs, where)
    order = [
        "full dependent GP, 250 places", "combined", "global only", "independent GPs",
        "least squares, straight line", "identify (the file's terms, no prior)",
        "combined, true regressors in training",
    ]  # fmt: skip
    _cells(
        "thesis_measured",
        "against measured coefficients",
        methods,
        order,
        tested,
        inputs,
        truth=False,
    )
    _cells("thesis_truth", "of the model against truth", methods, order, tested, inputs, truth=True)
    _densities(methods, order, tested, inputs)
    flight = tested[DRAWN]
    begins = float(np.quantile(flight.table["t"], 0.4))
    thesis_figure.draw(methods, flight, inputs, begins, out / "figure_5_11.svg")
    print(f"Figure 5.11, flight {DRAWN}: {out / 'figure_5_11.svg'}")
    _disturbed(first, tested, inputs)


def _with(effort: Effort, *, latents: int, local: bool) -> Effort:
    structure = Structure(latents=latents)
    return replace(effort, settings=replace(effort.settings, structure=structure), local=local)


def _full(found: Fitted, flight: flights.Flight, inputs: tuple[str, ...]) -> Fitted:
    """The exact process with the combined one's hyper-parameters, on 250 places of the flight."""
    data = flights.data(flight, inputs)
    step = data.piece.size // 250
    rows = samples.rows(
        found.scaling, data.inputs[::step], data.values[::step], data.variance[::step]
    )
    points, values, own = exact.observed(rows)
    total = own + np.asarray(found.base.noise)[points.output]
    known = exact.condition(found.base.kernel, points, values, total)
    return replace(found, posterior=known, use_local=np.zeros(6, dtype=bool), local=None)


def _asked(found: Fitted, where: np.ndarray, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    belief = fitting.predict(found, where)
    return mean + belief.mean, np.sqrt(belief.variance + found.discrepancy)


def _line(inputs: np.ndarray, values: np.ndarray):
    columns = np.concatenate([np.ones((inputs.shape[0], 1)), inputs], axis=1)
    slope = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = np.std(values - columns @ slope, axis=0)

    def ask(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = np.concatenate([np.ones((where.shape[0], 1)), where], axis=1) @ slope
        return found, np.broadcast_to(left, found.shape)

    return ask


def _stored(model, inputs: tuple[str, ...], where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    values = dict(zip(inputs, where.T, strict=True))
    found = model.predict(values, measured=True)
    return (
        np.stack([found[name].mean for name in COEFFICIENTS], axis=1),
        np.stack([found[name].deviation for name in COEFFICIENTS], axis=1),
    )


def _cells(name: str, what: str, methods, order, tested, inputs, *, truth: bool) -> None:
    rows: list[Row] = []
    for method in order:
        cells = []
        for flight in tested.values():
            where = flight.true_inputs if truth else flight.inputs(inputs)
            wanted = flight.true_values if truth else flight.measured
            cells.append(flights.error(methods[method](where)[0], wanted))
        rows.append((method, *_rounded(np.mean(cells, axis=0)), *_means(np.array(cells))))
    if not truth:
        cells = np.array(list(PUBLISHED.values()))
        rows.append(("published (other flights)", *_rounded(cells.mean(axis=0)), *_means(cells)))
    table.show(
        name,
        f"Brumby, learnt from one flight, error {what} on three others: 100·std(difference)/std, %",
        ("method", *COEFFICIENTS, "forces", "moments"),
        rows,
    )


def _rounded(values: np.ndarray) -> list[str]:
    return [f"{value:.1f}" for value in values]


def _means(cells: np.ndarray) -> tuple[str, str]:
    return f"{cells[:, :3].mean():.1f}", f"{cells[:, 3:].mean():.1f}"


def _densities(methods, order, tested, inputs) -> None:
    """Calibration on the unseen flights, noise of the measurement included."""
    rows: list[Row] = []
    for method in order:
        density, held = [], []
        for flight in tested.values():
            found, deviation = methods[method](flight.inputs(inputs))
            if method.startswith("least"):
                total = deviation
            else:
                total = np.hypot(deviation, flight.noise)
            density.append(flights.nlpd(found, total, flight.measured))
            held.append(100.0 * flights.coverage(found, total, flight.measured))
        rows.append(
            (
                method,
                f"{np.mean(density):.2f}",
                *[f"{value:.0f}" for value in np.mean(held, axis=0)],
            )
        )
    table.show(
        "thesis_calibration",
        "Brumby: mean NLPD of measured coefficients on unseen flights [nat], % in 95 % intervals",
        ("method", "NLPD", *COEFFICIENTS),
        rows,
    )


def _disturbed(first, tested, inputs) -> None:
    """Error against truth where the training samples are made worse."""
    rows: list[Row] = []
    random = np.random.default_rng(1)
    plain = flights.data(first, inputs, truth=True)
    spread = np.std(plain.values, axis=0)
    cases = [("true regressors, measured coefficients", plain)]
    for share in (0.1, 0.3):
        noisy = plain.values + share * spread * random.standard_normal(plain.values.shape)
        cases.append(
            (f"noise of {100 * share:.0f} % of the spread added",
             replace(plain, values=noisy, variance=plain.variance + (share * spread) ** 2))
        )  # fmt: skip
    for degrees in (0.5, 1.5):
        wrong = plain.inputs.copy()
        wrong[:, 0] += np.radians(degrees) * random.standard_normal(wrong.shape[0])
        variance = plain.input_variance.copy()
        variance[:, 0] = np.radians(degrees) ** 2
        cases.append(
            (
                f"alpha with {degrees} deg of noise",
                replace(plain, inputs=wrong, input_variance=variance),
            )
        )
    biased = plain.inputs.copy()
    biased[:, 0] += np.radians(1.0)
    cases.append(("alpha 1 deg too large", replace(plain, inputs=biased)))
    for name, data in cases:
        found = fitting.fit(data, replace(EFFORT, local=False))
        cells = []
        for flight in tested.values():
            belief = fitting.predict(found, flight.true_inputs)
            cells.append(flights.error(belief.mean, flight.true_values))
        rows.append((name, *_rounded(np.mean(cells, axis=0)), *_means(np.array(cells))))
    table.show(
        "thesis_disturbed",
        "Brumby, dependent GP, zero mean: error against truth [%] by what is wrong in training",
        ("training", *COEFFICIENTS, "forces", "moments"),
        rows,
    )


def oblique_wing(out: Path, method: str | None) -> None:
    """Cross-coupling without prior structure, number of points, and where dependence pays."""
    extra = [] if method is None else ["--method", method]
    rows: list[Row] = []
    for sweep in SWEEPS:
        aircraft = ROOT / "data" / "aircraft" / f"ad1_{sweep}.toml"
        folder = out / sweep
        folder.mkdir(parents=True, exist_ok=True)
        log, truth = folder / "first.tlog", folder / "first_truth.npz"
        if not truth.exists():
            recorded = ["--record", log, "--truth", truth, "--seed", "141"]
            flights.run("sitl", "--aircraft", aircraft, *recorded, "--gust", "0.1")
        if not (folder / "identify" / "samples.parquet").exists():
            flights.run("identify", log, "--aircraft", aircraft, "--prior", "none", "--out",
                        folder / "identify", *extra)  # fmt: skip
        flight = flights.load(folder / "identify" / "samples.parquet", truth, aircraft)
        described = aircraft_file.load(aircraft)
        inputs = flights.names(described)
        data = flights.data(flight, inputs)
        found = fitting.fit(data, replace(EFFORT, local=False))
        rows += _couplings(sweep, found, described, inputs, data.inputs)
        if sweep == "30":
            _points(found, flight, inputs)
            _ablation(flight, inputs)
    table.show(
        "thesis_coupling",
        "AD-1, dependent GP with zero mean: derivatives at trim, one sd, and what flew",
        ("sweep", "derivative", "found", "one sd", "truth"),
        rows,
    )


def _couplings(sweep: str, found: Fitted, aircraft, inputs, where: np.ndarray) -> list[Row]:
    trim = np.median(where, axis=0)[None, :]
    slopes = posterior.slopes(found.posterior, found.scaled(trim))
    rows: list[Row] = []
    for name, variable in (
        ("Cm", "phat"),
        ("Cl", "qhat"),
        ("Cm", "aileron"),
        ("Cl", "aileron"),
        ("CY", "alpha"),
    ):
        row, column = COEFFICIENTS.index(name), inputs.index(variable)
        ratio = found.scaling.unit[row] / found.scaling.spread[column]
        terms = aircraft.aerodynamics[name].terms
        flew = terms[variable].value if variable in terms else 0.0
        rows.append(
            (sweep, f"{name}_{variable}", f"{float(slopes.mean[0, row, column]) * ratio:.3g}",
             f"{np.sqrt(float(slopes.variance[0, row, column])) * ratio:.2g}", f"{flew:.3g}")
        )  # fmt: skip
    return rows


def _split(flight: flights.Flight) -> tuple[np.ndarray, np.ndarray]:
    held = flight.table["held_out"].astype(bool)
    return ~held, held


def _points(found: Fitted, flight: flights.Flight, inputs) -> None:
    """Error on held-out maneuvers against the number of inducing points, by way of choosing."""
    kept, held = _split(flight)
    data = flights.data(flight, inputs)
    rows_all = samples.rows(found.scaling, data.inputs, data.values, data.variance)
    train = refresh.thinned(samples.some_of(rows_all, kept), 1500, 1)
    candidates, _, own = exact.observed(refresh.thinned(train, 200, 2))
    noise = own + np.asarray(found.base.noise)[candidates.output]
    wanted = flight.true_values[held] - flight.measured.mean(axis=0)
    where = found.scaled(data.inputs[held])
    rows: list[Row] = []
    for method in ("mutual information", "entropy", "random", "k-means"):
        cells = []
        for size in SIZES:
            errors = []
            for seed in range(3 if method == "random" else 1):
                chosen = selection.choose(
                    method, found.base.kernel, candidates, noise, size, seed=seed
                )
                base = inducing.basis(
                    found.base.kernel,
                    found.base.noise,
                    found.base.repeats,
                    selection.take(candidates, chosen),
                )
                known = inducing.posterior(base, inducing.told(base, train))
                mean = np.asarray(posterior.mean(known, where)) * found.scaling.unit
                errors.append(np.mean(flights.error(mean, wanted)))
            cells.append(f"{np.mean(errors):.1f}")
        rows.append((method, *cells))
    table.show(
        "thesis_points",
        "AD-1 at 30 deg: mean held-out error against truth [%] by number of (input, output) points",
        ("chosen by", *map(str, SIZES)),
        rows,
    )


def _ablation(flight: flights.Flight, inputs) -> None:
    """Dependent against independent processes, same effort, same samples."""
    kept, held = _split(flight)
    plain = flights.data(flight, inputs)
    parts = ("inputs", "values", "variance", "input_variance", "slopes", "piece")
    plain = replace(plain, **{name: getattr(plain, name)[kept] for name in parts})
    cases = {"all outputs, all samples": plain}
    fewer = plain.values.copy()
    fewer[np.arange(fewer.shape[0]) % 600 > 60, 4] = np.nan
    cases["Cm missing for nine tenths"] = replace(plain, values=fewer)
    first = np.isin(plain.piece, np.unique(plain.piece)[:4])
    cases["four maneuvers only"] = replace(
        plain, **{name: getattr(plain, name)[first] for name in parts}
    )
    random = np.random.default_rng(3)
    noisy = plain.values.copy()
    spread = np.std(plain.values[:, 4])
    noisy[:, 4] += spread * random.standard_normal(noisy.shape[0])
    variance = plain.variance.copy()
    variance[:, 4] += spread**2
    cases["Cm ten times noisier"] = replace(plain, values=noisy, variance=variance)
    wanted = flight.true_values[held] - flight.measured.mean(axis=0)
    where = flight.inputs(inputs)[held]
    rows: list[Row] = []
    for name, data in cases.items():
        for kind, latents in (("dependent", 2), ("independent", 0)):
            found = fitting.fit(data, _with(EFFORT, latents=latents, local=False))
            belief = fitting.predict(found, where)
            deviation = np.sqrt(belief.variance + found.discrepancy)
            measured = flight.measured - flight.measured.mean(axis=0)
            total = np.hypot(deviation, flight.noise[held])
            density = flights.nlpd(belief.mean, total, measured[held])
            cells = flights.error(belief.mean, wanted)
            rows.append(
                (name, kind, *_rounded(cells), f"{cells.mean():.1f}", f"{density.mean():.2f}")
            )
    table.show(
        "thesis_ablation",
        "AD-1 at 30 deg: held-out error against truth [%], NLPD [nat]",
        ("training", "processes", *COEFFICIENTS, "mean", "NLPD"),
        rows,
    )


if __name__ == "__main__":
    main()
