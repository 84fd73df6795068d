"""Sizes of lags, delays and play of servos, with which flights are reckoned.

What such a change does is linear only about its size, so that a search moves sizes on to where
they turn out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from gcs_sysid.diagnose.aided import quantities
from gcs_sysid.diagnose.aided.unknowns import Unknowns
from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.hypothesis import Ranked


def acting(listed: Unknowns, causes: Sequence[Candidate]) -> set[str]:
    """Lags and delays that causes free, of which it is known what more of them does."""
    names = {name for one in causes for name in one.frees}
    return {name for name in names if f"{quantities.MORE}{name}" in listed.names}


def wanted(
    listed: Unknowns, best: Ranked, reached: Mapping[str, float], *, overshot: bool
) -> dict[str, float] | None:
    """With which sizes of servos' changes to reckon from now on; None where those are near enough.

    Args:
        listed: all unknowns.
        best: the favourite.
        reached: with which was reckoned so far.
        overshot: whether the flight was far less likely with sizes moved on from there, so that
            these stay. What is wrong beside a lag can make it seem longer wherever it is taken.
    """
    own = freed(listed, best.causes, best.posterior.mean)
    sizes = quantities.servo_sizes(own, reached, acting=listed.acting, least=listed.least)
    if sizes is None or not overshot:
        return sizes
    kept = {**sizes, **reached}
    return kept if kept.keys() > reached.keys() else None


def freed(
    listed: Unknowns, causes: Sequence[Candidate], values: Float[np.ndarray, " unknown"]
) -> dict[str, float]:
    """Values of the quantities that causes free, with what is ordinarily off in the same way."""
    found = {}
    for name in (name for candidate in causes for name in candidate.frees):
        parts = [name, *([listed.beside[name]] if name in listed.beside else [])]
        found[name] = float(sum(values[listed.names.index(each)] for each in parts))
    return found


def of_one_servo(causes: Iterable[Candidate]) -> bool:
    """Whether two of the causes are about how one control follows what it is told."""
    about = [one.about for one in causes if one.cause.name.startswith("actuator_")]
    return len(about) > len(set(about))
