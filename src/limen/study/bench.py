"""The benchmark tables of the documentation: medians, and ratios to a peer or a plain way in the same run."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pyvips
from numpy.typing import NDArray

from limen.data import ingest, sample_image
from limen.data.image import Image, open_image
from limen.data.pages import GUTTER, PAGE, Pyramid
from limen.display.display import Display
from limen.draw.feedback import Feedback
from limen.frame import Renderer
from limen.gpu.device import Device, open_device
from limen.placement import OnSurface, one_to_one_size_px
from limen.select.image import View, select, view_of
from limen.stream import Stream
from limen.tolerance import Policy, Tolerance, tolerance_of
from limen.track.stand import standing_viewer
from limen.track.walk import session_named

__all__ = ["BENCHES", "Measured", "bench_image", "one_to_one_room", "walk_tolerances"]

Say = Callable[[str], None]


class Measured(msgspec.Struct, frozen=True):
    """One row of a benchmark's table."""

    what: str
    value: float
    unit: str


@dataclass(frozen=True)
class Blank:
    """Pages of a virtual image that cost nothing to read, so that only our own work is timed."""

    pyramid: Pyramid
    page = np.zeros((PAGE + 2 * GUTTER, PAGE + 2 * GUTTER, 4), dtype=np.uint8)

    def read_page(self, _page: int) -> NDArray[np.uint8]:
        return self.page


def one_to_one_room() -> View:
    """All 416 panels of the Reality Deck, a texel on every pixel."""
    deck = Display.preset("reality-deck")
    return view_of(deck, Pyramid.of(one_to_one_size_px(deck)), OnSurface("one-to-one"))


def walk_tolerances(seconds: float, policy: Policy, rate_hz: float = 30.0) -> Iterator[Tolerance]:
    """What the visitor of session A does not see, frame by frame."""
    session = session_named("A", Display.preset("reality-deck"))
    for frame in session.frames(rate_hz):
        if frame.time_s - session.start_s > seconds:
            return
        yield tolerance_of(frame.viewers, policy)


def bench_image(quick: bool, say: Say) -> list[Measured]:
    """Rows of ``limen bench image``."""
    rows = []
    for part in (_frames, _reading, _drawing) if quick else (_frames, _reading, _drawing, _ingest):
        say(part.__doc__ or "")
        rows += part(quick)
    return rows


BENCHES: dict[str, Callable[[bool, Say], list[Measured]]] = {"image": bench_image}


def _frames(quick: bool) -> list[Measured]:
    """frames of a walk through 416 panels, cache kept"""
    view = one_to_one_room()
    rows = []
    for policy in (Policy("acuity", 1.0), Policy()):
        select_ms, stream_ms, needed, pages = _walk(view, policy, 15 if quick else 145)
        both = [a + b for a, b in zip(select_ms, stream_ms, strict=True)]
        name = f"acuity {policy.acuity_arcmin:g}'"
        rows += [
            Measured(f"{name}: pages wanted, mean", float(np.mean(pages)), "pages/frame"),
            Measured(f"{name}: new pages, mean", float(np.mean(needed)), "pages/frame"),
            Measured(f"{name}: new pages, 99th percentile", float(np.percentile(needed, 99)), "pages/frame"),
            Measured(f"{name}: frames that need at most 64 uploads", float(np.mean(np.array(needed) <= 64)), "share"),
            Measured(f"{name}: select, median", statistics.median(select_ms), "ms"),
            Measured(f"{name}: stream, median", statistics.median(stream_ms), "ms"),
            Measured(f"{name}: select + stream, median", statistics.median(both), "ms"),
            Measured(f"{name}: select + stream, 99th percentile", float(np.percentile(both, 99)), "ms"),
        ]
    return rows


def _walk(view: View, policy: Policy, seconds: float) -> tuple[list[float], list[float], list[int], list[int]]:
    """Milliseconds of selecting and streaming, new pages and wanted pages of every frame after the first second."""
    times: tuple[list[float], list[float], list[int], list[int]] = ([], [], [], [])
    with Stream(Blank(view.pyramid), slots=16_384, cpu_pages=16_384, uploads_per_frame=64) as stream:
        for number, tolerance in enumerate(walk_tolerances(seconds, policy)):
            begin = time.perf_counter()
            cut = select(view, tolerance)
            middle = time.perf_counter()
            update = stream.update(cut.pages)
            stream.drawable(cut.pair_page)
            end = time.perf_counter()
            new = update.statistics.missing + len(update.uploads)
            while not stream.settled:  # what is new in the next frame is then due to the step alone
                stream.update(cut.pages, uploads=len(cut))
                stream.wait()
            if number >= 30:
                for values, value in zip(times, ((middle - begin) * 1e3, (end - middle) * 1e3, new, len(cut)), strict=True):
                    values.append(value)
    return times


def _reading(quick: bool) -> list[Measured]:
    """pages read from a JPEG pyramid, beside pyvips"""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sample.tif"
        sample_image(path, 0.02 if quick else 0.1)
        ours, theirs = [], []
        with open_image(path) as image:
            base = image.pyramid.levels[0]
            order = np.random.default_rng(0).permutation(base.columns * base.rows)[: 60 if quick else 400]
            peer = pyvips.Image.new_from_file(str(path), access="random")
            region = pyvips.Region.new(peer)
            for page in order.tolist():
                column, row = page % base.columns, page // base.columns
                ours.append(_timed(lambda: image.read_page((0, column, row), 0)))  # noqa: B023 - called at once
                x, y = column * PAGE, row * PAGE
                width, height = min(PAGE, image.size_px[0] - x), min(PAGE, image.size_px[1] - y)
                theirs.append(_timed(lambda: region.fetch(x, y, width, height)))  # noqa: B023
        return [
            Measured("page read, limen, median", statistics.median(ours), "ms"),
            Measured("page read, pyvips, median", statistics.median(theirs), "ms"),
            Measured("page read, pyvips / limen", statistics.median(theirs) / statistics.median(ours), "ratio"),
        ]


def _drawing(quick: bool) -> list[Measured]:
    """panels drawn, every page resident"""
    device = open_device()
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "sample.tif"
            sample_image(path, 0.02 if quick else 0.06)
            with open_image(path) as image:
                return [row for sampling in ("sharp", "fast") for row in _draw(device, image, sampling, 3 if quick else 9)]
    finally:
        device.destroy()


def _draw(device: Device, image: Image, sampling: str, repeats: int) -> list[Measured]:
    display = Display.preset("desktop")
    viewer = standing_viewer(display)
    rows = []
    kind = "sharp" if sampling == "sharp" else "fast"
    with Renderer(device, display, image, OnSurface("cover"), sampling=kind) as renderer:
        for policy in (Policy("full"), Policy()):
            next(iter(renderer.pictures([viewer], policy)))
            drawn = [_timed(lambda: next(iter(renderer.pictures([viewer], policy)))) for _ in range(repeats)]  # noqa: B023
            rows.append(Measured(f"2560 x 1440 panel, {kind}, {policy.name}: draw + read", statistics.median(drawn), "ms"))
        if kind == "sharp":
            feedback = Feedback(device, renderer.view)
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
