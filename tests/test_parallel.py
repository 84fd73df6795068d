"""Work side by side comes back in order, whole, and without waiting for itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from gcs_sysid import parallel


@pytest.fixture
def _four_cores(monkeypatch) -> Iterator[None]:
    parallel._pool.cache_clear()
    monkeypatch.setattr(parallel, "_cores", lambda: 4)
    yield
    parallel._pool().shutdown()
    parallel._pool.cache_clear()


@pytest.mark.usefixtures("_four_cores")
class TestOnFourCores:
    def test_results_come_in_the_order_of_what_was_given(self):
        def slow_at_first(number: int, other: int) -> int:
            time.sleep(0.02 * (5 - number))
            return 10 * number + other

        assert parallel.each(slow_at_first, range(5), range(5, 10)) == [5, 16, 27, 38, 49]

    def test_cores_work_at_the_same_time(self):
        met = threading.Barrier(4, timeout=20.0)
        assert len(parallel.each(lambda _: met.wait(), range(4))) == 4

    def test_more_levels_than_cores_do_not_wait_for_each_other(self):
        def deep(level: int) -> int:
            return 1 if level == 0 else sum(parallel.each(deep, [level - 1] * 3))

        assert parallel.each(deep, [4] * 8) == [81] * 8

    def test_an_error_reaches_who_asked(self):
        def fails(number: int) -> int:
            if number == 3:
                raise ValueError("the third")
            return number

        with pytest.raises(ValueError, match="the third"):
            parallel.each(fails, range(8))
        assert parallel.each(fails, range(3)) == [0, 1, 2]

    def test_who_stops_does_not_wait_for_what_has_not_begun(self):
        begun, going = [], threading.Event()

        def waits(number: int) -> None:
            begun.append(number)
            if number == 0:
                raise KeyboardInterrupt
            going.wait(20.0)

        with pytest.raises(KeyboardInterrupt):
            parallel.each(waits, range(100))
        going.set()
        parallel.each(abs, range(4))
        assert len(begun) < 10

    def test_no_more_is_begun_than_is_soon_asked_for(self):
        begun: list[int] = []
        made = parallel.ahead(lambda number: begun.append(number) or number, range(100), by=2)
        assert next(made) == 0
        time.sleep(0.2)
        assert len(begun) <= 2 * 4 + 1
        assert list(made) == list(range(1, 100))


@pytest.mark.parametrize("cores", [1, 4])
def test_arguments_that_do_not_go_together_are_an_error(monkeypatch, cores):
    monkeypatch.setattr(parallel, "_cores", lambda: cores)
    with pytest.raises(ValueError, match="shorter"):
        parallel.each(lambda one, other: one + other, range(3), range(2))


def test_one_core_works_in_the_thread_that_asks(monkeypatch):
    monkeypatch.setattr(parallel, "_cores", lambda: 1)
    here = threading.get_ident()
    assert parallel.each(lambda _: threading.get_ident(), range(3)) == [here] * 3
