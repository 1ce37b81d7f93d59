"""Draws a terrain into a quilt: every panel a window onto patches of its own fineness, coloured from pages.

References
----------
Garland, Heckbert 1995, *Fast Polygonal Approximation of Terrains and Height Fields* (what the patches are).
Heckbert 1983, *Texture Mapping Polygons in Perspective* (the level by the larger side of a pixel's footprint).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.data.terrain.model import Patch, PatchSource
from limen.errors import DeviceLimitError
from limen.geometry import Floats
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.pool import PagePool
from limen.gpu.targets import DEPTH_FORMAT, QUILT_FORMAT, Targets
from limen.layers.common.matching import PanelMatching
from limen.layers.terrain.draw import uniforms as records
from limen.layers.terrain.draw.pipelines import BINDINGS, OUTLINE_VERTICES, TerrainOverlay, TerrainPipelines
from limen.layers.terrain.look import TerrainLook, contour_interval_m
from limen.layers.terrain.patches import PatchPlaces
from limen.stream.chunks import Arrival
from limen.stream.pages import PageSource, PageTable, page_table
from limen.viewing.projection import QuiltPanels

__all__ = ["Drape", "Ground", "PageTables", "PanelPatches", "Rims", "TerrainLayer", "TerrainOverlay"]

_POST_CENTRES = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5]])
"""Texel (i, j) of relief and heights is post (i, j), and its centre lies half a texel further."""


class Ground(PatchSource, Protocol):
    """What is asked of a terrain here; `limen.Terrain` is one."""

    @property
    def size_posts(self) -> tuple[int, int]: ...
    @property
    def spacing_m(self) -> tuple[float, float]: ...
    @property
    def low_m(self) -> float: ...
    @property
    def high_m(self) -> float: ...
    @property
    def has_voids(self) -> bool: ...
    @property
    def relief(self) -> PageSource: ...
    @property
    def heights(self) -> PageSource: ...


class PanelPatches(Protocol):
    """Which patch is drawn on which panel, sorted by panel; a selector's cut is one."""

    @property
    def pair_panel(self) -> NDArray[np.int64]: ...
    @property
    def pair_patch(self) -> NDArray[np.int64]: ...


class Rims(NamedTuple):
    """Triangles that join the patches of each panel: vertices by their numbers in the whole vertex buffer."""

    indices: NDArray[np.uint32]  # (K,)
    panel_first: NDArray[np.int64]  # (N + 1,): where each panel's begin


class PageTables(NamedTuple):
    """What is resident of every page source, as `limen.stream.pages.PageStream.table` gives it."""

    relief: PageTable
    heights: PageTable
    drape: PageTable | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Drape:
    """An image that lies over the terrain.

    Parameters
    ----------
    texel_from_post
        Affine, shape (2, 3): where the image is at post (column, row), in texels from its top left corner.
    """

    pyramid: Pyramid
    pool: PagePool
    texel_from_post: Floats


class TerrainLayer:
    """One terrain on one display.

    Parameters
    ----------
    relief, heights
        Pools of `rgba8unorm` for the terrain's pages.
    vertex_capacity, index_capacity
        Those of the `limen.layers.terrain.patches.patch_stream` whose arrivals are written.
    background
        Linear light (red, green, blue) where nothing is drawn.
    clip
        Clip by distances where the adapter can; False cuts in the fragment stage, with the same picture.

    Raises
    ------
    DeviceLimitError
        If the adapter cannot hold so many vertices or indices in one buffer.
    """

    def __init__(
        self,
        device: Device,
        ground: Ground,
        *,
        relief: PagePool,
        heights: PagePool,
        drape: Drape | None = None,
        vertex_capacity: int,
        index_capacity: int,
        background: tuple[float, float, float] = (0.0, 0.0, 0.0),
        clip: bool = True,
    ) -> None:
        self._device, self._ground, self._drape = device, ground, drape
        self._pools = {"relief_pool": relief, "heights_pool": heights, "drape_pool": drape.pool if drape else relief}
        self._background = (*background, 1.0)
        usage = wgpu.BufferUsage
        self._vertices = _buffer(device, "vertices", vertex_capacity * records.VERTEX.itemsize, usage.VERTEX)
        self._cores = _buffer(device, "core indices", -(-index_capacity // 2) * 4, usage.INDEX)
        self._rims = GrowingBuffer(device, "rim indices", usage.INDEX)
        self._buffers = {
            "terrain": GrowingBuffer(device, "terrain", usage.UNIFORM),
            "view": GrowingBuffer(device, "views", usage.UNIFORM),
            "sources": GrowingBuffer(device, "sources", usage.UNIFORM),
            "table": GrowingBuffer(device, "table", usage.STORAGE),
        }
        self._tables: PageTables | None = None
        self._fading = False
        self._sampler = device.wgpu.create_sampler(mag_filter="linear", min_filter="linear")
        self._pipelines = TerrainPipelines(device, clip=clip, holes=ground.has_voids)
        self._targets = Targets(device)
        self._matching = PanelMatching(device)

    def write(self, arrived: Sequence[Arrival[Patch]]) -> None:
        """Copy patches to where a stream placed them; drawing submitted before still sees what was there."""
        queue = self._device.wgpu.queue
        for patch, (first_vertex, first_index, _), content in arrived:
            rows = records.vertex_rows(patch, content)
            queue.write_buffer(self._vertices, first_vertex * records.VERTEX.itemsize, rows)
            core = content.core.reshape(-1)
            if len(core):
                padded = np.zeros(len(core) + len(core) % 2, np.uint16)  # copies have a multiple of 4 bytes
                padded[: len(core)] = core
                queue.write_buffer(self._cores, first_index * 2, padded)

    def draw(
        self,
        windows: QuiltPanels,
        eyes_m: Floats,
        room_from_posts: Floats,
        cut: PanelPatches,
        places: PatchPlaces,
        rims: Rims,
        *,
        pages: PageTables,
        allowed_px: Floats,
        look: TerrainLook,
        overlay: TerrainOverlay | None = None,
        tints: NDArray[np.float32] | None = None,
        target: Any = None,
        target_format: str = QUILT_FORMAT,
        slot: int = 0,
    ) -> Any:
        """Draw the patches of a cut, one draw for each pair of a patch and a panel and one for each panel's rims.

        Parameters
        ----------
        windows
            The panels of one quilt, with as many copies as there are eyes.
        eyes_m
            Shape (E, 3) in the room, one eye or two; the second is drawn to the right of the first.
        room_from_posts
            Affine map from (column, row, height in metres) to the room, metres: shape (4, 4).
        cut
            Panels are numbered as in the quilt; all patches must be resident.
        places
            Of the stream whose uploads were written.
        rims
            The triangles between the cut's patches.
        pages
            Copied to the GPU only when it is another object than last time.
        allowed_px
            The largest invisible error of each panel, in pixels: pages are drawn so much coarser. Shape (N,).
        overlay
            ``panels`` lays ``tints`` over every panel (see `limen.layers.terrain.look.panel_tints`). ``patches`` shows
            every triangle flat and every patch in a hue of its own.
        target
            A texture view to draw into (a window's), of ``target_format`` and the quilt's size for all eyes.
        slot
            Quilts of one size are drawn over each other, unless they are given numbers of their own.

        Returns
        -------
        texture
            Valid until the next draw of a quilt of the same size and slot; ``None`` with a ``target``.

        Raises
        ------
        ValueError
            If a patch of the cut is not resident, or the numbers of eyes and panels do not go together.
        """
        eyes_m = np.asarray(eyes_m, dtype=float).reshape(-1, 3)
        if windows.copies != len(eyes_m):
            raise ValueError(f"windows for {windows.copies} eyes were given {len(eyes_m)}")
        if not places.resident[cut.pair_patch].all():
            raise ValueError("a patch of the cut is not resident")
        room_from_posts = np.asarray(room_from_posts, dtype=float)
        nodes, node = self._ground.nodes, self._ground.patches.node[cut.pair_patch]
        order = records.nearest_first(nodes, node, cut.pair_panel, room_from_posts, eyes_m[0])
        facing = self._write_frame(
            windows, eyes_m, room_from_posts, cut, allowed_px, look,
            tints if overlay == "panels" else None,
        )  # fmt: skip
        self._write_pages(pages)
        self._rims.write(rims.indices)
        size = (windows.quilt.size_px[0] * windows.copies, windows.quilt.size_px[1])
        texture = None if target is not None else self._targets.texture(size, target_format, slot)
        view = texture.create_view() if texture is not None else target
        contours = contour_interval_m(look, self._ground.low_m, self._ground.high_m) > 0
        depth = self._targets.texture(size, DEPTH_FORMAT).create_view()
        pipelines, group, colour = self._pipelines, self._group(), self._colour(view)
        encoder = self._device.wgpu.create_command_encoder(label="terrain")
        of_triangles = overlay == "patches"
        render_pass = encoder.begin_render_pass(
            color_attachments=colour if of_triangles else [],
            depth_stencil_attachment={
                "view": depth, "depth_clear_value": 0.0, "depth_load_op": "clear", "depth_store_op": "store",
            },
        )  # fmt: skip
        render_pass.set_pipeline(
            pipelines.patches(target_format, look.colours, contours=contours) if of_triangles else pipelines.depth()
        )
        render_pass.set_vertex_buffer(0, self._vertices)
        self._record(render_pass, group, windows, facing, (cut.pair_panel, cut.pair_patch[order]), places, rims)
        render_pass.end()
        if not of_triangles:
            picture = pipelines.picture(
                target_format, look.colours, contours=contours, panels=overlay == "panels", fading=self._fading
            )
            self._record_picture(encoder, picture, group, depth, colour, np.flatnonzero(facing).tolist())
        self._matching.record(encoder, windows, eyes_m, view, target_format)
        self._device.wgpu.queue.submit([encoder.finish()])
        return texture

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """A drawn quilt's pixels, shape (H, W, 4); waits until it is drawn."""
        return self._targets.read(texture)

    def read_depth(self, windows: QuiltPanels) -> NDArray[np.float32]:
        """The depth of the last draw of a quilt of this size, shape (H, W): 1 is near, 0 nothing; waits."""
        return self._targets.read_depth((windows.quilt.size_px[0] * windows.copies, windows.quilt.size_px[1]))

    def destroy(self) -> None:
        """Free everything but the pools."""
        for buffer in (self._vertices, self._cores, self._rims, *self._buffers.values()):
            buffer.destroy()
        self._targets.destroy()
        self._matching.destroy()
        self._pipelines.clear()

    # ------------------------------------------------------------------ steps of a draw

    def _write_frame(
        self, windows: QuiltPanels, eyes_m: Floats, room_from_posts: Floats, cut: PanelPatches, allowed_px: Floats,
        look: TerrainLook, tints: NDArray[np.float32] | None,
    ) -> NDArray[np.bool_]:  # fmt: skip
        """Hand over what all fragments of a frame have in common; returns which panels each eye is before, (E, N)."""
        ground = self._ground
        origin = records.origin_near(eyes_m[0], room_from_posts, ground.size_posts)
        chosen = np.unique(ground.patches.node[cut.pair_patch]).astype(np.int64)
        near = [records.nearest_m(ground.nodes, chosen, room_from_posts, eye) for eye in eyes_m]
        views = [windows.seen_from(eye, copy, near[copy]) for copy, eye in enumerate(eyes_m)]
        low_high = ground.low_m, ground.high_m
        buffers = self._buffers
        size_px = (windows.quilt.size_px[0] * windows.copies, windows.quilt.size_px[1])
        buffers["terrain"].write(records.terrain_row(look, origin, room_from_posts, ground.spacing_m, low_high))
        rows = records.view_rows(views, room_from_posts, origin, allowed_px, tints, size_px)
        buffers["view"].write(records.in_strides(rows))
        self._origin = origin
        return np.array([view.facing for view in views])

    def _write_pages(self, pages: PageTables) -> None:
        ground, drape = self._ground, self._drape
        tables = [pages.relief, pages.heights, pages.relief if drape is None else pages.drape]
        if any(table is None for table in tables):
            raise ValueError("a terrain with a drape is drawn with the drape's pages")
        if pages is not self._tables:
            self._buffers["table"].write(np.concatenate([page_table(table) for table in tables if table is not None]))
            self._tables = pages
            self._fading = any(bool((table.fade[table.slot >= 0] < 1).any()) for table in tables if table is not None)
        pyramids = [ground.relief.pyramid, ground.heights.pyramid, drape.pyramid if drape else ground.relief.pyramid]
        maps = [_POST_CENTRES, _POST_CENTRES, drape.texel_from_post if drape else _POST_CENTRES]
        rows, first = [], 0
        for pyramid, table, pool, texel_from_post in zip(pyramids, tables, self._pools.values(), maps, strict=True):
            assert table is not None
            ready = bool(table.slot[-1] >= 0)
            rows.append(records.source_row(pyramid, pool.layer_px, first, texel_from_post, self._origin, ready))
            first += pyramid.page_count
        self._buffers["sources"].write(np.concatenate(rows))

    def _colour(self, view: Any) -> list[dict[str, Any]]:
        return [{"view": view, "clear_value": self._background, "load_op": "clear", "store_op": "store"}]

    def _record(
        self, render_pass: Any, group: Any, windows: QuiltPanels, facing: NDArray[np.bool_],
        pairs: tuple[NDArray[np.int64], ...], places: PatchPlaces, rims: Rims,
    ) -> None:  # fmt: skip
        count = facing.shape[1]
        pair_panel, patches = pairs
        pair_first = np.searchsorted(pair_panel, np.arange(count + 1)).tolist()
        cores = list(
            zip(
                places.core_indices[patches].tolist(),
                places.first_index[patches].tolist(),
                places.first_vertex[patches].tolist(),
                strict=True,
            )
        )
        bounds, rim_first = windows.bounds_px.tolist(), rims.panel_first.tolist()
        for index, sized in ((self._cores, "uint16"), (self._rims.buffer, "uint32")):
            render_pass.set_index_buffer(index, sized)
            for eye, panel in np.argwhere(facing).tolist():
                left, top, right, bottom = bounds[panel]
                view = eye * count + panel
                own = cores[pair_first[panel] : pair_first[panel + 1]]
                if not own or right <= left or bottom <= top:
                    continue
                shift = eye * windows.quilt.size_px[0]
                render_pass.set_bind_group(0, group, [view * records.VIEW_STRIDE])
                render_pass.set_scissor_rect(left + shift, top, right - left, bottom - top)
                if sized == "uint16":
                    for indices, first_index, first_vertex in own:
                        if indices:
                            render_pass.draw_indexed(indices, 1, first_index, first_vertex)
                elif rim_first[panel + 1] > rim_first[panel]:
                    begin = rim_first[panel]
                    render_pass.draw_indexed(rim_first[panel + 1] - begin, 1, begin)

    def _record_picture(
        self, encoder: Any, pipeline: Any, group: Any, depth: Any, colour: list[dict[str, Any]], views: list[int]
    ) -> None:
        """Colour the pixels of every panel whose depth was drawn; others fail the depth test, or are thrown away."""
        entries = [{"binding": 0, "resource": depth}]
        depths = self._device.wgpu.create_bind_group(layout=self._pipelines.depth_layout, entries=entries)
        attached = {"view": depth, "depth_read_only": True} if self._pipelines.attaches_depth else None
        render_pass = encoder.begin_render_pass(color_attachments=colour, depth_stencil_attachment=attached)
        render_pass.set_pipeline(pipeline)
        render_pass.set_bind_group(1, depths)
        for view in views:
            render_pass.set_bind_group(0, group, [view * records.VIEW_STRIDE])
            render_pass.draw(OUTLINE_VERTICES)
        render_pass.end()

    def _group(self) -> Any:
        resources: dict[str, Any] = {name: {"buffer": buffer.buffer} for name, buffer in self._buffers.items()}
        resources["view"] |= {"offset": 0, "size": records.TERRAIN_VIEW.itemsize}
        resources |= {name: pool.texels for name, pool in self._pools.items()} | {"bilinear": self._sampler}
        entries = [{"binding": number, "resource": resources[name]} for name, number in BINDINGS.items()]
        return self._device.wgpu.create_bind_group(layout=self._pipelines.layout, entries=entries)


def _buffer(device: Device, label: str, size: int, usage: int) -> Any:
    try:
        return device.wgpu.create_buffer(label=label, size=size, usage=usage | wgpu.BufferUsage.COPY_DST)
    except wgpu.GPUError as error:
        reason = " ".join(str(error).split())
        raise DeviceLimitError(f"{label}: the adapter refused {size / 1e6:.0f} MB, give it less: {reason}") from None
