"""What JAX's compiler is told before it compiles anything, wherever the package is used from."""

from __future__ import annotations

import os
from importlib.metadata import version

_FUSION = "xla_cpu_experimental_ynn_fusion_type"
_KNOWN = ("0.10.", "0.11.", "0.12.")


def compute_rightly() -> None:
    """Tells it to leave products of matrices apart from what is done with them.

    From jaxlib 0.10.2 on it puts whole chains of them into one call of a library, which then, from
    some hundred rows on, gives wrong numbers without a word: a variance was off by half of itself
    (jax-ml/jax issue 39103). An empty list of such chains is what earlier versions had. An unknown
    flag would end the program, so that versions it was not tried with go without.
    """
    flags = os.environ.get("XLA_FLAGS", "")
    if version("jaxlib").startswith(_KNOWN) and _FUSION not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} --{_FUSION}=".strip()


compute_rightly()
