"""How long frames of a terrain take: on a wall at the paper's distances, and on one panel beside VTK's full grid."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from typing import ClassVar, NamedTuple

import msgspec
import numpy as np
import wgpu
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
from limen.layers.terrain.selector import Choice, TerrainSettings
from limen.study.error_kernels import measure_residuals
from limen.study.terrain_peers import INSTALL, missing_package
from limen.study.terrain_table import Table2Row, at_wall_centre, table2_rows
from limen.study.terrain_vtk import FullGrid, hillshade
from limen.study.triangulations import Posts, drawn
from limen.viewing.panel_demands import panel_demands
from limen.viewing.policy import Policy
from limen.viewing.projection import PanelProjections, QuiltPanels, QuiltView, guard_of
from limen.viewing.standing import standing_viewer
from limen.viewing.viewer import Viewer

__all__ = [
    "LOOK",
    "SeenSurface",
    "Table2",
    "TerrainFrameRow",
    "TerrainPanel",
    "choice_of",
    "displacement",
    "frame_aims",
    "frame_rows",
    "one_panel",
    "table2",
    "timed",
]

Say = Callable[[str], None]

LOOK = TerrainLook(colours="plain")
"""One grey, lit by the sun: what both draw."""


class Table2(Table2Row, frozen=True, kw_only=True):
    """A row of the paper's second table, and how long limen takes to draw all its active panels."""

    frame_ms: float
    frame_cpu_ms: float | None
    """On a software adapter, of all threads: steadier than the clock where others compute, too. Null on others."""
    triangles: int
    frames: int

    columns: ClassVar[tuple[str, ...]] = (
        "distance m", "min px", "paper", "max px", "paper", "active", "exact rule", "triangles", "frame ms",
        "cpu frame", "frames/s", "paper",
    )  # fmt: skip

    def cells(self) -> tuple[str, ...]:
        paper_max = "" if self.paper_max_error_px is None else f"{self.paper_max_error_px:.2f}"
        return (
            f"{self.distance_m:g}", f"{self.min_error_px:.2f}", f"{self.paper_min_error_px:.2f}",
            f"{self.max_error_px:.2f}", paper_max, str(self.active_panels), str(self.active_panels_exact),
            f"{self.triangles:,}", f"{self.frame_ms:,.1f}", _ms(self.frame_cpu_ms), f"{1e3 / self.frame_ms:.1f}",
            f"{self.paper_frames_per_s:.1f}",
        )  # fmt: skip


class TerrainFrameRow(msgspec.Struct, frozen=True, kw_only=True):
    """One way to draw the same view on one panel; medians over frames."""

    method: str
    triangles: int
    frame_ms: float
    frame_cpu_ms: float | None
    """As of `Table2`."""
    frames: int
    allowed_px: float
    """The largest error that the viewer cannot see."""
    max_error_px: float
    """How far a place of the true surface is from where it is drawn, at most, over all posts in view."""

    columns: ClassVar[tuple[str, ...]] = ("method", "triangles", "frame ms", "cpu frame", "allowed px", "max error px")

    def cells(self) -> tuple[str, ...]:
        times = f"{self.frame_ms:,.1f}", _ms(self.frame_cpu_ms)
        return (self.method, f"{self.triangles:,}", *times, f"{self.allowed_px:.3f}", f"{self.max_error_px:.3f}")


class Times(NamedTuple):
    """Medians, milliseconds."""

    frame_ms: float
    cpu_ms: float | None
    frames: int


def table2(device: Device, terrain: Terrain, frames: int, say: Say, display: Display | None = None) -> list[Table2]:
    """The paper's second table on its own wall, with limen's frames.

    As in the paper one fixed camera sees the whole wall, and the user before the wall's centre decides about detail.
    """
    wall = display or Display.preset("rostock")
    camera_m = standing_viewer(wall).position_m
    layer = TerrainLayer(
        terrain, settings=TerrainSettings(rule="middle"), policy=Policy("scheel"), reference_m=camera_m
    )
    found = []
    with Renderer(device, wall, [layer], eye_m=camera_m) as renderer:
        for row in table2_rows(wall):
            say(f"{len(wall.panels)} panels, {row.distance_m:g} m")
            viewer = at_wall_centre(wall, row.distance_m)
            triangles, times = measure_frames(device, renderer, viewer, frames)
            found.append(
                Table2(
                    **msgspec.structs.asdict(row), frame_ms=times.frame_ms, frame_cpu_ms=times.cpu_ms,
                    triangles=triangles, frames=times.frames,
                )
            )  # fmt: skip
    return found


def measure_frames(device: Device, renderer: Renderer, viewer: Viewer, frames: int) -> tuple[int, Times]:
    """Triangles and times of frames whose patches and pages are there: choosing, joining, and drawing, to its end."""
    seen = renderer.state(0.0, viewers=(viewer,))
    for _ in renderer.pictures(seen):
        pass  # waits until all that is wanted is there
    fence = device.wgpu.create_buffer(size=4, usage=wgpu.BufferUsage.COPY_SRC)
    triangles = 0

    def frame() -> None:
        nonlocal triangles
        triangles = renderer.frame(seen).layers[0].drawn
        device.wgpu.queue.read_buffer(fence, size=4)  # comes after all that was submitted

    times = timed(frame, frames, by_cpu=device.is_software)
    fence.destroy()
    return triangles, times


def timed(call: Callable[[], object], repeats: int, *, by_cpu: bool) -> Times:
    clock, cpu = [], []
    for _ in range(repeats):
        begin, begin_cpu = time.perf_counter(), time.process_time()
        call()
        clock.append((time.perf_counter() - begin) * 1e3)
        cpu.append((time.process_time() - begin_cpu) * 1e3)
    return Times(statistics.median(clock), statistics.median(cpu) if by_cpu else None, repeats)


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
) -> list[TerrainFrameRow]:
    """Limen under the policy ``acuity`` and VTK's full grid, the same view of all of the terrain."""
    display, viewer = stage = stage or one_panel()
    policy, eye_m = Policy("acuity"), np.array(viewer.position_m)
    choice = choice_of(terrain, stage, policy)
    say("limen on one panel")
    seen = displacement(terrain, posts, choice)
    allowed_px = float(choice.allowed_px[0])
    layer = TerrainLayer(terrain, LOOK, policy=policy, reference_m=viewer.position_m)
    with Renderer(device, display, [layer]) as renderer:
        triangles, times = measure_frames(device, renderer, viewer, frames)
    rows = [_row("limen", triangles, times, allowed_px, seen.error_px)]
    missing = missing_package("vtk")
    if missing:
        say(f"vtk: skipped, {missing} is not installed ({INSTALL})")
        return rows
    grid = FullGrid(posts, choice.room_from_posts, display.panels[0], eye_m, hillshade(posts, LOOK))
    try:
        say(f"VTK on one panel ({grid.renderer_name})")
        grid.draw()
        times = timed(grid.draw, frames, by_cpu=device.is_software)
        return [*rows, _row("vtk", grid.triangles, times, allowed_px, 0.0)]
    finally:
        grid.close()


def _row(method: str, triangles: int, times: Times, allowed_px: float, error_px: float) -> TerrainFrameRow:
    return TerrainFrameRow(
        method=method, triangles=triangles, frame_ms=times.frame_ms, frame_cpu_ms=times.cpu_ms, frames=times.frames,
        allowed_px=allowed_px, max_error_px=error_px,
    )  # fmt: skip


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


def frame_aims(rows: Sequence[TerrainFrameRow]) -> Iterator[str]:
    """What was aimed at, beside what these rows say of it."""
    by_method = {row.method: row for row in rows}
    limen, vtk = by_method.get("limen"), by_method.get("vtk")
    if limen:
        yield f"largest error on the panel: {limen.max_error_px:.3f} px (aim: at most {limen.allowed_px:.3f})"
    if limen and vtk:
        ratio = vtk.frame_ms / limen.frame_ms
        by_cpu = (vtk.frame_cpu_ms or 0.0) / limen.frame_cpu_ms if limen.frame_cpu_ms else None
        steadier = f", by processor time {by_cpu:.0f}" if by_cpu else ""
        yield f"frame, VTK's full grid / limen at 1 m: {ratio:.0f}{steadier} (aim: 50)"


def _ms(value: float | None) -> str:
    return "" if value is None else f"{value:,.1f}"
