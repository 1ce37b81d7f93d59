"""What layers cost together: frames of a show of four, beside those of shows of one."""

from __future__ import annotations

import statistics
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from limen.data import sample_image, sample_points
from limen.data.opening import open_content
from limen.data.points.ingest import ingest_points
from limen.data.samples.mesh import sample_mesh
from limen.data.samples.terrain import sample_terrain
from limen.data.terrain.ingest import ingest_terrain
from limen.display.display import Display
from limen.frame.renderer import Renderer
from limen.gpu.device import Device, open_device
from limen.layers.registry import layer_of
from limen.study.bench.table import Row, Say, Table
from limen.study.bench.timing import Spent, medians, timed, turns
from limen.viewing.standing import standing_viewer

__all__ = ["bench_layers"]

_COLUMNS = {
    "layers": "", "drawn": ",", "frame_ms": ",.1f", "frame_cpu_ms": ",.1f", "frames": "",
    "over_alone": ".2f",
}  # fmt: skip
"""What is drawn is triangles or splats. Times are medians over ``frames``, of choosing and drawing, to the end, when
all chunks are there; ``over_alone`` is the median of a frame of all layers over the sum of those of each alone in the
same round, by the steadier time."""
_AIM = 1.1
_TOGETHER = "together"


class _Size(NamedTuple):
    gigapixels: float
    triangles: int
    posts: int
    points: int
    scale: float
    """Of the display's pixels."""
    frames: int


_FULL, _QUICK = _Size(0.06, 70_000, 2049, 2_000_000, 1.0, 9), _Size(0.005, 5_000, 257, 40_000, 0.25, 5)


def bench_layers(quick: bool, say: Say) -> list[Table]:
    """The table of ``limen bench layers``: one layer of every kind, as each is shown by default."""
    size = _QUICK if quick else _FULL
    display = Display.preset("desktop").scaled(size.scale)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="limen-bench-")))
        say("a sample of every kind is made")
        contents = [open_content(path) for path in _samples(folder, size)]
        for content in contents:
            stack.callback(getattr(content, "close", lambda: None))
        device = stack.enter_context(open_device())
        say(f"{display.name}, {display.total_px / 1e6:.1f} megapixels, on {device.adapter_name}")
        layers = {content.kind: layer_of(content) for content in contents}
        shows = {kind: [layer] for kind, layer in layers.items()} | {_TOGETHER: list(layers.values())}
        renderers = {name: stack.enter_context(Renderer(device, display, shown)) for name, shown in shows.items()}
        rows = _measured(device, renderers, size.frames)
    aim = f"a frame of all layers / those of each alone: {rows[-1]['over_alone']:.2f} (aim: at most {_AIM:.2f})"
    return [Table(_COLUMNS, rows, [aim])]


def _samples(folder: Path, size: _Size) -> list[Path]:
    """A file or folder of each kind, ready to be shown."""
    image, mesh, terrain, points = (
        folder / name for name in ("image.tif", "mesh.ply", "terrain.terrain", "points.points")
    )
    sample_image(image, size.gigapixels)
    sample_mesh(mesh, size.triangles)
    sample_terrain(folder / "terrain.tif", size.posts)
    ingest_terrain(folder / "terrain.tif", terrain)
    sample_points(folder / "points.ply", size.points)
    ingest_points(folder / "points.ply", points)
    return [image, mesh, terrain, points]


def _measured(device: Device, renderers: dict[str, Renderer], frames: int) -> list[Row]:
    viewers = {name: (standing_viewer(renderer.display),) for name, renderer in renderers.items()}
    states = {name: renderer.state(0.0, viewers=viewers[name]) for name, renderer in renderers.items()}
    spent: dict[str, list[Spent]] = {name: [] for name in renderers}
    reports: dict[str, Any] = {}

    def frame(name: str) -> Any:
        report = renderers[name].frame(states[name])
        device.wait()
        return report

    for name, renderer in renderers.items():
        for _ in renderer.pictures(states[name]):
            pass  # waits until all that is wanted is there
        frame(name)
    for _, name in turns(list(renderers), frames):
        reports[name], took = timed(lambda: frame(name))  # noqa: B023
        spent[name].append(took)
    by_cpu = device.is_software
    rows: list[Row] = []
    for name, report in reports.items():
        drawn = sum(layer.drawn for layer in report.layers)
        times = medians("frame", spent[name], by_cpu=by_cpu)
        rows.append({"layers": name, "drawn": drawn, **times, "frames": frames})
    rounds = zip(*spent.values(), strict=True)
    ratios = [
        together.steady_ms(by_cpu=by_cpu) / sum(each.steady_ms(by_cpu=by_cpu) for each in alone)
        for *alone, together in rounds
    ]
    rows[-1]["over_alone"] = statistics.median(ratios)
    return rows
