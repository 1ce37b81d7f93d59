"""Draws an image into quilts: pages from the pool, each pixel at the level that the tolerance asks for.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 3.2 (the level of a pixel).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.display.quilt import Quilt
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.pool import PagePool
from limen.gpu.shader import load_shader
from limen.gpu.targets import DEPTH_FORMAT, Target
from limen.layers.common.page_detail import Detail
from limen.layers.image.draw import uniforms as records
from limen.layers.image.draw.lens_mesh import LensMesh
from limen.layers.image.layer import ImagePart, Sampling
from limen.layers.image.select import ImageOnDisplay
from limen.stream.allocators import Slots
from limen.stream.chunks import Update
from limen.stream.pages import PageTable, page_table
from limen.viewing.placement import OnSurface
from limen.viewing.projection import GUARD_PX, QuiltView

if TYPE_CHECKING:
    from limen.layers.image.layer import ImageLayer

__all__ = ["EXACT_FORMAT", "ImageDrawer"]

EXACT_FORMAT = "rgba8unorm"
"""Format for the overlay ``exact``: level, levels coarser, the panel's place in the quilt, 255 where drawn."""

_KERNELS: dict[Sampling, int] = {"fast": 0, "sharp": 1}
_OVERLAYS = {"": 0, "levels": 1, "exact": 2, "error": 3}

_NUMBERS = {
    "frame": 0, "panels": 1, "eyes": 2, "quads": 3, "levels": 4, "table": 5, "pool": 6, "bilinear": 7, "finer": 9,
    "lenses": 10, "corners": 15,
}  # fmt: skip
_FLAT = ("frame", "panels", "eyes", "quads", "levels", "pool", "bilinear", "finer")
_BENT = ("frame", "panels", "eyes", "levels", "table", "pool", "bilinear", "finer", "lenses")
_LENS = (*_BENT, "corners")
_OVER = {"src_factor": "src-alpha", "dst_factor": "one-minus-src-alpha", "operation": "add"}
"""Levels that blend into each other are painted over each other, the coarsest first."""


_WHERE_NOTHING_IS = {"format": DEPTH_FORMAT, "depth_write_enabled": False, "depth_compare": "greater-equal"}
"""Images have the depth 0."""

_Variant: TypeAlias = tuple[str, str, bool, bool]
"""Of a pipeline: the target's format, the overlay, whether a panel is turned, and whether there is depth: then it is
drawn where nothing else is, which lies behind all."""


class ImageDrawer:
    """Draws one image.

    Parameters
    ----------
    layer
        What is shown, and how it is sampled.
    gpu_bytes
        Memory for pages.

    Raises
    ------
    InputError, DeviceLimitError
        If there is not room for the coarsest page and one more, or the adapter cannot hold so many.
    """

    def __init__(self, device: Device, layer: ImageLayer, gpu_bytes: int) -> None:
        self._device, self._pool = device, PagePool(device, gpu_bytes, layer.image.pyramid.page_count)
        self.allocators = (Slots(self._pool.slots),)
        self._shader = load_shader(device, "limen.layers.image.draw", "lens_split.wgsl")
        kernel = {"KERNEL": _KERNELS[layer.sampling]}
        self._stages = {
            "flat": _Stage(device, self._shader, "flat", _FLAT, kernel),
            "bent": _Stage(device, self._shader, "bent", _BENT, kernel),
            "lens": _Stage(device, self._shader, "lens", _LENS, {**kernel, "EXACT": 1}),
            "mesh": _Stage(device, self._shader, "lens", _LENS, {**kernel, "EXACT": 0}),
        }
        self._lens_mesh: LensMesh | None = None
        self._view: ImageOnDisplay | None = None
        self._static_rows: dict[Quilt, records.Rows] = {}
        storage = wgpu.BufferUsage.STORAGE
        self._buffers = {
            name: GrowingBuffer(device, name, storage)
            for name in ("panels", "eyes", "quads", "table", "levels", "finer", "lenses")
        }
        self._buffers["frame"] = GrowingBuffer(device, "frame", wgpu.BufferUsage.UNIFORM)
        self._buffers["levels"].write(records.level_rows(layer.image.pyramid))
        self._buffers["finer"].write(np.zeros(1, np.float32))  # always bound, read only by what looks pages up
        self._sampler = device.wgpu.create_sampler(mag_filter="linear", min_filter="linear")
        self._table_of: PageTable | None = None
        self._detail: Detail | None = None

    def upload(self, source: int, update: Update[NDArray[np.uint8]]) -> None:
        self._pool.write(update.arrived)

    def prepare(self, view: QuiltView, part: ImagePart, overlay: str) -> None:
        """Nothing has to be known before."""

    def draw(self, encoder: Any, target: Target, view: QuiltView, part: ImagePart, overlay: str) -> None:
        """Draw the panels of a quilt; beyond the image and outside panels' outlines nothing is drawn.

        ``overlay``: beside those of an `limen.layers.image.layer.ImageLayer`, ``exact`` writes numbers instead, see
        `EXACT_FORMAT`.
        """
        shown, quilt, cut = part.view, view.quilt, part.cut
        if self._view is None or shown.maps is not self._view.maps or shown.placement is not self._view.placement:
            self._static_rows.clear()  # a pan, a zoom or a lens on the surface
        self._view = shown
        quads, cells = self._write(view, part)
        if (part.pages.table is not None or overlay == "levels") and cut.detail is not self._detail:
            self._buffers["finer"].write(records.log2_tau(cut.detail.tau).astype(np.float32))
            self._detail = cut.detail
        if cells:
            self.lens_mesh.encode(encoder, cells, self._buffers)
            self._buffers["corners"] = self.lens_mesh.corners
        render_pass = encoder.begin_render_pass(
            color_attachments=[target.colour()], depth_stencil_attachment=target.depth() if target.is_deep else None
        )
        resources = {"pool": self._pool.texels, "bilinear": self._sampler}
        variant = (target.format, overlay, any(quilt.turns), target.is_deep)
        if quads:
            stage = self._stages["bent" if shown.maps is None else "flat"]
            stage.begin(render_pass, self._buffers, resources, variant)
            render_pass.draw(4, quads)
        if cells:
            stage = self._stages["lens" if self.lens_mesh.tessellation.mode == "exact" else "mesh"]
            stage.begin(render_pass, self._buffers, resources, variant)
            render_pass.draw_indirect(self.lens_mesh.drawn.buffer, 0)
        render_pass.end()

    @property
    def lens_mesh(self) -> LensMesh:
        """What the view's lenses are drawn by; made anew where its placement asks for another tessellation."""
        assert self._view is not None
        placement = self._view.placement
        assert isinstance(placement, OnSurface)
        if self._lens_mesh is None or self._lens_mesh.tessellation != placement.tessellation:
            if self._lens_mesh is not None:
                self._lens_mesh.destroy()
            self._lens_mesh = LensMesh(self._device, self._shader, placement.tessellation)
        return self._lens_mesh

    def triangles(self, *, wait: bool) -> int:
        """That lenses were drawn in."""
        if not wait or self._view is None or self._view.cells is None or self.lens_mesh.tessellation.mode == "exact":
            return 0
        return self.lens_mesh.count

    def destroy(self) -> None:
        if self._lens_mesh is not None:
            self._lens_mesh.destroy()
        for buffer in self._buffers.values():
            buffer.destroy()
        self._pool.destroy()
        self._stages.clear()
        self._sampler = self._shader = self._lens_mesh = None

    # ------------------------------------------------------------------ steps of a draw

    def _write(self, seen: QuiltView, part: ImagePart) -> tuple[int, int]:
        """Hand the frame over; returns how many quads and cells are to be drawn."""
        view, quilt, buffers, pages = part.view, seen.quilt, self._buffers, part.pages
        fields: dict[str, Any] = {"layers_per_px": 1 / np.array(self._pool.layer_px)}
        lenses, fields["tables"] = records.lens_rows(view, quilt)
        buffers["lenses"].write(lenses)
        if view.cells is not None:
            fields |= self.lens_mesh.write(view.cells, quilt)
        guard_px = _guard_of(seen, view)
        buffers["frame"].write(
            records.frame_row(view, quilt.size_px, part.tolerance, part.eye_m, bias=part.cut.bias, **fields)
        )
        buffers["panels"].write(self._panel_rows(part, quilt, guard_px))
        buffers["eyes"].write(records.eye_rows(view, quilt, part.tolerance))
        if pages.table is not None and pages.table is not self._table_of:
            buffers["table"].write(page_table(pages.table))
            self._table_of = pages.table
        if pages.pairs is None:
            return len(quilt.panels), 0
        quads = records.page_quads(view, quilt, part.cut, pages.pairs, guard_px)
        buffers["quads"].write(quads)
        return len(quads), fields.get("cells", 0)

    def _panel_rows(self, part: ImagePart, quilt: Quilt, guard_px: float) -> records.Rows:
        if part.view.maps is None:
            return records.panel_rows(part.view, quilt, part.eye_m, guard_px)
        if quilt not in self._static_rows:
            self._static_rows[quilt] = records.panel_rows(part.view, quilt, part.eye_m, guard_px)
        return self._static_rows[quilt]


def _guard_of(seen: QuiltView, view: ImageOnDisplay) -> float:
    """Panels that touch would be drawn over each other.

    What is seen through lenses ends at outlines: beside it, the image without them would be something else.
    """
    return seen.panels.guard_px if seen.panels.guard_px >= GUARD_PX and view.cells is None else 0.0


class _Stage:
    """One of the shader's ways of drawing, and what it reads."""

    def __init__(
        self, device: Device, shader: Any, kind: str, names: Sequence[str], constants: Mapping[str, float]
    ) -> None:
        self._device, self._shader, self._kind, self._names, self._constants = device, shader, kind, names, constants
        self._layout: Any = None
        self._group: Any = None
        self._bound: list[Any] = []
        self._pipelines: dict[_Variant, Any] = {}

    def begin(
        self,
        render_pass: Any,
        buffers: dict[str, GrowingBuffer],
        resources: dict[str, Any],
        variant: _Variant,
    ) -> None:
        """Set all that a draw call needs; the bind group is a new one where a buffer had to grow."""
        if self._layout is None:
            self._layout = self._bind_group_layout()
        if variant not in self._pipelines:
            self._pipelines[variant] = self._pipeline(*variant)
        used = [name for name in self._names if name in buffers]
        state = [buffers[name].buffer for name in used]
        if self._group is None or state != self._bound:
            resources = resources | {name: {"buffer": buffers[name].buffer} for name in used}
            entries = [{"binding": _NUMBERS[name], "resource": resources[name]} for name in self._names]
            self._group = self._device.wgpu.create_bind_group(layout=self._layout, entries=entries)
            self._bound = state
        render_pass.set_pipeline(self._pipelines[variant])
        render_pass.set_bind_group(0, self._group)

    def _bind_group_layout(self) -> Any:
        both = wgpu.ShaderStage.VERTEX | wgpu.ShaderStage.FRAGMENT
        kinds: dict[str, dict[str, Any]] = {
            "frame": {"buffer": {"type": "uniform"}},
            "pool": {"texture": {"sample_type": "float", "view_dimension": "2d-array"}},
            "bilinear": {"sampler": {"type": "filtering"}},
        }
        storage = {"buffer": {"type": "read-only-storage"}}
        entries = [{"binding": _NUMBERS[name], "visibility": both, **kinds.get(name, storage)} for name in self._names]
        return self._device.kept("create_bind_group_layout", entries=entries)

    def _pipeline(self, target_format: str, overlay: str, turned: bool, deep: bool) -> Any:
        colours: dict[str, Any] = {"format": target_format}
        # What is seen through lenses lies over what would be seen without them.
        if overlay != "exact" and self._kind != "lens":
            colours["blend"] = {"color": _OVER, "alpha": {**_OVER, "src_factor": "one"}}
        return self._device.kept(
            "create_render_pipeline",
            label=f"image {self._kind}",
            layout=self._device.kept("create_pipeline_layout", bind_group_layouts=[self._layout]),
            vertex={"module": self._shader, "entry_point": f"{self._kind}_vertex"},
            primitive={"topology": "triangle-list" if self._kind == "lens" else "triangle-strip"},
            depth_stencil=_WHERE_NOTHING_IS if deep else None,
            fragment={
                "module": self._shader,
                "entry_point": f"{self._kind}_fragment",
                "constants": {**self._constants, "OVERLAY": _OVERLAYS[overlay], "TURNED": turned},
                "targets": [colours],
            },
        )
