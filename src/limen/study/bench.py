"""The benchmark tables of the documentation: medians, and ratios to a peer or a plain way in the same run."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import numpy as np
import pyvips

from limen.data import ingest, sample_image
from limen.data.image.file import Image, open_image
from limen.data.pages import PAGE, Pyramid
from limen.display.display import Display
from limen.frame.renderer import Renderer
from limen.gpu.device import Device, open_device
from limen.layers.image.draw.feedback import Feedback
from limen.layers.image.layer import LOOKAHEAD_S, ImageLayer, Sampling, select_ahead
from limen.layers.image.select import ImageOnDisplay, select, view_of
from limen.stream.allocators import Slots
from limen.stream.chunks import ChunkStream, completed
from limen.stream.pages import drawable_pages, page_streaming
from limen.study.bench_lens import LensRow, bench_lens
from limen.study.bench_panels import PanelsRow, bench_panels
from limen.study.blank_source import Blank
from limen.study.charts import CHARTS, chart
from limen.study.frames import frame_of
from limen.study.kernels import kernel_rows
from limen.study.observer import Observer
from limen.track.walk import session_named
from limen.viewing.placement import OnSurface, one_to_one_size_px
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer

__all__ = [
    "BENCHES",
    "Measured",
    "Table",
    "Walk",
    "bench_image",
    "blank_stream",
    "measure_walk",
    "one_to_one_room",
    "walk_viewers",
]

Say = Callable[[str], None]
_KINDS: tuple[Sampling, ...] = ("sharp", "fast")
_SLOTS = 16_384
_CHART_PX = 544  # a little more than the observer's 256 samples at 0.64 arcminutes for two pixels
_FILTERS = (
    ("box", "bilinear"),
    ("box", "catmull-rom"),
    ("mitchell", "catmull-rom"),
    ("magic-sharp", "catmull-rom"),
    ("lanczos-2", "bilinear"),
    ("lanczos-3", "catmull-rom"),
    ("lanczos-3", "lanczos-3"),
    ("lanczos-2", "catmull-rom"),
)
"""Halving and drawing; limen's own are the last."""


class Measured(msgspec.Struct, frozen=True):
    """One row of a benchmark's table."""

    what: str
    value: float
    unit: str

    columns: ClassVar[tuple[str, ...]] = ("what", "value", "unit")

    def cells(self) -> tuple[str, ...]:
        return (self.what, f"{self.value:,.3g}", self.unit)


def one_to_one_room() -> ImageOnDisplay:
    """All 416 panels of the Reality Deck, a texel on every pixel."""
    deck = Display.preset("reality-deck")
    return view_of(deck, Pyramid.of(one_to_one_size_px(deck)), OnSurface("one-to-one"))


def blank_stream(pyramid: Pyramid) -> ChunkStream[Any]:
    """Blank pages on their way to 16,384 slots, before which as many may wait."""
    return replace(page_streaming(Blank(pyramid)), kept=_SLOTS).stream(Slots(_SLOTS), threads=2)


def walk_viewers(seconds: float, rate_hz: float = 60.0) -> Iterator[tuple[Viewer, ...]]:
    """The visitor of session A, frame by frame."""
    session = session_named("A", Display.preset("reality-deck"))
    for frame in session.frames(rate_hz):
        if frame.time_s - session.start_s > seconds:
            return
        yield frame.viewers


def bench_image(quick: bool, say: Say) -> list[Measured]:
    """Rows of ``limen bench image``."""
    rows: list[Measured] = []
    for part in (_frames, _reading, _drawing) if quick else (_frames, _reading, _drawing, _ingest):
        say(part.__doc__ or "")
        rows += part(quick)
    return rows


def bench_kernels(quick: bool, say: Say) -> list[Measured]:
    """Rows of ``limen bench kernels``: what the independent observer says of filters for halving and drawing pages."""
    observer = Observer()
    texels_arcmin = (0.64,) if quick else (0.64, 1.0)
    seeds, size_px = range(1 if quick else 3), (_CHART_PX, _CHART_PX)
    contents = {name: [chart(name, size_px, seed) for seed in seeds] for name in CHARTS}
    rows = []
    for texel_arcmin in texels_arcmin:
        say(f"level 1, a texel of which subtends {texel_arcmin:g} arcminutes")
        for row in kernel_rows(observer, contents, _FILTERS[-1:] if quick else _FILTERS, 1, texel_arcmin):
            what = f"{row.halving} + {row.drawing}, {row.texel_arcmin:g}', {row.content}"
            rows += [Measured(what, row.jod, "JOD"), Measured(what, row.drop_p99, "JOD, largest drop")]
    return rows


Table = list[Measured] | list[PanelsRow] | list[LensRow]

BENCHES: dict[str, Callable[[bool, Say], Table]] = {
    "image": bench_image,
    "kernels": bench_kernels,
    "panels": bench_panels,
    "lens": bench_lens,
}


def _frames(quick: bool) -> list[Measured]:
    """frames of a walk through 416 panels at 60 Hz, cache kept"""
    view = one_to_one_room()
    rows = []
    for policy in (Policy("acuity", 1.0), Policy()):
        for ahead_s in (0.0, LOOKAHEAD_S):
            walk = measure_walk(view, policy, 12 if quick else 145, ahead_s)
            both = [a + b for a, b in zip(walk.select_ms, walk.stream_ms, strict=True)]
            name = f"acuity {policy.acuity_arcmin:g}'" + (f", {ahead_s:g} s ahead" if ahead_s else "")
            rows += [
                Measured(f"{name}: pages wanted, mean", float(np.mean(walk.wanted)), "pages/frame"),
                Measured(f"{name}: uploads needed at once, mean", float(np.mean(walk.needed)), "pages/frame"),
                Measured(f"{name}: uploads needed at once, 99th percentile", _percentile(walk.needed), "pages/frame"),
                Measured(f"{name}: frames that need at most 64", float(np.mean(np.array(walk.needed) <= 64)), "share"),
                Measured(f"{name}: select, median", statistics.median(walk.select_ms), "ms"),
                Measured(f"{name}: stream, median", statistics.median(walk.stream_ms), "ms"),
                Measured(f"{name}: select + stream, median", statistics.median(both), "ms"),
                Measured(f"{name}: select + stream, 99th percentile", _percentile(both), "ms"),
            ]
    return rows


@dataclass(frozen=True)
class Walk:
    """A walk's frames after the first second, one entry a frame."""

    select_ms: list[float]
    stream_ms: list[float]
    needed: list[int]
    wanted: list[int]


def measure_walk(view: ImageOnDisplay, policy: Policy, seconds: float, ahead_s: float) -> Walk:
    """Select and stream every frame with 64 uploads each, decoding (of blank pages) always done in time."""
    walk = Walk([], [], [], [])
    earlier: tuple[Viewer, ...] = ()
    with blank_stream(view.pyramid) as stream:
        for number, viewers in enumerate(walk_viewers(seconds)):
            begin = time.perf_counter()
            cut = select(view, tolerance_of(viewers, policy))
            soon = select_ahead(view, policy, viewers, earlier, ahead_s) if ahead_s else None
            middle = time.perf_counter()
            update = stream.update(cut.pages, soon=soon)
            stream.touch(drawable_pages(view.pyramid, stream.resident, cut.pair_page)[1])
            end = time.perf_counter()
            earlier = viewers
            while not stream.idle:
                stream.wait(0.01)
            if number == 0:  # start with what the first place needs, as after standing there
                for _ in completed([(stream, cut.pages)]):
                    pass
            elif number >= 60:
                walk.select_ms.append((middle - begin) * 1e3)
                walk.stream_ms.append((end - middle) * 1e3)
                walk.needed.append(update.statistics.needed)
                walk.wanted.append(len(cut))
    return walk


def _percentile(values: list[float] | list[int]) -> float:
    return float(np.percentile(values, 99))


def _reading(quick: bool) -> list[Measured]:
    """pages read from a JPEG pyramid, beside pyvips"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sample.tif"
        sample_image(path, 0.02 if quick else 0.1)
        with open_image(path) as image:
            base = image.pyramid.levels[0]
            inner = [(c, r) for r in range(base.rows - 1) for c in range(base.columns - 1)]
            region = pyvips.Region.new(pyvips.Image.new_from_file(str(path), access="random"))
            ours: list[float] = []
            theirs: list[float] = []
            for number, index in enumerate(np.random.default_rng(0).permutation(len(inner))[:400].tolist()):
                column, row = inner[index]
                calls = [
                    (ours, partial(image.read_page, (0, column, row), 0)),
                    (theirs, partial(region.fetch, column * PAGE, row * PAGE, PAGE, PAGE)),
                ]
                # Whoever reads second finds the file's bytes in the cache, so they take turns.
                for times, call in calls if number % 2 else calls[::-1]:
                    times.append(_timed(call))
        ours, theirs = ours[20:], theirs[20:]
        return [
            Measured("page read, limen, median", statistics.median(ours), "ms"),
            Measured("page read, pyvips, median", statistics.median(theirs), "ms"),
            Measured("page read, pyvips / limen", statistics.median(theirs) / statistics.median(ours), "ratio"),
        ]


def _drawing(quick: bool) -> list[Measured]:
    """panels drawn, every page resident"""
    with open_device() as device, tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sample.tif"
        sample_image(path, 0.02 if quick else 0.06)
        with open_image(path) as image:
            return [row for sampling in ("sharp", "fast") for row in _draw(device, image, sampling, 3 if quick else 9)]


def _draw(device: Device, image: Image, kind: Sampling, repeats: int) -> list[Measured]:
    display, placement = Display.preset("desktop"), OnSurface("cover")
    viewer = standing_viewer(display)
    rows = []
    with Renderer(device, display, [ImageLayer(image, placement, sampling=kind)]) as renderer:
        for policy in (Policy("full"), Policy()):
            frame = frame_of(renderer, [viewer], policy=policy)
            next(iter(renderer.pictures(frame)))
            drawn = [_timed(lambda: next(iter(renderer.pictures(frame)))) for _ in range(repeats)]  # noqa: B023
            rows.append(
                Measured(f"2560 x 1440 panel, {kind}, {policy.name}: draw + read", statistics.median(drawn), "ms")
            )
        if kind == "sharp":
            feedback = Feedback(device, view_of(display, image.pyramid, placement))
            tolerance = tolerance_of([viewer], Policy())
            passes = [_timed(lambda: (feedback.run(tolerance), feedback.read())) for _ in range(repeats)]
            rows.append(Measured("feedback pass of a panel at 1/8, with read back", statistics.median(passes), "ms"))
            feedback.destroy()
    return rows


def _ingest(_quick: bool) -> list[Measured]:
    """ingest of 0.25 gigapixels"""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "source.tif", Path(folder) / "target.tif"
        sample = sample_image(source, 0.25, aspect=1.6)
        report = ingest(source, target)
        return [
            Measured("sample image", sample.seconds / 0.25, "s/gigapixel"),
            Measured("ingest", report.seconds / 0.25, "s/gigapixel"),
            Measured("ingest, most anonymous memory", report.peak_rss_mib, "MiB"),
        ]


def _timed(call: Callable[[], object]) -> float:
    begin = time.perf_counter()
    call()
    return (time.perf_counter() - begin) * 1e3
