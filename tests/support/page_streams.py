"""Pages of an image in a pool of so many slots, and what is drawn of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

from limen.stream.allocators import Slots
from limen.stream.chunks import Index
from limen.stream.pages import Drawable, PageSource, PageTable, drawable_pages, page_streaming, resident_table

__all__ = ["PageStream"]


class PageStream:
    """A `limen.stream.chunks.ChunkStream` of pages, asked what it can draw; ``streaming``: another ``per_frame`` or
    ``kept`` than pages have."""

    def __init__(self, source: PageSource, slots: int, **streaming: int) -> None:
        self._pyramid = source.pyramid
        self._stream = replace(page_streaming(source), **streaming).stream(Slots(slots), 2)  # type: ignore[arg-type]

    def drawable(self, pages: Index) -> Drawable:
        """What is drawn in place of each page; that these were drawn is told to the stream, as frames do."""
        drawable, used = drawable_pages(self._pyramid, self._stream.resident, pages)
        self._stream.touch(used)
        return drawable

    def table(self) -> PageTable:
        return resident_table(self._pyramid, self._stream.resident)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()
