"""Draws what somebody sees of the lit display: every panel in the room, with its pixels from the quilts.

The same pass makes the picture of a projector that lights panels which do not shine themselves: a projector is a
camera run backwards, so what a camera at its place ought to see is what it must throw.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 4 (un-mapping the quilt by
texture mapping to a projector's picture; simulated displays).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.errors import DeviceLimitError
from limen.frame.simulator_uniforms import PanelRows, frame_rows
from limen.gpu.buffers import GrowingBuffer, TextureReader
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.viewing.camera import Camera

__all__ = ["DisplaySimulator"]

_LIGHT_FORMAT = "rgba16float"
_DEPTH_FORMAT = "depth32float"
_PICTURE_FORMAT = "rgba8unorm-srgb"
_BLACK = (0.0, 0.0, 0.0, 0.0)
_FAN = 18  # an octagon's triangles
_FRAME_BYTES = 256  # one row of the uniform buffer, as dynamic offsets want it
_ADD = {"src_factor": "one", "dst_factor": "one", "operation": "add"}


class DisplaySimulator:
    """A display whose panels show parts of quilts, for cameras anywhere in the room.

    Parameters
    ----------
    display
        The installation; panels that no quilt holds are drawn unlit.
    quilts
        The images that hold the panels.
    guard_px
        How far beyond a panel's outline the quilts' pixels are that panel's: 1.5 for scenes
        (`limen.viewing.projection.GUARD_PX`), 0 for images, whose panels end at their outlines. Pixels beyond are never
        read.

    Raises
    ------
    ValueError
        If there is no quilt.
    """

    def __init__(self, device: Device, display: Display, quilts: Sequence[Quilt], *, guard_px: float = 0.0) -> None:
        if not quilts:
            raise ValueError("a lit display needs at least one quilt")
        self._device, self._quilts, self._guard_px = device, tuple(quilts), guard_px
        self._rows = PanelRows(display, quilts)
        self._shader = load_shader(device, "limen.frame", "simulator.wgsl")
        self._sampler = device.wgpu.create_sampler(mag_filter="linear", min_filter="linear")
        self._panels = GrowingBuffer(device, "lit panels", wgpu.BufferUsage.STORAGE)
        self._frames = GrowingBuffer(device, "lit frames", wgpu.BufferUsage.UNIFORM)
        self._layouts = [self._frame_layout(), self._picture_layout()]
        self._pipelines: dict[float | str, Any] = {}
        self._targets: dict[str, Any] = {}
        self._size_px = (0, 0)
        self._reader = TextureReader(device)

    def draw(
        self,
        textures: Sequence[Any],
        camera: Camera,
        *,
        samples: int = 3,
        copy: int = 0,
        uneven: bool = True,
        frames: bool = True,
        target: Any = None,
        target_format: str = _PICTURE_FORMAT,
    ) -> Any:
        """What the camera sees; between panels it is black.

        Parameters
        ----------
        textures
            Those of the quilts, in their order, in a format that is read as linear light (``rgba8unorm-srgb``).
        samples
            Places along each side of a pixel that are looked at, averaged in linear light; from 1.
        copy
            Which of the copies side by side in the textures is shown, where a quilt is drawn for two eyes.
        uneven
            Panels show that their light falls off at a slant. Their gain is in the quilts already, as on the display.
        frames
            Frames, backs and unlit panels are drawn dark. Without, they are black (and still cover what is behind
            them): a projector throws no light there.
        target
            A texture view to draw into (a window's), of ``target_format`` and the camera's size.

        Returns
        -------
        texture
            ``rgba8unorm-srgb`` of the camera's size, valid until the next draw; ``None`` with a ``target``.

        Raises
        ------
        DeviceLimitError
            If the camera's picture is larger than a texture can be.
        ValueError
            If a texture is missing or has another size than its quilt.
        """
        self._check(textures, samples, copy)
        self._resize(camera.size_px)
        self._panels.write(self._rows.seen_from(np.array(camera.eye_m)))
        copy_px = copy * self._quilts[0].size_px[0]
        self._frames.write(
            frame_rows(camera, samples, copy_px=copy_px, guard_px=self._guard_px, uneven=uneven, frames=frames)
        )
        lit = self._frame_group()
        bound = [self._picture_group(texture) for texture in (*textures, textures[-1])]
        light, total = (self._picture_group(self._targets[name]) for name in ("light", "sum"))
        encoder = self._device.wgpu.create_command_encoder(label="lit display")
        for sample in range(samples**2):
            self._draw_light(encoder, lit, bound, sample)
            self._add(encoder, light, "sum", 1 / samples**2, clear=sample == 0)
        self._add(encoder, total, "picture", 1.0, clear=True, view=target, target_format=target_format)
        self._device.wgpu.queue.submit([encoder.finish()])
        return None if target is not None else self._targets["picture"]

    def read(self, texture: Any) -> NDArray[np.uint8]:
        """A drawn picture's pixels, shape (H, W, 4); waits until it is drawn."""
        return self._reader.read(texture)

    def destroy(self) -> None:
        """Free everything but the quilts' textures."""
        for texture in self._targets.values():
            texture.destroy()
        self._targets.clear()
        self._panels.destroy()
        self._frames.destroy()
        self._reader.destroy()
        self._pipelines.clear()
        self._layouts.clear()
        self._size_px = (0, 0)
        self._sampler = self._shader = None

    # ------------------------------------------------------------------ steps of a draw

    def _check(self, textures: Sequence[Any], samples: int, copy: int) -> None:
        if samples < 1:
            raise ValueError(f"samples must be from 1, got {samples}")
        if len(textures) != len(self._quilts):
            raise ValueError(f"{len(self._quilts)} quilts need as many textures, got {len(textures)}")
        for texture, quilt in zip(textures, self._quilts, strict=True):
            width, height, _ = texture.size
            if height != quilt.size_px[1] or width % quilt.size_px[0] or not 0 <= copy < width // quilt.size_px[0]:
                raise ValueError(f"a texture of {width} x {height} holds no copy {copy} of a quilt of {quilt.size_px}")

    def _resize(self, size_px: tuple[int, int]) -> None:
        """Targets of the camera's size; nothing happens if they have it already."""
        if size_px == self._size_px:
            return
        if max(size_px) > self._device.max_texture_px:
            raise DeviceLimitError(
                f"a camera's picture of {size_px[0]} x {size_px[1]} pixels exceeds the adapter's "
                f"{self._device.max_texture_px} a side: make it smaller"
            )
        for texture in self._targets.values():
            texture.destroy()
        usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.TEXTURE_BINDING
        formats = {"light": _LIGHT_FORMAT, "sum": _LIGHT_FORMAT, "depth": _DEPTH_FORMAT, "picture": _PICTURE_FORMAT}
        self._targets = {
            name: self._device.wgpu.create_texture(
                label=f"lit {name}",
                size=(*size_px, 1),
                format=form,
                usage=usage | wgpu.TextureUsage.COPY_SRC if name == "picture" else usage,
            )
            for name, form in formats.items()
        }
        self._size_px = size_px

    def _draw_light(self, encoder: Any, lit: Any, bound: Sequence[Any], sample: int) -> None:
        """All panels from one place in every pixel; one draw for each quilt, because each is a texture of its own."""
        render_pass = encoder.begin_render_pass(
            color_attachments=[self._attachment("light", clear=True)],
            depth_stencil_attachment={
                "view": self._targets["depth"].create_view(),
                "depth_clear_value": 0.0,
                "depth_load_op": "clear",
                "depth_store_op": "discard",
            },
        )
        render_pass.set_pipeline(self._light_pipeline())
        render_pass.set_bind_group(0, lit, [sample * _FRAME_BYTES])
        for group, (first, count) in zip(bound, self._rows.ranges, strict=True):
            if count:
                render_pass.set_bind_group(1, group)
                render_pass.draw(_FAN, count, 0, first)
        render_pass.end()

    def _add(
        self,
        encoder: Any,
        source: Any,
        target: str,
        share: float,
        *,
        clear: bool,
        view: Any = None,
        target_format: str = _PICTURE_FORMAT,
    ) -> None:
        """Add ``share`` of a bound picture to a target (or to a ``view`` in its stead), all in linear light."""
        attachment = self._attachment(target, clear=clear)
        if view is not None:
            attachment["view"] = view
        render_pass = encoder.begin_render_pass(color_attachments=[attachment])
        render_pass.set_pipeline(self._sum_pipeline(target, share, target_format))
        render_pass.set_bind_group(0, self._frame_group(), [0])
        render_pass.set_bind_group(1, source)
        render_pass.draw(3)
        render_pass.end()

    def _attachment(self, name: str, *, clear: bool) -> dict[str, Any]:
        load = "clear" if clear else "load"
        return {
            "view": self._targets[name].create_view(), "clear_value": _BLACK, "load_op": load, "store_op": "store"
        }  # fmt: skip

    # ------------------------------------------------------------------ pipelines and bindings

    def _frame_layout(self) -> Any:
        both = wgpu.ShaderStage.VERTEX | wgpu.ShaderStage.FRAGMENT
        frame = {"type": "uniform", "has_dynamic_offset": True}
        return self._device.kept(
            "create_bind_group_layout",
            entries=[
                {"binding": 0, "visibility": both, "buffer": frame},
                {"binding": 1, "visibility": both, "buffer": {"type": "read-only-storage"}},
                {"binding": 2, "visibility": wgpu.ShaderStage.FRAGMENT, "sampler": {"type": "filtering"}},
            ],
        )

    def _picture_layout(self) -> Any:
        texture = {"sample_type": "float", "view_dimension": "2d"}
        return self._device.kept(
            "create_bind_group_layout",
            entries=[{"binding": 0, "visibility": wgpu.ShaderStage.FRAGMENT, "texture": texture}],
        )

    def _frame_group(self) -> Any:
        return self._device.wgpu.create_bind_group(
            layout=self._layouts[0],
            entries=[
                {"binding": 0, "resource": {"buffer": self._frames.buffer, "offset": 0, "size": _FRAME_BYTES}},
                {"binding": 1, "resource": {"buffer": self._panels.buffer}},
                {"binding": 2, "resource": self._sampler},
            ],
        )

    def _picture_group(self, texture: Any) -> Any:
        entries = [{"binding": 0, "resource": texture.create_view()}]
        return self._device.wgpu.create_bind_group(layout=self._layouts[1], entries=entries)

    def _light_pipeline(self) -> Any:
        if "light" not in self._pipelines:
            depth = {"format": _DEPTH_FORMAT, "depth_write_enabled": True, "depth_compare": "greater"}
            self._pipelines["light"] = self._pipeline("lit", {"format": _LIGHT_FORMAT}, {}, depth_stencil=depth)
        return self._pipelines["light"]

    def _sum_pipeline(self, target: str, share: float, target_format: str) -> Any:
        if (key := share if target == "sum" else target_format) not in self._pipelines:
            colours: dict[str, Any] = {"format": target_format}
            if target == "sum":
                colours = {"format": _LIGHT_FORMAT, "blend": {"color": _ADD, "alpha": _ADD}}
            self._pipelines[key] = self._pipeline("sum", colours, {"SHARE": share})
        return self._pipelines[key]

    def _pipeline(self, name: str, colours: dict[str, Any], constants: dict[str, float], **more: Any) -> Any:
        return self._device.kept(
            "create_render_pipeline",
            label=f"lit {name}",
            layout=self._device.kept("create_pipeline_layout", bind_group_layouts=self._layouts),
            vertex={"module": self._shader, "entry_point": f"{name}_vertex"},
            primitive={"topology": "triangle-list"},
            fragment={
                "module": self._shader,
                "entry_point": f"{name}_fragment",
                "constants": constants,
                "targets": [colours],
            },
            **more,
        )
