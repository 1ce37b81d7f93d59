"""The main job, told as a story: a visitor walks through a room of panels, and only what she can see is moved."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture

from limen.data import ingest, sample_image
from limen.data.image.file import Image
from limen.data.opening import open_picture
from limen.data.store.atomic import write_bytes
from limen.display.display import Display
from limen.errors import NeedsIngestError
from limen.frame.renderer import Renderer
from limen.geometry import Floats
from limen.gpu.device import Device, open_device
from limen.layers.image.layer import ImageLayer
from limen.layers.image.select import levels_at, select, view_of
from limen.pictures.files import write_picture
from limen.pictures.room import draw_room, draw_surface
from limen.study.frames import frame_of
from limen.study.moments import Moment, level_tints, telling_moments
from limen.study.plots import traffic_picture
from limen.study.report import Crop, Scene, Story, write_report
from limen.study.traffic import (
    PAPER_PAGE_BYTES,
    Report,
    count_traffic,
    detail_of,
    one_to_one_view,
    page_bytes_of,
    policies_of,
)
from limen.system import cache_folder, place_in_cache
from limen.track.session import Session
from limen.track.walk import session_named
from limen.units import arcmin_to_rad
from limen.viewing.placement import Fit, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of

__all__ = ["DemoResult", "Watch", "run_demo"]

Rgb = NDArray[np.uint8]

SAMPLE_PX, SAMPLE_SEED = (92_160, 7_200), 1
"""The sample is 0.66 gigapixels: a texel on every pixel of five rows of the left, front and right wall."""

_PREVIEW_SCALE = 1 / 20
_TINT_CELLS = (48, 27)
_FILM_FRAMES, _FILM_SIZE, _FILM_MS = 48, (960, 480), 120
_CROP_PX = (560, 315)
_PAPERS_HZ = 10.0  # how often its three walks are looked at


class Watch(Protocol):
    """How a person follows: ``with watch("drawing", total) as step: step(1)``."""

    def __call__(self, what: str, total: float | None = None) -> AbstractContextManager[Callable[[float], None]]: ...


@dataclass(frozen=True)
class DemoResult:
    """What a demo left behind."""

    report: Path
    pictures: list[Path]
    traffic: list[Report]
    seconds: float


def run_demo(content: Path | None, out: Path, watch: Watch, placement: OnSurface | None = None) -> DemoResult:
    """Walk a visitor through the Reality Deck and write ``report.html`` and its pictures into a folder.

    Parameters
    ----------
    content
        An image; ``None`` makes (once) a sample image.
    out
        The folder for the report and the pictures.
    watch
        Told what is going on.
    placement
        How the image lies on the room's walls: by default the sample one-to-one, other images fitted inside.

    Raises
    ------
    LimenError
        If the content cannot be read, there is no adapter, or the folder cannot be written to.
    """
    begin = time.perf_counter()
    display = Display.preset("reality-deck")
    session = session_named("A", display)
    with _opened(content, watch) as image, open_device() as device:
        fit: Fit = "one-to-one" if content is None else "contain"
        tour = _Tour(device, display, image, placement or OnSurface(fit), session, out)
        scenes = tour.scenes(watch)
        crops = tour.crops(scenes[0], watch)
        film = tour.film(watch)
        reports = [tour.traffic(watch), _papers_traffic(watch)]
        plots = [traffic_picture(report, "svg") for report in reports]
        story = Story(
            display=display, image=image, session=session, placement=tour.placement, adapter=device.adapter_name,
            scenes=scenes, crops=crops, film=film, reports=reports, plots=plots, seconds=time.perf_counter() - begin,
        )  # fmt: skip
        report = write_report(out / "report.html", story)
    extras = {"walk.webp": film, "traffic.svg": plots[0], "traffic-one-to-one.svg": plots[1]}
    pictures = [*tour.written, *(write_bytes(out / name, content) for name, content in extras.items())]
    return DemoResult(report, pictures, reports, time.perf_counter() - begin)


class _Tour:
    """Pictures of one image in one room at moments of one walk."""

    def __init__(
        self, device: Device, display: Display, image: Image, placement: OnSurface, session: Session, out: Path
    ) -> None:
        self.display, self.image, self.placement, self.session, self.out = display, image, placement, session, out
        self.view = view_of(display, image.pyramid, placement)
        self.policy = Policy()
        self.written: list[Path] = []
        self._device = device
        full = select(self.view, tolerance_of((), Policy("full")))
        self.shown = np.zeros(len(display.panels), dtype=bool)
        self.shown[full.pair_panel] = True
        self.full_pages = len(full)
        self.moments = telling_moments(display, self.shown, session)
        self._previews: dict[str, Rgb] = {}

    def scenes(self, watch: Watch) -> list[Scene]:
        """The room, the unrolled wall and the levels at every moment."""
        small = self.display.scaled(_PREVIEW_SCALE)
        with Renderer(self._device, small, [ImageLayer(self.image, self.placement, self.policy)]) as renderer:
            return [self._scene(number, moment, renderer, watch) for number, moment in enumerate(self.moments, 1)]

    def _scene(self, number: int, moment: Moment, renderer: Renderer, watch: Watch) -> Scene:
        previews = self._draw_previews(moment, renderer, watch)
        tolerance = tolerance_of(moment.viewers, self.policy)
        tints, counts = level_tints(self.view, tolerance, _TINT_CELLS)
        tinted = {name: _tinted(previews[name], tint) for name, tint in tints.items()}
        path_m = np.array([frame.viewers[0].position_m for frame in self.session.frames(5.0)])
        pictures = (
            draw_room(self.display, pictures=previews, viewers=moment.viewers, path_m=path_m, size_px=(1400, 720)),
            draw_surface(self.display, previews, 2600),
            draw_surface(self.display, tinted, 2600),
        )
        names = ("room", "wall", "levels")
        for name, picture in zip(names, pictures, strict=True):
            self.written.append(write_picture(self.out / f"{number}-{name}.jpg", picture))
        cut = select(self.view, tolerance)
        return Scene(
            moment, *pictures, level_share=counts / max(counts.sum(), 1), pages=len(cut), full_pages=self.full_pages
        )

    def crops(self, scene: Scene, watch: Watch) -> list[Crop]:
        """A near and a far panel pixel by pixel: all detail, what was drawn, and both as the eye resolves them."""
        viewer = scene.moment.viewers[0]
        distance = np.array([np.linalg.norm(panel.centre_m - viewer.position_m) for panel in self.display.panels])
        detail = self._detail()
        lively = self.shown & (detail >= np.median(detail[self.shown]))
        near = int(np.where(lively & (distance < distance[self.shown].min() + 1.2), detail, -1).argmax())
        far = int(np.where(lively, distance, -1).argmax())
        crops = []
        with watch("drawing panels pixel by pixel", 2) as step:
            for index in dict.fromkeys((near, far)):
                crops.append(self._crop(index, scene, float(distance[index])))
                step(1)
        return crops

    def film(self, watch: Watch) -> bytes:
        """The walk as an animated picture (WebP): colours tell where detail is."""
        frames = []
        times_s = np.linspace(0, min(self.session.duration_s, 60.0), _FILM_FRAMES) + self.session.start_s
        with watch("filming the walk", len(times_s)) as step:
            for time_s in times_s:
                viewers = self.session.at(float(time_s))
                tints, _ = level_tints(self.view, tolerance_of(viewers, self.policy), (16, 9))
                tinted = {name: _tinted(self._previews[name], tint) for name, tint in tints.items()}
                frames.append(
                    Picture.fromarray(draw_room(self.display, pictures=tinted, viewers=viewers, size_px=_FILM_SIZE))
                )
                step(1)
        file = io.BytesIO()
        frames[0].save(
            file, "WEBP", save_all=True, append_images=frames[1:], duration=_FILM_MS, loop=0, quality=72, method=2
        )
        return file.getvalue()

    def traffic(self, watch: Watch) -> Report:
        """What this walk over this image would move, frame by frame."""
        policies = policies_of(["full", "acuity"], ["1", "0.64", "0.5"])
        policies += policies_of(["acuity+gaze", "contrast+gaze"], ["0.64"])
        page_bytes = page_bytes_of(self.image)
        with watch("looking for contrast", 1.0) as step:
            detail = detail_of(self.image, self.display, progress=_fraction(step))
        with watch("counting pages of the walk", len(self.session.times_s(30.0))) as step:
            counts = count_traffic(self.view, self.session, policies, detail=detail, advance=lambda: step(1))
        return Report(self.image.path.name, self.view, 30.0, page_bytes, False, (counts,))

    def _draw_previews(self, moment: Moment, renderer: Renderer, watch: Watch) -> dict[str, Rgb]:
        pictures: dict[str, Rgb] = {}
        count = len(self.display.panels)
        with watch(f"drawing {count} panels: {moment.title.lower()}", count) as step:
            for name, picture, _ in renderer.pictures(frame_of(renderer, moment.viewers)):
                pictures[name] = picture[..., :3].copy()
                step(1)
        self._previews = pictures
        return pictures

    def _detail(self) -> Floats:
        """How much there is to see on each panel: the spread of its preview's brightness."""
        return np.array([float(self._previews[panel.name].std()) for panel in self.display.panels])

    def _crop(self, index: int, scene: Scene, distance_m: float) -> Crop:
        panel = self.display.panels[index]
        pictures: list[tuple[Rgb, tuple[int, int]]] = []
        layer = ImageLayer(self.image, self.placement)
        with Renderer(self._device, self.display.part([index]), [layer], whole=self.display) as renderer:
            for policy in (Policy("full"), self.policy):
                frame = frame_of(renderer, scene.moment.viewers, policy=policy)
                _, picture, _ = next(iter(renderer.pictures(frame)))
                pictures.append(_busiest(picture[..., :3], _CROP_PX, pictures[0][1] if pictures else None))
        full, drawn = pictures[0][0], pictures[1][0]
        resolved_px = distance_m * np.tan(arcmin_to_rad(self.policy.acuity_arcmin)) / panel.pitch_m[0]
        tolerance = tolerance_of(scene.moment.viewers, self.policy)
        middle = np.array(pictures[0][1]) + np.array(_CROP_PX) / 2
        level = int(levels_at(self.view, tolerance, index, middle))
        seen = [_as_resolved(picture, float(resolved_px)) for picture in (full, drawn)]
        return Crop(panel.name, distance_m, level, float(resolved_px), full, drawn, seen[0], seen[1])


def _papers_traffic(watch: Watch) -> Report:
    """The test of Papadopoulos, Kaufman 2013: three walls, three sessions, a texel on every pixel."""
    display = Display.preset("reality-deck")
    walls = display.select(["front/*", "left/*", "right/*"])
    view = one_to_one_view(walls)
    policies = policies_of(["full", "acuity"], ["1", "0.64", "0.5"]) + policies_of(["acuity+gaze"], ["0.64"])
    sessions = [session_named(name, display) for name in "ABC"]
    frames = sum(len(walk.times_s(_PAPERS_HZ)) for walk in sessions)
    with watch("counting pages of three walks", frames) as step:
        counts = tuple(
            count_traffic(view, walk, policies, rate_hz=_PAPERS_HZ, advance=lambda: step(1)) for walk in sessions
        )
    return Report("one-to-one", view, _PAPERS_HZ, PAPER_PAGE_BYTES, False, counts)


@contextmanager
def _opened(content: Path | None, watch: Watch) -> Iterator[Image]:
    """The content, or the sample; what has no pyramid and is large gets one, once, in the cache."""
    with _open_ready(_sample(watch) if content is None else content, watch) as image:
        yield image


def _sample(watch: Watch) -> Path:
    width, height = SAMPLE_PX
    path = cache_folder() / f"sample-{width}x{height}-seed{SAMPLE_SEED}.tif"
    if not path.exists():
        gigapixels = width * height / 1e9
        with watch(f"making a sample image of {gigapixels:.2f} gigapixels (once)", 1.0) as step:
            sample_image(path, seed=SAMPLE_SEED, aspect=width / height, size=width, progress=_fraction(step))
    return path


def _open_ready(content: Path, watch: Watch) -> Image:
    try:
        return open_picture(content)
    except NeedsIngestError:
        state = content.stat()
        path = place_in_cache(content.stem, f"{content.resolve()} {state.st_size} {state.st_mtime_ns}", ".tif")
        if not path.exists():
            with watch(f"making a pyramid of {content.name} (once)", 1.0) as step:
                ingest(content, path, progress=_fraction(step))
        return open_picture(path)


def _fraction(step: Callable[[float], None]) -> Callable[[float], None]:
    """Turns 'this much is done' into steps."""
    done = 0.0

    def progress(fraction: float) -> None:
        nonlocal done
        step(fraction - done)
        done = fraction

    return progress


def _tinted(picture: Rgb, tint: Rgb) -> Rgb:
    """The picture in grey, coloured by the level."""
    large = np.asarray(Picture.fromarray(tint).resize((picture.shape[1], picture.shape[0]), Picture.Resampling.NEAREST))
    grey = picture.astype(float).mean(axis=2, keepdims=True) / 255
    return np.asarray(large * (0.4 + 0.6 * grey), dtype=np.uint8)


def _busiest(picture: Rgb, size_px: tuple[int, int], at: tuple[int, int] | None) -> tuple[Rgb, tuple[int, int]]:
    """The part of a picture with the most detail (or the part ``at``), and where it is."""
    width, height = size_px
    if at is None:
        places = [
            (x, y)
            for y in range(0, max(1, picture.shape[0] - height + 1), height // 2)
            for x in range(0, max(1, picture.shape[1] - width + 1), width // 2)
        ]
        at = max(
            places,
            key=lambda place: float(np.abs(np.diff(_part(picture, place, size_px).astype(float), axis=1)).mean()),
        )
    return _part(picture, at, size_px).copy(), at


def _part(picture: Rgb, at: tuple[int, int], size_px: tuple[int, int]) -> Rgb:
    return picture[at[1] : at[1] + size_px[1], at[0] : at[0] + size_px[0]]


def _as_resolved(picture: Rgb, resolved_px: float) -> Rgb:
    """What is left of a picture when ``resolved_px`` pixels merge into one sample of the eye; in linear light."""
    if resolved_px <= 1:
        return picture
    height, width = picture.shape[:2]
    small = (max(1, round(width / resolved_px)), max(1, round(height / resolved_px)))
    linear = (picture / 255.0) ** 2.2
    channels = []
    for channel in np.moveaxis(linear, 2, 0):
        plane = Picture.fromarray(channel.astype(np.float32))
        again = plane.resize(small, Picture.Resampling.LANCZOS).resize((width, height), Picture.Resampling.BICUBIC)
        channels.append(np.asarray(again))
    return np.asarray(np.clip(np.stack(channels, axis=2), 0, 1) ** (1 / 2.2) * 255 + 0.5, dtype=np.uint8)
