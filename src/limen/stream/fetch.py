"""Items read and decoded in the background: what streams of pages and of patches have in common.

An item is a number until a worker reads it. `Fetcher.exchange` takes a frame's wishes, the most important first, and
returns what has been read of them; it never waits. An item that cannot be read is logged once and never asked again.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Generic, NamedTuple, TypeVar

from limen.errors import PageError

__all__ = ["Fetcher", "Pending"]

_log = logging.getLogger(__name__)

Item = TypeVar("Item")


class Pending(NamedTuple):
    """How many items are where."""

    decoded: int
    queued: int  # being decoded included
    failed: int


class Fetcher(Generic[Item]):
    """Reads numbered items in threads of its own.

    Parameters
    ----------
    read
        Gives an item by its number, called from several threads at once; a `PageError` says that it cannot.
    cost
        What an item counts against a frame's budget.
    kept
        How many decoded items may wait to be taken.
    name
        What an item is called in the log.
    """

    def __init__(
        self, read: Callable[[int], Item], *, kept: int, threads: int, name: str, cost: Callable[[Item], int]
    ) -> None:
        self._read, self._kept, self._name, self._cost = read, kept, name, cost
        self._lock = threading.Condition()
        self._wishes: set[int] = set()  # of the last exchange
        self._queue: list[int] = []  # most important last, so that a worker pops from the end
        self._decoding: set[int] = set()
        self._decoded: OrderedDict[int, Item] = OrderedDict()
        self.failed: set[int] = set()
        self._closed = False
        # Daemons: a program that ends without closing (an error in a script) must not wait for them for ever.
        self._workers = [
            threading.Thread(target=self._work, name=f"limen-decode-{number}", daemon=True) for number in range(threads)
        ]
        for worker in self._workers:
            worker.start()

    def exchange(self, missing: Iterable[int], budget: int) -> tuple[list[tuple[int, Item]], Pending]:
        """Hand over what has been decoded of ``missing`` until ``budget`` is spent, and read the rest from now on.

        What was asked for earlier and is not in ``missing`` is given up.
        """
        wishes = list(missing)
        with self._lock:
            self._wishes = set(wishes)
            ready = self._take(wishes, budget)
            self._enqueue(wishes, {number for number, _ in ready})
            pending = Pending(len(self._decoded), len(self._queue) + len(self._decoding), len(self.failed))
        return ready, pending

    @property
    def idle(self) -> bool:
        """Nothing is queued or being decoded."""
        with self._lock:
            return not (self._queue or self._decoding)

    @property
    def settled(self) -> bool:
        """Nothing that the last exchange wished for is queued, being decoded, or waiting to be taken."""
        with self._lock:
            return not (self._queue or self._decoding & self._wishes or self._decoded.keys() & self._wishes)

    def wait(self, timeout_s: float) -> None:
        """Sleep until an item that is wished for has been decoded."""
        with self._lock:
            if (self._queue or self._decoding) and not self._decoded.keys() & self._wishes:
                self._lock.wait(timeout_s)

    def close(self) -> None:
        """Stop the workers; items being decoded are finished first."""
        with self._lock:
            self._closed = True
            self._queue.clear()
            self._lock.notify_all()
        for worker in self._workers:
            worker.join()

    def _take(self, wishes: list[int], budget: int) -> list[tuple[int, Item]]:
        """Decoded items, the most important first; of what nobody wants any more, the oldest are dropped."""
        if not self._decoded:
            return []
        ready: list[tuple[int, Item]] = []
        spent = 0
        for number in wishes:
            if spent >= budget:
                break
            item = self._decoded.pop(number, None)
            if item is not None:
                ready.append((number, item))
                spent += self._cost(item)
        unwanted = [number for number in self._decoded if number not in self._wishes]
        for number in unwanted[: max(0, len(self._decoded) - self._kept // 2)]:
            del self._decoded[number]
        self._lock.notify_all()
        return ready

    def _enqueue(self, wishes: list[int], ready: set[int]) -> None:
        """Replace the queue by these wishes, as many as there is room for."""
        room = max(0, self._kept - len(self._decoded))
        queue: list[int] = []
        for number in wishes:
            if len(queue) == room:
                break
            if not (number in ready or number in self._decoded or number in self._decoding or number in self.failed):
                queue.append(number)
        queue.reverse()
        self._queue = queue
        if queue:
            self._lock.notify_all()

    # ------------------------------------------------------------------ the workers

    def _work(self) -> None:
        while (number := self._next()) is not None:
            item: Item | None = None
            try:
                item = self._read(number)
            except PageError as error:
                _log.warning("%s; its coarser level is shown instead", error)
            except Exception:
                # A worker that dies would stop every later item; this one is given up instead.
                _log.exception("%s %d could not be decoded; its coarser level is shown instead", self._name, number)
            with self._lock:
                self._decoding.discard(number)
                if item is None:
                    self.failed.add(number)
                elif not self._closed:
                    self._decoded[number] = item
                self._lock.notify_all()

    def _next(self) -> int | None:
        with self._lock:
            while not self._closed and not self._queue:
                self._lock.wait()
            if self._closed:
                return None
            number = self._queue.pop()
            self._decoding.add(number)
            return number
