"""The script for ArduPlane, run in a Lua interpreter against a mock of its scripting interface."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcs_sysid.maneuvers.export import lua

lua53 = pytest.importorskip("lupa.lua53", reason="lupa is not installed")

MOCK = Path(__file__).with_name("ardupilot_mock.lua").read_text(encoding="utf-8")
ENTRY = {
    "name": "elevator_doublet_20mps",
    "how": "a doublet",
    "entry": {"airspeed": 20.0},
    "abort": {
        "airspeed": [14.0, 28.0],
        "load_factor": [-0.5, 2.5],
        "bank": [-0.7, 0.8],
        "height_min": [50.0],
    },
}
DOUBLET = np.repeat([0.0, 100.0, -100.0, 0.0], 25)
THROTTLE = np.repeat([0.0, 40.0], 50)


class Board:
    """A flight controller that runs a script; `fly` moves its clock on by steps of 20 ms."""

    def __init__(self) -> None:
        # Nothing of Python is given to the script.
        runtime = lua53.LuaRuntime(
            unpack_returned_tuples=True, register_eval=False, register_builtins=False
        )
        runtime.execute(MOCK)
        self.world: Any = runtime.globals().world
        text = lua.script(ENTRY, "Ultra Stick", {2: DOUBLET, 3: THROTTLE, 4: 0.5 * DOUBLET})
        self._update: Callable[[], Any] = runtime.execute(text)[0]
        self._step()

    def _step(self) -> None:
        self._update, wait = self._update()
        assert wait == 20

    def fly(self, steps: int = 1) -> None:
        for _ in range(steps):
            self.world.now += 20
            self._step()

    def start(self, share: float = 1.0) -> None:
        self.world.parameters["GSID_SHARE"] = share
        self.world.switch = 2
        self.fly()
        assert "flying" in self.text

    def pulse(self, channel: int) -> int | None:
        """Pulse that overrides a channel (from 0); None where the autopilot has it."""
        given = self.world.overrides[channel]
        return given.pulse if given is not None and given.until_ms > self.world.now else None

    @property
    def text(self) -> str:
        return self.world.texts[len(self.world.texts)]


@pytest.fixture
def board() -> Board:
    return Board()


def test_it_waits_for_the_switch_and_gives_everything_back(board) -> None:
    board.fly(50)
    assert board.pulse(1) is None
    board.start()
    board.fly(30)
    assert board.pulse(1) == 1600
    board.fly(75)
    assert board.text == "GSID elevator_doublet_20mps: done"
    board.fly(4)
    assert [board.pulse(channel) for channel in (1, 2, 3)] == [None, None, None]
    board.fly(100)
    assert board.pulse(1) is None, "once for each time that the switch is put high"
    # The first sample is passed over when the switch is seen; it is zero.
    assert board.world.logged == 99


def test_the_whole_input_is_added_to_what_the_autopilot_commands(board) -> None:
    """Scaled outputs of 45° in cdeg either way; reversed and lopsided outputs; throttle a range."""
    board.world.scaled[19] = 900.0
    board.world.scaled[21] = 2250.0
    board.world.scaled[70] = 55.0
    board.start()
    found = []
    for _ in range(100):
        board.fly()
        found.append([board.pulse(channel) for channel in (1, 2, 3)])
    # The clock has moved on by one step when the switch has been seen.
    index = np.minimum(np.arange(1, 101), 99)
    wanted = np.stack(
        [1600 + DOUBLET[index], 1550 + THROTTLE[index], 1480 - 190 + 0.5 * DOUBLET[index]], axis=1
    )
    np.testing.assert_array_equal(np.array(found[:99], dtype=float), wanted[:99])


def test_a_quarter_first(board) -> None:
    assert board.world.parameters["GSID_SHARE"] == 0.25
    board.start(share=0.25)
    board.fly(30)
    assert board.pulse(1) == 1525


def test_pulses_stay_within_the_output(board) -> None:
    board.world.scaled[19] = 4300.0
    board.start()
    board.fly(30)
    assert board.pulse(1) == 2000


def test_the_switch_ends_it(board) -> None:
    board.start()
    board.fly(30)
    board.world.switch = 1
    board.fly()
    assert "stopped by the switch" in board.text
    board.fly(3)
    assert board.pulse(1) is None


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("airspeed", 13.0, "airspeed"), ("airspeed", 29.0, "airspeed"),
        ("airspeed", None, "no air"), ("roll", -0.75, "bank"),
        ("height", 49.0, "height"), ("load", 2.6, "load"), ("load", -0.6, "load"),
        ("armed", False, "disarmed"), ("mode", 0, "mode"), ("rc", False, "no RC"),
        ("ekf", True, "EKF"),
    ],
)  # fmt: skip
def test_every_limit_aborts_within_sixty_milliseconds(board, name, value, why) -> None:
    board.start()
    board.fly(30)
    board.world[name] = value
    board.fly()
    assert "aborted" in board.text
    assert why in board.text
    board.fly(3)
    assert board.pulse(1) is None
    board.world[name] = {"airspeed": 20.0, "roll": 0.0, "height": 100.0, "load": 1.0,
                         "armed": True, "mode": 5, "rc": True, "ekf": False}[name]  # fmt: skip
    board.fly(10)
    assert board.pulse(1) is None, "it does not go on by itself"


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [("airspeed", 23.0, "fly 20 m/s"), ("roll", math.radians(12.0), "level"), ("mode", 0, "mode")],
)
def test_it_begins_where_it_was_planned_only(board, name, value, why) -> None:
    board.world[name] = value
    board.world.switch = 2
    board.fly(2)
    assert "not flown" in board.text
    assert why in board.text
    assert board.pulse(1) is None


def test_a_switch_that_is_high_at_power_up_starts_nothing() -> None:
    board = Board()
    board.world.switch = 2
    board.fly(1)
    assert "flying" in board.text, "low was seen at the first look"
    fresh = lua53.LuaRuntime(unpack_returned_tuples=True)
    fresh.execute(MOCK)
    world: Any = fresh.globals().world
    world.switch = 2
    update = fresh.execute(lua.script(ENTRY, "Ultra Stick", {2: DOUBLET}))[0]
    for _ in range(20):
        world.now += 20
        update, _wait = update()
    assert world.overrides[1] is None


def test_without_a_switch_nothing_is_flown(board) -> None:
    board.world.has_switch = False
    board.world.switch = 2
    board.fly(20)
    assert board.pulse(1) is None
