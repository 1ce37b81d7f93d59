"""How long frames of a terrain take, and how true they are: on one panel beside VTK's full grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.file import Terrain
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.panel import Panel
from limen.frame.renderer import Renderer
from limen.geometry import Floats
from limen.gpu.device import Device
from limen.layers.terrain.layer import TerrainLayer
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.selector import Choice
from limen.study.baselines.full_grid import FullGrid, hillshade
from limen.study.baselines.packages import is_skipped
from limen.study.bench.table import Row, Say
from limen.study.bench.timing import medians, timed
from limen.study.error_kernels import measure_residuals
from limen.study.triangulations import Posts, drawn
from limen.viewing.panel_demands import panel_demands
from limen.viewing.policy import Policy
from limen.viewing.projection import PanelProjections, QuiltPanels, QuiltView, guard_of
from limen.viewing.viewer import Viewer

__all__ = [
    "FRAMES",
    "LOOK",
    "SeenSurface",
    "TerrainPanel",
    "choice_of",
    "displacement",
    "frame_aims",
    "frame_rows",
    "measure_frames",
    "one_panel",
]

LOOK = TerrainLook(colours="plain")
"""One grey, lit by the sun: what both draw."""

FRAMES = {
    "method": "", "triangles": ",", "frame_ms": ",.1f", "frame_cpu_ms": ",.1f", "frames": "", "allowed_px": ".3f",
    "max_error_px": ".3f",
}  # fmt: skip
"""The same view on one panel, medians over ``frames``: the largest error that the viewer cannot see, and how far a
place of the true surface is from where it is drawn, at most, over all posts in view."""


def measure_frames(device: Device, renderer: Renderer, viewer: Viewer, frames: int) -> Row:
    """Triangles and times of frames whose patches and pages are there: choosing, joining, and drawing, to its end."""
    seen = renderer.state(0.0, viewers=(viewer,))
    for _ in renderer.pictures(seen):
        pass  # waits until all that is wanted is there

    def frame() -> int:
        triangles = renderer.frame(seen).layers[0].drawn
        device.wait()
        return triangles

    found = [timed(frame) for _ in range(frames)]
    times = medians("frame", [spent for _, spent in found], by_cpu=device.is_software)
    return {"triangles": found[-1][0], **times, "frames": frames}


class TerrainPanel(NamedTuple):
    """One panel, and a viewer before its middle."""

    display: Display
    viewer: Viewer


def one_panel() -> TerrainPanel:
    """A panel as those of the paper's wall, and a viewer 1 m before it."""
    pitch_m, size_px = 0.303e-3, (1920, 1200)
    width, height = (count * pitch_m for count in size_px)
    panel = Panel("panel", size_px, (-width / 2, 1.5 + height / 2, 0.0), (1, 0, 0), (0, -1, 0), (pitch_m, pitch_m))
    return TerrainPanel(Display("panel", (panel,)), Viewer((0.0, 1.5, 1.0), direction=(0.0, 0.0, -1.0)))


def frame_rows(
    device: Device, terrain: Terrain, posts: Posts, frames: int, say: Say, stage: TerrainPanel | None = None
) -> list[Row]:
    """Limen under the policy ``acuity`` and VTK's full grid, the same view of all of the terrain."""
    display, viewer = stage = stage or one_panel()
    policy, eye_m = Policy("acuity"), np.array(viewer.position_m)
    choice = choice_of(terrain, stage, policy)
    say("limen on one panel")
    allowed = {"allowed_px": float(choice.allowed_px[0])}
    error_px = displacement(terrain, posts, choice).error_px
    layer = TerrainLayer(terrain, LOOK, policy=policy, reference_m=viewer.position_m)
    with Renderer(device, display, [layer]) as renderer:
        times = measure_frames(device, renderer, viewer, frames)
    rows = [{"method": "limen", **times, **allowed, "max_error_px": error_px}]
    if is_skipped("vtk", say):
        return rows
    grid = FullGrid(posts, choice.room_from_posts, display.panels[0], eye_m, hillshade(posts, LOOK))
    try:
        say(f"VTK on one panel ({grid.renderer_name})")
        grid.draw()
        spent = [timed(grid.draw)[1] for _ in range(frames)]
    finally:
        grid.close()
    times = {"triangles": grid.triangles, **medians("frame", spent, by_cpu=device.is_software), "frames": frames}
    return [*rows, {"method": "vtk", **times, **allowed, "max_error_px": 0.0}]


def choice_of(terrain: Terrain, stage: TerrainPanel, policy: Policy) -> Choice:
    """What limen draws for a viewer who is the reference eye, too, and where the terrain stands."""
    display, viewer = stage
    quilt = pack_outlines(display)[0]
    sight = TerrainLayer(terrain, reference_m=viewer.position_m).selector(display, display)
    stands = sight.room_from_posts(sight.settings.look_at)
    view = QuiltView.of(QuiltPanels(display, quilt, guard_px=guard_of(display, quilt)), [viewer.position_m])
    return sight.choose(view, stands, panel_demands(display, [viewer], policy))


class SeenSurface(NamedTuple):
    """What of the true surface is in view, and how far from its place it is drawn."""

    posts: int
    holes: int  # of them, those where nothing is drawn
    error_px: float


def displacement(terrain: Terrain, posts: Posts, choice: Choice) -> SeenSurface:
    """How far the posts in view of a quilt's first panel are from where its patches have them, at most.

    Every post is projected from its true place and from that of the drawn surface above or below it; the patches, and
    the fans between them, are put together and measured by other means than those that draw them.
    """
    rows, columns = posts.heights_m.shape
    triangles = drawn((terrain.read_patch(int(patch)) for patch in choice.cut.pair_patch), (columns, rows))
    residuals = np.full(posts.heights_m.shape, np.nan, np.float32)
    measure_residuals(posts.heights_m, triangles.astype(np.int64), residuals)
    (eye,), stands = choice.view.eyes, choice.room_from_posts
    size_px = np.array(choice.view.quilt.size_px)
    count, holes, error_px = 0, 0, 0.0
    for row in range(rows):
        places = np.column_stack([np.arange(columns), np.full(columns, row), posts.heights_m[row].astype(np.float64)])
        true_px, inside = _projected(eye, size_px, stands, places)
        if posts.void is not None:
            inside &= ~posts.void[row]
        places[:, 2] += residuals[row]
        drawn_px, _ = _projected(eye, size_px, stands, places)
        off_px = np.linalg.norm(drawn_px - true_px, axis=1)[inside]
        count, holes = count + len(off_px), holes + int(np.isnan(off_px).sum())
        error_px = max(error_px, float(np.nan_to_num(off_px).max(initial=0.0)))
    return SeenSurface(count, holes, error_px)


def _projected(
    views: PanelProjections, size_px: NDArray[np.int64], room_from_posts: Floats, places: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """Pixels of the quilt (N, 2), and which are on the first panel and before the eye (N,)."""
    way = places @ room_from_posts[:3, :3].T + room_from_posts[:3, 3] - views.eye_m
    x, y, w = views.clip[0] @ way.T
    ahead = np.maximum(w, 1e-12)
    inside = (w > 1e-12) & np.asarray((views.edges[0] @ way.T > 0).all(axis=0))
    return np.column_stack([x / ahead, -y / ahead]) * size_px / 2, inside


def frame_aims(rows: Sequence[Row]) -> Iterator[str]:
    """What was aimed at, beside what these rows say of it."""
    by_method = {row["method"]: row for row in rows}
    limen, vtk = by_method.get("limen"), by_method.get("vtk")
    if limen:
        yield f"largest error on the panel: {limen['max_error_px']:.3f} px (aim: at most {limen['allowed_px']:.3f})"
    if limen and vtk:
        ratio = vtk["frame_ms"] / limen["frame_ms"]
        by_cpu = (vtk["frame_cpu_ms"] or 0.0) / limen["frame_cpu_ms"] if limen["frame_cpu_ms"] else None
        steadier = f", by processor time {by_cpu:.0f}" if by_cpu else ""
        yield f"frame, VTK's full grid / limen at 1 m: {ratio:.0f}{steadier} (aim: 50)"
