"""Rows that the terrain's shaders read: built in double precision, handed over in single. No GPU here.

The dtypes are the structs of ``terrain.wgsl``, field by field; a test compares them. Places are counted from an origin
post near the eye: the difference of whole posts is exact, so that nothing jitters however large a terrain is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.data.pages import Pyramid
from limen.data.terrain.model import Nodes, Patch
from limen.geometry import Floats
from limen.layers.common.page_detail import KEPT
from limen.layers.common.panel_uniforms import ways_of_pixels
from limen.layers.terrain import look as terrain_look
from limen.layers.terrain.look import TerrainLook
from limen.viewing.projection import PanelProjections

__all__ = [
    "MOST_LEVELS",
    "SOURCE",
    "TERRAIN",
    "TERRAIN_VIEW",
    "VERTEX",
    "VIEW_STRIDE",
    "Origin",
    "in_strides",
    "nearest_first",
    "origin_near",
    "source_row",
    "terrain_row",
    "vertex_rows",
    "view_rows",
]

Rows: TypeAlias = NDArray[np.void]

MOST_LEVELS = 24
_RAMP = 20

VERTEX = np.dtype([("post", "<u4", 2), ("height_m", "<f4"), ("patch", "<u4")])
TERRAIN = np.dtype(
    [
        ("origin_post", "<i4", 2),
        ("origin_height_m", "<f4"),
        ("exaggeration", "<f4"),
        ("spacing_m", "<f4", 2),
        ("low_m", "<f4"),
        ("range_m", "<f4"),
        ("tint_from_m", "<f4"),
        ("tints_per_m", "<f4"),
        ("sea_level_m", "<f4"),
        ("contour_interval_m", "<f4"),
        ("sun", "<f4", 4),
        ("sea", "<f4", 4),
        ("ramp", "<f4", (_RAMP, 4)),
    ]
)
TERRAIN_VIEW = np.dtype(
    [
        ("x", "<f4", 4),
        ("y", "<f4", 4),
        ("w", "<f4", 4),
        ("edges", "<f4", (8, 4)),
        ("eye", "<f4", 4),
        ("way", "<f4", 4),
        ("way_right", "<f4", 4),
        ("way_down", "<f4", 4),
        ("corners", "<f4", (8, 4)),
        ("tint", "<f4", 4),
        ("near", "<f4"),
        ("tolerance_log2", "<f4"),
        ("padding", "<u4", 2),
    ]
)
SOURCE = np.dtype(
    [
        ("texel_from_post", "<f4", 4),
        ("offset", "<f4", 2),
        ("origin", "<i4", 2),
        ("size_px", "<i4", 2),
        ("per_texel", "<f4", 2),
        ("top", "<u4"),
        ("ready", "<u4"),
        ("padding", "<u4", 2),
        ("entries", "<u4", (MOST_LEVELS // 4, 4)),
    ]
)

VIEW_STRIDE = 512
"""Bytes from one panel's row to the next: WebGPU wants 256 or multiples between bindings of one buffer."""

_NO_SEA = -3.0e38
_COARSEST_LOG2 = 100.0
"""Of a panel on which anything may be drawn: its tolerance has no bound."""


class Origin(NamedTuple):
    """What places are counted from: a post and a height, as integers and a number that float32 holds."""

    post: NDArray[np.int64]  # (2,)
    height_m: float


def origin_near(eye_m: Floats, room_from_posts: Floats, size_posts: tuple[int, int]) -> Origin:
    """The post of the terrain nearest to an eye, and the eye's height."""
    column, row, height_m = (np.linalg.inv(room_from_posts) @ [*eye_m, 1.0])[:3]
    post = np.clip(np.rint([column, row]), 0, np.array(size_posts) - 1).astype(np.int64)
    return Origin(post, float(np.float32(height_m)))


def vertex_rows(patch: int, content: Patch) -> Rows:
    """Rows of `VERTEX`, one a vertex of a patch."""
    rows = np.zeros(len(content.posts), VERTEX)
    rows["post"], rows["height_m"], rows["patch"] = content.posts, content.heights_m, patch
    return rows


def nearest_first(
    nodes: Nodes, node: NDArray[np.int32], pair_panel: NDArray[np.int64], room_from_posts: Floats, eye_m: Floats
) -> NDArray[np.int64]:
    """An order of pairs of panels and nodes, panel by panel, in which what is near is drawn before what it hides."""
    rect, low_high = nodes.rect[node].astype(float), nodes.low_high_m[node].astype(float)
    middle = np.stack([rect[:, [0, 2]].mean(axis=1), rect[:, [1, 3]].mean(axis=1), low_high.mean(axis=1)], axis=1)
    away = np.linalg.norm(middle @ room_from_posts[:3, :3].T + room_from_posts[:3, 3] - eye_m, axis=1)
    return np.lexsort((away, pair_panel))


def view_rows(
    views: Sequence[PanelProjections],
    room_from_posts: Floats,
    origin: Origin,
    allowed_px: Floats,
    tints: NDArray[np.float32] | None,
    size_px: tuple[int, int],
) -> Rows:
    """Rows of `TERRAIN_VIEW`: all panels of the first eye, then all of the second.

    Parameters
    ----------
    allowed_px
        The largest invisible error of each panel, pixels, shape (N,).
    tints
        See `limen.layers.terrain.look.panel_tints`.
    size_px
        Width and height of what is drawn into: the quilt, for all eyes.
    """
    at = room_from_posts @ [*origin.post, origin.height_m, 1.0]
    rows = np.zeros((len(views), len(allowed_px)), TERRAIN_VIEW)
    for row, view in zip(rows, views, strict=True):
        way_from_post = np.column_stack([room_from_posts[:3, :3], at[:3] - view.eye_m])
        for axis, name in enumerate(("x", "y", "w")):
            row[name] = view.clip[:, axis] @ way_from_post
        row["edges"] = view.edges @ way_from_post
        _write_ways(row, view, np.asarray(np.linalg.inv(room_from_posts[:3, :3]), dtype=float), at[:3], size_px)
        row["near"] = view.near
        row["tolerance_log2"] = np.minimum(np.log2(np.maximum(allowed_px * KEPT, 1.0)), _COARSEST_LOG2)
        if tints is not None:
            row["tint"] = tints
    return rows.reshape(-1)


def in_strides(rows: Rows) -> NDArray[np.uint8]:
    """Rows of `TERRAIN_VIEW` as bytes, `VIEW_STRIDE` apart: shape (rows, VIEW_STRIDE)."""
    apart = np.zeros((len(rows), VIEW_STRIDE), np.uint8)
    apart[:, : rows.itemsize] = rows.view(np.uint8).reshape(len(rows), -1)
    return apart


def _write_ways(
    row: Rows, view: PanelProjections, posts_from_room: Floats, origin_m: Floats, size_px: tuple[int, int]
) -> None:
    """What leads back from a pixel and its depth, near / w, to a place: the eye + (way of the pixel) / depth."""
    facing = view.facing
    way_from_pixel = posts_from_room @ ways_of_pixels(view.clip[facing], size_px)
    row["eye"][:, :3] = posts_from_room @ (view.eye_m - origin_m)
    for axis, name in enumerate(("way_right", "way_down", "way")):
        row[name][facing, :3] = way_from_pixel[:, :, axis] * view.near[facing, None]
    last = np.minimum(np.arange(view.corners.shape[1]), view.corner_count[:, None] - 1)
    outline = np.take_along_axis(view.corners, last[..., None], axis=1)
    corners = np.einsum("naj,nkj->nka", view.clip, outline)[facing]
    row["corners"][facing, :, :2], row["corners"][facing, :, 3] = corners[..., :2] / corners[..., 2:], 1.0


def terrain_row(
    look: TerrainLook, origin: Origin, room_from_posts: Floats, spacing_m: tuple[float, float],
    low_high_m: tuple[float, float],
) -> Rows:  # fmt: skip
    """The one row of `TERRAIN`; how much heights are exaggerated is seen from the map to the room."""
    row = np.zeros(1, TERRAIN)
    row["origin_post"], row["origin_height_m"] = origin.post, origin.height_m
    across, _, up = np.linalg.norm(room_from_posts[:3, :3], axis=0)
    row["exaggeration"], row["spacing_m"] = up * spacing_m[0] / across, spacing_m
    low, high = low_high_m
    row["low_m"], row["range_m"] = low, high - low
    ramp = terrain_look.hypsometric_ramp()
    first, last = terrain_look.tint_range_m(look, low, high)
    row["tint_from_m"], row["tints_per_m"] = first, (len(ramp) - 1) / (last - first)
    row["sea_level_m"] = _NO_SEA if look.sea_level_m is None else look.sea_level_m
    row["contour_interval_m"] = terrain_look.contour_interval_m(look, low, high)
    row["sun"][:, :3], row["sun"][:, 3] = terrain_look.toward_sun(look), look.ambient
    row["sea"][:, :3] = terrain_look.sea_light()
    row["ramp"][:, : len(ramp), :3] = ramp
    row["ramp"][:, len(ramp) :, :3] = ramp[-1]
    return row


def source_row(
    pyramid: Pyramid,
    layer_px: tuple[int, int],
    first_entry: int,
    texel_from_post: Floats,
    origin: Origin,
    ready: bool,
) -> Rows:
    """One row of `SOURCE`: where texels of a page source are, for places counted from the origin post.

    Parameters
    ----------
    layer_px
        Size of a layer of its pool, in texels.
    first_entry
        Where the table of its pages begins.
    texel_from_post
        Affine, shape (2, 3); post (column, row) has its centre at that texel.
    ready
        Whether its coarsest page is there.
    """
    row = np.zeros(1, SOURCE)
    row["texel_from_post"] = texel_from_post[:, :2].reshape(-1)
    texel = texel_from_post[:, :2] @ origin.post + texel_from_post[:, 2]
    whole = np.floor(texel)
    row["origin"], row["offset"] = whole.astype(np.int64), texel - whole
    row["size_px"], row["top"], row["ready"] = pyramid.size_px, len(pyramid.levels) - 1, ready
    row["per_texel"] = 1.0 / np.array(layer_px)
    row["entries"].reshape(-1)[: len(pyramid.levels)] = [level.first_page + first_entry for level in pyramid.levels]
    return row
