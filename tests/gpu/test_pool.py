"""The page pool: what it holds, what it costs, what it leaves behind."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest

from limen.errors import DeviceLimitError
from limen.gpu.buffers import GrowingBuffer, TextureReader
from limen.gpu.pool import PAGE_SIDE, PagePool
from limen.stream.chunks import Arrival

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

ROW_BYTES = 512 * 4096 * 4
LAYER_BYTES = 4096 * 4096 * 4


def _counts() -> dict[str, int]:
    import wgpu

    gc.collect()
    counts = wgpu.diagnostics.object_counts.get_dict()
    return {name: row["count"] for name, row in counts.items() if name in ("Buffer", "Texture", "TextureView")}


@pytest.mark.parametrize(
    ("budget", "slots"),
    [(ROW_BYTES, 15), (2 * ROW_BYTES, 45), (3 * ROW_BYTES, 45), (LAYER_BYTES - 1, 105), (LAYER_BYTES, 225),
     (3 * LAYER_BYTES, 675)],
)  # fmt: skip
def test_a_pool_holds_what_its_budget_allows(device: Any, budget: int, slots: int) -> None:
    pool = PagePool(device, budget, 10_000)
    assert pool.slots == slots
    assert budget // 2 < pool.bytes <= budget
    assert pool.slots * PAGE_SIDE**2 * 4 <= pool.bytes
    pool.destroy()


@pytest.mark.parametrize(
    ("pages", "slots"), [(1, 15), (15, 15), (16, 45), (105, 105), (106, 225), (226, 450), (6 * 225, 7 * 225)]
)
def test_a_pool_holds_no_more_than_there_is(device: Any, pages: int, slots: int) -> None:
    pool = PagePool(device, 20 * LAYER_BYTES, pages)
    assert pool.slots == slots
    pool.destroy()


def test_a_pool_can_be_large(device: Any) -> None:
    """4,500 pages; software drivers commit memory only when a page is written."""
    pool = PagePool(device, 20 * LAYER_BYTES, 10_000)
    assert pool.slots == 4500
    pool.destroy()


def test_too_small_a_budget_is_refused_with_the_least_that_works(device: Any) -> None:
    with pytest.raises(DeviceLimitError, match=r"give at least 8\.4 MB"):
        PagePool(device, ROW_BYTES - 1, 1)


def test_only_whole_pages_go_into_slots_that_exist(device: Any) -> None:
    pool = PagePool(device, ROW_BYTES, 15)
    page = np.zeros((PAGE_SIDE, PAGE_SIDE, 4), np.uint8)
    with pytest.raises(ValueError, match="slot 15 is not in a pool of 15"):
        pool.write([Arrival(0, (15,), page)])
    with pytest.raises(ValueError, match="264 x 264"):
        pool.write([Arrival(0, (0,), page[4:-4, 4:-4])])
    pool.destroy()


def test_destroying_a_pool_leaves_no_object(device: Any) -> None:
    before = _counts()
    pool = PagePool(device, ROW_BYTES, 15)
    assert _counts() != before
    pool.write([Arrival(0, (3,), np.zeros((PAGE_SIDE, PAGE_SIDE, 4), np.uint8))])
    pool.destroy()
    del pool
    assert _counts() == before


def test_a_buffer_grows_and_says_so(device: Any) -> None:
    import wgpu

    buffer = GrowingBuffer(device, "rows", wgpu.BufferUsage.STORAGE | wgpu.BufferUsage.COPY_SRC)
    buffer.write(np.empty(0, np.float32))
    first = buffer.generation
    buffer.write(np.arange(8, dtype=np.float32))
    assert buffer.generation == first
    rows = np.arange(5000, dtype=np.float32)
    buffer.write(rows)
    assert buffer.generation == first + 1
    read = np.frombuffer(device.wgpu.queue.read_buffer(buffer.buffer, 0, rows.nbytes), np.float32)
    assert (read == rows).all()
    buffer.destroy()


@pytest.mark.parametrize("size_px", [(64, 3), (65, 7), (1, 1), (300, 200)])
def test_a_texture_is_read_back_whatever_its_width(device: Any, size_px: tuple[int, int]) -> None:
    import wgpu

    width, height = size_px
    texels = np.random.default_rng(0).integers(0, 256, (height, width, 4), dtype=np.uint8)
    usage = wgpu.TextureUsage.COPY_DST | wgpu.TextureUsage.COPY_SRC
    texture = device.wgpu.create_texture(size=(width, height, 1), format="rgba8unorm", usage=usage)
    layout = {"bytes_per_row": width * 4, "rows_per_image": height}
    device.wgpu.queue.write_texture({"texture": texture}, texels, layout, (width, height, 1))
    reader = TextureReader(device)
    assert (reader.read(texture) == texels).all()
    assert (reader.read(texture) == texels).all()
    reader.destroy()
    texture.destroy()
