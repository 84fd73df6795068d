"""The AD-1 at four sweep angles: cross-coupling without prior structure, points, dependence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.gp import exact, fitting, inducing, posterior, refresh, samples, selection
from gcs_sysid.gp.fitting import Data, Fitted
from tests.benchmarks import table
from tests.benchmarks import thesis_data as flights
from tests.benchmarks.thesis_data import EFFORT, ROOT, Row, rounded, with_structure

SWEEPS = ("00", "30", "45", "60")
SIZES = (25, 50, 100, 150, 200, 250, 300)
SEEDS = (0, 1, 2, 3, 4)
"""Of the ablation."""


def oblique_wing(out: Path) -> None:
    """Cross-coupling without prior structure, number of points, and where dependence pays."""
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
            asked = ("--aircraft", aircraft, "--prior", "none", "--method", "equation-error")
            flights.run("identify", log, *asked, "--out", folder / "identify")
        flight = flights.load(folder / "identify" / "samples.parquet", truth, aircraft)
        described = aircraft_file.load(aircraft)
        inputs = flights.names(described)
        data = flights.data(flight, inputs)
        found = fitting.fit(data, replace(EFFORT, local=False))
        felt = fitting.fit(flights.data(flight, inputs, truth=True), replace(EFFORT, local=False))
        rows += _couplings(sweep, (found, felt), described, inputs, data.inputs)
        if sweep == "30":
            _points(found, flight, inputs)
            _ablation(flight, inputs)
    table.show(
        "thesis_coupling",
        "AD-1, dependent GP with zero mean: derivatives at trim, one sd, and what flew",
        ("sweep", "derivative", "found", "one sd", "at what the wing felt", "truth"),
        rows,
    )


def _couplings(
    sweep: str, by: tuple[Fitted, Fitted], aircraft, inputs, where: np.ndarray
) -> list[Row]:
    """Slopes at trim over regressors as reconstructed, and over those that the wing felt."""
    trim = np.median(where, axis=0)[None, :]
    slopes = [posterior.slopes(one.posterior, one.scaled(trim)) for one in by]
    rows: list[Row] = []
    for name, variable in (
        ("Cm", "phat"),
        ("Cl", "qhat"),
        ("Cm", "aileron"),
        ("Cl", "aileron"),
        ("CY", "alpha"),
    ):
        row, column = COEFFICIENTS.index(name), inputs.index(variable)
        ratios = [one.scaling.unit[row] / one.scaling.spread[column] for one in by]
        terms = aircraft.aerodynamics[name].terms
        flew = terms[variable].value if variable in terms else 0.0
        found, felt = (
            f"{float(one.mean[0, row, column]) * ratio:.3g}"
            for one, ratio in zip(slopes, ratios, strict=True)
        )
        sd = np.sqrt(float(slopes[0].variance[0, row, column])) * ratios[0]
        rows.append((sweep, f"{name}_{variable}", found, f"{sd:.2g}", felt, f"{flew:.3g}"))
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
    """Dependent against independent processes, same effort, same samples, over several seeds."""
    kept, held = _split(flight)
    plain = _part(flights.data(flight, inputs), kept)
    middle = flight.measured.mean(axis=0)
    wanted, measured = (each[held] - middle for each in (flight.true_values, flight.measured))
    where, noise = flight.inputs(inputs)[held], flight.noise[held]
    found: dict[tuple[str, str], list[tuple[np.ndarray, float]]] = {}
    for seed in SEEDS:
        for name, data in _cases(plain, seed).items():
            for kind, latents in (("dependent", 2), ("independent", 0)):
                effort = with_structure(EFFORT, latents=latents, local=False, seed=seed)
                one = fitting.fit(data, effort)
                belief = fitting.predict(one, where)
                total = np.sqrt(belief.variance + one.discrepancy + noise**2)
                density = float(flights.nlpd(belief.mean, total, measured).mean())
                errors = flights.error(belief.mean, wanted)
                found.setdefault((name, kind), []).append((errors, density))
    rows: list[Row] = []
    for (name, kind), each in found.items():
        errors, density = (np.array(part) for part in zip(*each, strict=True))
        whole = errors.mean(axis=1)
        cells = [f"{whole.mean():.1f} ± {whole.std():.1f}"]
        cells.append(f"{density.mean():.2f} ± {density.std():.2f}")
        rows.append((name, kind, *rounded(errors.mean(axis=0)), *cells))
    table.show(
        "thesis_ablation",
        f"AD-1 at 30 deg: held-out error against truth [%], NLPD [nat]; means over {len(SEEDS)} "
        "seeds of search, points and what is missing, ± their standard deviation",
        ("training", "processes", *COEFFICIENTS, "mean", "NLPD"),
        rows,
    )


def _part(data: Data, which: np.ndarray) -> Data:
    parts = ("inputs", "values", "variance", "input_variance", "slopes", "piece")
    return replace(data, **{name: getattr(data, name)[which] for name in parts})


def _cases(plain: Data, seed: int) -> dict[str, Data]:
    """Where dependence may pay, or cost."""
    random = np.random.default_rng(seed)
    fewer = plain.values.copy()
    count = fewer.shape[0]
    fewer[(np.arange(count) + random.integers(600)) % 600 > 60, 4] = np.nan
    four = np.isin(plain.piece, random.choice(np.unique(plain.piece), 4, replace=False))
    noisy, variance = plain.values.copy(), plain.variance.copy()
    spread = np.std(plain.values[:, 4])
    noisy[:, 4] += spread * random.standard_normal(count)
    variance[:, 4] += spread**2
    return {
        "all outputs, all samples": plain,
        "Cm missing for nine tenths": replace(plain, values=fewer),
        "four maneuvers only": _part(plain, four),
        "Cm ten times noisier": replace(plain, values=noisy, variance=variance),
    }
