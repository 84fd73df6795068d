"""What a cause is: a named set of quantities set free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Parameter:
    """One number that a cause sets free.

    Attributes:
        name: as reports and documents call it.
        frees: the quantity of `motion.quantities`; `{control}` stands for a control's name.
        nominal: its value where the cause is absent.
        sigma: one standard deviation of how far a cause of this kind takes it from there.
        matters: smallest change worth naming.
        unit: of all of these.
    """

    name: str
    frees: str
    nominal: float
    sigma: float
    matters: float
    unit: str


@dataclass(frozen=True)
class Cause:
    """One thing that may be wrong.

    Attributes:
        name: its identifier.
        parameters: what it frees.
        explanation: one line for an engineer; `{NAME}` is a parameter, `{change}` the first one's
            change in percent, `{control}` the control.
        shown_by: what to fly to tell it from others.
        of_control: whether it is about one control, and so counts once for each.
    """

    name: str
    parameters: tuple[Parameter, ...]
    explanation: str
    shown_by: str
    of_control: bool = False


@dataclass(frozen=True)
class Candidate:
    """A cause, and the control it is about."""

    cause: Cause
    control: str | None = None

    @property
    def frees(self) -> tuple[str, ...]:
        """Quantities set free."""
        return tuple(
            parameter.frees.format(control=self.control) for parameter in self.cause.parameters
        )


def candidates(causes: Mapping[str, Cause], controls: tuple[str, ...]) -> tuple[Candidate, ...]:
    """Every cause, once for each control where it is about one."""
    return tuple(
        Candidate(cause, control)
        for cause in causes.values()
        for control in (controls if cause.of_control else (None,))
    )
