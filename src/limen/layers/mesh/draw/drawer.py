"""Draws a mesh into a quilt: every panel a window onto the same scene, all of them in one indirect draw.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 3.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import wgpu

from limen.data.mesh.mesh import Mesh
from limen.errors import InputError
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.gpu.targets import DEPTH_FORMAT, Target
from limen.layers.common.lighting import AMBIENT, TOWARD_LIGHT
from limen.layers.mesh.draw.folded import fold_colours, mesh_of_nodes
from limen.layers.mesh.draw.sort import TriangleSorter
from limen.layers.mesh.draw.sorter import Sorter
from limen.layers.mesh.draw.textures import upload_textures
from limen.layers.mesh.draw.uniforms import corner_rows, scene_row
from limen.layers.mesh.layer import MeshLayer, MeshPart
from limen.layers.mesh.select import MeshCut
from limen.stream.chunks import Allocator, Update
from limen.viewing.projection import NEAR_M, QuiltView

__all__ = ["MeshDrawer"]

_OVERLAYS = {"": 0, "panels": 1, "simplified": 0}
_NUMBERS = {
    "scene": 0, "views": 1, "triangles": 2, "ways": 3, "pairs": 4, "corners": 5, "pictures": 6, "smoothly": 7,
    "warped": 8,
}  # fmt: skip
_SORTED = ("views", "triangles", "ways", "pairs", "warped")


class MeshDrawer:
    """Draws one mesh.

    Parameters
    ----------
    layer
        What is shown, and how its depth is made.
    gpu_bytes
        Nothing is streamed: the mesh is taken whole.
    first_pairs
        See `limen.layers.mesh.draw.sorter.Sorter`.
    sorter
        How triangles find their panels; all ways draw the same picture.

    Raises
    ------
    DeviceLimitError
        If the mesh is larger than a shader of this adapter can see.
    """

    allocators: tuple[Allocator, ...] = ()

    def __init__(
        self,
        device: Device,
        layer: MeshLayer,
        gpu_bytes: int = 0,
        *,
        first_pairs: int | None = None,
        sorter: type[Sorter] = TriangleSorter,
    ) -> None:
        self._device, self._tree, self._depth = device, layer.tree, layer.depth
        self._mesh = mesh = layer.mesh if layer.tree is None else mesh_of_nodes(layer.mesh, layer.tree.tree)
        self.sorter = sorter(device, mesh.positions, mesh.triangles, first_pairs=first_pairs)
        self._has_holes = bool((mesh.colours[:, 3] < 128).any() or (mesh.textures[..., 3] < 128).any())
        self._clips = layer.clip and device.can_clip and not self._has_holes
        self._fragments = load_shader(device, "limen.layers.mesh.draw", "scene.wgsl")
        self._vertices = (
            load_shader(device, "limen.layers.mesh.draw", "scene_clip.wgsl") if self._clips else self._fragments
        )
        self._corners = GrowingBuffer(device, "corners", wgpu.BufferUsage.STORAGE)
        self._corners.write(corner_rows(mesh))
        self._scene = GrowingBuffer(device, "scene", wgpu.BufferUsage.UNIFORM)
        self._pictures = upload_textures(device, mesh.textures)
        self._sampler = device.wgpu.create_sampler(
            mag_filter="linear", min_filter="linear", mipmap_filter="linear",
            address_mode_u="repeat", address_mode_v="repeat",
        )  # fmt: skip
        self._layout = self._bind_group_layout()
        self._pipelines: dict[tuple[str, str], Any] = {}
        self._cut: MeshCut | None = None
        self._deformed: Mesh | None = None
        self._tinted = False
        self._pairs = 0

    def upload(self, source: int, update: Update[Any]) -> None:
        """Nothing is streamed."""

    def prepare(self, view: QuiltView, part: MeshPart, overlay: str) -> None:
        """Find which triangles touch which panels; waits for the adapter.

        Where there is no room for all pairs, more is made and they are sorted once more: no triangle is lost.
        """
        if part.deformed is not self._deformed and part.deformed is not None:
            self._move(part.deformed)
        if part.cut is not None and part.cut is not self._cut:
            self._cut = part.cut
            self.sorter.choose(part.cut.triangles)
        if overlay == "simplified" or self._tinted:
            self._paint(part.cut if overlay == "simplified" else None)
        eyes_m = view.eyes_m
        if view.panels.copies != len(eyes_m):
            raise ValueError(f"windows for {view.panels.copies} eyes were given {len(eyes_m)}")
        eye_from_mesh = np.repeat(part.room_from_mesh[None, :3], len(eyes_m), axis=0)
        eye_from_mesh[:, :, 3] -= eyes_m
        forward = np.repeat(np.array([view.looking]), len(eyes_m), axis=0)
        self._scene.write(
            scene_row(
                part.room_from_mesh, vertices=self.sorter.vertex_count, panels=len(view.quilt.panels), forward=forward,
                near_m=NEAR_M, light=np.array([*TOWARD_LIGHT, AMBIENT]),
            )
        )  # fmt: skip
        self.sorter.sort(list(view.eyes), eye_from_mesh)
        self._pairs = self.sorter.settle()

    def draw(self, encoder: Any, target: Target, view: QuiltView, part: MeshPart, overlay: str) -> None:
        render_pass = encoder.begin_render_pass(
            color_attachments=[target.colour()], depth_stencil_attachment=target.depth()
        )
        render_pass.set_pipeline(self._pipeline(target.format, overlay))
        render_pass.set_bind_group(0, self._group())
        self.sorter.record(render_pass, view.panels)
        render_pass.end()

    def triangles(self, *, wait: bool) -> int:
        """Pairs of a triangle and a panel that it touches."""
        return self._pairs

    def destroy(self) -> None:
        self._pictures.destroy()
        for buffer in (self._corners, self._scene):
            buffer.destroy()
        self.sorter.destroy()
        self._pipelines.clear()

    # ------------------------------------------------------------------ steps of a draw

    def _move(self, mesh: Mesh) -> None:
        """The same triangles with other places and normals."""
        if len(mesh.positions) != self.sorter.vertex_count or len(mesh.triangles) != self.sorter.triangle_count:
            raise InputError("a mesh that is deformed keeps its triangles: another mesh needs another layer")
        self._deformed = mesh
        self.sorter.move(mesh.positions)
        self._corners.write(corner_rows(mesh))

    def _paint(self, cut: MeshCut | None) -> None:
        """Colours that show what a cut folds, or the mesh's own."""
        assert self._tree is not None
        self._tinted = cut is not None
        colours = self._mesh.colours if cut is None else fold_colours(self._tree, cut)
        self._corners.write(corner_rows(replace(self._mesh, colours=colours)))

    def _group(self) -> Any:
        # Not every way of sorting has what another draws from; the shader of this one does not look there.
        buffers = {name: self.sorter.buffers.get(name, self.sorter.buffers["ways"]) for name in _SORTED}
        buffers |= {"scene": self._scene, "corners": self._corners}
        resources: dict[str, Any] = {name: {"buffer": buffer.buffer} for name, buffer in buffers.items()}
        resources |= {"pictures": self._pictures.create_view(dimension="2d-array"), "smoothly": self._sampler}
        entries = [{"binding": number, "resource": resources[name]} for name, number in _NUMBERS.items()]
        return self._device.wgpu.create_bind_group(layout=self._layout, entries=entries)

    def _bind_group_layout(self) -> Any:
        kinds: dict[str, dict[str, Any]] = {
            "scene": {"buffer": {"type": "uniform"}},
            "pictures": {"texture": {"sample_type": "float", "view_dimension": "2d-array"}},
            "smoothly": {"sampler": {"type": "filtering"}},
        }
        storage = {"buffer": {"type": "read-only-storage"}}
        both = wgpu.ShaderStage.VERTEX | wgpu.ShaderStage.FRAGMENT
        return self._device.kept(
            "create_bind_group_layout",
            entries=[
                {"binding": number, "visibility": both, **kinds.get(name, storage)} for name, number in _NUMBERS.items()
            ],
        )

    def _pipeline(self, target_format: str, overlay: str) -> Any:
        key = (target_format, overlay)
        if key not in self._pipelines:
            entry = ("" if self._clips else "cut_") + "picture" + ("_deep" if self._depth == "shared" else "")
            self._pipelines[key] = self._device.kept(
                "create_render_pipeline",
                label=entry,
                layout=self._device.kept("create_pipeline_layout", bind_group_layouts=[self._layout]),
                vertex={
                    "module": self._vertices,
                    "entry_point": "vertex",
                    "constants": {"SOURCE": self.sorter.source},
                },
                primitive={"topology": "triangle-list"},
                depth_stencil={"format": DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "greater"},
                fragment={
                    "module": self._fragments,
                    "entry_point": entry,
                    "constants": {"OVERLAY": _OVERLAYS[overlay]},
                    "targets": [{"format": target_format}],
                },
            )
        return self._pipelines[key]
