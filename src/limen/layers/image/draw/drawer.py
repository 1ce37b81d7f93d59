"""Draws an image into quilts: pages from the pool, each pixel at the level that the tolerance asks for.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 3.2 (the level of a pixel).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.display.quilt import Quilt
from limen.geometry import Vec3
from limen.gpu.buffers import GrowingBuffer, TextureReader
from limen.gpu.device import Device
from limen.gpu.pool import PagePool
from limen.gpu.shader import load_shader
from limen.layers.common.matching import PanelMatching
from limen.layers.common.page_detail import Detail
from limen.layers.image.cut import Cut
from limen.layers.image.draw import uniforms as records
from limen.layers.image.draw.lens_mesh import LensMesh
from limen.layers.image.select import ImageOnDisplay
from limen.stream.pages import Drawable, PageStream, PageTable, page_table
from limen.viewing.placement import OnSurface
from limen.viewing.projection import QuiltPanels
from limen.viewing.tolerance import Tolerance

__all__ = ["EXACT_FORMAT", "QUILT_FORMAT", "ImageLayer", "Overlay", "PlacedPages", "Sampling", "drawable_of"]

Sampling: TypeAlias = Literal["sharp", "fast"]
Overlay: TypeAlias = Literal["levels", "exact", "error"]

QUILT_FORMAT = "rgba8unorm-srgb"
EXACT_FORMAT = "rgba8unorm"
"""Format for the overlay ``exact``: level, levels coarser, the panel's place in the quilt, 255 where drawn."""

_KERNELS: dict[Sampling, int] = {"fast": 0, "sharp": 1}
_OVERLAYS: dict[Overlay | None, int] = {None: 0, "levels": 1, "exact": 2, "error": 3}
_RIM_PX = 0.01
"""An image ends at its panel's outline; a pixel whose centre is on it is dimmed with the panel."""
_BLACK = (0.0, 0.0, 0.0, 0.0)

_NUMBERS = {
    "frame": 0, "panels": 1, "eyes": 2, "quads": 3, "levels": 4, "table": 5, "pool": 6, "bilinear": 7, "finer": 9,
    "lenses": 10, "corners": 15,
}  # fmt: skip
_FLAT = ("frame", "panels", "eyes", "quads", "levels", "pool", "bilinear", "finer")
_BENT = ("frame", "panels", "eyes", "levels", "table", "pool", "bilinear", "finer", "lenses")
_LENS = (*_BENT, "corners")
_OVER = {"src_factor": "src-alpha", "dst_factor": "one-minus-src-alpha", "operation": "add"}
"""Levels that blend into each other are painted over each other, the coarsest first."""


_Variant: TypeAlias = tuple[str, Overlay | None, bool]
"""Of a pipeline: the target's format, the overlay, and whether a panel is turned."""


class PlacedPages(NamedTuple):
    """Where the pages are that a frame draws."""

    pairs: Drawable | None  # of `Cut.pair_page`
    table: PageTable | None  # for pixels that look pages up


def drawable_of(stream: PageStream, view: ImageOnDisplay, cut: Cut) -> PlacedPages:
    """What of a cut is there to be drawn."""
    looked_up = view.maps is None or view.cells is not None
    return PlacedPages(
        None if view.maps is None else stream.drawable(cut.pair_page), stream.table() if looked_up else None
    )


class ImageLayer:
    """One image on one display.

    Parameters
    ----------
    view
        The image on the display; for an image on a shape instead of the surface, or the other way round, make another
        layer on the same pool.
    pool
        Where the image's pages are.
    sampling
        ``sharp``: a cubic kernel as wide as the pixel's footprint. ``fast``: bilinear, for live windows without a
        GPU; it aliases where a pixel covers nearly two texels.
    guard_px
        How far beyond panels' outlines the image is drawn in the display's own quilts.
    """

    def __init__(
        self,
        device: Device,
        view: ImageOnDisplay,
        pool: PagePool,
        *,
        sampling: Sampling = "sharp",
        guard_px: float = 0.0,
    ) -> None:
        self._device, self._view, self._pool, self._guard_px = device, view, pool, guard_px
        self._shader = load_shader(device, "limen.layers.image.draw", "lens_split.wgsl")
        kernel = {"KERNEL": _KERNELS[sampling]}
        self._stages = {
            "flat": _Stage(device, self._shader, "flat", _FLAT, kernel),
            "bent": _Stage(device, self._shader, "bent", _BENT, kernel),
            "lens": _Stage(device, self._shader, "lens", _LENS, {**kernel, "EXACT": 1}),
            "mesh": _Stage(device, self._shader, "lens", _LENS, {**kernel, "EXACT": 0}),
        }
        self._lens_mesh: LensMesh | None = None
        self._targets: dict[tuple[tuple[int, int], str], Any] = {}
        self._static_rows: dict[Quilt, records.Rows] = {}
        self._windows: dict[Quilt, QuiltPanels] = {}
        self._matching = PanelMatching(device)
        storage = wgpu.BufferUsage.STORAGE
        self._buffers = {
            name: GrowingBuffer(device, name, storage)
            for name in ("panels", "eyes", "quads", "table", "levels", "finer", "lenses")
        }
        self._buffers["frame"] = GrowingBuffer(device, "frame", wgpu.BufferUsage.UNIFORM)
        self._buffers["levels"].write(records.level_rows(view.pyramid))
        self._buffers["finer"].write(np.zeros(1, np.float32))  # always bound, read only by what looks pages up
        self._sampler = device.wgpu.create_sampler(mag_filter="linear", min_filter="linear")
        self._reader = TextureReader(device)
        self._table_of: PageTable | None = None
        self._detail: Detail | None = None

    def place(self, view: ImageOnDisplay) -> None:
        """Go on with another view of the same image on the same display (a pan, a zoom or a lens on the surface)."""
        if (view.maps is None) != (self._view.maps is None) or view.pyramid.size_px != self._view.pyramid.size_px:
            raise ValueError("another image, or one on a shape instead of the surface, needs another layer")
        self._view = view
        self._static_rows.clear()
        self._windows.clear()

    def draw(
        self,
        cut: Cut,
        drawable: PlacedPages,
        tolerance: Tolerance,
        quilt: Quilt,
        *,
        eye_m: Vec3 | None = None,
        overlay: Overlay | None = None,
        target: Any = None,
        target_format: str = QUILT_FORMAT,
    ) -> Any:
        """Draw the panels of a quilt; beyond the image and outside panels' outlines the quilt is black.

        Parameters
        ----------
        cut
            What the selector chose for the same view and tolerance.
        drawable
            What `drawable_of` says of it. A table is copied to the GPU only when it is another object than last time.
        tolerance
            The tolerance that the cut was chosen for.
        eye_m
            The eye point of an image on a shape, unless the shape fixes it; and for whom panels are matched that lose
            light at a slant.
        overlay
            ``levels`` tints each pixel by its level, ``error`` by how far lenses draw it from where it belongs;
            ``exact`` writes numbers instead, see `EXACT_FORMAT`.
        target
            A texture view to draw into (a window's), of ``target_format`` and the quilt's size.

        Returns
        -------
        texture
            The quilt's texture, valid until the next draw of a quilt of the same size; ``None`` with a ``target``.
        """
        if overlay == "exact":
            target_format = EXACT_FORMAT
        quads, cells = self._write(cut, drawable, tolerance, quilt, eye_m)
        if (drawable.table is not None or overlay == "levels") and cut.detail is not self._detail:
            self._buffers["finer"].write(records.log2_tau(cut.detail.tau).astype(np.float32))
            self._detail = cut.detail
        texture = None if target is not None else self._target(quilt.size_px, target_format)
        encoder = self._device.wgpu.create_command_encoder(label="image")
        if cells:
            self.lens_mesh.encode(encoder, cells, self._buffers)
            self._buffers["corners"] = self.lens_mesh.corners
        render_pass = encoder.begin_render_pass(
            color_attachments=[
                {
                    "view": texture.create_view() if texture is not None else target,
                    "clear_value": _BLACK,
                    "load_op": "clear",
                    "store_op": "store",
                }
            ]
        )
        resources = {"pool": self._pool.texels, "bilinear": self._sampler}
        if quads:
            stage = self._stages["bent" if self._view.maps is None else "flat"]
            stage.begin(render_pass, self._buffers, resources, (target_format, overlay, any(quilt.turns)))
            render_pass.draw(4, quads)
        if cells:
            stage = self._stages["lens" if self.lens_mesh.tessellation.mode == "exact" else "mesh"]
            stage.begin(render_pass, self._buffers, resources, (target_format, overlay, any(quilt.turns)))
            render_pass.draw_indirect(self.lens_mesh.drawn.buffer, 0)
        render_pass.end()
        if overlay != "exact":  # whose numbers are no light
            self._match(encoder, quilt, eye_m, texture.create_view() if texture is not None else target, target_format)
        self._device.wgpu.queue.submit([encoder.finish()])
        return texture

    @property
    def lens_mesh(self) -> LensMesh:
        """What the view's lenses are drawn by; made anew where its placement asks for another tessellation."""
        placement = self._view.placement
        assert isinstance(placement, OnSurface)
        if self._lens_mesh is None or self._lens_mesh.tessellation != placement.tessellation:
            if self._lens_mesh is not None:
                self._lens_mesh.destroy()
            self._lens_mesh = LensMesh(self._device, self._shader, placement.tessellation)
        return self._lens_mesh

    @property
    def triangle_count(self) -> int:
        """In how many triangles lenses were drawn last; waits for the GPU."""
        if self._view.cells is None or self.lens_mesh.tessellation.mode == "exact":
            return 0
        return self.lens_mesh.count

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """A drawn quilt's pixels, shape (H, W, 4); waits until it is drawn."""
        return self._reader.read(texture)

    def destroy(self) -> None:
        """Free everything but the pool."""
        for texture in self._targets.values():
            texture.destroy()
        self._targets.clear()
        if self._lens_mesh is not None:
            self._lens_mesh.destroy()
        for buffer in self._buffers.values():
            buffer.destroy()
        self._reader.destroy()
        self._matching.destroy()
        self._stages.clear()
        self._sampler = self._shader = self._lens_mesh = None

    # ------------------------------------------------------------------ steps of a draw

    def _write(
        self, cut: Cut, drawable: PlacedPages, tolerance: Tolerance, quilt: Quilt, eye_m: Vec3 | None
    ) -> tuple[int, int]:
        """Hand the frame over; returns how many quads and cells are to be drawn."""
        view, buffers = self._view, self._buffers
        fields: dict[str, Any] = {"layers_per_px": 1 / np.array(self._pool.layer_px)}
        lenses, fields["tables"] = records.lens_rows(view, quilt)
        buffers["lenses"].write(lenses)
        if view.cells is not None:
            fields |= self.lens_mesh.write(view.cells, quilt)
        buffers["frame"].write(records.frame_row(view, quilt.size_px, tolerance, eye_m, bias=cut.bias, **fields))
        buffers["panels"].write(self._panel_rows(quilt, eye_m))
        buffers["eyes"].write(records.eye_rows(view, quilt, tolerance))
        if drawable.table is not None and drawable.table is not self._table_of:
            buffers["table"].write(page_table(drawable.table))
            self._table_of = drawable.table
        if drawable.pairs is None:
            return len(quilt.panels), 0
        quads = records.page_quads(view, quilt, cut, drawable.pairs, self._guard_of(quilt))
        buffers["quads"].write(quads)
        return len(quads), fields.get("cells", 0)

    def _match(self, encoder: Any, quilt: Quilt, eye_m: Vec3 | None, target: Any, target_format: str) -> None:
        if quilt not in self._windows:
            self._windows[quilt] = QuiltPanels(self._view.display, quilt, guard_px=max(_RIM_PX, self._guard_of(quilt)))
        windows = self._windows[quilt]
        eyes_m = np.zeros((0, 3)) if eye_m is None else np.array([eye_m], dtype=float)
        self._matching.record(encoder, windows, eyes_m, target, target_format)

    def _guard_of(self, quilt: Quilt) -> float:
        """Panels of other quilts than the display's own touch, and would be drawn over each other.

        What is seen through lenses ends at outlines: beside it, the image without them would be something else.
        """
        return self._guard_px if quilt in self._view.display.quilts and self._view.cells is None else 0.0

    def _panel_rows(self, quilt: Quilt, eye_m: Vec3 | None) -> records.Rows:
        if self._view.maps is None:
            return records.panel_rows(self._view, quilt, eye_m, self._guard_of(quilt))
        if quilt not in self._static_rows:
            self._static_rows[quilt] = records.panel_rows(self._view, quilt, eye_m, self._guard_of(quilt))
        return self._static_rows[quilt]

    def _target(self, size_px: tuple[int, int], target_format: str) -> Any:
        key = (size_px, target_format)
        if key not in self._targets:
            usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC | wgpu.TextureUsage.TEXTURE_BINDING
            self._targets[key] = self._device.wgpu.create_texture(
                label="quilt", size=(*size_px, 1), format=target_format, usage=usage
            )
        return self._targets[key]


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
        return self._device.wgpu.create_bind_group_layout(entries=entries)

    def _pipeline(self, target_format: str, overlay: Overlay | None, turned: bool) -> Any:
        colours: dict[str, Any] = {"format": target_format}
        # What is seen through lenses lies over what would be seen without them.
        if overlay != "exact" and self._kind != "lens":
            colours["blend"] = {"color": _OVER, "alpha": {**_OVER, "src_factor": "one"}}
        return self._device.wgpu.create_render_pipeline(
            label=f"image {self._kind}",
            layout=self._device.wgpu.create_pipeline_layout(bind_group_layouts=[self._layout]),
            vertex={"module": self._shader, "entry_point": f"{self._kind}_vertex"},
            primitive={"topology": "triangle-list" if self._kind == "lens" else "triangle-strip"},
            fragment={
                "module": self._shader,
                "entry_point": f"{self._kind}_fragment",
                "constants": {**self._constants, "OVERLAY": _OVERLAYS[overlay], "TURNED": turned},
                "targets": [colours],
            },
        )
