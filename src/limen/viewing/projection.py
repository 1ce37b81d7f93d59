"""Where every panel stands for one eye: one matrix a panel, from the room to its place in the quilt.

A panel is a window. What an eye at ``E`` sees through pixel ``p`` lies on the ray from ``E`` through it, so a place
``X = E + d`` belongs to the pixel where the ray along ``d`` meets the panel's plane. That is a projective map with
one matrix, which takes places straight to the clip space of the quilt, the panel's own place and turn included: all
panels of a quilt are drawn by one rasterisation.

With ``n`` the panel's normal toward the viewers, ``o`` its origin and ``h = n . (E - o)`` the eye's height above it,
``w = -n . d`` is ``h`` on the panel and grows along every ray. Depth is ``near / w`` (reversed: 1 is near, 0 infinitely
far away), in the order of distance on every ray, and is made by the rasteriser.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 3.1 (the homography per facet).
Kooima 2009, *Generalized Perspective Projection* (the same picture as an off-axis frustum).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.mapping import overlaps, quilt_outlines
from limen.display.packing import GUARD_PX
from limen.display.panel import MAX_OUTLINE_CORNERS
from limen.display.quilt import Quilt
from limen.errors import DeviceLimitError
from limen.geometry import Floats, Vec3

__all__ = [
    "GUARD_PX",
    "NEAR_M",
    "PanelProjections",
    "QuiltPanels",
    "QuiltView",
    "check_quilt_sizes",
    "guard_of",
    "quilt_from_room",
]

NEAR_M = 0.02
"""What is nearer to the eye than about this is cut away, unless it is known where things begin."""

_GUARDED = 0.98
"""In the guard band, places are a little farther away than an outline's farthest corner."""

_IN_PLANE_M = 1e-6  # an eye this near to a panel's plane, or behind it, sees no pixel of it


class PanelProjections(NamedTuple):
    """What one eye sees of the panels, as linear forms of ``d``, the way from the eye to a place (metres).

    One row a panel; ``clip[:, 0] . d``, ``clip[:, 1] . d`` and ``clip[:, 2] . d`` are x, y, w in the clip space of the
    quilt, z is ``near``. ``edges[:, k] . d / w`` is the distance in pixels from edge k of the outline and its guard
    band, positive inside; rows beyond the outline's number of corners repeat its first. ``corners`` are unit vectors
    toward the corners of outline and guard band.
    """

    clip: Floats  # (N, 3, 3)
    near: Floats  # (N,)
    edges: Floats  # (N, 8, 3)
    corners: Floats  # (N, 8, 3)
    corner_count: NDArray[np.int64]  # (N,)
    facing: NDArray[np.bool_]  # (N,): the eye is in front of the panel
    eye_m: Floats  # (3,), in the room
    outline_m: Floats  # (N, 8, 3), in the room, without the guard; the same array for every eye of the same windows


@dataclass(frozen=True)
class QuiltPanels:
    """The panels of a quilt as windows: what does not depend on the eye.

    Parameters
    ----------
    display, quilt
        Where the panels hang, and where they lie in the image.
    copies
        How many eyes are drawn side by side: the quilt is that many times as wide.
    guard_px
        How far beyond its outline a panel is drawn. Without it, pixels whose centre the outline just misses stay black,
        and whoever samples the quilt between pixels sees dotted seams. Where a mapping of the user's own leaves no room
        between panels it is 0, or they would draw over each other: see `guard_of`.
    """

    display: Display
    quilt: Quilt
    copies: int = 1
    guard_px: float = GUARD_PX

    def seen_from(self, eye_m: Vec3 | Floats, copy: int = 0, near_m: float = NEAR_M) -> PanelProjections:
        """The panels as one eye sees them.

        Parameters
        ----------
        eye_m
            The eye in the room, shape (3,).
        copy
            Which of the quilt's copies is this eye's.
        near_m
            Nothing nearer to the eye is to be seen. The larger, the finer is depth on adapters that make reversed depth
            from the other kind (OpenGL).
        """
        lines = self._lines
        relative = np.asarray(eye_m, dtype=float) - lines.origin_m
        height = np.einsum("na,na->n", lines.normal, relative)
        w = -lines.normal
        across = _ray_form(lines.per_right, relative, height, lines.normal)
        along = _ray_form(lines.per_down, relative, height, lines.normal)
        place = np.einsum("nij,njk->nik", lines.quilt[:, :, :2], np.stack([across, along], axis=1))
        place += lines.quilt[:, :, 2:] * w[:, None]
        width, quilt_height = self.quilt.size_px
        scale = 2 / (width * self.copies)
        x = (place[:, 0] + copy * width * w) * scale - w
        y = w - place[:, 1] * (2 / quilt_height)
        a, b, c = (lines.outline[:, :, number, None] for number in range(3))
        edges = a * across[:, None] + b * along[:, None] + c * w[:, None]
        return PanelProjections(
            np.stack([x, y, w], axis=1), self.near_of(eye_m, near_m), edges, _corners(edges, lines.corner_count),
            lines.corner_count, self.facing(eye_m),
            np.asarray(eye_m, dtype=float), lines.outline_m,
        )  # fmt: skip

    def near_of(self, eye_m: Vec3 | Floats, near_m: float) -> Floats:
        """`PanelProjections.near` where nothing nearer to the eye than ``near_m`` is to be seen, shape (N,)."""
        lines, eye = self._lines, np.asarray(eye_m, dtype=float)
        height = np.einsum("na,na->n", lines.normal, eye - lines.origin_m)
        farthest = np.linalg.norm(lines.outline_m - eye, axis=2).max(axis=1)
        # A power of two, so that what is told from depth is the same to the last bit whatever else a frame begins with.
        return _power_of_two(np.maximum(height, 0) * _GUARDED * near_m / np.maximum(farthest, 1e-300))

    def facing(self, eye_m: Vec3 | Floats) -> NDArray[np.bool_]:
        """Which panels an eye is in front of, shape (N,); one in a panel's plane sees nothing of it."""
        relative = np.asarray(eye_m, dtype=float) - self._lines.origin_m
        return np.asarray(np.einsum("na,na->n", self._lines.normal, relative) > _IN_PLANE_M)

    @cached_property
    def bounds_px(self) -> NDArray[np.int64]:
        """Left, top, right and bottom of the pixels that panels and their guards touch, in the first copy: (N, 4)."""
        outlines = quilt_outlines(self.display, self.quilt)
        low = np.floor(outlines.min(axis=1) - self.guard_px).clip(0)
        high = np.minimum(np.ceil(outlines.max(axis=1) + self.guard_px), self.quilt.size_px)
        return np.concatenate([low, high], axis=1).astype(np.int64)

    @cached_property
    def corners_px(self) -> Floats:
        """Corners of outline and guard band in the first copy's pixels, shape (N, 8, 2).

        Rows beyond an outline's number of corners repeat its first.
        """
        lines = self._lines
        number = np.arange(MAX_OUTLINE_CORNERS)
        here = np.where(number < lines.corner_count[:, None], number, 0)
        before = (here - 1) % lines.corner_count[:, None]
        edges, edges_before = (np.take_along_axis(lines.outline, at[..., None], axis=1) for at in (here, before))
        corners = np.cross(edges_before, edges)
        corners = corners[..., :2] / corners[..., 2:]
        return np.asarray(corners @ lines.quilt[:, :, :2].transpose(0, 2, 1) + lines.quilt[:, None, :, 2])

    @cached_property
    def light(self) -> tuple[Floats, Floats]:
        """Gain and falloff of every panel, shape (N,) each; see `limen.display.panel.Panel`."""
        panels = [self.display.panels[index] for index in self.quilt.panels]
        return np.array([panel.gain for panel in panels]), np.array([panel.falloff for panel in panels])

    @cached_property
    def middle_m(self) -> Floats:
        """The mean of the panels' middles, shape (3,)."""
        return np.asarray(self._lines.middle_m.mean(axis=0))

    @cached_property
    def _lines(self) -> _Lines:
        chosen = list(self.quilt.panels)
        panels = [self.display.panels[index] for index in chosen]
        arrays = self.display.arrays
        right, down, pitch_m = arrays.right[chosen], arrays.down[chosen], arrays.pitch_m[chosen]
        outline = np.zeros((len(panels), MAX_OUTLINE_CORNERS, 3))
        outline_m = np.zeros_like(outline)
        for row, panel in zip(outline_m, panels, strict=True):
            row[:] = panel.outline_m[np.minimum(np.arange(MAX_OUTLINE_CORNERS), len(panel.lit_outline_px) - 1)]
        count = np.array([len(panel.lit_outline_px) for panel in panels], dtype=np.int64)
        for row, panel in zip(outline, panels, strict=True):
            row[:] = _edges_px(panel.lit_outline_px, self.guard_px)
        return _Lines(
            self.display.nudged_origin_m[chosen],
            right / pitch_m[:, :1],
            down / pitch_m[:, 1:],
            np.cross(down, right),
            np.array([panel.outline_m.mean(axis=0) for panel in panels]),
            self.quilt.quilt_from_panel(self.display),
            outline,
            outline_m,
            count,
        )


@dataclass(frozen=True, eq=False)
class QuiltView:
    """One quilt as the eyes that it is drawn for see it: what every layer selects by and draws with.

    Parameters
    ----------
    panels
        The quilt's, whatever the eye.
    eyes_m
        Where the eyes are, shape (E, 3): one, or two side by side; none where nobody looks.
    looking
        Where the first viewer's head points.
    near_m
        Nothing nearer to any eye is to be seen: the larger, the finer is depth on adapters that need it.
    """

    panels: QuiltPanels
    eyes_m: Floats
    looking: Vec3 = (0.0, 0.0, -1.0)
    near_m: float = NEAR_M

    @classmethod
    def of(cls, panels: QuiltPanels, eyes_m: Sequence[Vec3 | Floats], looking: Vec3 = (0.0, 0.0, -1.0)) -> QuiltView:
        """As eyes at these places see it."""
        if len(eyes_m) not in (0, panels.copies):
            raise ValueError(f"windows for {panels.copies} eyes were given {len(eyes_m)}")
        return cls(panels, np.array(eyes_m, dtype=float).reshape(-1, 3), looking)

    @cached_property
    def eyes(self) -> tuple[PanelProjections, ...]:
        """What each eye sees of the panels; made when it is first asked for, as images on them do not."""
        return tuple(self.panels.seen_from(eye_m, copy, self.near_m) for copy, eye_m in enumerate(self.eyes_m))

    def beginning_at(self, near_m: float) -> QuiltView:
        """The same where nothing is nearer to any eye."""
        view = replace(self, near_m=near_m)
        if "eyes" in vars(self):  # all but the depth is known
            eyes = (eye._replace(near=self.panels.near_of(eye.eye_m, near_m)) for eye in self.eyes)
            vars(view)["eyes"] = tuple(eyes)
        return view

    @property
    def quilt(self) -> Quilt:
        return self.panels.quilt

    @property
    def size_px(self) -> tuple[int, int]:
        """Of all eyes together."""
        width, height = self.panels.quilt.size_px
        return (width * self.panels.copies, height)

    @property
    def facing(self) -> NDArray[np.bool_]:
        """Which panels the first eye is in front of, shape (N,); all where nobody looks."""
        return self.panels.facing(self.eyes_m[0]) if len(self.eyes_m) else np.ones(len(self.quilt.panels), np.bool_)


def guard_of(display: Display, quilt: Quilt) -> float:
    """How far beyond outlines the panels of a quilt can be drawn, pixels: `GUARD_PX` where all are far enough apart."""
    return 0.0 if any(overlaps(quilt_outlines(display, quilt), 2 * GUARD_PX)) else GUARD_PX


def check_quilt_sizes(quilts: Sequence[Quilt], max_texture_px: int, copies: int = 1) -> None:
    """Quilts that limen packs fit the adapter; those of a display's own mapping may not.

    Raises
    ------
    DeviceLimitError
        If one is wider or higher than the adapter's textures, for so many eyes side by side.
    """
    for number, quilt in enumerate(quilts):
        width, height = quilt.size_px[0] * copies, quilt.size_px[1]
        if max(width, height) > max_texture_px:
            raise DeviceLimitError(
                f"quilt '{quilt.output or number}' of the display's own mapping is {width} x {height} px for {copies} "
                f"eye(s), this adapter holds {max_texture_px} px a side: map its panels to several quilts, or to none"
            )


class _Lines(NamedTuple):
    """Of every panel of a quilt, one row a panel."""

    origin_m: Floats  # (N, 3)
    per_right: Floats  # (N, 3): pixels per metre, to the right
    per_down: Floats  # (N, 3)
    normal: Floats  # (N, 3), toward the viewers
    middle_m: Floats  # (N, 3)
    quilt: Floats  # (N, 2, 3): quilt pixels from panel pixels
    outline: Floats  # (N, 8, 3): a x + b y + c is the distance in pixels inside an edge and its guard
    outline_m: Floats  # (N, 8, 3): places in the room; rows beyond the number of corners repeat the last
    corner_count: NDArray[np.int64]  # (N,)


def quilt_from_room(display: Display, quilt: Quilt, eye_m: Vec3) -> Floats:
    """The one matrix of every panel: homogeneous room coordinates (metres) to the clip space of the quilt.

    Returns
    -------
    shape (N, 4, 4)
        In the order of the quilt's panels. Clip space is WebGPU's (x right, y up, depth 0 ... 1), depth reversed.
    """
    views = QuiltPanels(display, quilt).seen_from(eye_m)
    matrices = np.zeros((len(views.near), 4, 4))
    rows = views.clip
    matrices[:, [0, 1, 3], :3] = rows
    matrices[:, [0, 1, 3], 3] = -rows @ np.asarray(eye_m, dtype=float)
    matrices[:, 2, 3] = views.near
    return matrices


def _power_of_two(values: Floats) -> Floats:
    """The largest that is no larger; of zero, zero."""
    return np.ldexp(np.where(values > 0, 0.5, 0.0), np.frexp(values)[1])


def _ray_form(axis: Floats, relative: Floats, height: Floats, normal: Floats) -> Floats:
    """Where the ray along ``d`` meets the panel's plane, measured along ``axis`` and times ``w``: forms (N, 3)."""
    return np.asarray(axis * height[:, None] - normal * np.einsum("na,na->n", axis, relative)[:, None])


def _edges_px(corners: Floats, guard_px: float) -> Floats:
    """Lines inside of which a convex outline (clockwise, y down) and its guard band lie: shape (8, 3)."""
    step = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.linalg.norm(step, axis=1)[:, None]
    offset = guard_px - np.einsum("ka,ka->k", inward, corners)
    edges = np.column_stack([inward, offset])
    return np.asarray(edges[[*range(len(edges)), *([0] * (MAX_OUTLINE_CORNERS - len(edges)))]])


def _corners(edges: Floats, count: Sequence[int] | NDArray[np.int64]) -> Floats:
    """Where neighbouring edges meet, as unit vectors on the viewed side: shape (N, 8, 3)."""
    before = (np.arange(MAX_OUTLINE_CORNERS)[None] - 1) % np.asarray(count)[:, None]
    corners = np.cross(np.take_along_axis(edges, before[..., None], axis=1), edges)
    return np.asarray(corners / np.maximum(np.linalg.norm(corners, axis=2, keepdims=True), 1e-300))
