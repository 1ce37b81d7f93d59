"""What the image shader reads, as rows: built in double precision, handed over in single. No GPU here.

The dtypes are the structs of ``image.wgsl``, field by field; a test compares them.
"""

from __future__ import annotations

import colorsys
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import PAGE, Pyramid
from limen.data.store.resample import linear_of_srgb
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.geometry import Floats, Vec3
from limen.layers.common.page_detail import BLEND_LEVELS
from limen.layers.image.cut import PageCut
from limen.layers.image.lens_cells import first_pixel
from limen.layers.image.select import ImageOnDisplay, shape_kind
from limen.stream.pages import Drawable
from limen.viewing.lens import rows_of, sharpest_bend
from limen.viewing.placement import OnShape, PanelMaps
from limen.viewing.tolerance import Tolerance
from limen.vision.acuity import GAZE_PER_DEG

__all__ = [
    "FRAME",
    "LEVEL",
    "PAGE_QUAD",
    "PANEL",
    "eye_rows",
    "frame_row",
    "lens_rows",
    "level_colours",
    "level_rows",
    "log2_tau",
    "page_quads",
    "panel_rows",
]

Rows: TypeAlias = NDArray[np.void]
Index: TypeAlias = NDArray[np.int64]

FRAME = np.dtype(
    [
        ("quilt_px", "<f4", 2),
        ("image_px", "<f4", 2),
        ("eye", "<f4", 4),
        ("eyes", "<u4"),
        ("bias", "<i4"),
        ("top", "<i4"),
        ("shape", "<u4"),
        ("turn", "<f4"),
        ("divisor", "<u4"),
        ("jitter_px", "<u4", 2),
        ("layers_per_px", "<f4", 2),
        ("blend", "<f4"),
        ("per_deg", "<f4"),
        ("lenses", "<u4"),
        ("tables", "<u4"),
        ("cells", "<u4"),
        ("max_triangles", "<u4"),
    ]
)
PANEL = np.dtype(
    [
        ("origin_px", "<f4", 2),
        ("size_px", "<u4", 2),
        ("pitch_m", "<f4", 2),
        ("mip", "<i4"),
        ("outline_edges", "<u4"),
        ("scale", "<f4", 2),
        ("offset", "<f4", 2),
        ("first_page", "<i4", 2),
        ("true_mip", "<i4"),
        ("true_px", "<f4"),
        ("ray", "<f4", 4),
        ("ray_right", "<f4", 4),
        ("ray_down", "<f4", 4),
        ("turn", "<f4", 2),
        ("guard_px", "<f4"),
        ("padding", "<f4"),
        ("outline", "<f4", (8, 4)),
    ]
)
PAGE_QUAD = np.dtype(
    [
        ("rect_px", "<i4", 4),
        ("scale", "<f4", 2),
        ("offset", "<f4", 2),
        ("panel", "<u4"),
        ("level", "<u4"),
        ("slot", "<u4"),
        ("coarser", "<u4"),
        ("from_log2", "<f4"),
        ("until_log2", "<f4"),
        ("fade", "<f4"),
        ("over", "<f4"),
    ]
)
LEVEL = np.dtype([("columns", "<u4"), ("rows", "<u4"), ("first_page", "<u4"), ("padding", "<u4"), ("colour", "<f4", 4)])

_THROUGH_LENSES = 4
_ALWAYS = 1000.0
_RAINBOW_LEVELS = 8
_VIOLET_HUE = 0.78
_SATURATION = 0.78
_OVERLAY_SHARE = 0.35


def level_colours(count: int) -> NDArray[np.float64]:
    """sRGB colours (0 ... 1) of the overlay ``levels``: red is level 0, violet level 8 and above; shape (count, 3)."""
    hues = [min(level, _RAINBOW_LEVELS) / _RAINBOW_LEVELS * _VIOLET_HUE for level in range(count)]
    return np.array([colorsys.hsv_to_rgb(hue, _SATURATION, 1.0) for hue in hues])


def frame_row(
    view: ImageOnDisplay, quilt_px: tuple[int, int], tolerance: Tolerance, eye_m: Vec3 | None, **fields: int
) -> Rows:
    """One row of `FRAME`; ``fields`` are those that only some passes know."""
    row = np.zeros(1, FRAME)
    row["quilt_px"], row["image_px"] = quilt_px, view.pyramid.size_px
    row["eyes"], row["top"] = len(tolerance.tan_angle), len(view.pyramid.levels) - 1
    row["blend"], row["per_deg"] = BLEND_LEVELS, GAZE_PER_DEG
    placement = view.placement
    if isinstance(placement, OnShape):
        row["shape"], row["turn"] = 1 + shape_kind(placement), math.radians(placement.turn_deg)
        row["eye"][0, :3] = placement.local_eye(eye_m)
    elif placement.bends:
        row["shape"], row["lenses"] = _THROUGH_LENSES, len(placement.lenses)
    for name, value in fields.items():
        row[name] = value
    return row


def panel_rows(view: ImageOnDisplay, quilt: Quilt, eye_m: Vec3 | None, guard_px: float = 0.0) -> Rows:
    """Rows of `PANEL`, in the order of the quilt's panels, each drawn so many pixels beyond its outline."""
    chosen = list(quilt.panels)
    arrays = view.display.arrays
    rows = np.zeros(len(chosen), PANEL)
    maps = quilt.quilt_from_panel(view.display)
    rows["origin_px"], rows["turn"], rows["size_px"] = maps[:, :, 2], maps[:, :, 0], arrays.size_px[chosen]
    rows["guard_px"] = _guard_pixels(guard_px)
    rows["pitch_m"] = arrays.pitch_m[chosen]
    true_px = np.array([view.display.panels[index].true_px for index in chosen])
    rows["true_px"] = true_px
    for row, index in zip(rows, chosen, strict=True):
        edges = _outline_edges(view.display.panels[index], guard_px)
        row["outline_edges"] = len(edges)
        row["outline"][: len(edges), :3] = edges
    if isinstance(view.placement, OnShape):
        local = view.placement.local_from_room()
        corner = view.display.nudged_origin_m[chosen] @ local[:3, :3].T + local[:3, 3]
        rows["ray"][:, :3] = corner - view.placement.local_eye(eye_m)
        rows["ray_right"][:, :3] = (arrays.right * arrays.pitch_m[:, :1])[chosen] @ local[:3, :3].T
        rows["ray_down"][:, :3] = (arrays.down * arrays.pitch_m[:, 1:])[chosen] @ local[:3, :3].T
        return rows
    assert view.maps is not None
    offset = view.maps.offset[chosen]
    first = np.floor(offset / PAGE)
    rows["mip"], rows["scale"] = view.maps.mip_level[chosen], view.maps.scale[chosen]
    rows["true_mip"] = PanelMaps(rows["scale"] / true_px[:, None], offset).mip_level
    rows["first_page"], rows["offset"] = first, offset - first * PAGE
    return rows


def lens_rows(view: ImageOnDisplay, quilt: Quilt) -> tuple[NDArray[np.float32], int]:
    """The lenses of every panel of a quilt, three rows of four numbers each, then all tables; where these begin.

    Foci count from the panel's first page: near it, single precision suffices. Shape (3 * panels * lenses + ..., 4).
    """
    if isinstance(view.placement, OnShape) or not view.placement.lenses:
        return np.zeros((0, 4), np.float32), 0
    assert view.maps is not None
    of_lens, tables = rows_of(view.placement.lenses)
    if view.placement.tessellation.mode == "acuity":
        of_lens[:, 11] = [1 / max(sharpest_bend(lens), 1e-30) for lens in view.placement.lenses]
    chosen = list(quilt.panels)
    rows = np.tile(of_lens, (len(chosen), 1, 1))
    rows[:, :, :2] -= (np.floor(view.maps.offset[chosen] / PAGE) * PAGE)[:, None]
    whole = np.concatenate([rows.ravel(), tables, np.zeros(-len(tables) % 4)])
    return whole.reshape(-1, 4).astype(np.float32), rows.size


def eye_rows(view: ImageOnDisplay, quilt: Quilt, tolerance: Tolerance) -> NDArray[np.float32]:
    """Every eye in the frame of every panel of a quilt, two rows of four numbers each.

    Foot point and height (m), pixels per metre of distance; the gaze along right, down and normal, its slack (deg).
    Near the panel, single precision suffices; the room's origin may be far away. Shape (2 * panels * eyes, 4).
    """
    arrays, chosen = view.display.arrays, list(quilt.panels)
    right, down = arrays.right[chosen], arrays.down[chosen]
    axes = np.stack([right, down, np.cross(down, right)], axis=1)
    relative = tolerance.eyes_m[None] - arrays.origin_m[chosen][:, None]
    place = np.einsum("pei,pai->pea", relative, axes)
    gaze = np.einsum("ei,pai->pea", tolerance.gaze, axes)
    reach = tolerance.tan_angle[None] * view.sharpness[chosen, None] / arrays.pitch_m[chosen][:, :1]
    slack = np.broadcast_to(tolerance.slack_deg, reach.shape)
    rows = np.concatenate([place, reach[..., None], gaze, slack[..., None]], axis=2)
    return rows.reshape(-1, 4).astype(np.float32)


def level_rows(pyramid: Pyramid) -> Rows:
    rows = np.zeros(len(pyramid.levels), LEVEL)
    for row, level in zip(rows, pyramid.levels, strict=True):
        row["columns"], row["rows"], row["first_page"] = level.columns, level.rows, level.first_page
    rows["colour"][:, :3] = linear_of_srgb(level_colours(len(rows)))
    rows["colour"][:, 3] = _OVERLAY_SHARE
    return rows


def page_quads(view: ImageOnDisplay, quilt: Quilt, cut: PageCut, drawable: Drawable, guard_px: float = 0.0) -> Rows:
    """Rows of `PAGE_QUAD` for the (panel, page) pairs of a cut that fall into a quilt.

    A quad holds the pixels whose centres lie in the page, so neighbours share no pixel and leave none out,
    whatever the rasteriser rounds. The coarsest come first: finer ones are painted over them. Where a page reaches a
    panel's last pixel, so many more beyond it show its gutter.
    """
    assert view.maps is not None
    row_of = np.full(len(view.display.panels), -1)
    row_of[list(quilt.panels)] = np.arange(len(quilt.panels))
    here = (row_of[cut.pair_panel[drawable.asked]] >= 0) & (drawable.slot >= 0)
    pair = drawable.asked[here]
    panel, page = cut.pair_panel[pair], cut.pair_page[pair]
    level, column, row = view.pyramid.page_of(page)
    cell = np.stack([column, row], axis=1)
    scale, offset = view.maps.scale[panel], view.maps.offset[panel]
    span = PAGE * np.exp2(level)[:, None]
    size_px = view.display.arrays.size_px[panel]

    def pixels_before(texel: Floats) -> Index:
        return np.clip(first_pixel(texel, scale, offset), 0, size_px)

    coarser = drawable.coarser[here]
    shrink = np.exp2(-(level + coarser))[:, None]
    rows = np.zeros(len(panel), PAGE_QUAD)
    rows["rect_px"][:, :2] = pixels_before(cell * span)
    rows["rect_px"][:, 2:] = pixels_before(np.minimum((cell + 1) * span, np.array(view.pyramid.size_px)))
    rows["scale"], rows["offset"] = scale * shrink, offset * shrink - (cell >> coarser[:, None]) * PAGE
    rows["panel"], rows["level"] = row_of[panel], level
    rows["slot"], rows["coarser"] = drawable.slot[here], coarser
    rows["from_log2"], rows["until_log2"] = _ramps(view, cut, panel, page, level, cell)
    rows["fade"], rows["over"] = drawable.share[here], drawable.over[here]
    order = np.lexsort((-coarser, -level))
    rows, size_px = rows[order], size_px[order]
    seen = (rows["rect_px"][:, :2] < rows["rect_px"][:, 2:]).all(axis=1)
    rows, size_px = rows[seen], size_px[seen]
    if guard_px:
        rect, guard = rows["rect_px"], _guard_pixels(guard_px)
        rect[:, :2] -= np.where(rect[:, :2] == 0, guard, 0)
        rect[:, 2:] += np.where(rect[:, 2:] == size_px, guard, 0)
    return rows


def _guard_pixels(guard_px: float) -> int:
    """How many pixels beside a panel's grid have their middle inside of the guard, and not on its edge."""
    return max(math.ceil(guard_px - 0.5), 0)


def _ramps(
    view: ImageOnDisplay, cut: PageCut, panel: Index, page: Index, level: Index, cell: Index
) -> tuple[Floats, Floats]:
    """The tolerances (log2 of texels) between which pages are drawn: their own tau, and their parent's."""
    top = len(view.pyramid.levels) - 1
    inner, parent = level < top, page.copy()
    parent[inner] = view.pyramid.page_index(level[inner] + 1, cell[inner, 0] >> 1, cell[inner, 1] >> 1)
    assert view.maps is not None
    finest = np.clip(view.maps.mip_level[panel] + cut.bias, 0, top)
    begin = np.where(level <= finest, -_ALWAYS, log2_tau(cut.detail.tau[page]))
    return begin, np.where(inner, log2_tau(cut.detail.tau[parent]), _ALWAYS)


def log2_tau(tau: Floats) -> Floats:
    """For the shader: -1000 where nothing finer is ever drawn."""
    return np.where(tau > 0, np.log2(np.maximum(tau, 1e-300)), -_ALWAYS)


def _outline_edges(panel: Panel, guard_px: float) -> Floats:
    """Lines (a, b, c) with ``a x + b y + c >= 0`` inside the outline and its guard, pixels; shape (edges, 3)."""
    corners: list[tuple[float, float]] = list(panel.outline_px)
    if not corners:
        return np.empty((0, 3))
    following = corners[1:] + corners[:1]
    area = sum(x0 * y1 - x1 * y0 for (x0, y0), (x1, y1) in zip(corners, following, strict=True))
    turn = math.copysign(1.0, area)
    edges = []
    for (x0, y0), (x1, y1) in zip(corners, following, strict=True):
        a, b = turn * (y0 - y1), turn * (x1 - x0)
        edges.append((a, b, guard_px * math.hypot(a, b) - (a * x0 + b * y0)))
    return np.array(edges)
