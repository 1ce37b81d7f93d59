"""A rehearsal: synthetic photographs of a display whose panels hang a little off, and how well they are found."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from limen.calibrate.boards import boards_of, draw_board
from limen.calibrate.camera import Intrinsics
from limen.calibrate.detect import Sighting, detect
from limen.calibrate.poses import apply, compose, fit, inverse, of_panel, panel_at, turn_deg
from limen.calibrate.solve import Calibration, solve
from limen.calibrate.synthetic import Photographer
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats
from limen.pictures.files import write_picture

__all__ = ["PanelError", "Rehearsal", "displaced", "errors_of", "looking", "phone", "places", "rehearse"]

_FIELD_DEG = 60.0
"""Across the photographs' longer side: a phone's ordinary lens has 60 to 75 degrees."""

_BENT = (-0.1, 0.03, 0.0, 0.0, 0.0)


class PanelError(msgspec.Struct):
    """What a panel is off by after the calibration, beside what the calibration itself expects."""

    panel: str
    photos: int
    rms_px: float
    position_error_mm: float
    angle_error_deg: float
    position_std_mm: float
    angle_std_deg: float


class Rehearsal(msgspec.Struct):
    display: str
    photos: int
    size_px: tuple[int, int]
    rms_px: float
    panels: list[PanelError]
    warnings: list[str]


def rehearse(
    display: Display,
    *,
    photos: int = 12,
    megapixels: float = 12.0,
    off_m: float = 0.02,
    off_deg: float = 3.0,
    seed: int = 0,
    folder: Path | None = None,
    step: Callable[[], object] = lambda: None,
) -> Rehearsal:
    """Photograph a display whose panels are off by up to ``off_m`` and ``off_deg``, calibrate it, and compare.

    Raises
    ------
    InputError
        If a number makes no sense, or the photographs do not determine the panels' poses.
    """
    if photos < 1 or not 0.1 <= megapixels <= 24 or off_m < 0 or off_deg < 0:
        raise InputError("a rehearsal needs at least 1 photograph of 0.1 to 24 megapixels, and panels off by 0 or more")
    camera = phone(megapixels)
    photographer = Photographer(camera, oversampling=2)
    truth = displaced(display, off_m, off_deg, seed)
    pictures = {b.panel: draw_board(b, p)[..., 0] for b, p in zip(boards_of(display), display.panels, strict=True)}
    sightings = []
    for number, pose in enumerate(places(truth, photos, camera, seed)):
        photo = photographer.photograph(truth, pictures, pose, seed + number)
        name = f"photo-{number:02d}.jpg"
        if folder is not None:
            write_picture(folder / name, np.repeat(photo[..., None], 3, axis=2))
        sightings.append(Sighting(name, camera.size_px, *detect(photo)))
        step()
    found = solve(display, sightings)
    errors = errors_of(found, truth)
    rows = [
        PanelError(p.panel, p.photos, p.rms_px, *errors[p.panel], p.position_std_mm, p.angle_std_deg)
        for p in found.panels
    ]
    return Rehearsal(display.name, photos, camera.size_px, found.rms_px, rows, list(found.warnings))


def errors_of(found: Calibration, truth: Display) -> dict[str, tuple[float, float]]:
    """Position error of the centre in millimetres and angle in degrees of each panel that was seen.

    Photographs alone do not know the room, so both displays are laid over each other first, panels' corners on corners.
    """
    seen = {panel.panel for panel in found.panels}
    pairs = [(p, t) for p, t in zip(found.display.panels, truth.panels, strict=True) if p.name in seen]
    over = fit(np.concatenate([p.corners_m for p, _ in pairs]), np.concatenate([t.corners_m for _, t in pairs]))
    errors = {}
    for panel, true in pairs:
        centre = apply(over, panel.centre_m[None])[0]
        rest = compose(inverse(of_panel(true)), compose(over, of_panel(panel)))
        errors[panel.name] = (1000 * float(np.linalg.norm(centre - true.centre_m)), float(turn_deg(rest)))
    return errors


def displaced(display: Display, off_m: float, off_deg: float, seed: int) -> Display:
    """The display with each panel moved by up to ``off_m``, and turned about its centre by up to ``off_deg``.

    Along their normals panels only move toward the viewers, so that neighbours do not cut into each other.
    """
    random = np.random.default_rng(seed)
    panels = []
    for panel in display.panels:
        turn = np.radians(random.uniform(-off_deg, off_deg, 3) / math.sqrt(3))
        move = random.uniform(-off_m, off_m, 3) / math.sqrt(3)
        normal = np.array(panel.normal)
        move += (abs(move @ normal) - move @ normal) * normal
        about = np.concatenate([turn, np.zeros(3)])
        about[3:] = panel.centre_m - apply(about, panel.centre_m[None])[0] + move
        panels.append(panel_at(panel, compose(about, of_panel(panel))))
    return replace(display, panels=tuple(panels))


def places(display: Display, photos: int, camera: Intrinsics, seed: int) -> list[Floats]:
    """Poses of photographs, each looking at a panel from somewhere in front, so that neighbours are seen too.

    The photographs go from panel to panel; each stands as far away as it takes to see twice the panel, or as other
    panels allow, up to 40 degrees to a side and 30 above, held as people hold cameras.
    """
    random = np.random.default_rng(seed + 1)
    half = math.atan(min(camera.size_px) / 2 / camera.focal_px[0])
    poses = []
    for target in np.linspace(0, len(display.panels) - 1e-6, photos, endpoint=False).astype(int):
        panel = display.panels[int(target)]
        azimuth, elevation = np.radians([random.uniform(-40, 40), random.uniform(-5, 30)])
        right, up = np.array(panel.right), -np.array(panel.down)
        toward = math.cos(elevation) * (math.cos(azimuth) * np.array(panel.normal) + math.sin(azimuth) * right)
        toward = toward + math.sin(elevation) * up
        far = math.hypot(*panel.size_m) / math.tan(half)
        shares = [
            share for share in _NEARER if not _hidden(display, int(target), panel.centre_m + share * far * toward)
        ]
        eye = panel.centre_m + (shares[0] if shares else _NEARER[-1]) * far * toward
        poses.append(looking(eye, panel.centre_m, up, random.choice(_ROLLS_DEG) + random.uniform(-8, 8)))
    return poses


_NEARER = (1.0, 0.75, 0.5, 0.35)
_ROLLS_DEG = (0.0, 0.0, 90.0)


def looking(eye_m: Floats, target_m: Floats, up: Floats, roll_deg: float = 0.0) -> Floats:
    """The pose (6,) of a photograph taken at ``eye_m``, of ``target_m``, with the camera turned by ``roll_deg``."""
    forward = target_m - eye_m
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, up)
    right = right / np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    turn = Rotation.from_euler("z", roll_deg, degrees=True) * Rotation.from_matrix(axes)
    return np.concatenate([turn.as_rotvec(), -turn.apply(eye_m)])


def _hidden(display: Display, target: int, eye_m: Floats) -> bool:
    """Whether another panel stands between an eye and the middle of a panel."""
    ray = display.panels[target].centre_m - eye_m
    for number, panel in enumerate(display.panels):
        normal = np.array(panel.normal)
        slope = float(ray @ normal)
        if number == target or abs(slope) < 1e-9:
            continue
        share = float((panel.centre_m - eye_m) @ normal) / slope
        off = eye_m + share * ray - panel.centre_m
        inside = abs(off @ panel.right) < panel.size_m[0] / 2 and abs(off @ panel.down) < panel.size_m[1] / 2
        if 0 < share < 1 and inside:
            return True
    return False


def phone(megapixels: float) -> Intrinsics:
    """A camera of 4 : 3 whose lens bends a little, and is a little off the sensor's centre."""
    width = round(math.sqrt(megapixels * 1e6 * 4 / 3))
    height = round(width * 3 / 4)
    focal = width / 2 / math.tan(math.radians(_FIELD_DEG / 2))
    return Intrinsics((width, height), (focal, focal), (0.505 * width, 0.492 * height), _BENT)
