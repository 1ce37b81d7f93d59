"""Frames for the tests of whole renderers: their messages, their finished pictures, and what is left on the adapter."""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.frame.renderer import Renderer
from limen.frame.report import FrameReport, LayerReport
from limen.viewing.placement import InRoom, LookAt, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import AnyPlacement, FrameState
from limen.viewing.viewer import Pointer, Viewer

__all__ = [
    "CLOSE",
    "ELSEWHERE",
    "EYE",
    "FULL",
    "MEMORY",
    "SMALL_PX",
    "STANDS",
    "VIEWER",
    "WALL",
    "Make",
    "Rgb",
    "assert_equal",
    "assert_same",
    "changed",
    "drawn",
    "frame_of",
    "lit",
    "living",
    "off",
    "psnr",
    "row_of",
]

FULL = Policy("full")
Rgb = NDArray[np.uint8]
Make: TypeAlias = Callable[..., Renderer]

WALL = Display.preset("rostock").scaled(0.05)
"""24 panels of 96 x 60 pixels, on which one thing of every kind is shown."""

MEMORY = 64 << 20
"""Bytes on the adapter for one thing: all of it is cleared before the first frame."""

SMALL_PX = 30_000
"""Of a quilt: four of the wall's panels and more."""

EYE = (0.2, 1.7, 0.3)
VIEWER = Viewer(EYE, time_s=2.5)
STANDS = np.array([[0.7, 0, 0, 0], [0, 0.7, 0, 1.5], [0, 0, 0.7, -3.0], [0, 0, 0, 1.0]])
CLOSE = LookAt((0.55, 0.5), 30, 35, 5_000)
ELSEWHERE: dict[str, AnyPlacement] = {
    "image": OnSurface(zoom=2.0, centre=(0.3, 0.6)),
    "mesh": InRoom.of(STANDS @ np.diag([0.5, 0.5, 0.5, 1.0])),
    "terrain": msgspec.structs.replace(CLOSE, heading_deg=120.0),
    "points": InRoom.of(STANDS @ np.diag([0.5, 0.5, 0.5, 1.0])),
}
"""Another placement for each kind."""


def frame_of(
    renderer: Renderer, *viewers: Viewer, time_s: float | None = None, pointers: Sequence[Pointer] = (), **changes: Any
) -> FrameState:
    """The message of a frame for these viewers, by the first one's clock; ``changes``: of the first layer's state."""
    now_s = time_s if time_s is not None else viewers[0].time_s if viewers else 0.0
    return changed(renderer.state(now_s, viewers=viewers, pointers=tuple(pointers)), **changes)


def changed(frame: FrameState, **changes: Any) -> FrameState:
    """The same with other fields of the first layer's state."""
    first, *others = frame.layers
    return msgspec.structs.replace(frame, layers=(msgspec.structs.replace(first, **changes), *others))


def drawn(renderer: Renderer, frame: FrameState, **options: Any) -> tuple[dict[str, Rgb], FrameReport]:
    """Copies of all finished pictures (h, w, 3), and one report for all of them."""
    pictures, reports = {}, {}
    for name, pixels, report in renderer.pictures(frame, **options):
        pictures[name] = pixels[..., :3].copy()
        reports[id(report)] = report
    return pictures, FrameReport.of(list(reports.values()))


def row_of(report: FrameReport) -> LayerReport:
    """What is told of the only layer."""
    (row,) = report.layers
    return row


def assert_same(one: NDArray[Any], other: NDArray[Any], but: float = 0.002) -> None:
    """But for edges, which fall on another side of a pixel's middle where it lies elsewhere in a quilt."""
    assert one.shape == other.shape
    assert (np.abs(one.astype(int) - other).max(axis=-1) > 8).mean() <= but


def assert_equal(one: dict[str, Rgb], other: dict[str, Rgb]) -> None:
    assert list(one) == list(other)
    for name, picture in one.items():
        np.testing.assert_array_equal(picture, other[name], name)


def lit(pictures: dict[str, Rgb]) -> int:
    """How many pixels show more than what lies behind everything."""
    return sum(int((picture.max(axis=-1) > 40).sum()) for picture in pictures.values())


def off(one: dict[str, Rgb], other: dict[str, Rgb]) -> int:
    """How many pixels clearly differ."""
    assert list(one) == list(other)
    return sum(int((np.abs(one[name].astype(int) - other[name]).max(axis=-1) > 8).sum()) for name in one)


def psnr(one: NDArray[Any], other: NDArray[Any]) -> float:
    return float(10 * np.log10(255**2 / ((one.astype(float) - other) ** 2).mean()))


def living() -> dict[str, int]:
    """How many objects of each kind the adapter holds for us."""
    import wgpu

    gc.collect()
    return {name: row["count"] for name, row in wgpu.diagnostics.object_counts.get_dict().items()}
