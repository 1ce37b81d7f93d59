"""Draws a terrain into a quilt: every panel a window onto patches of its own fineness, coloured from pages.

References
----------
Garland, Heckbert 1995, *Fast Polygonal Approximation of Terrains and Height Fields* (what the patches are).
Heckbert 1983, *Texture Mapping Polygons in Perspective* (the level by the larger side of a pixel's footprint).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.data.terrain.model import PatchSource
from limen.errors import DeviceLimitError
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.pool import PageFormat, PagePool
from limen.gpu.targets import DEPTH_FORMAT, Target, Targets
from limen.layers.terrain.borders import Fans
from limen.layers.terrain.draw import uniforms as records
from limen.layers.terrain.draw.pipelines import BINDINGS, OUTLINE_VERTICES, TerrainPipelines
from limen.layers.terrain.look import contour_interval_m, panel_tints
from limen.layers.terrain.patches import PatchPlaces, patch_ranges
from limen.layers.terrain.selector import TerrainPart
from limen.stream.allocators import Slots
from limen.stream.chunks import Allocator, Update
from limen.stream.pages import PageSource, PageTable, page_table
from limen.viewing.projection import QuiltView

if TYPE_CHECKING:
    from limen.layers.terrain.layer import TerrainLayer

__all__ = ["Ground", "TerrainDrawer"]

_INDEX_BYTES = 2

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


class TerrainDrawer:
    """Draws one terrain.

    Parameters
    ----------
    layer
        What is shown, and how it looks.
    gpu_bytes
        An eighth is for vertices, one for indices, the rest for pages, at most the same for each kind.
    clip
        Clip by distances where the adapter can; False cuts in the fragment stage, with the same picture.

    Raises
    ------
    InputError
        If the terrain's coarsest patches do not fit into ``gpu_bytes``.
    DeviceLimitError
        If the adapter cannot hold so much.
    """

    def __init__(self, device: Device, layer: TerrainLayer, gpu_bytes: int, *, clip: bool = True) -> None:
        ground: Ground = layer.terrain
        self._device, self._ground, self._look, self._draped = device, ground, layer.look, layer.draped
        vertices, indices = gpu_bytes // 8 // records.VERTEX.itemsize, gpu_bytes // 8 // _INDEX_BYTES
        places = patch_ranges(ground, vertices, indices)
        sources: list[tuple[PageFormat, Any]] = [("rgba8unorm", ground.relief), ("rgba8unorm", ground.heights)]
        if layer.draped is not None:
            sources.append(("rgba8unorm-srgb", layer.draped.image))
        each_bytes = gpu_bytes * 3 // 4 // len(sources)
        self._pools = [PagePool(device, each_bytes, source.pyramid.page_count, format=form) for form, source in sources]
        self.allocators: tuple[Allocator, ...] = (places, *(Slots(pool.slots) for pool in self._pools))
        usage = wgpu.BufferUsage
        self._vertices = _buffer(device, "vertices", vertices * records.VERTEX.itemsize, usage.VERTEX)
        self._cores = _buffer(device, "core indices", -(-indices // 2) * 4, usage.INDEX)
        self._rims = GrowingBuffer(device, "rim indices", usage.INDEX)
        self._buffers = {
            "terrain": GrowingBuffer(device, "terrain", usage.UNIFORM),
            "view": GrowingBuffer(device, "views", usage.UNIFORM),
            "sources": GrowingBuffer(device, "sources", usage.UNIFORM),
            "table": GrowingBuffer(device, "table", usage.STORAGE),
        }
        self._tables: tuple[PageTable, ...] = ()
        self._fading = False
        self._sampler = device.wgpu.create_sampler(mag_filter="linear", min_filter="linear")
        self._pipelines = TerrainPipelines(device, clip=clip, holes=ground.has_voids)
        self._targets = Targets(device)

    def upload(self, source: int, update: Update[Any]) -> None:
        """Copy what has come to where it lies; drawing submitted before still sees what was there."""
        if source:
            self._pools[source - 1].write(update.arrived)
            return
        queue = self._device.wgpu.queue
        for patch, (first_vertex, first_index, _), content in update.arrived:
            rows = records.vertex_rows(patch, content)
            queue.write_buffer(self._vertices, first_vertex * records.VERTEX.itemsize, rows)
            core = content.core.reshape(-1)
            if len(core):
                padded = np.zeros(len(core) + len(core) % 2, np.uint16)  # copies have a multiple of 4 bytes
                padded[: len(core)] = core
                queue.write_buffer(self._cores, first_index * 2, padded)

    def prepare(self, view: QuiltView, part: TerrainPart, overlay: str) -> None:
        """Nothing has to be known before."""

    def draw(self, encoder: Any, target: Target, view: QuiltView, part: TerrainPart, overlay: str) -> None:
        """One draw for each pair of a patch and a panel, and one for each panel's triangles between patches."""
        places, fans, look = part.places, part.fans, self._look
        assert places is not None
        assert fans is not None
        patches = part.cut.pair_patch
        if not places.resident[patches].all():
            raise ValueError("a patch of the cut is not resident")
        stands, eyes_m = part.choice.room_from_posts, view.eyes_m
        nodes, node = self._ground.nodes, self._ground.patches.node[patches]
        order = records.nearest_first(nodes, node, part.cut.pair_panel, stands, eyes_m[0])
        tints = panel_tints(part.choice.seen, part.cut.panel_error_px) if overlay == "panels" else None
        self._write_frame(view, part, tints)
        self._write_pages(part.tables)
        self._rims.write(fans.triangles.reshape(-1))
        contours = contour_interval_m(look, self._ground.low_m, self._ground.high_m) > 0
        facing = np.array([eye.facing for eye in view.eyes])
        pipelines, group = self._pipelines, self._group()
        pairs = part.cut.pair_panel, patches[order]
        if overlay == "patches":
            render_pass = encoder.begin_render_pass(
                color_attachments=[target.colour()], depth_stencil_attachment=target.depth()
            )
            render_pass.set_pipeline(pipelines.patches(target.format, look.colours, contours=contours))
            self._record(render_pass, group, view, facing, pairs, places, fans)
            render_pass.end()
            return
        depth = self._targets.texture(view.size_px, DEPTH_FORMAT).create_view()
        render_pass = encoder.begin_render_pass(
            color_attachments=[],
            depth_stencil_attachment={
                "view": depth, "depth_clear_value": 0.0, "depth_load_op": "clear", "depth_store_op": "store",
            },
        )  # fmt: skip
        render_pass.set_pipeline(pipelines.depth())
        self._record(render_pass, group, view, facing, pairs, places, fans)
        render_pass.end()
        picture = pipelines.picture(
            target.format, look.colours, contours=contours, panels=overlay == "panels", fading=self._fading,
            deep=not target.alone,
        )  # fmt: skip
        self._record_picture(encoder, picture, group, depth, target, np.flatnonzero(facing).tolist())

    def triangles(self, *, wait: bool) -> int:
        return 0

    def read_depth(self, view: QuiltView) -> NDArray[np.float32]:
        """The depth of the last draw of a quilt of this size, shape (H, W): 1 is near, 0 nothing; waits."""
        return self._targets.read_depth(view.size_px)

    def destroy(self) -> None:
        """Free everything; the terrain and its drape stay open."""
        for buffer in (self._vertices, self._cores, self._rims, *self._buffers.values()):
            buffer.destroy()
        for pool in self._pools:
            pool.destroy()
        self._targets.destroy()
        self._pipelines.clear()

    # ------------------------------------------------------------------ steps of a draw

    def _write_frame(self, view: QuiltView, part: TerrainPart, tints: NDArray[np.float32] | None) -> None:
        """Hand over what all fragments of a frame have in common."""
        ground, stands, choice = self._ground, part.choice.room_from_posts, part.choice
        origin = records.origin_near(view.eyes_m[0], stands, ground.size_posts)
        low_high = ground.low_m, ground.high_m
        buffers = self._buffers
        buffers["terrain"].write(records.terrain_row(self._look, origin, stands, ground.spacing_m, low_high))
        rows = records.view_rows(list(view.eyes), stands, origin, choice.allowed_px, tints, view.size_px)
        buffers["view"].write(records.in_strides(rows))
        self._origin = origin

    def _write_pages(self, tables: tuple[PageTable, ...]) -> None:
        ground, draped = self._ground, self._draped
        if len(tables) != len(self._pools):
            raise ValueError("a terrain with a drape is drawn with the drape's pages")
        # Relief takes the place of a drape that is not there.
        shown = tables if draped else (*tables, tables[0])
        if list(map(id, tables)) != list(map(id, self._tables)):
            self._buffers["table"].write(np.concatenate([page_table(table) for table in shown]))
            self._tables = tables
            self._fading = any(bool((table.fade[table.slot >= 0] < 1).any()) for table in shown)
        pyramids = [ground.relief.pyramid, ground.heights.pyramid, (draped.image if draped else ground.relief).pyramid]
        maps = [_POST_CENTRES, _POST_CENTRES, draped.texel_from_post if draped else _POST_CENTRES]
        rows, first = [], 0
        for pyramid, table, pool, texel_from_post in zip(pyramids, shown, self._three_pools, maps, strict=True):
            ready = bool(table.slot[-1] >= 0)
            rows.append(records.source_row(pyramid, pool.layer_px, first, texel_from_post, self._origin, ready))
            first += pyramid.page_count
        self._buffers["sources"].write(np.concatenate(rows))

    @property
    def _three_pools(self) -> list[PagePool]:
        """Of relief, heights and drape; relief in place of a drape that is not there."""
        return self._pools if self._draped else [*self._pools, self._pools[0]]

    def _record(
        self, render_pass: Any, group: Any, view: QuiltView, facing: NDArray[np.bool_],
        pairs: tuple[NDArray[np.int64], ...], places: PatchPlaces, fans: Fans,
    ) -> None:  # fmt: skip
        render_pass.set_vertex_buffer(0, self._vertices)
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
        bounds, rim_first = view.panels.bounds_px.tolist(), (fans.panel_first * 3).tolist()
        for index, sized in ((self._cores, "uint16"), (self._rims.buffer, "uint32")):
            render_pass.set_index_buffer(index, sized)
            for eye, panel in np.argwhere(facing).tolist():
                left, top, right, bottom = bounds[panel]
                row = eye * count + panel
                own = cores[pair_first[panel] : pair_first[panel + 1]]
                if not own or right <= left or bottom <= top:
                    continue
                shift = eye * view.quilt.size_px[0]
                render_pass.set_bind_group(0, group, [row * records.VIEW_STRIDE])
                render_pass.set_scissor_rect(left + shift, top, right - left, bottom - top)
                if sized == "uint16":
                    for indices, first_index, first_vertex in own:
                        if indices:
                            render_pass.draw_indexed(indices, 1, first_index, first_vertex)
                elif rim_first[panel + 1] > rim_first[panel]:
                    begin = rim_first[panel]
                    render_pass.draw_indexed(rim_first[panel + 1] - begin, 1, begin)

    def _record_picture(
        self, encoder: Any, pipeline: Any, group: Any, depth: Any, target: Target, views: list[int]
    ) -> None:
        """Colour the pixels of every panel whose depth was drawn; others fail the depth test, or are thrown away."""
        entries = [{"binding": 0, "resource": depth}]
        depths = self._device.wgpu.create_bind_group(layout=self._pipelines.depth_layout, entries=entries)
        attached = target.depth() if not target.alone else None
        if target.alone and self._pipelines.attaches_depth:
            attached = {"view": depth, "depth_read_only": True}
        render_pass = encoder.begin_render_pass(color_attachments=[target.colour()], depth_stencil_attachment=attached)
        render_pass.set_pipeline(pipeline)
        render_pass.set_bind_group(1, depths)
        for view in views:
            render_pass.set_bind_group(0, group, [view * records.VIEW_STRIDE])
            render_pass.draw(OUTLINE_VERTICES)
        render_pass.end()

    def _group(self) -> Any:
        resources: dict[str, Any] = {name: {"buffer": buffer.buffer} for name, buffer in self._buffers.items()}
        resources["view"] |= {"offset": 0, "size": records.TERRAIN_VIEW.itemsize}
        pools = zip(("relief_pool", "heights_pool", "drape_pool"), self._three_pools, strict=True)
        resources |= {name: pool.texels for name, pool in pools} | {"bilinear": self._sampler}
        entries = [{"binding": number, "resource": resources[name]} for name, number in BINDINGS.items()]
        return self._device.wgpu.create_bind_group(layout=self._pipelines.layout, entries=entries)


def _buffer(device: Device, label: str, size: int, usage: int) -> Any:
    try:
        return device.wgpu.create_buffer(label=label, size=size, usage=usage | wgpu.BufferUsage.COPY_DST)
    except wgpu.GPUError as error:
        reason = " ".join(str(error).split())
        raise DeviceLimitError(f"{label}: the adapter refused {size / 1e6:.0f} MB, give it less: {reason}") from None
