from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from limen.data.store.tile_cache import TileCache

TILE = np.zeros((16, 16, 4), dtype=np.uint8)


def test_a_tile_wanted_by_many_threads_at_once_is_decoded_once():
    cache, calls, results = TileCache(1 << 20), [], []

    def decode():
        calls.append(threading.get_ident())
        time.sleep(0.05)
        return TILE

    threads = [threading.Thread(target=lambda: results.append(cache.get("a", decode))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(calls) == 1
    assert all(result is TILE for result in results)


def test_the_budget_holds_and_the_least_recently_used_leaves_first():
    cache = TileCache(3 * TILE.nbytes)
    for key in "abc":
        cache.get(key, TILE.copy)
    cache.get("a", TILE.copy)
    cache.get("d", TILE.copy)
    assert cache.bytes_held == 3 * TILE.nbytes
    decoded = []
    for key in "acdb":
        cache.get(key, lambda key=key: decoded.append(key) or TILE.copy())
    assert decoded == ["b"]


def test_a_failure_reaches_everybody_and_is_forgotten():
    cache = TileCache(1 << 20)

    def fail():
        raise ValueError("bad tile")

    with pytest.raises(ValueError, match="bad tile"):
        cache.get("a", fail)
    assert cache.get("a", lambda: TILE) is TILE
