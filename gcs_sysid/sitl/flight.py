"""One flight to fly: who believes what, what really flies, and what nobody is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.sitl.jsbsim_aircraft import Start, Wind
from gcs_sysid.sitl.jsbsim_xml import Feel, Fuel
from gcs_sysid.sitl.link import Link
from gcs_sysid.sitl.plan import Leg
from gcs_sysid.sitl.sensors import Noise
from gcs_sysid.sitl.telemetry import RATES

EPOCH_US = 1_790_000_000_000_000
"""Wall time at which a recording begins unless its flight says otherwise: 21 September 2026. A
clock would make every recording another file."""


@dataclass(frozen=True)
class Hidden:
    """What an aircraft file has no words for and yet happens.

    Attributes:
        heading_bias: indicated less true heading [rad].
        delays: by message type [s]: what a message says was true `delay` before its time stamp;
            a servo output moves its surface `delay` after (before, where negative).
        feel: how much of a control's deflection the air feels, by control.
        stall_lag: how late what lies beyond a knot of alpha comes and goes [s]: a hysteresis.
    """

    heading_bias: float = 0.0
    delays: Mapping[str, float] = field(default_factory=dict)
    feel: Mapping[str, Feel] = field(default_factory=dict)
    stall_lag: float = 0.0


@dataclass(frozen=True)
class Flight:
    """One flight to fly.

    Attributes:
        believed: the aircraft as its file describes it; the autopilot's gains come from it.
        flown: the aircraft that really flies.
        legs: the plan.
        wind: moving air.
        start: where it begins.
        noise: of the sensors.
        link: the radio.
        rates: of the messages of a recording [Hz]; each divides the tick rate.
        fuel: that the engines burn, if any.
        reboot: when the flight computer restarts, if ever [s after the recording begins].
        seed: of everything random, 0 to 2³¹ - 1.
        epoch_us: wall time at which the recording begins [µs since 1970].
        hidden: what really happens beside `flown`.
        shipped: an aircraft of JSBSim's own whose mass, aerodynamics and engine fly instead of
            those of `flown`; servos and sensors are those of `flown`.
    """

    believed: Aircraft
    flown: Aircraft
    legs: tuple[Leg, ...]
    wind: Wind = field(default_factory=Wind)
    start: Start = field(default_factory=Start)
    noise: Noise = field(default_factory=Noise)
    link: Link = field(default_factory=Link)
    rates: Mapping[str, int] = field(default_factory=lambda: RATES)
    fuel: Fuel | None = None
    reboot: float | None = None
    seed: int = 0
    epoch_us: int = EPOCH_US
    hidden: Hidden = field(default_factory=Hidden)
    shipped: str | None = None

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return sum(leg.duration for leg in self.legs)
