"""Lenses drawn in triangles: how many, how far from where it belongs anything is drawn, and what a frame takes.

The modes are those of the paper's comparison (NGV: ``coarse``, PRE: ``uniform``, ADGV: ``acuity``), limen's ``error``,
and ``exact``, without triangles; at the paper's distances from the display, with one lens and with three. Two rows at
each distance are there to be compared with ``acuity``: the ``uniform`` cut and the ``error`` that are nowhere worse.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, sections 3.3 and 6.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from limen.data.pages import PAGE, Pyramid
from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.frame.renderer import Renderer
from limen.gpu.device import open_device
from limen.layers.image.draw.drawer import ImageDrawer
from limen.layers.image.draw.lens_mesh import Triangles
from limen.layers.image.layer import ImageLayer
from limen.layers.image.lens_cells import lens_cells
from limen.layers.image.select import ImageOnDisplay
from limen.study.bench.table import Row, Say, Table
from limen.study.bench.timing import timed, turns
from limen.study.blank_source import Blank
from limen.study.frames import frame_of
from limen.viewing.lens import Lens, shown_at
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import FrameState
from limen.viewing.tessellation import Tessellation
from limen.viewing.viewer import Viewer
from limen.vision.acuity import SNELLEN_ARCMIN, optimal_distance_m

__all__ = ["LENSES", "DrawnLenses", "LensPicture", "aims", "bench_lens", "drawn_lenses", "measured", "wall"]

_IMAGE_PX = (19_000, 9_500)
_PITCH_M = 0.00025
_FEET_M = 0.3048

LENSES: dict[int, tuple[Lens, ...]] = {
    1: (Lens((9_500.0, 4_750.0), 2_400.0, 4.0, 0.0, "gaussian"),),
    3: (
        Lens((9_500.0, 4_750.0), 2_400.0, 4.0, 0.0, "gaussian"),
        Lens((11_400.0, 5_200.0), 1_500.0, 4.0, 0.4, "cosine", "rectangular"),
        Lens((6_600.0, 4_300.0), 1_900.0, 3.0, 0.4, "cosine"),
    ),
}
"""The paper's Gaussian; and with it two with flat tops, one of which overlaps it."""

_SAMPLES = 60_000
_MOST_SEGMENTS = 512


_COLUMNS = {
    "lenses": "", "distance_m": ".2f", "mode": "", "segments": "", "like": "", "triangles": ",", "max_error_px": ".2f",
    "mean_error_px": ".3f", "frame_ms": ",.0f",
}  # fmt: skip
"""Triangles are only those of what lenses reach, in all modes; ``segments`` those along a side, of ``uniform``;
``like``: the mode whose largest error the row was to stay below; times are of drawing and reading the wall back."""


class DrawnLenses(NamedTuple):
    """What a frame's last quilt shows through lenses, and in which triangles."""

    view: ImageOnDisplay
    quilt: Quilt
    triangles: Triangles


class LensPicture(NamedTuple):
    """What was drawn through lenses once."""

    triangles: int
    max_error_px: float
    mean_error_px: float  # by area
    least_turn: float
    """The smallest ratio of a triangle's areas, in the image and on the display: below 0 it is folded over."""
    area_px: float


class _Way(NamedTuple):
    mode: str
    tessellation: Tessellation
    nobody: bool = False
    like: str = ""


def wall() -> Display:
    """Two by two panels of 1280 x 720."""
    width, height = 1280, 720
    panels = [
        Panel(
            f"{column}{row}", (width, height), (column * width * _PITCH_M, 1.0 - row * height * _PITCH_M, 0.0),
            (1, 0, 0), (0, -1, 0), (_PITCH_M, _PITCH_M),
        )
        for row in range(2)
        for column in range(2)
    ]  # fmt: skip
    return Display("wall", tuple(panels))


def drawn_lenses(renderer: Renderer, frame: FrameState) -> DrawnLenses:
    """Draw a frame of one image, of what is there of it, and read back the triangles of its last quilt."""
    chosen = renderer.choose(frame)
    renderer.draw(chosen, len(renderer.quilts) - 1)
    (piece,) = chosen.pieces
    drawer = piece.shown.drawer
    assert isinstance(drawer, ImageDrawer)
    return DrawnLenses(piece.cut.parts[-1].view, renderer.quilts[-1], drawer.lens_mesh.read())


def measured(drawn: DrawnLenses, samples: int = _SAMPLES) -> LensPicture:
    """How far from where it belongs a quilt's triangles draw what they show.

    Each place that a triangle shows at a pixel belongs where the lenses' inverse says (`limen.viewing.lens.shown_at`,
    in double precision). Asked are the middles of triangles and of their sides, and ``samples`` places at random, as
    many in each.
    """
    view, quilt, triangles = drawn
    assert view.maps is not None
    assert isinstance(view.placement, OnSurface)
    panel = np.array(quilt.panels)[triangles.panel]
    scale, offset = view.maps.scale[panel], view.maps.offset[panel]
    texel = triangles.texel + (np.floor(offset / PAGE) * PAGE)[:, None]
    places = np.array([[0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [1 / 3, 1 / 3, 1 / 3]])
    random = np.random.default_rng(7).dirichlet([1, 1, 1], max(1, samples // max(len(panel), 1)))
    worst, total = 0.0, 0.0
    areas = [np.linalg.det(np.diff(corners, axis=1)) / 2 for corners in (texel, triangles.pixel)]
    for place in (*places, *random):
        belongs = (shown_at(view.placement.lenses, place @ texel) - offset) / scale
        error_px = np.linalg.norm(belongs - place @ triangles.pixel, axis=1)
        worst = max(worst, float(error_px.max()))
        total += float((error_px * np.abs(areas[1])).sum())
    area_px = float(np.abs(areas[1]).sum())
    mean = total / (len(places) + len(random)) / area_px
    return LensPicture(len(panel), worst, mean, float((areas[0] / areas[1]).min()), area_px)


def bench_lens(quick: bool, say: Say) -> list[Table]:
    """The table of ``limen bench lens``."""
    display = wall()
    nearest = optimal_distance_m(_PITCH_M, SNELLEN_ARCMIN)
    rows: list[Row] = []
    with open_device() as device:
        say(f"two by two panels of 1280 x 720 and {_PITCH_M * 1e3:g} mm, on {device.adapter_name}")
        with Renderer(device, display, [ImageLayer(Blank(Pyramid.of(_IMAGE_PX)))]) as renderer:  # type: ignore[arg-type]
            for count, lenses in LENSES.items():
                for distance_m in (nearest,) if quick else (nearest, 9 * _FEET_M, 20 * _FEET_M):
                    say(f"{count} lenses at {distance_m:.2f} m" if count > 1 else f"one lens at {distance_m:.2f} m")
                    rows += _rows(renderer, lenses, distance_m, 3 if quick else 5)
    return [Table(_COLUMNS, rows, [*aims(rows), _everywhere(display, rows)])]


def _rows(renderer: Renderer, lenses: tuple[Lens, ...], distance_m: float, frames: int) -> Iterator[Row]:
    low, high = renderer.display.bounds_m
    across, up, _ = (low + high) / 2
    viewers, policy = [Viewer((float(across), float(up), distance_m))], Policy("acuity", SNELLEN_ARCMIN)

    def frame(way: _Way) -> FrameState:
        placement = OnSurface("cover", lenses=lenses, tessellation=way.tessellation)
        return frame_of(renderer, [] if way.nobody else viewers, policy=policy, placement=placement)

    def draw(way: _Way) -> float:
        """Draw a frame and read it back; how long that took, in ms, without choosing and waiting for pages."""
        reports, spent = timed(lambda: {id(report): report for _, _, report in renderer.pictures(frame(way))})
        rows = [row for report in reports.values() for row in report.layers]
        return spent.clock_ms - sum(row.select_ms + row.stream_ms for row in rows)

    def of(way: _Way) -> LensPicture:
        draw(way)
        return measured(drawn_lenses(renderer, frame(way)))

    plain = [_Way(mode, Tessellation(mode)) for mode in ("exact", "coarse", "uniform", "acuity", "error")]
    found = {way: of(way) for way in plain}
    acuity, uniform = found[plain[3]], found[plain[2]]
    segments = max(1, math.floor(16 * math.sqrt(uniform.max_error_px / acuity.max_error_px)))
    while True:
        equal = _Way("uniform", Tessellation("uniform", segments=segments, most=_MOST_SEGMENTS), like="acuity")
        found[equal] = of(equal)
        if found[equal].max_error_px <= acuity.max_error_px or segments >= _MOST_SEGMENTS:
            break
        del found[equal]
        segments += 1
    # For nobody, the error is the same everywhere.
    less = _Way("error", Tessellation("error", error_px=acuity.max_error_px), nobody=True, like="acuity")
    found[less] = of(less)
    times: dict[_Way, list[float]] = {way: [] for way in found}
    for _, way in turns(list(found), frames):
        draw(way)  # another tessellation compiles its shaders first
        times[way].append(draw(way))
    for way, drawn in found.items():
        seen = drawn if way.mode != "exact" else drawn._replace(triangles=0, max_error_px=0.0, mean_error_px=0.0)
        yield {
            "lenses": len(lenses), "distance_m": distance_m, "mode": way.mode,
            "segments": way.tessellation.segments if way.mode == "uniform" else None, "like": way.like,
            "triangles": seen.triangles, "max_error_px": seen.max_error_px, "mean_error_px": seen.mean_error_px,
            "frame_ms": statistics.median(times[way]),
        }  # fmt: skip


def aims(rows: Sequence[Row]) -> list[str]:
    """What was aimed at, beside what these rows say of it."""
    found = []
    for (lenses, distance_m), here in _by_place(rows).items():
        uniform, error, acuity = here["uniform", "acuity"], here["error", "acuity"], here["acuity", ""]
        found.append(
            f"{lenses} at {distance_m:.2f} m: error {here['error', '']['max_error_px']:.2f} px; where nothing is worse "
            f"than acuity's {acuity['max_error_px']:.2f} px, triangles of error / acuity "
            f"{error['triangles'] / acuity['triangles']:.2f} (aim: below 0.50), error / uniform "
            f"{error['triangles'] / uniform['triangles']:.3f} (aim: below 0.125), frame of uniform / acuity "
            f"{uniform['frame_ms'] / acuity['frame_ms']:.2f} (aim: 3.75)"
        )
    return found


def _everywhere(display: Display, rows: Sequence[Row]) -> str:
    """What the paper's PRE cuts, which does not know where lenses are."""
    maps = OnSurface("cover").panel_maps(display, _IMAGE_PX)
    everywhere = Lens((_IMAGE_PX[0] / 2, _IMAGE_PX[1] / 2), float(_IMAGE_PX[0]), 2.0)
    cells = len(lens_cells(display, maps, [everywhere]).panel)
    counts = [
        f"{here['error', 'acuity']['triangles'] / (2 * cells * here['uniform', 'acuity']['segments'] ** 2):.3f}"
        for here in _by_place(rows).values()
    ]
    return f"if uniform cut all of the wall, as the paper's PRE does, error / uniform: {', '.join(counts)}"


def _by_place(rows: Sequence[Row]) -> dict[tuple[int, float], dict[tuple[str, str], Row]]:
    places: dict[tuple[int, float], dict[tuple[str, str], Row]] = {}
    for row in rows:
        places.setdefault((row["lenses"], row["distance_m"]), {})[row["mode"], row["like"]] = row
    return places
