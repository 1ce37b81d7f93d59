"""Pages of an image: selected, streamed, read, drawn and made; beside pyvips, which reads the same files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

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
from limen.study.bench.table import FIGURES, Row, Say, Table, figure
from limen.study.bench.timing import Spent, median_of, timed, turns
from limen.study.blank_source import Blank
from limen.study.frames import frame_of
from limen.track.walk import session_named
from limen.viewing.placement import OnSurface, one_to_one_size_px
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer

__all__ = ["Walk", "bench_image", "blank_stream", "measure_walk", "one_to_one_room", "walk_viewers"]

_KINDS: tuple[Sampling, ...] = ("sharp", "fast")
_SLOTS = 16_384
_WARM_READS = 20


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


def bench_image(quick: bool, say: Say) -> list[Table]:
    """The table of ``limen bench image``."""
    rows: list[Row] = []
    for part in (_frames, _reading, _drawing) if quick else (_frames, _reading, _drawing, _ingest):
        say(part.__doc__ or "")
        rows += part(quick)
    return [Table(FIGURES, rows)]


def _frames(quick: bool) -> Iterator[Row]:
    """frames of a walk through 416 panels at 60 Hz, cache kept"""
    view = one_to_one_room()
    for policy in (Policy("acuity", 1.0), Policy()):
        for ahead_s in (0.0, LOOKAHEAD_S):
            walk = measure_walk(view, policy, 12 if quick else 145, ahead_s)
            needed, select_ms, stream_ms = (np.array(part) for part in (walk.needed, walk.select_ms, walk.stream_ms))
            name = f"acuity {policy.acuity_arcmin:g}'" + (f", {ahead_s:g} s ahead" if ahead_s else "")
            for what, value, unit in (
                ("pages wanted, mean", np.mean(walk.wanted), "pages/frame"),
                ("uploads needed at once, mean", np.mean(needed), "pages/frame"),
                ("uploads needed at once, 99th percentile", np.percentile(needed, 99), "pages/frame"),
                ("frames that need at most 64", np.mean(needed <= 64), "share"),
                ("select, median", np.median(select_ms), "ms"),
                ("stream, median", np.median(stream_ms), "ms"),
                ("select + stream, median", np.median(select_ms + stream_ms), "ms"),
                ("select + stream, 99th percentile", np.percentile(select_ms + stream_ms, 99), "ms"),
            ):
                yield figure(f"{name}: {what}", float(value), unit)


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

        def chosen() -> tuple[Any, Any]:
            cut = select(view, tolerance_of(viewers, policy))
            return cut, select_ahead(view, policy, viewers, earlier, ahead_s) if ahead_s else None

        def streamed() -> Any:
            update = stream.update(cut.pages, soon=soon)
            stream.touch(drawable_pages(view.pyramid, stream.resident, cut.pair_page)[1])
            return update

        for number, viewers in enumerate(walk_viewers(seconds)):
            (cut, soon), selecting = timed(chosen)
            update, streaming = timed(streamed)
            earlier = viewers
            while not stream.idle:
                stream.wait(0.01)
            if number == 0:  # start with what the first place needs, as after standing there
                for _ in completed([(stream, cut.pages)]):
                    pass
            elif number >= 60:
                walk.select_ms.append(selecting.clock_ms)
                walk.stream_ms.append(streaming.clock_ms)
                walk.needed.append(update.statistics.needed)
                walk.wanted.append(len(cut))
    return walk


@contextmanager
def _sample(gigapixels: float) -> Iterator[tuple[Path, Image]]:
    """A sample image that is gone afterwards: its path, and it opened."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sample.tif"
        sample_image(path, gigapixels)
        with open_image(path) as image:
            yield path, image


def _reading(quick: bool) -> Iterator[Row]:
    """pages read from a JPEG pyramid, beside pyvips"""
    with _sample(0.02 if quick else 0.1) as (path, image):
        base = image.pyramid.levels[0]
        inner = [(c, r) for r in range(base.rows - 1) for c in range(base.columns - 1)]
        region = pyvips.Region.new(pyvips.Image.new_from_file(str(path), access="random"))
        order = np.random.default_rng(0).permutation(len(inner))[:400].tolist()

        def read(reader: str, place: tuple[int, int]) -> object:
            column, row = place
            if reader == "limen":
                return image.read_page((0, column, row), 0)
            return region.fetch(column * PAGE, row * PAGE, PAGE, PAGE)

        spent: dict[str, list[Spent]] = {"pyvips": [], "limen": []}
        for number, reader in turns(list(spent), len(order)):
            spent[reader].append(timed(lambda: read(reader, inner[order[number]]))[1])  # noqa: B023
    theirs, ours = (median_of(each[_WARM_READS:]).clock_ms for each in spent.values())
    yield figure("page read, limen, median", ours, "ms")
    yield figure("page read, pyvips, median", theirs, "ms")
    yield figure("page read, pyvips / limen", theirs / ours, "ratio")


def _drawing(quick: bool) -> Iterator[Row]:
    """panels drawn, every page resident"""
    with open_device() as device, _sample(0.02 if quick else 0.06) as (_, image):
        for sampling in _KINDS:
            yield from _draw(device, image, sampling, 3 if quick else 9)


def _draw(device: Device, image: Image, kind: Sampling, repeats: int) -> Iterator[Row]:
    display, placement = Display.preset("desktop"), OnSurface("cover")
    viewer = standing_viewer(display)
    with Renderer(device, display, [ImageLayer(image, placement, sampling=kind)]) as renderer:
        for policy in (Policy("full"), Policy()):
            frame = frame_of(renderer, [viewer], policy=policy)
            drawn = [timed(lambda: next(renderer.pictures(frame)))[1] for _ in range(1 + repeats)]  # noqa: B023
            what = f"2560 x 1440 panel, {kind}, {policy.name}: draw + read"
            yield figure(what, median_of(drawn[1:]).clock_ms, "ms")
    if kind == "sharp":
        feedback = Feedback(device, view_of(display, image.pyramid, placement))
        tolerance = tolerance_of([viewer], Policy())
        passes = [timed(lambda: (feedback.run(tolerance), feedback.read()))[1] for _ in range(repeats)]
        feedback.destroy()
        yield figure("feedback pass of a panel at 1/8, with read back", median_of(passes).clock_ms, "ms")


def _ingest(_quick: bool) -> Iterator[Row]:
    """ingest of 0.25 gigapixels"""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "source.tif", Path(folder) / "target.tif"
        sample = sample_image(source, 0.25, aspect=1.6)
        report = ingest(source, target)
    yield figure("sample image", sample.seconds / 0.25, "s/gigapixel")
    yield figure("ingest", report.seconds / 0.25, "s/gigapixel")
    yield figure("ingest, most anonymous memory", report.peak_rss_mib, "MiB")
