"""All triangles of a terrain drawn by VTK, through pyvista: what any viewer does that keeps no levels of detail."""

from __future__ import annotations

import importlib
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.store.resample import srgb_of_linear
from limen.display.panel import Panel
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.terrain.look import TerrainLook, toward_sun
from limen.study.triangulations import Posts

__all__ = ["FullGrid", "hillshade"]

_GREY = 0.6  # linear light of the slope that faces the sun


class FullGrid:
    """The grid in a picture of one panel, as an eye on the panel's axis sees it; `close` frees it.

    Every row of squares is one strip of triangles, which needs a third of the indices of single ones and was no slower
    than those, than quads, or than a structured grid. Colours are computed beforehand, a code a post, and VTK's own
    lighting and antialiasing are off, so VTK has the least to do.

    Parameters
    ----------
    room_from_posts
        As of `limen.layers.terrain.look_at.room_from_posts`.
    eye_m
        In the room, before the panel's middle.

    Raises
    ------
    InputError
        If the eye is beside the panel's axis.
    """

    def __init__(
        self, posts: Posts, room_from_posts: Floats, panel: Panel, eye_m: Floats, colours: NDArray[np.uint8]
    ) -> None:
        logger: Any = importlib.import_module("vtkmodules.vtkCommonCore").vtkLogger
        logger.SetStderrVerbosity(logger.VERBOSITY_OFF)  # without a screen, it complains before it draws without one
        pyvista: Any = importlib.import_module("pyvista")
        rows, columns = posts.heights_m.shape
        self.triangles = 2 * (rows - 1) * (columns - 1)
        number = np.arange(rows * columns).reshape(rows, columns)
        zigzag = np.stack([number[:-1], number[1:]], axis=-1).reshape(rows - 1, -1)
        strips = np.column_stack([np.full(rows - 1, 2 * columns), zigzag]).ravel()
        mesh = pyvista.PolyData(_places(posts, room_from_posts), strips=strips)
        mesh["colours"] = colours.reshape(-1, 3)
        self._plotter = pyvista.Plotter(off_screen=True, window_size=list(panel.size_px), lighting="none")
        self._plotter.disable_anti_aliasing()
        self._plotter.render_window.SetMultiSamples(0)
        self._plotter.set_background("black")
        self._plotter.add_mesh(mesh, scalars="colours", rgb=True, lighting=False, show_scalar_bar=False)
        _set_camera(self._plotter.camera, panel, eye_m)
        self._plotter.renderer.ResetCameraClippingRange()
        self._plotter.show(auto_close=False)  # copies everything to where it is drawn from

    def draw(self) -> None:
        """One frame, to its end."""
        self._plotter.render()
        self._plotter.render_window.WaitForCompletion()

    def picture(self) -> NDArray[np.uint8]:
        """What was drawn, (height, width, 3)."""
        return np.asarray(self._plotter.screenshot(return_img=True))

    @property
    def renderer_name(self) -> str:
        """VTK's window and the driver that it draws with."""
        report = self._plotter.render_window.ReportCapabilities()
        driver = next((line for line in report.splitlines() if "renderer string" in line), "")
        return f"{type(self._plotter.render_window).__name__}, {driver.split(':')[-1].strip()}"

    def close(self) -> None:
        self._plotter.close()


def _places(posts: Posts, room_from_posts: Floats) -> NDArray[np.float32]:
    """Posts in the room, (rows * columns, 3)."""
    rows, columns = posts.heights_m.shape
    flat = room_from_posts[:3, 3] + np.arange(columns)[:, None] * room_from_posts[:3, 0]
    places = np.empty((rows, columns, 3), np.float32)
    for row in range(rows):
        heights = posts.heights_m[row, :, None] * room_from_posts[:3, 2]
        places[row] = flat + row * room_from_posts[:3, 1] + heights
    return places.reshape(-1, 3)


def _set_camera(camera: Any, panel: Panel, eye_m: Floats) -> None:
    width, height = panel.size_m
    right, down = np.array(panel.right), np.array(panel.down)
    middle = np.array(panel.origin_m) + right * width / 2 + down * height / 2
    way = middle - eye_m
    distance_m = float(np.linalg.norm(way))
    if float(np.hypot(way @ right, way @ down)) > 1e-6 * distance_m:
        raise InputError("eye_m: is beside the panel's axis; give an eye before its middle")
    camera.position, camera.focal_point, camera.up = tuple(eye_m), tuple(middle), tuple(-down)
    camera.view_angle = math.degrees(2 * math.atan(height / 2 / distance_m))


def hillshade(posts: Posts, look: TerrainLook) -> NDArray[np.uint8]:
    """Light from the sun and the sky on every post, as sRGB codes (rows, columns, 3); slopes by central differences."""
    per_row, per_column = np.gradient(posts.heights_m, posts.spacing_m[1], posts.spacing_m[0])
    sun = toward_sun(look)
    length = np.sqrt(1.0 + per_row**2 + per_column**2)
    direct = np.maximum((-per_column * sun[0] + per_row * sun[1] + sun[2]) / length, 0.0)  # rows run south
    light = _GREY * (look.ambient + (1 - look.ambient) * direct)
    codes = np.round(srgb_of_linear(light.astype(np.float64)) * 255).astype(np.uint8)
    return np.repeat(codes[..., None], 3, axis=-1)
