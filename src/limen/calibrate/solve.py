"""From photographs to a calibrated display."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np

from limen.calibrate.adjust import Adjusted, BundleAdjustment, adjust
from limen.calibrate.boards import Board, boards_of
from limen.calibrate.camera import Intrinsics
from limen.calibrate.chain import first_camera, first_poses
from limen.calibrate.detect import Sighting, look_at
from limen.calibrate.islands import require_one_island
from limen.calibrate.observations import observe
from limen.calibrate.poses import apply, compose, fit, inverse, of_panel, panel_at, turn_deg
from limen.calibrate.precision import Precision, precision
from limen.display.display import Display
from limen.display.panel import Panel
from limen.errors import InputError
from limen.geometry import Floats

__all__ = ["Calibration", "PanelFit", "PhotoFit", "calibrate", "solve"]

_VAGUE_FOCAL = 0.01
_POOR_RMS_PX = 1.0


class PanelFit(msgspec.Struct):
    """How one panel was found; lengths are of its centre, in the display's frame."""

    panel: str
    photos: int
    corners: int
    left_out: int  # corners that nothing explains
    rms_px: float
    worst_px: float
    position_std_mm: float
    angle_std_deg: float
    moved_mm: float  # from where the display file had it
    turned_deg: float


class PhotoFit(msgspec.Struct):
    """How one photograph fits."""

    photo: str
    panels: int
    corners: int
    left_out: int  # corners that nothing explains
    rms_px: float
    worst_px: float


@dataclass(frozen=True)
class Calibration:
    """A display whose panels hang where the photographs show them.

    Parameters
    ----------
    display
        The display with new poses; panels in no photograph keep theirs.
    camera
        The camera as found, or as given.
    panels, photos
        What was seen, each with its residual.
    rms_px, worst_px
        Distance between corners as seen and as predicted.
    warnings
        One line each.
    photo_poses
        Poses of ``photos`` (F, 6): from the room's frame to the camera's.
    sightings
        The markers in ``photos``.
    """

    display: Display
    camera: Intrinsics
    panels: tuple[PanelFit, ...]
    photos: tuple[PhotoFit, ...]
    rms_px: float
    worst_px: float
    warnings: tuple[str, ...]
    photo_poses: Floats
    sightings: tuple[Sighting, ...]


def calibrate(
    display: Display,
    photos: Sequence[Path],
    *,
    boards: Sequence[Board] | None = None,
    camera: Intrinsics | None = None,
    fix: str | None = None,
    step: Callable[[], object] = lambda: None,
) -> Calibration:
    """Find where the panels of a display hang, from photographs of the boards that they show.

    Parameters
    ----------
    display
        The display as it is known so far: sizes and pitch of its panels are taken as true, poses only choose the frame.
    photos
        Photographs by one camera at one zoom.
    boards
        What the panels show, in their order; by default `boards_of` the display.
    camera
        Its intrinsics, if known; else they are found too.
    fix
        The panel that keeps its pose. By default the frame is the one in which all panels together moved least.
    step
        Called after each photograph.

    Raises
    ------
    MissingFileError, FormatError
        If a photograph cannot be read.
    InputError
        If the photographs do not determine the panels' poses; the message says which, and what to do.
    """
    sightings = []
    for photo in photos:
        sightings.append(look_at(photo))
        step()
    return solve(display, sightings, boards=boards, camera=camera, fix=fix)


def solve(
    display: Display,
    sightings: Sequence[Sighting],
    *,
    boards: Sequence[Board] | None = None,
    camera: Intrinsics | None = None,
    fix: str | None = None,
) -> Calibration:
    """As `calibrate`, from markers already found."""
    _check_sizes(sightings, camera)
    everything = observe(display, boards or boards_of(display), sightings)
    seen_photos, photo = np.unique(everything.photo, return_inverse=True)
    seen_panels, panel = np.unique(everything.panel, return_inverse=True)
    seen = replace(everything, photo=photo.astype(np.int64), panel=panel.astype(np.int64))
    used = [sightings[number] for number in seen_photos]
    part = display.part(seen_panels.tolist()) if len(seen) else display
    _check_seen(display, part, used, sightings, fix)
    require_one_island(seen, part, "no photograph shows both")
    first = camera or first_camera(seen, used[0].size_px)
    problem = BundleAdjustment(
        seen, first, camera is None, len(used), len(part.panels), int(np.bincount(seen.panel).argmax())
    )
    if 2 * len(seen) <= problem.size:
        raise InputError(
            f"the photographs show too little: {2 * len(seen)} coordinates of corners for {problem.size} unknowns; "
            "take more photographs, or give --camera"
        )
    found = adjust(problem, *first_poses(seen, first, len(used), len(part.panels), problem.reference))
    require_one_island(found.problem.seen, part, "those that show both do not agree with the others")
    return _result(display, part, used, sightings, found, fix)


def _check_sizes(sightings: Sequence[Sighting], camera: Intrinsics | None) -> None:
    if not sightings:
        raise InputError("no photographs were given: name some, or a folder")
    sizes = {sighting.size_px: sighting.photo for sighting in reversed(sightings)}
    if len(sizes) > 1:
        (a, first), (b, other) = list(sizes.items())[-1], next(iter(sizes.items()))
        raise InputError(
            f"{other} is {b[0]} x {b[1]} px and {first} is {a[0]} x {a[1]}: all must come from one camera at one zoom, "
            "neither cropped nor turned"
        )
    size = sightings[0].size_px
    if camera is not None and camera.size_px != size:
        raise InputError(
            f"{sightings[0].photo} is {size[0]} x {size[1]} px and --camera is for {camera.size_px[0]} x "
            f"{camera.size_px[1]}: leave --camera out, or give the file of this camera at this size"
        )


def _check_seen(
    display: Display, part: Display, used: Sequence[Sighting], sightings: Sequence[Sighting], fix: str | None
) -> None:
    if not used:
        others = sum(len(sighting.ids) for sighting in sightings)
        raise InputError(
            f"none of {len(sightings)} photographs shows a marker of '{display.name}'"
            + (f" ({others} of another display's)" if others else "")
            + ": are the boards those of `limen calibrate boards` for this display, sharp, and not too small?"
        )
    if fix is not None and fix not in [panel.name for panel in part.panels]:
        known = fix in [panel.name for panel in display.panels]
        why = "is in no photograph" if known else f"is not one of '{display.name}'"
        raise InputError(f"--fix: panel '{fix}' {why}; one that can be fixed is '{part.panels[0].name}'")


def _result(
    display: Display,
    part: Display,
    used: Sequence[Sighting],
    sightings: Sequence[Sighting],
    found: Adjusted,
    fix: str | None,
) -> Calibration:
    grids = np.stack([_grid_corners(panel.size_m) for panel in part.panels])
    anchors = np.array([fix in (None, panel.name) for panel in part.panels])
    known = np.stack([panel.corners_m for panel in part.panels])
    guessed = np.stack([apply(pose, grid) for pose, grid in zip(found.panel_poses, grids, strict=True)])
    frame = fit(guessed[anchors].reshape(-1, 3), known[anchors].reshape(-1, 3))
    hung = [panel_at(p, compose(frame, pose)) for p, pose in zip(part.panels, found.panel_poses, strict=True)]
    deviations = precision(found, grids, anchors.astype(float))
    panels = tuple(_panel_fit(n, part, hung, found, deviations) for n in range(len(hung)))
    photos = tuple(_photo_fit(n, sighting, found) for n, sighting in enumerate(used))
    by_name = {panel.name: panel for panel in hung}
    apart = np.linalg.norm(found.errors_px[found.kept], axis=1)
    rms = float(np.sqrt((apart**2).mean()))
    unused = {sighting.photo for sighting in sightings} - {sighting.photo for sighting in used}
    return Calibration(
        display=replace(display, panels=tuple(by_name.get(panel.name, panel) for panel in display.panels)),
        camera=found.camera,
        panels=panels,
        photos=photos,
        rms_px=rms,
        worst_px=float(apart.max()),
        warnings=(*_warnings(display, panels, photos, sorted(unused)), *_doubts(rms, deviations)),
        photo_poses=compose(found.photo_poses, inverse(frame)),
        sightings=tuple(used),
    )


def _grid_corners(size_m: tuple[float, float]) -> Floats:
    width, height = size_m
    return np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0.0]])


def _panel_fit(number: int, part: Display, hung: Sequence[Panel], found: Adjusted, deviations: Precision) -> PanelFit:
    before, after = part.panels[number], hung[number]
    seen, errors = found.problem.seen, found.errors_px[found.kept]
    own = seen.panel == number
    apart = np.linalg.norm(errors[own], axis=1)
    moved = float(np.linalg.norm(after.centre_m - before.centre_m))
    turned = float(turn_deg(compose(of_panel(after), inverse(of_panel(before)))))
    return PanelFit(
        panel=before.name,
        photos=len(np.unique(seen.photo[own])),
        corners=int(own.sum()),
        left_out=int(found.left_out_by_panel[number]),
        rms_px=float(np.sqrt((apart**2).mean())),
        worst_px=float(apart.max()),
        position_std_mm=float(deviations.position_m[number]) * 1000,
        angle_std_deg=float(deviations.angle_deg[number]),
        moved_mm=moved * 1000,
        turned_deg=turned,
    )


def _photo_fit(number: int, sighting: Sighting, found: Adjusted) -> PhotoFit:
    seen, errors = found.problem.seen, found.errors_px[found.kept]
    own = seen.photo == number
    apart = np.linalg.norm(errors[own], axis=1)
    return PhotoFit(
        photo=sighting.photo,
        panels=len(np.unique(seen.panel[own])),
        corners=int(own.sum()),
        left_out=int(found.left_out_by_photo[number]),
        rms_px=float(np.sqrt((apart**2).mean())),
        worst_px=float(apart.max()),
    )


def _warnings(
    display: Display, panels: Sequence[PanelFit], photos: Sequence[PhotoFit], unused: Sequence[str]
) -> list[str]:
    seen = {panel.panel for panel in panels}
    said = [f"{photo}: shows no marker of this display, so it was not used" for photo in unused]
    said += [
        f"panel '{panel.name}' is in no photograph: it keeps the pose of the display file"
        for panel in display.panels
        if panel.name not in seen
    ]
    said += [
        f"panel '{panel.panel}' is in one photograph only, so nothing checks its pose: take another one of it"
        for panel in panels
        if panel.photos == 1
    ]
    said += [
        f"panel '{panel.panel}': most of it does not agree with the others ({panel.left_out} corners left out): are "
        "its pixels and size in the display file true, does it show its own board, did it move?"
        for panel in panels
        if panel.left_out > panel.corners
    ]
    said += [
        f"{photo.photo}: most of it does not agree with the other photographs ({photo.left_out} corners left out): "
        "was it taken after a panel moved, or at another zoom?"
        for photo in photos
        if photo.left_out > photo.corners
    ]
    said += [
        f"panel '{panel.name}' keeps its nudge_px {list(panel.nudge_px)}, which made up for where it hung: set it to 0"
        for panel in display.panels
        if panel.name in seen and any(panel.nudge_px)
    ]
    return said


def _doubts(rms_px: float, deviations: Precision) -> list[str]:
    said = []
    if rms_px > _POOR_RMS_PX:
        said.append(
            f"corners are {rms_px:.1f} px off where they should be: are the panels' sizes in the display file true, "
            "and was everything still?"
        )
    if deviations.focal_share > _VAGUE_FOCAL:
        known = f"known to {deviations.focal_share:.1%} only" if deviations.focal_share < 1 else "not known"
        said.append(
            f"the focal length is {known}, and so are distances from the camera: add photographs at an angle, or give "
            "--camera"
        )
    return said
