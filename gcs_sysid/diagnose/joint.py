"""Several flights as one problem: the same unknowns in the same order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs_sysid.diagnose.evidence import Information
from gcs_sysid.diagnose.problem import Problem
from gcs_sysid.diagnose.unknowns import Columns
from gcs_sysid.diagnose.whitening import Blocks, blocks


def names(problems: Sequence[Problem]) -> Columns:
    """Unknowns of all flights, each once, without signatures."""
    sigma: dict[str, float] = {}
    for problem in problems:
        sigma |= dict(zip(problem.names, problem.sigma.tolist(), strict=True))
    return Columns(tuple(sigma), np.array(list(sigma.values())), np.zeros((0, 6, len(sigma))))


def stacked(problems: Sequence[Problem], every: Columns, used: Sequence[int]) -> Blocks:
    """Blocks of the maneuvers `used` of all flights, over all unknowns."""
    parts, run = [], 0
    for problem in problems:
        part = blocks(problem, np.asarray(used, dtype=int), first_run=run)
        run = int(part.run.max()) + 1 if part.run.size else run
        place = [every.names.index(name) for name in problem.names]
        wide = np.zeros((*part.left.shape, len(every.names)))
        wide[:, :, place] = part.columns
        parts.append(replace(part, columns=wide))
    return Blocks(
        left=np.concatenate([part.left for part in parts]),
        measured=np.concatenate([part.measured for part in parts]),
        columns=np.concatenate([part.columns for part in parts]),
        run=np.concatenate([part.run for part in parts]),
        piece=np.concatenate([part.piece for part in parts]),
    )


def kinematics(problems: Sequence[Problem], every: Columns) -> Information:
    """What the kinematics alone say of the airspeed's scale error, flight by flight."""
    count = len(every.names)
    gram, score = np.zeros((count, count)), np.zeros(count)
    index = every.names.index("airspeed")
    for problem in problems:
        weight = problem.airspeed_sigma**-2
        gram[index, index] += weight
        score[index] += weight * problem.airspeed
    return Information(gram, score, float(len(problems)))
