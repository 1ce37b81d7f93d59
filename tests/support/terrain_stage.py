"""A terrain in memory, drawn with everything between its patches and a picture."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from limen.data.store.resample import srgb_of_linear
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import pack
from limen.layers.terrain.borders import BorderPool, Fans
from limen.layers.terrain.layer import Draped, TerrainLayer
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.pages import NeededPages
from limen.layers.terrain.patches import PatchPlaces, patch_streaming
from limen.layers.terrain.selector import Choice, TerrainPart, nearest_m
from limen.stream.chunks import completed
from limen.stream.pages import PageTable, page_streaming, resident_table
from support.drawing import Easel, eyes_view
from support.lands import GridLand

__all__ = ["EYE", "Stage", "codes_of", "hills", "leaves"]

EYE = (0.1, 0.05, 0.8)
_GPU_BYTES = 52_000_000
"""400,000 vertices, three million indices, and 45 pages of each kind, 15 with a drape."""


def hills(columns: int, rows: int, size_m: float = 9.0) -> Any:
    """Smooth hills, a sum of waves longer than 20 posts."""
    y, x = np.mgrid[:rows, :columns].astype(float)
    return size_m * (np.sin(x / 9.1) * np.cos(y / 7.3) + 0.5 * np.sin((x + 2 * y) / 11.7) + 0.3 * np.cos(y / 4.1))


def leaves(land: GridLand, step: int = 1) -> Any:
    """All leaves' patches of one step."""
    size = land.leaf
    return np.array([k for k, (n, s) in enumerate(land.patch_of) if s == step and np.ptp(land.rects[n][::2]) == size])


def codes_of(light: Any) -> Any:
    """8-bit sRGB of linear light."""
    return np.rint(srgb_of_linear(light) * 255).astype(np.uint8)


class Stage:
    """Everything between a terrain and its picture, waiting for all that is wanted."""

    def __init__(
        self,
        device: Any,
        land: GridLand,
        *,
        look: TerrainLook | None = None,
        drape: Any = None,
        clip: bool = True,
        matched: bool = False,
    ) -> None:
        from limen.layers.terrain.draw.drawer import TerrainDrawer

        draped = None if drape is None else Draped(*drape)
        layer = TerrainLayer(land, look or TerrainLook("plain"), draped=draped)  # type: ignore[arg-type]
        self.land, self.rims, self.easel = land, BorderPool(), Easel(device, background=(1, 0, 1), matched=matched)
        self.drawer = TerrainDrawer(device, layer, _GPU_BYTES, clip=clip)
        sources: list[Any] = [land.relief, land.heights, *([drape[0]] if drape is not None else [])]
        streamings = [patch_streaming(land), *(page_streaming(source) for source in sources)]
        self.streams = [each.stream(room, 2) for each, room in zip(streamings, self.drawer.allocators, strict=True)]
        self.pyramids = [source.pyramid for source in sources]
        self.pages = self.tables()

    def tables(self) -> tuple[PageTable, ...]:
        """Of relief, heights and, where there is one, a drape."""
        return tuple(
            resident_table(pyramid, stream.resident)
            for pyramid, stream in zip(self.pyramids, self.streams[1:], strict=True)
        )

    def load(self, patches: Any, pages: Any = None) -> None:
        every = [np.arange(pyramid.page_count) for pyramid in self.pyramids]
        wanted = [patches, *(every if pages is None else [pages] * len(every))]
        for source, update in completed(list(zip(self.streams, wanted, strict=True))):
            self.drawer.upload(source, update)
            if source == 0:
                for patch in update.evicted:
                    self.rims.remove(patch)
                for patch, (first_vertex, *_), content in update.arrived:
                    self.rims.add(patch, content, first_vertex)
        self.pages = self.tables()

    def draw(
        self,
        display: Display,
        room: Any,
        patches: Any,
        *,
        eyes: Any = EYE,
        joined: bool = True,
        overlay: str = "",
        allowed_px: float = 0.5,
        seen: int = 0,
    ) -> Any:
        """The one quilt's pixels, (H, W, 3); ``seen``: how all panels are."""
        (quilt,) = pack(display) if len(display.panels) == 1 else pack_outlines(display)
        count = len(display.panels)
        cut: Any = SimpleNamespace(
            pair_panel=np.repeat(np.arange(count), len(patches)), pair_patch=np.tile(patches, count),
            panel_error_px=np.ones(count),
        )  # fmt: skip
        places = PatchPlaces.of(self.streams[0].resident)
        if joined:
            fans = self.rims.fans(cut.pair_panel, cut.pair_patch, count)
        else:  # every rim as it is without neighbours
            each = [self.land.read_patch(int(patch)).rims + places.first_vertex[patch] for patch in patches]
            triangles, panel_first = np.concatenate(each).astype(np.uint32), np.arange(count + 1) * sum(map(len, each))
            fans = Fans(np.tile(triangles, (count, 1)), panel_first)
        view = eyes_view(display, quilt, eyes)
        nodes = np.unique(self.land.patches.node[patches]).astype(np.int64)
        near_m = min(nearest_m(self.land.nodes, nodes, room, eye_m) for eye_m in view.eyes_m)
        self.view = view.beginning_at(near_m)
        none = NeededPages(np.zeros(0, np.int64), np.zeros(0))
        allowed = np.full(count, allowed_px)
        choice = Choice(self.view, room, allowed, np.full(count, seen, np.int8), cut, none, none)
        part = TerrainPart(choice, cut, places, fans, self.pages)
        return self.easel.picture(self.drawer, self.view, part, overlay)[..., :3]

    def close(self) -> None:
        for stream in self.streams:
            stream.close()
        self.easel.destroy()
        self.drawer.destroy()
