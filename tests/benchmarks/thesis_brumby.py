"""The Brumby in gusts: one flight to learn from, three to foretell, beside the published cells."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gcs_sysid import aircraft_file
from gcs_sysid.aircraft import COEFFICIENTS
from gcs_sysid.estimate.result import AeroModel
from gcs_sysid.gp import exact, fitting, samples
from gcs_sysid.gp.fitting import Fitted
from gcs_sysid.offline import model_store
from tests.benchmarks import table, thesis_figure
from tests.benchmarks import thesis_data as flights
from tests.benchmarks.thesis_data import EFFORT, ROOT, Flight, Row, with_structure

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
WAYS = {
    "filter": ("--method", "filter-error", "--mass-properties", "flight"),
    "filter, file's inertia": ("--method", "filter-error"),
    "kinematic": ("--method", "equation-error"),
}
"""States that samples are made from, and how `identify` is asked for them."""
FIGURE = ROOT / "docs" / "figure-5-11.png"
"""Where it is kept with `--save`."""
COMPARED = ("filter", "kinematic")
PRINTED = "combined, zero mean"
"""What is shown flight by flight: what the published cells are of."""
COLUMNS = ("method", "states", *COEFFICIENTS, "forces", "moments")
Answer = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Method:
    """What says the coefficients of a flight.

    Attributes:
        name: of the model.
        states: those that it was learned at, and is asked at where the truth is not.
        ask: mean and one standard deviation of the coefficients at inputs.
        whole: whether the deviation is that of a measured value, its noise included.
        taken: variance of each input's error that lasted all of the flight learned from, whose
            states the model took as given; None for one that was found with them.
    """

    name: str
    states: str
    ask: Callable[[np.ndarray], Answer]
    whole: bool = False
    taken: np.ndarray | None = None


def brumby(out: Path) -> None:
    """Table 5.4 and what stands beside it."""
    if not (out / "flight_6_truth.npz").exists():
        flights.run("sitl", "--scenario", ROOT / "replay/brumby/scenario.toml", "--out", out)
    described = aircraft_file.load(BRUMBY)
    inputs = flights.names(described)
    first = {states: _learned_from(out, states) for states in COMPARED}
    plain = {states: _polynomial(out / _folder(states)) for states in COMPARED}
    tested = {states: _tested(out, states) for states in COMPARED}
    methods = _methods(first, plain, inputs)
    _against_measured(methods, tested, inputs)
    _against_truth(methods, tested["filter"], inputs)
    _calibrated(methods, tested, inputs)
    _angles(first["filter"], tested["filter"], inputs)
    flight = tested["filter"][DRAWN]
    begins = float(np.quantile(flight.table["t"], 0.4))
    drawn = {one.name: one.ask for one in methods if one.states == "filter"}
    to = FIGURE if table.kept() else out / FIGURE.name
    thesis_figure.draw(drawn, flight, inputs, begins, to)
    print(f"Figure 5.11, flight {DRAWN}: {to}")
    _disturbed(first["filter"], tested["filter"], inputs)


def causes(out: Path) -> None:
    """What states and inertia are worth to the polynomial, and how well it knows either."""
    inputs = flights.names(aircraft_file.load(BRUMBY))
    rows: list[Row] = []
    for states in WAYS:
        flight = _learned_from(out, states)
        ask = _stored(_polynomial(out / _folder(states)), inputs)
        cells = [
            flights.error(ask(each.true_inputs)[0], each.true_values)
            for each in _tested(out, "filter").values()
        ]
        off = np.std(flight.inputs(inputs) - flight.true_inputs, axis=0)
        alpha, beta = np.degrees(off[:2])
        rows.append((states, f"{alpha:.2f}", f"{beta:.2f}", *flights.means(cells)))
    table.show(
        "thesis_states",
        "Brumby, polynomial of the file's terms without prior, by the states that it was learned "
        "at: their error [°], and error against truth on three others [%]",
        ("states", "alpha", "beta", *COEFFICIENTS, "forces", "moments"),
        rows,
    )


def _folder(states: str) -> str:
    return "identify_" + states.split(",")[0] + ("_file" if "," in states else "")


def _learned_from(out: Path, states: str) -> Flight:
    """The flight to learn from."""
    model = out / _folder(states)
    if not (model / "samples.parquet").exists():
        asked = ("--aircraft", BRUMBY, "--prior", "none", "--out", model)
        flights.run("identify", out / "flight_1.tlog", *asked, *WAYS[states])
    return flights.load(model / "samples.parquet", out / "flight_1_truth.npz", BRUMBY)


def _tested(out: Path, states: str) -> dict[str, Flight]:
    """The other flights, with the model of the first inside the filter, or without."""
    found = {}
    for number in TESTED:
        to = out / f"predict_{states}_{number}"
        log, truth = out / f"flight_{number}.tlog", out / f"flight_{number}_truth.npz"
        method = "filter-error" if states == "filter" else "kinematic"
        if not (to / "predictions.parquet").exists():
            asked = ("--model", out / _folder(states), "--method", method, "--out", to)
            flights.run("predict", log, *asked)
        found[number] = flights.load(to / "predictions.parquet", truth, BRUMBY)
    return found


def _polynomial(model: Path) -> AeroModel:
    """What `identify` fitted, without the processes that it may have kept."""
    stored = model_store.load(model).model
    return AeroModel(stored.fits, stored.controls)


def _methods(
    first: Mapping[str, Flight], plain: Mapping[str, AeroModel], inputs: Sequence[str]
) -> list[Method]:
    """All that are compared, in the order of the tables."""
    found = []
    for states in COMPARED:
        flight = first[states]
        mean = flight.measured.mean(axis=0)
        combined = flights.learned(flight, inputs, EFFORT)
        alone = replace(combined, use_local=np.zeros(6, dtype=bool), local=None)
        zero = {PRINTED: combined}
        if states == "filter":
            single = with_structure(EFFORT, latents=0, local=False)
            zero = {
                "full dependent GP, 250 places": _full(combined, flight, inputs),
                PRINTED: combined,
                "global only, zero mean": alone,
                "independent GPs, zero mean": flights.learned(flight, inputs, single),
            }
        taken = flight.lasting(inputs)
        found += [
            Method(name, states, _asked(one, mean), taken=taken) for name, one in zero.items()
        ]
        if states == "filter":
            beside = _beside(plain[states], flight, inputs)
            found.append(Method("combined on the polynomial", states, beside))
            line = _line(flight.inputs(inputs), flight.measured)
            found.append(Method("least squares, straight line", states, line, whole=True))
    found += [Method("polynomial", states, _stored(plain[states], inputs)) for states in COMPARED]
    best = flights.learned(first["filter"], inputs, EFFORT, truth=True)
    mean = first["filter"].measured.mean(axis=0)
    return [*found, Method(PRINTED, "true", _asked(best, mean))]


def _full(found: Fitted, flight: Flight, inputs: Sequence[str]) -> Fitted:
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


def _asked(found: Fitted, mean: np.ndarray) -> Callable[[np.ndarray], Answer]:
    def ask(where: np.ndarray) -> Answer:
        belief = fitting.predict(found, where)
        return mean + belief.mean, np.sqrt(belief.variance + found.discrepancy)

    return ask


def _beside(
    plain: AeroModel, flight: Flight, inputs: Sequence[str]
) -> Callable[[np.ndarray], Answer]:
    """Both parts of the process on what the polynomial leaves, whether they earn it or not."""
    where = flight.inputs(inputs)
    values = dict(zip(inputs, where.T, strict=True))
    said = _stored(plain, inputs)
    slopes = np.zeros((where.shape[0], len(COEFFICIENTS), len(inputs)))
    for row, name in enumerate(COEFFICIENTS):
        for column, variable in enumerate(inputs):
            if variable in plain.depends_on(name):
                slopes[:, row, column] = plain.derivative(name, variable, values).mean
    left = flight.measured - said(where)[0]
    found = fitting.fit(replace(flights.data(flight, inputs), values=left, slopes=slopes), EFFORT)

    def ask(where: np.ndarray) -> Answer:
        mean, deviation = said(where)
        belief = fitting.predict(found, where)
        return mean + belief.mean, np.sqrt(deviation**2 + belief.variance + found.discrepancy)

    return ask


def _line(inputs: np.ndarray, values: np.ndarray) -> Callable[[np.ndarray], Answer]:
    columns = np.concatenate([np.ones((inputs.shape[0], 1)), inputs], axis=1)
    slope = np.linalg.lstsq(columns, values, rcond=None)[0]
    left = np.std(values - columns @ slope, axis=0)

    def ask(where: np.ndarray) -> Answer:
        found = np.concatenate([np.ones((where.shape[0], 1)), where], axis=1) @ slope
        return found, np.broadcast_to(left, found.shape)

    return ask


def _stored(model: AeroModel, inputs: Sequence[str]) -> Callable[[np.ndarray], Answer]:
    def ask(where: np.ndarray) -> Answer:
        found = model.predict(dict(zip(inputs, where.T, strict=True)), measured=True)
        return (
            np.stack([found[name].mean for name in COEFFICIENTS], axis=1),
            np.stack([found[name].deviation for name in COEFFICIENTS], axis=1),
        )

    return ask


def _against_truth(
    methods: Sequence[Method], tested: Mapping[str, Flight], inputs: Sequence[str]
) -> None:
    rows: list[Row] = []
    for one in methods:
        cells = [
            flights.error(one.ask(each.true_inputs)[0], each.true_values)
            for each in tested.values()
        ]
        rows.append((one.name, one.states, *flights.means(cells)))
    table.show(
        "thesis_truth",
        "Brumby in gusts of 8 to 15 kt winds, learnt from one flight: 100·std(model − truth)/"
        "std(truth) on three others, both at what the aerodynamics felt, %",
        COLUMNS,
        rows,
    )


def _against_measured(
    methods: Sequence[Method],
    tested: Mapping[str, Mapping[str, Flight]],
    inputs: Sequence[str],
) -> None:
    rows: list[Row] = []
    for one in methods:
        # What was measured depends on the inertia too: that of the model in question.
        if seen := tested.get(one.states):
            cells = [
                flights.error(one.ask(each.inputs(inputs))[0], each.measured)
                for each in seen.values()
            ]
            rows.append((one.name, one.states, *flights.means(cells)))
    published = flights.means(list(PUBLISHED.values()))
    rows.append(("published, combined, other flights", "navigation", *published))
    _cells(methods, tested, inputs)
    table.show(
        "thesis_measured",
        "Brumby in gusts of 8 to 15 kt winds, learnt from one flight: 100·std(model − measured)/"
        "std(measured) on three others, at the states reconstructed from them, %",
        COLUMNS,
        rows,
    )


def _cells(
    methods: Sequence[Method],
    tested: Mapping[str, Mapping[str, Flight]],
    inputs: Sequence[str],
) -> None:
    """Flight by flight, beside the published cells: which flights these were differs."""
    rows: list[Row] = []
    for one in methods:
        if one.name == PRINTED:
            for number, each in tested.get(one.states, {}).items():
                cells = flights.error(one.ask(each.inputs(inputs))[0], each.measured)
                rows.append((one.name, one.states, number, *flights.means([cells])))
    for number, cells in PUBLISHED.items():
        rows.append(("published, combined", "navigation", number, *flights.means([cells])))
    table.show(
        "thesis_cells",
        "Brumby, each flight: 100·std(model − measured)/std(measured), %; published cells are of "
        "other flights, and of an error that the thesis does not define",
        ("method", "states", "flight", *COEFFICIENTS, "forces", "moments"),
        rows,
    )


def _calibrated(
    methods: Sequence[Method],
    tested: Mapping[str, Mapping[str, Flight]],
    inputs: Sequence[str],
) -> None:
    """Densities and intervals on the unseen flights, noise of the measurement included."""
    rows: list[Row] = []
    for one in methods:
        seen = tested.get(one.states, {}).values()
        if not seen:
            continue
        rows.append((one.name, one.states, *_inside(one, seen, inputs)))
        if one.taken is not None and one.taken.any():
            given = replace(one, taken=None)
            name = f"{one.name}, states taken as given"
            rows.append((name, one.states, *_inside(given, seen, inputs)))
    table.show(
        "thesis_calibration",
        "Brumby: mean NLPD of measured coefficients on unseen flights [nat], % in 95 % intervals",
        ("method", "states", "NLPD", *COEFFICIENTS),
        rows,
    )


def _inside(one: Method, seen: Iterable[Flight], inputs: Sequence[str]) -> tuple[str, ...]:
    """Mean density, and the share in 95 % intervals of each coefficient [%]."""
    density, held = [], []
    for flight in seen:
        found, deviation = one.ask(flight.inputs(inputs))
        total = deviation if one.whole else np.hypot(deviation, flight.noise)
        total = np.hypot(total, _by_lasting(one, flight, inputs))
        density.append(flights.nlpd(found, total, flight.measured))
        held.append(100.0 * flights.coverage(found, total, flight.measured))
    return (f"{np.mean(density):.2f}", *(f"{value:.0f}" for value in np.mean(held, axis=0)))


def _angles(first: Flight, tested: Mapping[str, Flight], inputs: Sequence[str]) -> None:
    """How far the filter's flow angles are off, all flight and from sample to sample."""
    rows: list[Row] = []
    for name, flight in {"1": first, **tested}.items():
        off = np.degrees(flight.inputs(inputs) - flight.true_inputs)
        lasting = np.degrees(np.sqrt(flight.lasting(inputs)))
        for column, angle in enumerate(("alpha", "beta")):
            whole = np.degrees(np.sqrt(np.mean(flight.table[f"{angle}_sd"] ** 2)))
            passing = np.sqrt(whole**2 - lasting[column] ** 2)
            cells = (off[:, column].mean(), lasting[column], off[:, column].std(), passing)
            rows.append((name, angle, *(f"{cell:.2f}" for cell in cells)))
    table.show(
        "thesis_angles",
        "Brumby, flow angles of the filter that holds the model of flight 1: error of the mean and "
        "about it, each with what is stated of it [°]",
        ("flight", "angle", "mean off", "lasting sd", "off about it", "sd"),
        rows,
    )


STEP = 1e-3
"""Of the difference that gives a model's slope [rad]."""


def _by_lasting(
    one: Method, flight: Flight, inputs: Sequence[str]
) -> Float[np.ndarray, "sample output"]:
    """One deviation of each coefficient by lasting errors of the inputs, of both flights.

    A model that took its states as given has their errors in it, and is asked at those of another.
    """
    where = flight.inputs(inputs)
    total = np.zeros((where.shape[0], len(COEFFICIENTS)))
    if one.taken is None:
        return total
    for column, variance in enumerate(one.taken + flight.lasting(inputs)):
        if variance > 0.0:
            step = np.zeros(len(inputs))
            step[column] = STEP
            slope = (one.ask(where + step)[0] - one.ask(where - step)[0]) / (2.0 * STEP)
            total += slope**2 * variance
    return np.sqrt(total)


def _disturbed(first: Flight, tested: Mapping[str, Flight], inputs: Sequence[str]) -> None:
    """Error against truth where the training samples are made worse."""
    rows: list[Row] = []
    random = np.random.default_rng(1)
    plain = flights.data(first, inputs, truth=True)
    spread = np.std(plain.values, axis=0)
    cases = [("true regressors, measured coefficients", plain)]
    for share in (0.1, 0.3):
        noisy = plain.values + share * spread * random.standard_normal(plain.values.shape)
        variance = plain.variance + (share * spread) ** 2
        cases.append(
            (
                f"noise of {100 * share:.0f} % of the spread added",
                replace(plain, values=noisy, variance=variance),
            )
        )
    for gust in (0.3, 1.0):
        wrong, variance = plain.inputs.copy(), plain.input_variance.copy()
        angle = gust / first.table["V"]
        wrong[:, 0] += angle * _coloured(random, first.table["t"])
        variance[:, 0] = angle**2
        cases.append(
            (
                f"vertical gusts of {gust} m/s added that no state knows",
                replace(plain, inputs=wrong, input_variance=variance),
            )
        )
    biased = plain.inputs.copy()
    biased[:, 0] += np.radians(1.0)
    cases.append(("alpha 1 deg too large", replace(plain, inputs=biased)))
    mean = first.measured.mean(axis=0)
    for name, data in cases:
        found = fitting.fit(data, replace(EFFORT, local=False))
        cells = [
            flights.error(mean + fitting.predict(found, each.true_inputs).mean, each.true_values)
            for each in tested.values()
        ]
        rows.append((name, *flights.means(cells)))
    table.show(
        "thesis_disturbed",
        "Brumby, dependent GP, zero mean: error against truth [%] by what is wrong in training",
        ("training", *COEFFICIENTS, "forces", "moments"),
        rows,
    )


LASTS = 1.0
"""Correlation time of an added gust [s]."""


def _coloured(random: np.random.Generator, time: np.ndarray) -> np.ndarray:
    """Unit noise of first order at these times."""
    found = random.standard_normal(time.size)
    for row in range(1, time.size):
        kept = np.exp(-abs(time[row] - time[row - 1]) / LASTS)
        found[row] = kept * found[row - 1] + np.sqrt(1.0 - kept**2) * found[row]
    return found
