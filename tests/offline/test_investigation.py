"""The order in which causes are put to the test, with made-up answers in the place of flights."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from gcs_sysid.diagnose.hypothesis import Ranked
from gcs_sysid.offline import investigation
from gcs_sysid.offline.flight import Flight
from gcs_sysid.offline.question import Answer, Trial
from tests.diagnose.aided.made_unknowns import EVERY, listed, told
from tests.offline.made_aircraft import small


class Question:
    """Two favourites one after the other; who wants to know of the second is stopped."""

    listed, every = listed(), EVERY

    def __init__(self) -> None:
        self.turns = 0

    def begun(self, _telling: object) -> tuple[Question, None]:
        return self, None

    def relations(self, _begun: None) -> None:
        """None are needed."""

    def answered(self, *_given: object, **_named: object) -> Answer:
        information = told({"cg.x": -0.1})
        return Answer((), (), information, information.weighed(0.5))

    def tried(self, _telling: object, asked: Sequence[Trial], *_given: object) -> list[Answer]:
        self.turns += 1
        if self.turns == 2:
            raise KeyboardInterrupt
        information = told({"cg.x": -0.1, "mass": 0.12})
        return [Answer(one.causes, (), information, information) for one in asked]


class Asked:
    """Stands for what flights are asked."""

    def __init__(self, *_given: object) -> None:
        self.flown = ()

    def question(self) -> Question:
        return Question()


def test_what_is_known_is_handed_on_before_it_is_put_to_the_test(monkeypatch) -> None:
    monkeypatch.setattr(investigation, "Asked", Asked)
    kept: list[tuple[Ranked, ...]] = []
    unread = Flight.__new__(Flight)
    with pytest.raises(KeyboardInterrupt):
        investigation.investigate(
            small(), (unread,), (True,), (), lambda _text, _share: None, kept=kept.append
        )
    first, second = kept
    assert first[0].names == ("cg_shift",)
    assert set(second[0].names) == {"mass", "cg_shift"}
