"""How long many panels take: limen beside the published sorting, a hierarchy a frame, and a scene a panel.

The points are those of the paper's figures: 18 (panels), 19 (the same, part by part), 20 (pixels of the quilt) and 21
(triangles); its displays, with an icosphere of 1,280 panels among them, a bumpy knot inside, and an eye that walks
around. All ways of sorting draw the same picture with the same shaders, and take turns within a run.

References
----------
Harish, Narayanan 2013, *Designing Perspectively Correct Multiplanar Displays*, section 4.2.
"""

from __future__ import annotations

import itertools
import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from limen.data import torus_knot
from limen.errors import DeviceLimitError
from limen.geometry import Floats, as_vec3
from limen.gpu.device import Device, open_device
from limen.gpu.targets import Targets
from limen.layers.mesh.draw.drawer import MeshDrawer
from limen.layers.mesh.layer import MeshLayer, MeshPart, nearest_m
from limen.study.baselines.methods import METHODS, Method
from limen.study.panels_stage import DISPLAYS, PanelsScene, stage
from limen.viewing.projection import QuiltView

__all__ = [
    "Budget",
    "PanelsRow",
    "Point",
    "aims",
    "bench_panels",
    "measure",
    "points",
]

Say = Callable[[str], None]

_EVERY: tuple[Method, ...] = tuple(METHODS)
_TWO: tuple[Method, ...] = ("limen", "paper")
_TRIANGLES = 69_716
_MPX = 1 << 20
_QUICK_LIMIT_S, _FULL_LIMIT_S = 2.5, 20.0


class PanelsRow(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One way at one point; medians over frames. What was not measured is null, and ``note`` says why."""

    figure: int
    """Of the paper."""
    display: str
    panels: int
    triangles: int
    quilt_px: int
    method: str
    pairs: int | None = None
    """Of a triangle and a panel that it was drawn for."""
    sort_ms: float | None = None
    """From the eye's place to all pairs, the processor's part included."""
    draw_ms: float | None = None
    frame_ms: float | None = None
    sort_cpu_ms: float | None = None
    """On a software adapter, of all threads: steadier than the clock where others compute, too. Null on others."""
    frame_cpu_ms: float | None = None
    frames: int = 0
    parts_ms: dict[str, float] = {}
    """Parts of the frame, waited for one by one: figure 19, at the points of figure 18."""
    note: str = ""

    columns: ClassVar[tuple[str, ...]] = (
        "display", "figure", "panels", "triangles", "Mpixel", "method", "pairs", "sort ms", "draw ms", "frame ms",
        "cpu sort", "cpu frame",
    )  # fmt: skip

    @property
    def steady_ms(self) -> tuple[float, float]:
        """Of sorting and of the frame: by the processor's time where there is one, by the clock otherwise."""
        return self.sort_cpu_ms or self.sort_ms or 0.0, self.frame_cpu_ms or self.frame_ms or 0.0

    def cells(self) -> tuple[str, ...]:
        times = (self.sort_ms, self.draw_ms, self.frame_ms, self.sort_cpu_ms, self.frame_cpu_ms)
        return (
            self.display, str(self.figure), f"{self.panels:,}", f"{self.triangles:,}", f"{self.quilt_px / _MPX:.3g}",
            self.method, "" if self.pairs is None else f"{self.pairs:,}",
            *("" if value is None else f"{value:,.1f}" for value in times),
        )  # fmt: skip


class Point(NamedTuple):
    """What is measured together."""

    figure: int
    display: str
    triangles: int
    quilt_px: int
    methods: tuple[Method, ...]


class _Times(NamedTuple):
    """Seconds by the clock, and of the processor."""

    sort: float
    frame: float
    sort_cpu: float
    frame_cpu: float


_WORK: dict[str, Callable[[int, int], float]] = {
    "limen": lambda _panels, triangles: triangles,
    "paper": lambda panels, triangles: triangles * (panels + 200),
    "hierarchy": lambda panels, triangles: triangles * math.sqrt(panels),
    "per-panel": lambda panels, triangles: triangles * panels,
}
"""What the time of a frame grows with, roughly."""


@dataclass
class Budget:
    """What a frame of each way costs, learnt from the points before, so that nothing is begun that takes too long."""

    limit_s: float
    rates_s: dict[str, float] = field(default_factory=dict)

    def predicted_s(self, method: str, panels: int, triangles: int) -> float:
        """Of one frame; 0 where nothing is known yet."""
        return self.rates_s.get(method, 0.0) * _WORK[method](panels, triangles)

    def learn(self, method: str, panels: int, triangles: int, frame_s: float) -> None:
        """The least seen for the work counts: small points have costs that do not grow with it."""
        rate_s = frame_s / _WORK[method](panels, triangles)
        self.rates_s[method] = min(rate_s, self.rates_s.get(method, rate_s))


def points(quick: bool) -> list[Point]:
    """All points, small ones first in each figure."""
    size, many = (_MPX, _TRIANGLES // 8) if quick else (4 * _MPX, _TRIANGLES)
    shown = ("icosahedron", "120", "knot", "icosphere") if quick else tuple(DISPLAYS)
    found = [Point(18, name, many, size, _EVERY) for name in shown]
    found += [
        Point(20, "knot", many, pixels, _TWO)
        for pixels in ((_MPX // 4, 4 * _MPX) if quick else (_MPX // 4, _MPX, 4 * _MPX, 16 * _MPX, 64 * _MPX))
    ]
    counts = (6_000, 69_716) if quick else (6_000, 69_716, 348_000, 871_000)
    wide = ("sphere",) if quick else ("120", "sphere")
    every = _TWO if quick else _EVERY
    found += [Point(21, name, count, size, every) for name, count in itertools.product(wide, counts)]
    return found


def bench_panels(quick: bool, say: Say) -> list[PanelsRow]:
    """Rows of ``limen bench panels``."""
    rows: list[PanelsRow] = []
    budget = Budget(_QUICK_LIMIT_S if quick else _FULL_LIMIT_S)
    with open_device() as device:
        say(f"on {device.adapter_name}")
        for point in points(quick):
            say(f"figure {point.figure}: {point.display}, {point.triangles:,} triangles, {point.quilt_px:,} pixels")
            rows += measure(device, point, frames=3 if quick else 5, budget=budget)
    for text in aims(rows):
        say(text)
    return rows


def aims(rows: Sequence[PanelsRow]) -> list[str]:
    """What was aimed at, beside what these rows say of it, by their steadier times."""
    ours = [row for row in rows if row.method == "limen" and row.frames]
    shares = [row.steady_ms[0] / row.steady_ms[1] for row in ours]
    found = []
    if shares:
        most = ours[int(np.argmax(shares))]
        found.append(
            f"sorting's share of limen's frame: {min(shares):.0%} to {max(shares):.0%} (aim: under 25 %); most at "
            f"{most.panels:,} panels, {most.triangles:,} triangles, {most.quilt_px / _MPX:.3g} Mpixel"
        )
    by_method = {
        row.method: row.steady_ms for row in rows if row.figure == 18 and row.display == "icosphere" and row.frames
    }
    for method, which, what, aim in (("paper", 0, "sort", 5), ("per-panel", 1, "frame", 8)):
        if "limen" in by_method and method in by_method:
            ratio = by_method[method][which] / by_method["limen"][which]
            found.append(f"{what}, {method} / limen at 1,280 panels: {ratio:.1f} (aim: at least {aim})")
    return found


def measure(device: Device, point: Point, *, frames: int, budget: Budget) -> list[PanelsRow]:
    """Rows of one point, a way each; what the budget forbids has a note instead of times."""
    scenery = stage(point.display, point.quilt_px)
    mesh = torus_knot(point.triangles)
    panels = len(scenery.windows.quilt.panels)
    part = MeshPart(np.diag([scenery.scene_m] * 3 + [1.0]))
    scene = _Scene(device, MeshLayer(mesh), scenery, part, Targets(device), mesh.bounds)
    predicted_s = {method: budget.predicted_s(method, panels, mesh.size) for method in point.methods}
    drawers: dict[Method, MeshDrawer] = {}
    notes: dict[Method, str] = {}
    pairs: dict[Method, int] = {}
    times: dict[Method, list[_Times]] = {method: [] for method in point.methods}
    parts: dict[Method, dict[str, float]] = {}
    try:
        for method in point.methods:
            try:
                if predicted_s[method] > budget.limit_s:
                    raise DeviceLimitError(f"a frame would take about {predicted_s[method]:.0f} s")
                drawers[method] = scene.drawer(method)
            except DeviceLimitError as error:
                notes[method] = f"not measured: {error}"
        for number, eye_m in enumerate(scenery.eyes_m(frames)):
            # Whoever draws first finds other things in the caches, so they take turns.
            for method in _turned(list(drawers), number):
                if number == 0 or (number + 1) * predicted_s[method] <= budget.limit_s:
                    pairs[method], spent = scene.frame(drawers[method], eye_m)
                    times[method].append(spent)
                    budget.learn(method, panels, mesh.size, spent.frame)
                    predicted_s[method] = spent.frame
        if point.figure == 18:
            parts = {method: scene.parts(method, drawer, 3) for method, drawer in drawers.items() if method in _TWO}
    finally:
        for drawer in drawers.values():
            drawer.destroy()
        scene.targets.destroy()
    size_px = math.prod(scenery.windows.quilt.size_px)
    empty = PanelsRow(
        figure=point.figure, display=point.display, panels=panels, triangles=mesh.size, quilt_px=size_px, method=""
    )
    return [
        _filled(
            msgspec.structs.replace(empty, method=method, note=notes.get(method, ""), parts_ms=parts.get(method, {})),
            times[method], pairs.get(method), by_cpu=device.is_software,
        )
        for method in point.methods
    ]  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Scene:
    """What all ways draw."""

    device: Device
    layer: MeshLayer
    stage: PanelsScene
    part: MeshPart
    targets: Targets
    bounds: NDArray[np.float32]

    def drawer(self, method: Method) -> MeshDrawer:
        """A drawer that has drawn a frame already, and so has compiled its shaders and made its room.

        Raises
        ------
        DeviceLimitError
            If the adapter has too little memory for it.
        """
        drawer = MeshDrawer(self.device, self.layer, sorter=METHODS[method])
        try:
            self.frame(drawer, next(self.stage.eyes_m(1)))
        except BaseException:
            drawer.destroy()
            raise
        return drawer

    def frame(self, drawer: MeshDrawer, eye_m: Floats) -> tuple[int, _Times]:
        """Pairs and times of one frame."""
        begin, begin_cpu = time.perf_counter(), time.process_time()
        view = self._sort(drawer, eye_m)
        middle, middle_cpu = time.perf_counter(), time.process_time()
        self._draw(drawer, view)
        self.device.wait()
        end, end_cpu = time.perf_counter(), time.process_time()
        times = _Times(middle - begin, end - begin, middle_cpu - begin_cpu, end_cpu - begin_cpu)
        return drawer.triangles(wait=True), times

    def parts(self, method: Method, drawer: MeshDrawer, frames: int) -> dict[str, float]:
        """Milliseconds of the parts of a frame, by what is steadier: processor time on a software adapter.

        Every part is run and waited for alone; ``processor`` is what sorting takes beyond the sum of its parts.
        """
        clock = time.process_time if self.device.is_software else time.perf_counter
        spent: dict[str, list[float]] = {}

        def timed(name: str, call: Callable[[], object]) -> None:
            begin = clock()
            call()
            self.device.wait()
            spent.setdefault(name, []).append((clock() - begin) * 1e3)

        deep = MeshDrawer(self.device, replace(self.layer, depth="shared"), sorter=METHODS[method])
        try:
            for eye_m in self.stage.eyes_m(frames):
                timed("sort", partial(self._sort, drawer, eye_m))
                for name, steps in drawer.sorter.parts.items():
                    timed(name, partial(drawer.sorter.submit, steps))
                view = self._sort(deep, eye_m)
                timed("drawing", partial(self._draw, drawer, view))
                timed("shared", partial(self._draw, deep, view))
        finally:
            deep.destroy()
        medians = {name: statistics.median(values) for name, values in spent.items()}
        sorting = {name: medians[name] for name in drawer.sorter.parts}
        return {
            "processor": max(medians["sort"] - sum(sorting.values()), 0.0),
            **sorting,
            "drawing": medians["drawing"],
            "depth by fragments": max(medians["shared"] - medians["drawing"], 0.0),
        }

    def _sort(self, drawer: MeshDrawer, eye_m: Floats) -> QuiltView:
        """The first half of a frame: what the eye sees of the panels, and which triangles touch which of them."""
        windows = self.stage.windows
        ahead = windows.middle_m - eye_m[0]
        view = QuiltView.of(windows, list(eye_m), as_vec3(ahead / np.linalg.norm(ahead), "ahead"))
        view = view.beginning_at(nearest_m(self.bounds, self.part.room_from_mesh, view.eyes_m))
        drawer.prepare(view, self.part, "")
        return view

    def _draw(self, drawer: MeshDrawer, view: QuiltView) -> None:
        """The second half: everything that was sorted."""
        _, target = self.targets.target(view.size_px)
        encoder = self.device.wgpu.create_command_encoder(label="frame")
        drawer.draw(encoder, target, view, self.part, "")
        self.device.wgpu.queue.submit([encoder.finish()])


def _filled(row: PanelsRow, times: list[_Times], pairs: int | None, *, by_cpu: bool) -> PanelsRow:
    if not times:
        return row
    sort, frame, sort_cpu, frame_cpu = (statistics.median(values) * 1e3 for values in zip(*times, strict=True))
    draw = statistics.median([one.frame - one.sort for one in times]) * 1e3
    row = msgspec.structs.replace(row, pairs=pairs, frames=len(times), sort_ms=sort, draw_ms=draw, frame_ms=frame)
    return msgspec.structs.replace(row, sort_cpu_ms=sort_cpu, frame_cpu_ms=frame_cpu) if by_cpu else row


def _turned(methods: list[Method], number: int) -> list[Method]:
    first = number % max(len(methods), 1)
    return methods[first:] + methods[:first]
