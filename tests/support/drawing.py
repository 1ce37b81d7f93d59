"""One thing drawn by its drawer alone, into a texture of its own, and read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.quilt import Quilt
from limen.frame.matching import PanelMatching
from limen.geometry import Floats
from limen.gpu.device import Device
from limen.gpu.targets import QUILT_FORMAT, Rgb, Target, Targets
from limen.layers.base import Drawer
from limen.layers.mesh.layer import MeshLayer, MeshPart, nearest_m
from limen.viewing.projection import GUARD_PX, QuiltPanels, QuiltView

__all__ = ["BLACK", "NOWHERE", "Easel", "begun", "drawn_mesh", "eyes_view", "looking_at_panels", "mesh_view"]

BLACK: Rgb = (0.0, 0.0, 0.0)
NOWHERE = np.eye(4)
"""Where content stands that is in room coordinates already."""


class _Clear(Target):
    """Where nothing is drawn, alpha is 0 and tells so."""

    def colour(self) -> dict[str, Any]:
        return super().colour() | {"clear_value": (*self.background, 0.0)}


class Easel:
    """Textures that drawers draw into, one part at a time; there is nothing else in the picture.

    Parameters
    ----------
    background
        Linear light (red, green, blue) where nothing is drawn.
    clear
        Alpha is 0 where nothing is drawn.
    matched
        Panels are matched afterwards, as a renderer does.
    """

    def __init__(self, device: Device, *, background: Rgb = BLACK, clear: bool = False, matched: bool = False) -> None:
        self.targets, self._matching = Targets(device), PanelMatching(device) if matched else None
        self._device, self._background, self._target = device, background, _Clear if clear else Target

    def draw(
        self, drawer: Drawer[Any], view: QuiltView, part: Any, overlay: str = "", *, form: str = QUILT_FORMAT
    ) -> Any:
        """The texture, valid until the next draw of a view of this size."""
        texture = self.targets.texture(view.size_px, form)
        canvas = self._target(self.targets, texture.create_view(), form, view.size_px, self._background)
        drawer.prepare(view, part, overlay)
        encoder = self._device.wgpu.create_command_encoder(label="easel")
        drawer.draw(encoder, canvas, view, part, overlay)
        canvas.finish(encoder)
        if self._matching is not None:
            self._matching.record(encoder, view.panels, view.eyes_m, canvas.view, form)
        self._device.wgpu.queue.submit([encoder.finish()])
        return texture

    def picture(
        self, drawer: Drawer[Any], view: QuiltView, part: Any, overlay: str = "", *, form: str = QUILT_FORMAT
    ) -> NDArray[np.uint8]:
        """What is drawn: uint8 (H, W, 4)."""
        return self.targets.read(self.draw(drawer, view, part, overlay, form=form))

    def depth(self, view: QuiltView) -> Floats:
        """The depth of the last draw of a view of this size: (H, W), 1 is near, 0 nothing."""
        return self.targets.read_depth(view.size_px).astype(float)

    def destroy(self) -> None:
        self.targets.destroy()
        if self._matching is not None:
            self._matching.destroy()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy()


def eyes_view(
    display: Display, quilt: Quilt, eyes_m: Any, *, looking: Any = (0.0, 0.0, -1.0), guard_px: float = GUARD_PX
) -> QuiltView:
    """A quilt as eyes see it, (3,) or (E, 3), side by side."""
    eyes: Sequence[Floats] = list(np.asarray(eyes_m, dtype=float).reshape(-1, 3))
    x, y, z = np.asarray(looking, dtype=float).tolist()
    return QuiltView.of(QuiltPanels(display, quilt, max(len(eyes), 1), guard_px), eyes, (x, y, z))


def looking_at_panels(panels: QuiltPanels, eye_m: Any) -> Floats:
    """The direction from an eye to the middle of the panels."""
    forward = panels.middle_m - np.asarray(eye_m, dtype=float)
    return np.asarray(forward / max(float(np.linalg.norm(forward)), 1e-12))


def begun(view: QuiltView, bounds: Any, room_from_mesh: Floats = NOWHERE) -> QuiltView:
    """A view that begins where a mesh of these bounds does."""
    return view.beginning_at(nearest_m(bounds, room_from_mesh, view.eyes_m))


def mesh_view(display: Display, quilt: Quilt, mesh: Any, eyes_m: Any, *, looking: Any = None) -> QuiltView:
    """What eyes see of a mesh in room coordinates, looking at the middle of the panels unless told otherwise."""
    if looking is None:
        looking = looking_at_panels(QuiltPanels(display, quilt), np.reshape(eyes_m, (-1, 3))[0])
    return begun(eyes_view(display, quilt, eyes_m, looking=looking), mesh.bounds)


def drawn_mesh(
    device: Device,
    layer: MeshLayer,
    view: QuiltView,
    *,
    room_from_mesh: Floats = NOWHERE,
    background: Rgb = BLACK,
    **options: Any,
) -> tuple[NDArray[np.uint8], Floats]:
    """Pixels and depths of a mesh; ``options`` are those of its drawer."""
    from limen.layers.mesh.draw.drawer import MeshDrawer

    drawer = MeshDrawer(device, layer, **options)
    with Easel(device, background=background) as easel:
        picture = easel.picture(drawer, view, MeshPart(room_from_mesh))
        depth = easel.depth(view)
    drawer.destroy()
    return picture, depth
