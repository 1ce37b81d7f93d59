"""Pictures of a whole installation: the room seen from outside, and the surface unrolled.

They are drawn on the CPU from what each panel shows, so a machine without a graphics driver can draw a
display, too. Colours are blended in sRGB: these are illustrations, not measurements.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Picture
from PIL import ImageDraw, ImageFont

from limen.display.display import Display
from limen.display.panel import Panel
from limen.geometry import Floats
from limen.viewing.camera import Camera
from limen.viewing.viewer import Viewer

__all__ = ["draw_room", "draw_surface"]

Rgb = NDArray[np.uint8]

_BACKGROUND = (24, 26, 30)
_FLOOR = (38, 41, 47)
_FLOOR_LINE = (58, 62, 70)
_UNLIT = (52, 64, 82)
_BACK = (44, 42, 40)
_EDGE = (16, 18, 22)
_GHOST = (120, 128, 140)
_PERSON = (255, 176, 46)
_HEAD = (255, 214, 150)
_WEDGE = (112, 86, 40)
_PATH = (150, 112, 48)
_TEXT = (214, 218, 224)
_SUPERSAMPLE = 2


def draw_room(
    display: Display,
    *,
    pictures: Mapping[str, Rgb] | None = None,
    viewers: Iterable[Viewer] = (),
    path_m: Floats | None = None,
    size_px: tuple[int, int] = (1600, 900),
    camera: Camera | None = None,
) -> Rgb:
    """The room seen from outside and above; walls that face away are drawn as outlines.

    Parameters
    ----------
    display
        The installation.
    pictures
        What each panel shows, by name: uint8 (h, w, 3 or 4) of any size. Panels without one are drawn unlit.
    viewers
        People to draw.
    path_m
        A track on the floor, shape (N, 3).
    size_px
        Width and height of the picture.
    camera
        ``None`` finds a place from which all panels are seen.

    Returns
    -------
    uint8 (height, width, 3), sRGB
    """
    large = (size_px[0] * _SUPERSAMPLE, size_px[1] * _SUPERSAMPLE)
    people = list(viewers)
    camera = camera.sized(large) if camera else _camera_for(display, people, large)
    canvas = Picture.new("RGB", large, _BACKGROUND)
    _draw_floor(ImageDraw.Draw(canvas), display, camera, large, people)
    if path_m is not None and len(path_m) > 1:
        floor = np.asarray(path_m, dtype=float) * [1, 0, 1]
        _line(ImageDraw.Draw(canvas), camera, large, floor, _PATH, _SUPERSAMPLE)
    eye = np.array(camera.eye_m)
    # A room is looked into through its walls; of anything else, backs are seen as they are.
    room = not _from_outside(display)
    walls = {name: panels for name, panels in display.grids().items() if room and _is_flat(panels)}
    shown = [p for p in display.panels if p.grid_name not in walls or np.dot(eye - p.centre_m, p.normal) > 0]
    canvas = Picture.fromarray(_draw_panels(np.asarray(canvas).copy(), shown, pictures or {}, camera, large))
    drawing = ImageDraw.Draw(canvas)
    for name, panels in display.grids().items():
        away = [panel for panel in panels if np.dot(eye - panel.centre_m, panel.normal) <= 0]
        if away and name in walls:
            _draw_ghost(drawing, away, camera, large)
        if name in walls or len(away) < len(panels):  # the name of a hidden side would lie on another
            _label(drawing, name, panels, camera, large)
    for viewer in people:
        _draw_person(drawing, viewer, camera, large)
    return np.asarray(canvas.resize(size_px, Picture.Resampling.LANCZOS))


def draw_surface(display: Display, pictures: Mapping[str, Rgb], width_px: int = 2000) -> Rgb:
    """The unrolled surface with what each panel shows; panels without a picture are unlit.

    Returns
    -------
    uint8 (height, width_px, 3), sRGB; the height follows from the surface.
    """
    surface = display.surface
    density = width_px / surface.width
    height_px = max(1, round(surface.height * density))
    canvas = Picture.new("RGB", (width_px, height_px), _BACKGROUND)
    for panel in display.panels:
        x0, y0 = (
            (value - edge) * density for value, edge in zip(panel.surface_m, (surface.left, surface.top), strict=True)
        )
        x1, y1 = x0 + panel.size_m[0] * density, y0 + panel.size_m[1] * density
        # The edges of neighbours differ in the last bit, so they must not be rounded where that decides.
        left, top, right, bottom = (math.floor(edge + 0.5 + 1e-6) for edge in (x0, y0, x1, y1))
        box = (left, top, max(left + 1, right), max(top + 1, bottom))
        size = (box[2] - box[0], box[3] - box[1])
        if panel.name in pictures:
            tile = Picture.fromarray(np.ascontiguousarray(pictures[panel.name][..., :3]))
            canvas.paste(
                tile.resize(size, Picture.Resampling.BOX if tile.width >= size[0] else Picture.Resampling.BICUBIC), box
            )
        else:
            canvas.paste(_UNLIT, box)
    return np.asarray(canvas)


# ---------------------------------------------------------------------- where to stand


def _camera_for(display: Display, viewers: Sequence[Viewer], size_px: tuple[int, int]) -> Camera:
    """In front of a wall, above a room, beside an object."""
    mean = display.facing
    if np.linalg.norm(mean) > 0.5 and np.hypot(mean[0], mean[2]) > 0.1:
        azimuth = math.atan2(mean[0], mean[2]) + math.radians(28)
        elevation = max(math.radians(16), math.asin(min(mean[1] / np.linalg.norm(mean), 0.6)))
    elif _from_outside(display):
        azimuth, elevation = math.radians(28), math.radians(18)
    else:
        azimuth, elevation = math.radians(9), math.radians(33)
    toward = np.array(
        [math.sin(azimuth) * math.cos(elevation), math.sin(elevation), math.cos(azimuth) * math.cos(elevation)]
    )
    points = [panel.outline_m for panel in display.panels] + [np.array([viewer.position_m]) for viewer in viewers]
    return Camera.framing(np.concatenate(points), toward, size_px)


def _from_outside(display: Display) -> bool:
    """Whether panels face away from the middle of the display, on the whole: an object, not a room."""
    middles = np.array([panel.outline_m.mean(axis=0) for panel in display.panels])
    areas = np.array([math.prod(panel.size_m) for panel in display.panels])
    normals = np.array([panel.normal for panel in display.panels])
    outward = ((middles - display.bounds_m.mean(axis=0)) * normals).sum(axis=1)
    return float(outward @ areas) > 0.01 * float(areas.sum()) * float(np.ptp(display.bounds_m, axis=0).max())


def _is_flat(panels: Sequence[Panel]) -> bool:
    """Whether all panels face the same way, as those of a wall do."""
    normals = np.array([panel.normal for panel in panels])
    return bool((normals @ normals[0] > 1 - 1e-9).all())


# ---------------------------------------------------------------------- what is drawn


def _draw_panels(
    canvas: Rgb,
    panels: Sequence[Panel],
    pictures: Mapping[str, Rgb],
    camera: Camera,
    size_px: tuple[int, int],
) -> Rgb:
    """Lit outlines in their bezels, and backs of panels that face away; the nearest in front."""
    depth = np.full(canvas.shape[:2], np.inf)
    eye = np.array(camera.eye_m)
    for panel in panels:
        outline = panel.outline_m
        away = float(np.dot(eye - outline[0], panel.normal)) <= 0
        middle = outline.mean(axis=0)
        grown = 1 + 4 * panel.bezel_m / float(np.linalg.norm(outline - middle, axis=1).min())
        corners, distance = camera.project(middle + grown * (outline - middle))
        if distance.min() <= 0.05:
            continue
        x0, y0 = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
        x1, y1 = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, size_px)
        if x0 >= x1 or y0 >= y1:
            continue
        y, x = np.mgrid[y0:y1, x0:x1] + 0.5
        place, near = _on_panel(panel, camera, x, y)
        inside_m = _depth_in_outline(panel, place)
        seen = (inside_m > -max(panel.bezel_m, 1e-9)) & (near < depth[y0:y1, x0:x1])
        block = canvas[y0:y1, x0:x1]
        block[seen] = _colours(panel, pictures.get(panel.name), camera, place[seen], away=away)
        # A lit picture needs no line around it; unlit panels would merge without one.
        line = near / camera.focal_px * _SUPERSAMPLE
        dark = inside_m < 0 if panel.name in pictures and not away else inside_m < line * 0.6
        block[seen & dark] = _EDGE
        depth[y0:y1, x0:x1][seen] = near[seen]
    return canvas


def _colours(panel: Panel, picture: Rgb | None, camera: Camera, place_px: Floats, *, away: bool) -> Rgb:
    """Of what a panel shows at places on its grid, shape (N, 3): its picture, or a shade of its direction."""
    if picture is None or away:
        toward = np.array(camera.eye_m) - np.array(camera.target_m)
        light = toward / np.linalg.norm(toward) + np.array([-0.4, 0.8, 0.0])
        shade = abs(float(np.dot(light / np.linalg.norm(light), panel.normal)))
        colour = np.array(_BACK if away else _UNLIT) * (0.6 + 0.7 * shade)
        return np.broadcast_to(colour.astype(np.uint8), (len(place_px), 3))
    height, width = picture.shape[:2]
    share = np.clip(place_px / np.array(panel.size_px), 0, 1 - 1e-9)
    return np.asarray(picture[(share[:, 1] * height).astype(int), (share[:, 0] * width).astype(int), :3])


def _depth_in_outline(panel: Panel, place_px: Floats) -> Floats:
    """How far places on a panel's grid, (..., 2), lie inside its lit outline; metres, negative outside."""
    corners = panel.lit_outline_px * panel.pitch_m
    edges = np.concatenate([corners[1:], corners[:1]]) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    place = place_px * panel.pitch_m
    return np.asarray((place @ inward.T - (corners * inward).sum(axis=1)).min(axis=-1))


def _on_panel(panel: Panel, camera: Camera, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Places on the panel's pixel grid (..., 2) and depth behind picture pixels, by the inverse homography."""
    corners, distance = camera.project(panel.corners_m[[0, 1, 3]])
    triangle = np.concatenate([corners, np.ones((3, 1))], axis=1) * distance[:, None]
    # A place on the panel is c0 + u (c1 - c0) + v (c3 - c0) in homogeneous picture coordinates.
    matrix = np.stack([triangle[1] - triangle[0], triangle[2] - triangle[0], triangle[0]], axis=1)
    local = np.linalg.inv(matrix) @ np.stack([x.ravel(), y.ravel(), np.ones(x.size)])
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, near = local[0] / local[2], local[1] / local[2], 1 / local[2]
    near = np.where((near > 0) & np.isfinite(u) & np.isfinite(v), near, np.inf)
    place = np.stack([u, v], axis=-1) * panel.size_px
    return place.reshape(*x.shape, 2), near.reshape(x.shape)


def _draw_floor(
    drawing: ImageDraw.ImageDraw, display: Display, camera: Camera, size_px: tuple[int, int], viewers: Sequence[Viewer]
) -> None:
    low, high = display.bounds_m
    if low[1] > 3:  # a display far above any floor
        return
    places = np.array([viewer.position_m for viewer in viewers]).reshape(-1, 3)
    margin = 0.15 if high[2] - low[2] > 1 else 1.6
    x0, z0 = np.floor(np.minimum(low, places.min(axis=0, initial=math.inf))[[0, 2]] * 2 - 2 * margin) / 2
    x1, z1 = np.ceil(np.maximum(high, places.max(axis=0, initial=-math.inf))[[0, 2]] * 2 + 2 * margin) / 2
    outline, _ = camera.project(np.array([[x0, 0, z0], [x1, 0, z0], [x1, 0, z1], [x0, 0, z1]]))
    drawing.polygon([tuple(point) for point in outline], fill=_FLOOR)
    for x in np.arange(math.ceil(x0), x1 + 0.01):
        _line(drawing, camera, size_px, np.array([[x, 0, z0], [x, 0, z1]]), _FLOOR_LINE, _SUPERSAMPLE)
    for z in np.arange(math.ceil(z0), z1 + 0.01):
        _line(drawing, camera, size_px, np.array([[x0, 0, z], [x1, 0, z]]), _FLOOR_LINE, _SUPERSAMPLE)


def _line(
    drawing: ImageDraw.ImageDraw,
    camera: Camera,
    size_px: tuple[int, int],
    points_m: Floats,
    colour: tuple[int, int, int],
    width: int,
) -> None:
    place, depth = camera.project(points_m)
    if depth.min() > 0.05:
        drawing.line([tuple(point) for point in place], fill=colour, width=width, joint="curve")


def _draw_ghost(
    drawing: ImageDraw.ImageDraw, panels: Sequence[Panel], camera: Camera, size_px: tuple[int, int]
) -> None:
    """The outer edge of a wall that is seen from behind."""
    corners = np.concatenate([panel.corners_m for panel in panels])
    right, down = np.array(panels[0].right), np.array(panels[0].down)
    along, below = corners @ right, corners @ down
    extremes = [
        (along.min(), below.min()),
        (along.max(), below.min()),
        (along.max(), below.max()),
        (along.min(), below.max()),
    ]
    base = corners[0] - right * along[0] - down * below[0]
    loop = np.array([base + right * a + down * b for a, b in extremes])
    _line(drawing, camera, size_px, np.concatenate([loop, loop[:1]]), _GHOST, _SUPERSAMPLE)


def _draw_person(drawing: ImageDraw.ImageDraw, viewer: Viewer, camera: Camera, size_px: tuple[int, int]) -> None:
    """A figure as tall as the eyes are high, with a wedge on the floor that shows where the head points."""
    head = np.array(viewer.position_m)
    feet = head * [1, 0, 1]
    (foot, top), depth = camera.project(np.array([feet, head]))
    if depth.min() <= 0.05:
        return
    _draw_wedge(drawing, viewer, feet, camera, size_px)
    tall = foot[1] - top[1]  # eyes to floor in the picture; proportions of a standing adult
    if tall < 4:
        return

    def at(across: float, up: float) -> tuple[float, float]:
        return (foot[0] + (top[0] - foot[0]) * up + across * tall, foot[1] - up * tall)

    shadow = 0.17 * tall
    drawing.ellipse([foot[0] - shadow, foot[1] - shadow / 3, foot[0] + shadow, foot[1] + shadow / 3], fill=(20, 21, 24))
    for side in (-1, 1):
        drawing.polygon(
            [at(side * 0.02, 0.5), at(side * 0.1, 0.5), at(side * 0.085, 0.0), at(side * 0.02, 0.0)], fill=_PERSON
        )
        drawing.line([at(side * 0.125, 0.83), at(side * 0.155, 0.47)], fill=_PERSON, width=max(1, round(0.055 * tall)))
    drawing.polygon([at(-0.13, 0.84), at(0.13, 0.84), at(0.1, 0.48), at(-0.1, 0.48)], fill=_PERSON)
    drawing.rectangle([*at(-0.028, 0.93), *at(0.028, 0.84)], fill=_PERSON)
    drawing.ellipse([*at(-0.062, 1.075), *at(0.062, 0.905)], fill=_HEAD)


def _draw_wedge(
    drawing: ImageDraw.ImageDraw, viewer: Viewer, feet: Floats, camera: Camera, size_px: tuple[int, int]
) -> None:
    yaw = math.atan2(viewer.direction[0], viewer.direction[2])
    turns = np.radians(np.linspace(-15, 15, 7)) + yaw
    rim = feet + 1.1 * np.stack([np.sin(turns), np.zeros_like(turns), np.cos(turns)], axis=1)
    place, depth = camera.project(np.concatenate([feet[None], rim]))
    if depth.min() > 0.05:
        drawing.polygon([tuple(point) for point in place], fill=_WEDGE)


def _label(
    drawing: ImageDraw.ImageDraw, name: str, panels: Sequence[Panel], camera: Camera, size_px: tuple[int, int]
) -> None:
    corners = np.concatenate([panel.outline_m for panel in panels])
    middle = corners.mean(axis=0)
    up = -np.array(panels[0].down) if _is_flat(panels) else np.array([0.0, 1.0, 0.0])
    above = middle + up * (((corners - middle) @ up).max())
    place, depth = camera.project(above)
    if depth <= 0.05:
        return
    font = ImageFont.load_default(size=15 * _SUPERSAMPLE)
    drawing.text((place[0], place[1] - 6 * _SUPERSAMPLE), name, fill=_TEXT, font=font, anchor="ms")
