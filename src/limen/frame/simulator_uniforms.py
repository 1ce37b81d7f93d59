"""What ``simulator.wgsl`` reads, as rows: built in double precision, handed over in single. No GPU here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.data.store.resample import linear_of_srgb
from limen.display.display import Display
from limen.display.panel import MAX_OUTLINE_CORNERS, Panel
from limen.display.quilt import Quilt
from limen.geometry import Floats
from limen.viewing.camera import Camera

__all__ = ["BACK", "BEZEL", "LIT_FRAME", "LIT_PANEL", "UNLIT", "PanelRows", "frame_rows"]

Rows: TypeAlias = NDArray[np.void]

BACK = (52, 55, 62)
BEZEL = (14, 14, 16)
UNLIT = (24, 26, 30)
"""sRGB of what is not lit: backs where the eye looks straight at them, frames, and panels that no quilt holds."""

NEAR_M = 0.01
"""What is nearer to the camera along its axis is cut away."""

_BEHIND = 1e-5
"""How far a frame lies behind its panel, as a share of the panel's size, so that it never covers what is lit."""

_FRAME_STRIDE = 256  # WebGPU: alignment of dynamic offsets

LIT_FRAME = np.dtype(
    [
        ("x", "<f4", 4),
        ("y", "<f4", 4),
        ("w", "<f4", 4),
        ("near", "<f4"),
        ("samples", "<f4"),
        ("copy_px", "<f4"),
        ("guard_px", "<f4"),
        ("uneven", "<u4"),
        ("frames", "<u4"),
        ("padding", "<u4", 2),
    ]
)
LIT_PANEL = np.dtype(
    [
        ("corners", "<f4", (MAX_OUTLINE_CORNERS, 4)),
        ("corners_px", "<f4", (MAX_OUTLINE_CORNERS, 4)),
        ("edges", "<f4", (MAX_OUTLINE_CORNERS, 4)),
        ("normal", "<f4", 4),
        ("colour", "<f4", 4),
        ("lit", "<u4"),
        ("falloff", "<f4"),
        ("padding", "<u4", 2),
    ]
)


class PanelRows:
    """Rows of `LIT_PANEL`: every panel of every quilt in turn, then the panels that no quilt holds, then frames.

    ``ranges`` are the first row and the number of rows that each quilt's texture is bound for; the last range holds
    what needs none.
    """

    def __init__(self, display: Display, quilts: Sequence[Quilt]) -> None:
        held = [index for quilt in quilts for index in quilt.panels]
        dark = sorted(set(range(len(display.panels))) - set(held))
        maps = np.concatenate([quilt.quilt_from_panel(display) for quilt in quilts])
        panels = [display.panels[index] for index in [*held, *dark]]
        framed = [panel for panel in panels if panel.bezel_m > 0]
        count = len(panels) + len(framed)
        self._rows = np.zeros(count, LIT_PANEL)
        self._corners_m = np.zeros((count, MAX_OUTLINE_CORNERS, 3))
        for number, panel in enumerate(panels):
            self._place(number, panel, panel.lit_outline_px)
        for number, panel in enumerate(framed, len(panels)):
            self._place(number, panel, _grown(panel), behind=True)
        for number, (panel, quilt_from_panel) in enumerate(zip(panels, maps, strict=False)):
            self._light(number, panel, quilt_from_panel)
        self._rows["colour"][len(held) : len(panels), :3] = _linear(UNLIT)
        self._rows["colour"][len(panels) :, :3] = _linear(BEZEL)
        counts = [len(quilt.panels) for quilt in quilts]
        starts = np.concatenate([[0], np.cumsum(counts)]).tolist()
        self.ranges = [*zip(starts, counts, strict=False), (len(held), count - len(held))]

    def __len__(self) -> int:
        return len(self._rows)

    def seen_from(self, eye_m: Floats) -> Rows:
        """The rows with corners relative to the eye; panels that it sees from behind show their backs."""
        rows = self._rows.copy()
        relative = self._corners_m - eye_m
        rows["corners"][..., :3] = relative
        behind = np.einsum("na,na->n", relative[:, 0], rows["normal"][:, :3].astype(float)) > 0
        rows["lit"][behind] = 0
        rows["colour"][behind, :3] = _linear(BACK)
        rows["colour"][behind, 3] = 1.0
        return rows

    def _place(self, number: int, panel: Panel, outline_px: Floats, *, behind: bool = False) -> None:
        """Where a polygon hangs: where its picture is nudged to."""
        normal = np.array(panel.normal)
        step = np.array(panel.nudge_px) * panel.pitch_m
        moved = step[0] * np.array(panel.right) + step[1] * np.array(panel.down)
        moved = moved + normal * (_BEHIND * max(panel.size_m) if behind else 0.0)
        self._corners_m[number] = (panel.position_m(outline_px) - moved)[_repeated(len(outline_px))]
        self._rows[number]["normal"][:3] = normal

    def _light(self, number: int, panel: Panel, quilt_from_panel: Floats) -> None:
        """Which pixels of the quilt a polygon shows."""
        row = self._rows[number]
        corners = panel.lit_outline_px @ quilt_from_panel[:, :2].T + quilt_from_panel[:, 2]
        repeated = _repeated(len(corners))
        row["corners_px"][:, :2] = corners[repeated]
        row["edges"][:, :3] = edges_px(corners)[repeated]
        row["lit"], row["falloff"] = 1, panel.falloff


def _repeated(count: int) -> NDArray[np.int64]:
    """Eight indices of that many corners: one repeated makes triangles of no area, and asks an edge twice."""
    return np.minimum(np.arange(MAX_OUTLINE_CORNERS), count - 1)


def frame_rows(
    camera: Camera, samples: int, *, copy_px: float, guard_px: float, uneven: bool, frames: bool
) -> NDArray[np.uint8]:
    """One `LIT_FRAME` for each of ``samples`` x ``samples`` places in a pixel, uint8 (samples^2, 256)."""
    found = np.zeros(samples**2, LIT_FRAME)
    places = (np.arange(samples) + 0.5) / samples - 0.5
    for row, (y, x) in zip(found, [(y, x) for y in places for x in places], strict=True):
        clip = camera.clip_rows((float(x), float(y)))
        row["x"][:3], row["y"][:3], row["w"][:3] = clip
    found["near"], found["samples"], found["copy_px"], found["guard_px"] = NEAR_M, samples, copy_px, guard_px
    found["uneven"], found["frames"] = uneven, frames
    spaced = np.zeros((len(found), _FRAME_STRIDE), np.uint8)
    spaced[:, : LIT_FRAME.itemsize] = found.view(np.uint8).reshape(len(found), -1)
    return spaced


def edges_px(outline_px: Floats) -> Floats:
    """``a x + b y + c`` is the distance in pixels inside an edge of a convex outline (clockwise, y down): (K, 3)."""
    step = np.roll(outline_px, -1, axis=0) - outline_px
    inward = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.linalg.norm(step, axis=1)[:, None]
    return np.column_stack([inward, -np.einsum("ka,ka->k", inward, outline_px)])


def _grown(panel: Panel) -> Floats:
    """The outline of a panel with its frame, in pixels: every edge moved out by ``bezel_m``, shape (K, 2)."""
    pitch_m = np.array(panel.pitch_m)
    edges = edges_px(panel.lit_outline_px * pitch_m)  # in metres: pixels may be oblong
    edges[:, 2] += panel.bezel_m
    before = np.roll(edges, 1, axis=0)
    corners = np.cross(before, edges)
    return np.asarray(corners[:, :2] / corners[:, 2:] / pitch_m)


def _linear(srgb: tuple[int, int, int]) -> Floats:
    return linear_of_srgb(np.array(srgb) / 255)
