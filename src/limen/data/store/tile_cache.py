"""Decoded tiles, least recently used last to stay, within a byte budget."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from typing import Any

from numpy.typing import NDArray

__all__ = ["CACHE_BYTES", "TileCache"]

Texels = NDArray[Any]

CACHE_BYTES = 256 << 20
"""Decoded tiles that an open image keeps: about a thousand."""


class TileCache:
    """A thread-safe LRU of decoded tiles that never decodes one tile twice at once.

    The first thread that asks for a tile decodes it; others that ask meanwhile wait for that result. A tile that
    could not be decoded is not remembered: everybody waiting gets the error, the next to ask tries again.
    """

    def __init__(self, budget_bytes: int) -> None:
        self.budget_bytes = budget_bytes
        self._lock = threading.Lock()
        self._tiles: OrderedDict[Hashable, Texels] = OrderedDict()
        self._pending: dict[Hashable, Future[Texels]] = {}
        self._bytes = 0

    @property
    def bytes_held(self) -> int:
        return self._bytes

    def get(self, key: Hashable, decode: Callable[[], Texels]) -> Texels:
        """The tile ``key``, from ``decode()`` if it is not held. Callers must not write into it."""
        with self._lock:
            tile = self._tiles.get(key)
            if tile is not None:
                self._tiles.move_to_end(key)
                return tile
            pending = self._pending.get(key)
            mine: Future[Texels] | None = None
            if pending is None:
                mine = self._pending[key] = Future()
        if mine is None:
            assert pending is not None
            return pending.result()
        return self._fill(key, decode, mine)

    def clear(self) -> None:
        with self._lock:
            self._tiles.clear()
            self._bytes = 0

    def _fill(self, key: Hashable, decode: Callable[[], Texels], mine: Future[Texels]) -> Texels:
        try:
            tile = decode()
        except BaseException as error:
            with self._lock:
                del self._pending[key]
            mine.set_exception(error)
            raise
        with self._lock:
            del self._pending[key]
            self._tiles[key] = tile
            self._bytes += tile.nbytes
            while self._bytes > self.budget_bytes and self._tiles:
                _, old = self._tiles.popitem(last=False)
                self._bytes -= old.nbytes
        mine.set_result(tile)
        return tile
