"""Runs the filter with the aerodynamics inside in a process beside the listener.

What it needs compiled, a minute's matrices and seconds of computing at a time would otherwise stand
in the listener's memory and in its way. The process gives way to everybody, and ends with the
listener, however that ends.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import queue
import threading
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess

import jax
import numpy as np

from gcs_sysid.aircraft import Aircraft
from gcs_sysid.estimate.result import Prior
from gcs_sysid.live import heap, inside_fit
from gcs_sysid.live.inside import Inside
from gcs_sysid.live.inside_fit import Found, Task
from gcs_sysid.live.inside_known import Fed, Known

MOST = 384
"""Batches that wait at most, four minutes at 50 Hz: longer than any fit takes."""
PATIENT = 10
"""By how much the process steps back for others, as `nice` counts it."""


class Beside:
    """A filter in a process of its own, which begins with the first rows.

    Args:
        prepare: called there before anything is computed.
        aircraft: its file.
        prior: derivatives believed before; None ignores the file's.
    """

    def __init__(
        self,
        prepare: Callable[[], None],
        aircraft: Aircraft,
        prior: Mapping[str, Prior] | None,
    ) -> None:
        self._prepare, self._aircraft, self._prior = prepare, aircraft, prior
        self._waiting: queue.Queue[Fed] = queue.Queue(MOST)
        self._begun, self._closed = False, False
        self._process: SpawnProcess | None = None
        self._known = Known()

    @property
    def known(self) -> Known:
        """What the process told last."""
        return self._known

    @property
    def waiting(self) -> int:
        """Batches that the process has not been handed yet."""
        return self._waiting.qsize()

    @property
    def process(self) -> int | None:
        """Its number; None before it has begun."""
        return None if self._process is None else self._process.pid

    def take(self, fed: Fed) -> None:
        """Hands rows on; never waits. What finds no room is left out, and its number says so."""
        if not self._begun:
            self._begun = True
            # In a thread: to start a process takes as long as dozens of messages.
            threading.Thread(target=self._run, name="inside", daemon=True).start()
        try:
            self._waiting.put_nowait(fed)
        except queue.Full:
            return

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Goes on from what another one knew; to be called before rows come."""
        self._known = self._known._replace(state=dict(state))

    def close(self) -> None:
        """Ends the process, whatever it is about."""
        self._closed = True
        if self._process is not None:
            self._process.terminate()

    def _run(self) -> None:
        spawned = multiprocessing.get_context("spawn")
        here, there = spawned.Pipe()
        task = (self._prepare, self._aircraft, self._prior, dict(self._known.state), there)
        process = spawned.Process(target=_serve, args=task, name="inside", daemon=True)
        try:
            process.start()
            self._process = process
            there.close()
            if self._closed:
                process.terminate()
            threading.Thread(target=self._send, args=(here,), name="feed", daemon=True).start()
            while True:
                self._known = here.recv()
        except (EOFError, ConnectionError):
            why = "its process has ended"
        except Exception as error:  # noqa: BLE001 - the kinematic filter goes on without
            why = f"{type(error).__name__}: {error}"
        # What it knew would grow old without saying so; what a snapshot keeps of it stays.
        self._known = Known(phase=f"failed: {why}", lost=self._known.lost, state=self._known.state)

    def _send(self, here: Connection) -> None:
        try:
            while True:
                here.send(self._waiting.get())
        except OSError:
            # Who receives says that the process has ended.
            return


def _serve(
    prepare: Callable[[], None],
    aircraft: Aircraft,
    prior: Mapping[str, Prior] | None,
    state: Mapping[str, np.ndarray],
    there: Connection,
) -> None:
    """What the process does until the listener has enough of it, or is killed."""
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    if hasattr(os, "nice"):
        os.nice(PATIENT)
    prepare()
    running = Inside(aircraft, prior, fit=_fitted, tell=there.send)
    running.restore(state)
    try:
        while True:
            fed = there.recv()
            try:
                running.take(fed)
            except Exception as error:  # noqa: BLE001 - another minute may go well
                running.trouble(error)
            there.send(running.known)
    except (EOFError, OSError):
        return


def _fitted(task: Task) -> Found | None:
    """A fit whose compiled code and matrices are given back: the filter needs neither."""
    try:
        return inside_fit.fitted(task)
    finally:
        jax.clear_caches()
        gc.collect()
        heap.give_back()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(0)
