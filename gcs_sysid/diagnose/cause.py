"""What a cause is: a named set of quantities set free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

About = Literal["", "control", "stream", "derivative"]


@dataclass(frozen=True)
class Parameter:
    """One number that a cause sets free.

    Attributes:
        name: as reports and documents call it.
        frees: the quantity of `quantities`; `{about}` stands for what the cause is about, `{at}`
            for where.
        nominal: its value where the cause is absent.
        sigma: one standard deviation of how far a cause of this kind takes it from there.
        matters: smallest change worth naming.
        unit: of all of these.
        per: what `sigma` and `matters` are shares of, a key of `quantities.sizes`; "" for none.
        expected: where the cause takes it; 0 where either sign is as likely.
    """

    name: str
    frees: str
    nominal: float
    sigma: float
    matters: float
    unit: str
    per: str = ""
    expected: float = 0.0


@dataclass(frozen=True)
class Cause:
    """One thing that may be wrong.

    Attributes:
        name: its identifier.
        parameters: what it frees.
        explanation: one line for an engineer; `{NAME}` is a parameter, `{change}` the first one's
            change in percent, `{about}` what the cause is about; `explanation.Signed` has words
            for signs.
        shown_by: what to fly to tell it from others.
        about: of what there are several, so that the cause counts once for each.
        where: name of a parameter in which nothing is linear, such as where a stall begins: the
            cause is tried at each of `places`.
        places: values of that parameter.
        where_unit: its unit.
        where_per: what `places` are shares of, as for `Parameter.per`.
        needs: what a flight must have for it, a key of `quantities.has`; "" for nothing.
        weight: prior probability against other causes.
    """

    name: str
    parameters: tuple[Parameter, ...]
    explanation: str
    shown_by: str
    about: About = ""
    where: str = ""
    places: tuple[float, ...] = ()
    where_unit: str = ""
    where_per: str = ""
    needs: str = ""
    weight: float = 1.0


@dataclass(frozen=True)
class Candidate:
    """A cause, what it is about, and where it is tried.

    Attributes:
        cause: which.
        about: control, stream or derivative; empty where there is none.
        at: place where it is tried.
        also: controls of which the same could be said, since the same servos move them.
    """

    cause: Cause
    about: str = ""
    at: float | None = None
    also: tuple[str, ...] = ()

    @property
    def frees(self) -> tuple[str, ...]:
        """Quantities set free."""
        if self.at is None:
            return tuple(one.frees.format(about=self.about, at="") for one in self.cause.parameters)
        at = f"{self.at:.4g}"
        if not self.cause.where:
            # The place is where the effect is taken, not a parameter of the cause.
            return tuple(
                f"{one.frees.format(about=self.about)}.{at}" for one in self.cause.parameters
            )
        return tuple(one.frees.format(about=self.about, at=at) for one in self.cause.parameters)

    @property
    def label(self) -> str:
        """The cause, and what it is about, in words."""
        return f"{self.cause.name} {self.about}".rstrip()
