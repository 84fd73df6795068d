"""Coloured residuals made white, so that a sample counts for what it is worth.

Residuals are averaged over `BLOCK`, which leaves the band in which small aircraft move, and taken
as vector noise: each coefficient autoregressive in time, its innovations correlated with those of
the others (a flow angle in error shows in several coefficients at once). Klein & Morelli, *Aircraft
System Identification*, 2006, section 5.2.3, for why residuals are coloured; Cochrane & Orcutt 1949
for the remedy. What colour is left beyond that makes rows count for less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from gcs_sysid.diagnose.evidence import Information, information
from gcs_sysid.diagnose.problem import Problem

BLOCK = 0.1
"""Residuals are averaged over this [s]."""
ORDER = 4
"""Blocks that an innovation looks back."""
LONGEST = 3.0
"""Correlations over more than this [s] do not count."""
ROUNDS = 3
QUIET = 1.0
"""No maneuver counts for more than its share, however quiet it was."""


@dataclass(frozen=True)
class Blocks:
    """Averages over unbroken stretches of flight.

    Attributes:
        left: residuals of the usable coefficients.
        measured: these coefficients.
        columns: signatures.
        run: unbroken stretch that each block belongs to.
        piece: maneuver of each block.
    """

    left: Float[np.ndarray, "block coefficient"]
    measured: Float[np.ndarray, "block coefficient"]
    columns: Float[np.ndarray, "block coefficient unknown"]
    run: Int[np.ndarray, " block"]
    piece: Int[np.ndarray, " block"]


@dataclass(frozen=True)
class Noise:
    """Autoregressive noise.

    Attributes:
        memory: coefficients of each past block, the latest first.
        covariance: of the innovations.
        weight: of a maneuver, by its number: less than one where it was noisier than usual.
        inflation: rows that count as one.
        deviation: standard deviation of a block's noise.
    """

    memory: Float[np.ndarray, "lag coefficient"]
    covariance: Float[np.ndarray, "coefficient coefficient"]
    weight: dict[int, float]
    inflation: float
    deviation: Float[np.ndarray, " coefficient"]


def blocks(problem: Problem, used: Int[np.ndarray, " maneuver"], *, first_run: int = 0) -> Blocks:
    """Averages over `BLOCK` of the maneuvers `used`."""
    step = float(np.median(np.diff(problem.time)))
    size = max(1, round(BLOCK / step))
    inside = np.isin(problem.piece, used)
    broken = np.diff(problem.time) > 1.5 * BLOCK
    starts = inside & ~(np.concatenate([[False], inside[:-1]]) & ~np.concatenate([[True], broken]))
    run = np.cumsum(starts) - 1
    usable = list(problem.usable)
    parts: dict[str, list[np.ndarray]] = {
        name: [] for name in ("left", "measured", "columns", "run", "piece")
    }
    # A flight without any gets one run of no blocks.
    for number in range(max(int(starts.sum()), 1)):
        own = np.flatnonzero(inside & (run == number))
        own = own[: own.size // size * size].reshape(-1, size)
        parts["left"].append(problem.left[own][:, :, usable].mean(axis=1))
        parts["measured"].append(problem.measured[own][:, :, usable].mean(axis=1))
        parts["columns"].append(_averaged(problem, own)[:, usable])
        parts["run"].append(np.full(own.shape[0], first_run + number))
        parts["piece"].append(problem.piece[own[:, 0]])
    return Blocks(**{name: np.concatenate(part) for name, part in parts.items()})


def _averaged(
    problem: Problem, rows: Int[np.ndarray, "block sample"]
) -> Float[np.ndarray, "block six unknown"]:
    """Signatures of all unknowns, those of single maneuvers included."""
    columns = problem.columns.values[rows].mean(axis=1)
    piece = problem.piece[rows[:, 0]]
    within = [
        columns[:, :, problem.columns.names.index(offset.of)] * (piece == offset.piece)[:, None]
        for offset in problem.offsets
    ]
    return np.concatenate([columns, *(column[:, :, None] for column in within)], axis=2)


def learn(data: Blocks, sigma: Float[np.ndarray, " unknown"]) -> Noise:
    """The noise that is left when everything that may be wrong has had its say.

    Args:
        data: blocks of all flights, with the same unknowns.
        sigma: prior standard deviation of every unknown, causes at their widest.
    """
    count = data.left.shape[1]
    noise = Noise(
        memory=np.zeros((ORDER, count)),
        covariance=np.diag(np.maximum(np.var(data.left, axis=0), 1e-12)),
        weight={},
        inflation=1.0,
        deviation=data.left.std(axis=0),
    )
    for _ in range(ROUNDS):
        rest = data.left - data.columns @ _fitted(data, noise, sigma)
        noise = _described(rest, data)
    return noise


def _fitted(data: Blocks, noise: Noise, sigma: Float[np.ndarray, " unknown"]) -> np.ndarray:
    columns, left, _ = whitened(data, noise)
    scaled = columns * sigma
    inner = np.eye(sigma.size) + scaled.T @ scaled
    return sigma * np.linalg.solve(inner, scaled.T @ left)


def _described(rest: Float[np.ndarray, "block coefficient"], data: Blocks) -> Noise:
    lagged, now = _histories(data.run)
    memory = np.stack(
        [
            _autoregression(rest[lagged, column], rest[now, column])
            for column in range(rest.shape[1])
        ],
        axis=1,
    )
    innovation = rest[now] - np.einsum("nlc,lc->nc", rest[lagged], memory)
    covariance = np.cov(innovation, rowvar=False).reshape(rest.shape[1], -1)
    white = np.linalg.solve(np.linalg.cholesky(covariance), innovation.T).T
    weight = {
        int(piece): 1.0 / max(QUIET, float(np.mean(white[data.piece[now] == piece] ** 2)))
        for piece in np.unique(data.piece[now])
    }
    return Noise(memory, covariance, weight, _inflation(white, data.run[now]), rest.std(axis=0))


def _histories(run: Int[np.ndarray, " block"]) -> tuple[np.ndarray, np.ndarray]:
    """Rows with `ORDER` predecessors in the same run: those predecessors, and the rows."""
    now = np.arange(ORDER, run.size)
    now = now[run[now] == run[now - ORDER]]
    return now[:, None] - 1 - np.arange(ORDER), now


def _autoregression(
    past: Float[np.ndarray, "block lag"], now: Float[np.ndarray, " block"]
) -> Float[np.ndarray, " lag"]:
    ridge = 1e-6 * float(np.mean(now**2)) * now.size
    return np.linalg.solve(past.T @ past + ridge * np.eye(past.shape[1]), past.T @ now)


def _inflation(white: Float[np.ndarray, "block coefficient"], run: np.ndarray) -> float:
    """1 + 2 Σ of the positive autocorrelation that is left, tapered; the worst coefficient's."""
    lags = int(LONGEST / BLOCK)
    worst = 1.0
    for column in white.T:
        centred = column - column.mean()
        power = float(np.mean(centred**2))
        total = 1.0
        for lag in range(1, min(lags, column.size - 1) + 1):
            pairs = run[lag:] == run[:-lag]
            if pairs.sum() < 2 * lags:
                break
            both = float(np.mean(centred[lag:][pairs] * centred[:-lag][pairs])) / power
            total += 2.0 * (1.0 - lag / (lags + 1.0)) * both
        worst = max(worst, total)
    return worst


def whitened(
    data: Blocks, noise: Noise
) -> tuple[Float[np.ndarray, "row unknown"], Float[np.ndarray, " row"], Int[np.ndarray, " row"]]:
    """Signatures and residuals as rows of unit variance, and the maneuver of each row."""
    lagged, now = _histories(data.run)
    left = data.left[now] - np.einsum("nlc,lc->nc", data.left[lagged], noise.memory)
    columns = data.columns[now].copy()
    for lag in range(ORDER):
        columns -= data.columns[lagged[:, lag]] * noise.memory[lag][:, None]
    inverse = np.linalg.inv(np.linalg.cholesky(noise.covariance))
    root = np.sqrt(
        np.array([noise.weight.get(int(piece), 1.0) for piece in data.piece[now]]) / noise.inflation
    )
    left = (left @ inverse.T) * root[:, None]
    columns = np.einsum("ij,njk->nik", inverse, columns, optimize=True) * root[:, None, None]
    rows = np.repeat(data.piece[now], inverse.shape[0])
    return columns.reshape(-1, columns.shape[2]), left.reshape(-1), rows


def gathered(data: Blocks, noise: Noise) -> Information:
    """What all blocks say of the unknowns."""
    columns, left, _ = whitened(data, noise)
    return information(columns, left)
