"""What a cause is told as: its line for an engineer, with its numbers and words for their signs."""

from __future__ import annotations

from collections.abc import Sequence
from string import Formatter
from typing import Any

from gcs_sysid.diagnose.cause import Candidate
from gcs_sysid.diagnose.hypothesis import Estimate


class Signed(Formatter):
    """`{arm:.3f| m forward| m aft}`: the size, and after it what its sign means.

    Either may be missing: `{loss:|gains|loses} {loss:.2f||}`.
    """

    def format_field(self, value: Any, format_spec: str) -> str:
        """One number as it is told; words are for above and for below nothing."""
        if "|" not in format_spec:
            return super().format_field(value, format_spec)
        number, above, below = format_spec.split("|")
        told = f"{abs(value):{number}}" if number else ""
        return told + (below if value < 0.0 else above)


def explained(candidate: Candidate, estimates: Sequence[Estimate]) -> str:
    """The cause's explanation.

    Args:
        candidate: the cause, and what it is about.
        estimates: of all its parameters, the first of which is told in percent as `change`.
    """
    first = estimates[0]
    values = {estimate.name: estimate.value for estimate in estimates}
    change = 100.0 * (first.value - first.nominal)
    about = candidate.about
    if candidate.also:
        about = f"{about} (and the {' and the '.join(candidate.also)}, by the same servos)"
    return Signed().format(candidate.cause.explanation, **values, change=change, about=about)
