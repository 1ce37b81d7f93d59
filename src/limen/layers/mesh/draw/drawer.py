"""Draws a mesh into a quilt: every panel a window onto the same scene, all of them in one indirect draw.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 3.
"""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.geometry import Floats
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.gpu.targets import DEPTH_FORMAT, QUILT_FORMAT, Targets
from limen.layers.common.lighting import AMBIENT, TOWARD_LIGHT
from limen.layers.common.matching import PanelMatching
from limen.layers.mesh.draw.sort import TriangleSorter
from limen.layers.mesh.draw.sorter import Sorter
from limen.layers.mesh.draw.textures import upload_textures
from limen.layers.mesh.draw.uniforms import corner_rows, scene_row
from limen.viewing.choices import Depth
from limen.viewing.projection import NEAR_M, QuiltPanels

__all__ = ["DEPTH_FORMAT", "QUILT_FORMAT", "Depth", "SceneLayer", "SceneOverlay"]

SceneOverlay: TypeAlias = Literal["panels", "simplified"]

_OVERLAYS: dict[SceneOverlay | None, int] = {None: 0, "panels": 1, "simplified": 0}
_NUMBERS = {
    "scene": 0, "views": 1, "triangles": 2, "ways": 3, "pairs": 4, "corners": 5, "pictures": 6, "smoothly": 7,
    "warped": 8,
}  # fmt: skip
_SORTED = ("views", "triangles", "ways", "pairs", "warped")


class SceneLayer:
    """One mesh on one display.

    Parameters
    ----------
    mesh
        What is shown; `move` gives it other places every frame.
    background
        Linear light (red, green, blue) where nothing is drawn.
    clip
        Clip by distances where the adapter can; False cuts in the fragment stage, with the same picture.
    first_pairs
        See `limen.layers.mesh.draw.sorter.Sorter`.
    sorter
        How triangles find their panels; all ways draw the same picture.

    Raises
    ------
    DeviceLimitError
        If the mesh is larger than a shader of this adapter can see.
    """

    def __init__(
        self,
        device: Device,
        mesh: Mesh,
        *,
        background: tuple[float, float, float] = (0.0, 0.0, 0.0),
        clip: bool = True,
        first_pairs: int | None = None,
        sorter: type[Sorter] = TriangleSorter,
    ) -> None:
        self._device = device
        self._background = (*background, 1.0)
        self.sorter = sorter(device, mesh.positions, mesh.triangles, first_pairs=first_pairs)
        self._has_holes = bool((mesh.colours[:, 3] < 128).any() or (mesh.textures[..., 3] < 128).any())
        self._clips = clip and device.can_clip and not self._has_holes
        self._fragments = load_shader(device, "limen.layers.mesh.draw", "scene.wgsl")
        self._vertices = (
            load_shader(device, "limen.layers.mesh.draw", "scene_clip.wgsl") if self._clips else self._fragments
        )
        self._corners = GrowingBuffer(device, "corners", wgpu.BufferUsage.STORAGE)
        self._corners.write(corner_rows(mesh))
        self._bounds = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
        self._scene = GrowingBuffer(device, "scene", wgpu.BufferUsage.UNIFORM)
        self._pictures = upload_textures(device, mesh.textures)
        self._sampler = device.wgpu.create_sampler(
            mag_filter="linear", min_filter="linear", mipmap_filter="linear",
            address_mode_u="repeat", address_mode_v="repeat",
        )  # fmt: skip
        self._layout = self._bind_group_layout()
        self._pipelines: dict[tuple[str, Depth, SceneOverlay | None], Any] = {}
        self._targets = Targets(device)
        self._matching = PanelMatching(device)
        self._eyes_m = np.zeros((0, 3))

    def move(self, mesh: Mesh) -> None:
        """The same triangles with other places and normals: what the next frames show."""
        if len(mesh.positions) != self.sorter.vertex_count or len(mesh.triangles) != self.sorter.triangle_count:
            raise ValueError("a mesh with other triangles needs another layer")
        self.sorter.move(mesh.positions)
        self._corners.write(corner_rows(mesh))
        self._bounds = mesh.positions.min(axis=0), mesh.positions.max(axis=0)

    def paint(self, mesh: Mesh) -> None:
        """The same vertices with other colours, normals or places in textures."""
        self._corners.write(corner_rows(mesh))

    def choose(self, triangles: NDArray[np.uint32]) -> None:
        """Other triangles of the same vertices, shape (T, 3): what the next frames show."""
        self.sorter.choose(triangles)

    def sort(
        self, windows: QuiltPanels, eyes_m: Floats, room_from_mesh: Floats, *, forward: Floats | None = None
    ) -> int:
        """The first half of a frame: which triangles touch which panels; waits for the adapter.

        Where there is no room for all pairs, more is made and they are sorted once more: no triangle is lost.

        Parameters
        ----------
        windows
            The panels of one quilt, with as many copies as there are eyes.
        eyes_m
            Shape (E, 3), one eye or two; the second is drawn to the right of the first.
        room_from_mesh
            Affine map from the mesh's coordinates to the room, metres: shape (4, 4).
        forward
            Where each eye's camera looks, shape (E, 3), for the depth that all panels share; by default toward
            the middle of the panels.

        Returns
        -------
        int
            How many pairs of a triangle and a panel there are.
        """
        eyes_m = np.asarray(eyes_m, dtype=float).reshape(-1, 3)
        if windows.copies != len(eyes_m):
            raise ValueError(f"windows for {windows.copies} eyes were given {len(eyes_m)}")
        near_m = self._nearest_m(eyes_m, np.asarray(room_from_mesh, dtype=float))
        views = [
            windows.seen_from(eye, copy, near) for copy, (eye, near) in enumerate(zip(eyes_m, near_m, strict=True))
        ]
        eye_from_mesh = np.repeat(np.asarray(room_from_mesh, dtype=float)[None, :3], len(eyes_m), axis=0)
        eye_from_mesh[:, :, 3] -= eyes_m
        if forward is None:
            forward = windows.middle_m - eyes_m
        forward = forward / np.maximum(np.linalg.norm(forward, axis=1, keepdims=True), 1e-12)
        self._scene.write(
            scene_row(
                room_from_mesh, vertices=self.sorter.vertex_count, panels=len(windows.quilt.panels), forward=forward,
                near_m=NEAR_M, light=np.array([*TOWARD_LIGHT, AMBIENT]),
            )
        )  # fmt: skip
        self._eyes_m = eyes_m
        self.sorter.sort(views, eye_from_mesh)
        return self.sorter.settle()

    def draw(
        self,
        windows: QuiltPanels,
        *,
        depth: Depth = "panel",
        overlay: SceneOverlay | None = None,
        target: Any = None,
        target_format: str = QUILT_FORMAT,
        slot: int = 0,
    ) -> Any:
        """Submit the second half of a frame: everything that `sort` found, in one draw.

        Parameters
        ----------
        depth
            ``panel``: along each panel's normal, made by the rasteriser. ``shared``: that of the viewer's camera,
            continuous over all panels, written for every fragment.
        overlay
            ``panels`` tints every panel in a colour of its own.
        target
            A texture view to draw into (a window's), of ``target_format`` and the quilt's size for all eyes.
        slot
            Quilts of one size are drawn over each other, unless they are given numbers of their own.

        Returns
        -------
        texture
            Valid until the next draw of a quilt of the same size and slot; ``None`` with a ``target``.
        """
        size = (windows.quilt.size_px[0] * windows.copies, windows.quilt.size_px[1])
        texture = None if target is not None else self._targets.texture(size, target_format, slot)
        view = texture.create_view() if texture is not None else target
        self._submit(
            windows, view, self._targets.texture(size, DEPTH_FORMAT).create_view(), target_format, depth, overlay
        )
        return texture

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """A drawn quilt's pixels, shape (H, W, 4); waits until it is drawn."""
        return self._targets.read(texture)

    def read_depth(self, windows: QuiltPanels) -> NDArray[np.float32]:
        """The depth of the last draw of a quilt of this size, shape (H, W): 1 is near, 0 nothing; waits."""
        return self._targets.read_depth((windows.quilt.size_px[0] * windows.copies, windows.quilt.size_px[1]))

    def destroy(self) -> None:
        self._targets.destroy()
        self._matching.destroy()
        self._pictures.destroy()
        for buffer in (self._corners, self._scene):
            buffer.destroy()
        self.sorter.destroy()
        self._pipelines.clear()

    # ------------------------------------------------------------------ steps of a draw

    def _nearest_m(self, eyes_m: Floats, room_from_mesh: Floats) -> Floats:
        """How far from each eye the mesh begins: the distance of the ball around its bounding box."""
        low, high = self._bounds
        corners = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
        placed = corners @ room_from_mesh[:3, :3].T + room_from_mesh[:3, 3]
        middle = placed.mean(axis=0)
        radius = np.linalg.norm(placed - middle, axis=1).max()
        return np.asarray(np.maximum(np.linalg.norm(eyes_m - middle, axis=1) - radius, NEAR_M))

    def _submit(
        self,
        windows: QuiltPanels,
        view: Any,
        depth_view: Any,
        target_format: str,
        depth: Depth,
        overlay: SceneOverlay | None,
    ) -> None:
        encoder = self._device.wgpu.create_command_encoder(label="scene")
        render_pass = encoder.begin_render_pass(
            color_attachments=[
                {"view": view, "clear_value": self._background, "load_op": "clear", "store_op": "store"}
            ],
            depth_stencil_attachment={
                "view": depth_view, "depth_clear_value": 0.0, "depth_load_op": "clear", "depth_store_op": "store",
            },
        )  # fmt: skip
        render_pass.set_pipeline(self._pipeline(target_format, depth, overlay))
        render_pass.set_bind_group(0, self._group())
        self.sorter.record(render_pass, windows)
        render_pass.end()
        self._matching.record(encoder, windows, self._eyes_m, view, target_format)
        self._device.wgpu.queue.submit([encoder.finish()])

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
        return self._device.wgpu.create_bind_group_layout(
            entries=[
                {"binding": number, "visibility": both, **kinds.get(name, storage)} for name, number in _NUMBERS.items()
            ]
        )

    def _pipeline(self, target_format: str, depth: Depth, overlay: SceneOverlay | None) -> Any:
        key = (target_format, depth, overlay)
        if key not in self._pipelines:
            entry = ("" if self._clips else "cut_") + "picture" + ("_deep" if depth == "shared" else "")
            self._pipelines[key] = self._device.wgpu.create_render_pipeline(
                label=entry,
                layout=self._device.wgpu.create_pipeline_layout(bind_group_layouts=[self._layout]),
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
