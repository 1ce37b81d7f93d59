"""Matches the panels of a finished quilt to each other: gain, and light that falls off at a slant.

One pass for images, terrains, points, meshes and whatever lies behind them. It multiplies what was drawn by a factor,
in linear light, by blending; so nothing is read or copied, panels without gain and falloff are not touched, and
displays that have no others have no such pass. The price is that a pixel is rounded to 8 bits twice: it is within one
code of the exact product, where it would be within half a code if every shader had the factor in itself.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 4.1.1 (light that falls off).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import wgpu

from limen.display.display import Display
from limen.display.panel import MAX_OUTLINE_CORNERS
from limen.geometry import Floats
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.layers.common.panel_uniforms import Rows, ways_of_pixels
from limen.viewing.projection import PanelProjections, QuiltPanels

__all__ = ["MATCHED", "PanelMatching", "least_cosine", "matched_rows"]

MATCHED = np.dtype(
    [
        ("corners", "<f4", (8, 4)),
        ("across", "<f4", 3),
        ("gain", "<f4"),
        ("along", "<f4", 3),
        ("falloff", "<f4"),
        ("base", "<f4", 3),
        ("least_cosine", "<f4"),
        ("forward", "<f4", 3),
        ("padding", "<f4"),
    ]
)

_MOST_OBLIQUE_COSINE = 0.35
"""Panels seen at less than 20 degrees stay dimmer, or all others would have to be."""

_VERTICES = 3 * (MAX_OUTLINE_CORNERS - 2)
_TIMES = {
    "color": {"src_factor": "dst", "dst_factor": "zero", "operation": "add"},
    "alpha": {"src_factor": "zero", "dst_factor": "one", "operation": "add"},
}


class PanelMatching:
    """What is drawn last into every quilt of a layer."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self._rows = GrowingBuffer(device, "matched panels", wgpu.BufferUsage.STORAGE)
        self._pipelines: dict[str, Any] = {}

    def record(self, encoder: Any, windows: QuiltPanels, eyes_m: Floats, target: Any, target_format: str) -> None:
        """Dim a quilt that was drawn with the same encoder.

        Parameters
        ----------
        eyes_m
            Shape (E, 3), those that see the quilt's copies; none where nobody looks, and gain alone is applied.
        target
            A view of the quilt, in a format that holds linear light (``...-srgb``).
        """
        rows = matched_rows(windows, eyes_m)
        if not len(rows):
            return
        self._rows.write(rows)
        if target_format not in self._pipelines:
            self._pipelines[target_format] = self._pipeline(target_format)
        pipeline = self._pipelines[target_format]
        entries = [{"binding": 0, "resource": {"buffer": self._rows.buffer}}]
        group = self._device.wgpu.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
        render_pass = encoder.begin_render_pass(
            color_attachments=[{"view": target, "load_op": "load", "store_op": "store"}]
        )
        render_pass.set_pipeline(pipeline)
        render_pass.set_bind_group(0, group)
        render_pass.draw(_VERTICES, len(rows))
        render_pass.end()

    def destroy(self) -> None:
        self._rows.destroy()
        self._pipelines.clear()

    def _pipeline(self, target_format: str) -> Any:
        module = load_shader(self._device, "limen.frame", "matching.wgsl")
        return self._device.kept(
            "create_render_pipeline",
            label="matching",
            layout="auto",
            vertex={"module": module, "entry_point": "outline"},
            primitive={"topology": "triangle-list"},
            fragment={
                "module": module, "entry_point": "share", "targets": [{"format": target_format, "blend": _TIMES}]
            },
        )  # fmt: skip


def matched_rows(windows: QuiltPanels, eyes_m: Floats) -> Rows:
    """Rows of `MATCHED`: the panels that are dimmed, of the first eye and then of the second. No GPU here."""
    gain, falloff = windows.light
    if (gain == 1).all() and (falloff == 0).all():
        return np.zeros(0, MATCHED)
    views = [windows.seen_from(eye_m, copy) for copy, eye_m in enumerate(eyes_m)]
    copies: Sequence[PanelProjections | None] = views or [None] * windows.copies
    least = least_cosine(windows.display, eyes_m)
    width, height = windows.quilt.size_px
    size_px = width * len(copies), height
    parts = []
    for copy, view in enumerate(copies):
        slanted = np.zeros(len(gain), bool) if view is None else view.facing & (falloff > 0)
        chosen = np.flatnonzero((gain < 1) | slanted)
        rows = np.zeros(len(chosen), MATCHED)
        corners = windows.corners_px[chosen] + [copy * width, 0.0]
        rows["corners"][..., 0] = 2 * corners[..., 0] / size_px[0] - 1
        rows["corners"][..., 1] = 1 - 2 * corners[..., 1] / size_px[1]
        rows["corners"][..., 3] = 1.0
        rows["gain"], rows["least_cosine"] = gain[chosen], least
        rows["base"][:, 2] = rows["forward"][:, 2] = 1.0  # where nobody looks: straight on
        if view is not None:
            at = slanted[chosen]
            clip = view.clip[chosen[at]]
            rows["falloff"][at], rows["forward"][at] = falloff[chosen[at]], clip[:, 2]
            rows["across"][at], rows["along"][at], rows["base"][at] = ways_of_pixels(clip, size_px).transpose(2, 0, 1)
        parts.append(rows)
    return np.concatenate(parts)


def least_cosine(display: Display, eyes_m: Floats) -> float:
    """Of the angle between a panel's normal and the way to an eye, over the corners of all panels that lose light.

    All others are dimmed to match, within limits. It is the whole display's, whichever of its panels a quilt holds or
    are asked for: what is drawn apart has to match, too.
    """
    display = display.whole
    falling = np.flatnonzero(np.array([panel.falloff > 0 for panel in display.panels]))
    least = 1.0
    for eye_m in eyes_m if len(falling) else ():
        ways = eye_m - display.outlines_m[falling]
        height = np.einsum("na,nka->nk", display.normals[falling], ways)
        cosine = height / np.maximum(np.linalg.norm(ways, axis=2), 1e-300)
        least = min(least, float(cosine[cosine > 0].min(initial=1.0)))
    return max(least, _MOST_OBLIQUE_COSINE)
