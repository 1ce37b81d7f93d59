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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data import torus_knot
from limen.data.store.atomic import write_bytes
from limen.errors import DeviceLimitError
from limen.geometry import Floats, as_vec3
from limen.gpu.device import Device, open_device
from limen.gpu.targets import Targets
from limen.layers.mesh.draw.drawer import MeshDrawer
from limen.layers.mesh.draw.sort import TriangleSorter
from limen.layers.mesh.draw.sorter import Sorter
from limen.layers.mesh.layer import MeshLayer, MeshPart, nearest_m
from limen.study.baselines.sort_paper import PaperSorter
from limen.study.baselines.sort_whole import OctreeSorter, WholeScene
from limen.study.bench.panels_displays import DISPLAYS, PanelsScene, stage
from limen.study.bench.panels_plot import panels_picture
from limen.study.bench.table import Row, Say, Table
from limen.study.bench.timing import Spent, median_of, medians, steady_ms, timed, turns
from limen.study.plots import format_of
from limen.viewing.projection import QuiltView

__all__ = ["METHODS", "Budget", "MeasuredPoint", "Point", "aims", "bench_panels", "measure", "points"]

METHODS: dict[str, type[Sorter]] = {
    "limen": TriangleSorter,
    "paper": PaperSorter,
    "hierarchy": OctreeSorter,
    "per-panel": WholeScene,
}
"""Ways to find the panels of a triangle: limen's own, and those that it is compared with."""
_TWO = ("limen", "paper")
_TRIANGLES = 69_716
_MPX = 1 << 20
_QUICK_LIMIT_S, _FULL_LIMIT_S = 2.5, 20.0


_COLUMNS = {
    "figure": "", "display": "", "panels": ",", "triangles": ",", "quilt_px": ",", "method": "", "pairs": ",",
    "sort_ms": ",.1f", "draw_ms": ",.1f", "frame_ms": ",.1f", "sort_cpu_ms": ",.1f", "frame_cpu_ms": ",.1f",
    "frames": "", "note": "",
}  # fmt: skip
"""Of one way at one point of the paper's ``figure``: medians over ``frames``. Pairs are of a triangle and a panel that
it was drawn for; sorting is from the eye's place to all pairs, the processor's part included. ``note``: why it was not
measured."""
_PARTS = {"display": "", "panels": ",", "method": "", "part": "", "ms": ",.1f"}
"""Of a frame, waited for one by one: figure 19, at the points of figure 18."""


class Point(NamedTuple):
    """What is measured together."""

    figure: int
    display: str
    triangles: int
    quilt_px: int
    methods: tuple[str, ...]


class MeasuredPoint(NamedTuple):
    """A point's rows, one a way, and the parts of its frames."""

    rows: list[Row]
    parts: list[Row]


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
    found = [Point(18, name, many, size, tuple(METHODS)) for name in shown]
    found += [
        Point(20, "knot", many, pixels, _TWO)
        for pixels in ((_MPX // 4, 4 * _MPX) if quick else (_MPX // 4, _MPX, 4 * _MPX, 16 * _MPX, 64 * _MPX))
    ]
    counts = (6_000, 69_716) if quick else (6_000, 69_716, 348_000, 871_000)
    wide = ("sphere",) if quick else ("120", "sphere")
    every = _TWO if quick else tuple(METHODS)
    found += [Point(21, name, count, size, every) for name, count in itertools.product(wide, counts)]
    return found


def bench_panels(quick: bool, say: Say, plot: Path | None = None) -> list[Table]:
    """The tables of ``limen bench panels``; ``plot``: a file for their picture."""
    rows: list[Row] = []
    parts: list[Row] = []
    budget = Budget(_QUICK_LIMIT_S if quick else _FULL_LIMIT_S)
    with open_device() as device:
        say(f"panels on {device.adapter_name}")
        for point in points(quick):
            say(f"figure {point.figure}: {point.display}, {point.triangles:,} triangles, {point.quilt_px:,} pixels")
            found = measure(device, point, frames=3 if quick else 5, budget=budget)
            rows, parts = rows + found.rows, parts + found.parts
    if plot is not None:
        write_bytes(plot, panels_picture(rows, parts, format_of(plot)))
    return [
        Table(_COLUMNS, rows, aims(rows)),
        Table(_PARTS, parts, name="parts", title="Parts of a frame, each waited for alone"),
    ]


def aims(rows: Sequence[Row]) -> list[str]:
    """What was aimed at, beside what these rows say of it, by their steadier times."""
    ours = [row for row in rows if row["method"] == "limen" and row["frames"]]
    shares = [steady_ms(row, "sort") / steady_ms(row, "frame") for row in ours]
    found = []
    if shares:
        most = ours[int(np.argmax(shares))]
        found.append(
            f"sorting's share of limen's frame: {min(shares):.0%} to {max(shares):.0%} (aim: under 25 %); most at "
            f"{most['panels']:,} panels, {most['triangles']:,} triangles, {most['quilt_px'] / _MPX:.3g} Mpixel"
        )
    many = {
        row["method"]: row for row in rows if row["figure"] == 18 and row["display"] == "icosphere" and row["frames"]
    }
    for method, part, aim in (("paper", "sort", 5), ("per-panel", "frame", 8)):
        if "limen" in many and method in many:
            ratio = steady_ms(many[method], part) / steady_ms(many["limen"], part)
            found.append(f"{part}, {method} / limen at 1,280 panels: {ratio:.1f} (aim: at least {aim})")
    return found


def measure(device: Device, point: Point, *, frames: int, budget: Budget) -> MeasuredPoint:
    """One point by every way; what the budget forbids has a note instead of times."""
    scenery = stage(point.display, point.quilt_px)
    mesh = torus_knot(point.triangles)
    panels = len(scenery.windows.quilt.panels)
    part = MeshPart(np.diag([scenery.scene_m] * 3 + [1.0]))
    scene = _Scene(device, MeshLayer(mesh), scenery, part, Targets(device), mesh.bounds)
    predicted_s = {method: budget.predicted_s(method, panels, mesh.size) for method in point.methods}
    drawers: dict[str, MeshDrawer] = {}
    notes: dict[str, str] = {}
    pairs: dict[str, int] = {}
    times: dict[str, list[_Frame]] = {method: [] for method in point.methods}
    parts: dict[str, dict[str, float]] = {}
    try:
        for method in point.methods:
            try:
                if predicted_s[method] > budget.limit_s:
                    raise DeviceLimitError(f"a frame would take about {predicted_s[method]:.0f} s")
                drawers[method] = scene.drawer(method)
            except DeviceLimitError as error:
                notes[method] = f"not measured: {error}"
        eyes_m = list(scenery.eyes_m(frames))
        for number, method in turns(list(drawers), frames):
            if number == 0 or (number + 1) * predicted_s[method] <= budget.limit_s:
                pairs[method], spent = scene.frame(drawers[method], eyes_m[number])
                times[method].append(spent)
                predicted_s[method] = spent.frame.clock_ms / 1e3
                budget.learn(method, panels, mesh.size, predicted_s[method])
        if point.figure == 18:
            parts = {method: scene.parts(method, drawer, 3) for method, drawer in drawers.items() if method in _TWO}
    finally:
        for drawer in drawers.values():
            drawer.destroy()
        scene.targets.destroy()
    where = {"display": point.display, "panels": panels}
    rows = [
        {
            "figure": point.figure, **where, "triangles": mesh.size,
            "quilt_px": math.prod(scenery.windows.quilt.size_px), "method": method, "pairs": pairs.get(method),
            **_medians(times[method], by_cpu=device.is_software), "frames": len(times[method]),
            "note": notes.get(method, ""),
        }
        for method in point.methods
    ]  # fmt: skip
    each = [(method, name, ms) for method, of_frame in parts.items() for name, ms in of_frame.items()]
    return MeasuredPoint(rows, [{**where, "method": method, "part": name, "ms": ms} for method, name, ms in each])


class _Frame(NamedTuple):
    """What a frame took, and its first half."""

    sort: Spent
    frame: Spent


def _medians(times: list[_Frame], *, by_cpu: bool) -> Row:
    if not times:
        return {}
    sorts, frames = zip(*times, strict=True)
    draw_ms = statistics.median(one.frame.clock_ms - one.sort.clock_ms for one in times)
    return {"draw_ms": draw_ms, **medians("sort", sorts, by_cpu=by_cpu), **medians("frame", frames, by_cpu=by_cpu)}


@dataclass(frozen=True, slots=True)
class _Scene:
    """What all ways draw."""

    device: Device
    layer: MeshLayer
    stage: PanelsScene
    part: MeshPart
    targets: Targets
    bounds: NDArray[np.float32]

    def drawer(self, method: str) -> MeshDrawer:
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

    def frame(self, drawer: MeshDrawer, eye_m: Floats) -> tuple[int, _Frame]:
        """Pairs and times of one frame."""
        view, sort = timed(lambda: self._sort(drawer, eye_m))
        _, rest = timed(lambda: self._finished(partial(self._draw, drawer, view)))
        return drawer.triangles(wait=True), _Frame(sort, Spent(*map(sum, zip(sort, rest, strict=True))))

    def parts(self, method: str, drawer: MeshDrawer, frames: int) -> dict[str, float]:
        """Milliseconds of the parts of a frame, by what is steadier: processor time on a software adapter.

        Every part is run and waited for alone; ``processor`` is what sorting takes beyond the sum of its parts.
        """
        spent: dict[str, list[Spent]] = {}

        def part(name: str, call: Callable[[], object]) -> None:
            _, took = timed(lambda: self._finished(call))
            spent.setdefault(name, []).append(took)

        deep = MeshDrawer(self.device, replace(self.layer, depth="shared"), sorter=METHODS[method])
        try:
            for eye_m in self.stage.eyes_m(frames):
                part("sort", partial(self._sort, drawer, eye_m))
                for name, steps in drawer.sorter.parts.items():
                    part(name, partial(drawer.sorter.submit, steps))
                view = self._sort(deep, eye_m)
                part("drawing", partial(self._draw, drawer, view))
                part("shared", partial(self._draw, deep, view))
        finally:
            deep.destroy()
        by_cpu = self.device.is_software
        found = {name: median_of(each).steady_ms(by_cpu=by_cpu) for name, each in spent.items()}
        sorting = {name: found[name] for name in drawer.sorter.parts}
        return {
            "processor": max(found["sort"] - sum(sorting.values()), 0.0),
            **sorting,
            "drawing": found["drawing"],
            "depth by fragments": max(found["shared"] - found["drawing"], 0.0),
        }

    def _finished(self, call: Callable[[], object]) -> None:
        """A call, and what it submits, to its end."""
        call()
        self.device.wait()

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
