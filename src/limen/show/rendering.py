"""`render`: what every panel shows of any content, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from limen.data.image.file import Image
from limen.data.mesh.mesh import Mesh
from limen.data.opening import open_content
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats
from limen.gpu.device import Device, open_device
from limen.layers.common.room_placement import mesh_in_room
from limen.layers.image.draw.drawer import Overlay
from limen.layers.image.renderer import Renderer
from limen.layers.mesh.draw.drawer import SceneOverlay
from limen.layers.mesh.renderer import SceneRenderer, Simplified
from limen.layers.mesh.select import FoldTree
from limen.layers.terrain.draw.drawer import TerrainOverlay
from limen.layers.terrain.renderer import TerrainRenderer
from limen.layers.terrain.selector import TerrainSettings
from limen.viewing.choices import Stereo
from limen.viewing.placement import LookAt, OnShape, OnSurface, Placement
from limen.viewing.policy import Policy, ignores_acuity
from limen.viewing.viewer import Viewer
from limen.vision.acuity import HUMAN_ARCMIN, acuity_from

if TYPE_CHECKING:
    from limen.data.points.file import Points
    from limen.data.terrain.file import Terrain
    from limen.layers.points.draw.drawer import PointsOverlay

__all__ = ["render"]

_NAMES = {"mesh": "a mesh", "points": "a cloud of points", "terrain": "a terrain"}


def render(
    content: Image | Mesh | Points | Terrain | str | Path,
    display: Display,
    viewers: Sequence[Viewer] = (),
    policy: str | Policy | None = None,
    *,
    panels: str | Sequence[str] = "*",
    acuity_arcmin: str | float = HUMAN_ARCMIN,
    placement: Placement | Floats | LookAt | None = None,
    overlay: Overlay | SceneOverlay | TerrainOverlay | PointsOverlay | None = None,
    stereo: Stereo = "none",
    scale: float = 1.0,
    device: Device | None = None,
) -> dict[str, NDArray[np.uint8]]:
    """What each panel shows: detail as the policy asks for.

    Parameters
    ----------
    content
        An opened image, mesh, terrain or cloud of points, or a file's path.
    display
        The installation.
    viewers
        Who looks. Of an image, nothing is left out for nobody. All else is seen by the first, whom it needs.
    policy
        ``full``, ``acuity`` or ``contrast``, the last two also with ``+gaze`` (or a `limen.viewing.policy.Policy`);
        of a terrain also ``scheel``; of a mesh or points also ``+motion``, ``budget:N`` and ``size:N``. By default
        ``acuity``, of a mesh ``full``: for the others its vertices are joined to a tree first, two seconds for a
        million triangles.
    panels
        Shell-style pattern(s) of the panels wanted.
    acuity_arcmin
        For all policies but ``full`` and ``scheel``: arcminutes, ``human`` or ``snellen``.
    placement
        How the image lies on the display, and the lenses that it is seen through (`limen.viewing.placement.OnSurface`):
        by default fitted inside the unrolled surface, centred, without any. Of a mesh or points, the affine map from
        its coordinates to the room, metres, shape (4, 4): by default `limen.layers.common.room_placement.mesh_in_room`.
        Of a terrain, a `limen.LookAt`: from where it is looked at by the first viewer; by default all of it is seen.
    overlay
        ``levels`` tints every pixel of an image by the level drawn, ``error`` by how far lenses draw it from where it
        belongs, ``panels`` a mesh by the panel that shows it and a
        terrain by how its panels are seen, ``patches`` shows a terrain's triangles, ``simplified`` what stands for
        much of a mesh or points.
    stereo
        Of a mesh, see `limen.layers.mesh.renderer.SceneRenderer`; with ``sequential`` there are ``name@left`` and
        ``name@right``.
    scale
        Draw panels of fewer, larger pixels (0.125 for an eighth), as for a picture of the whole room.
    device
        An opened adapter; by default one is opened for this call.

    Returns
    -------
    dict
        Panel name -> uint8 (height, width, 4), sRGB.

    Raises
    ------
    InputError
        For a policy, pattern or file that does not exist, anything but an image without a viewer, and what is meant
        for another kind of content.
    NoAdapterError
        If there is no graphics adapter, not even a software one.
    """
    with ExitStack() as stack:
        opened = open_content(content) if isinstance(content, str | Path) else content
        if isinstance(opened, Image) and opened is not content:
            stack.enter_context(opened)
        if policy is None:
            policy = "full" if isinstance(opened, Mesh) else "acuity"
        wanted = display.select(panels).scaled(scale)
        asked = _Asked(display, wanted, list(viewers), _policy(policy, acuity_arcmin), placement, overlay, stereo)
        if not viewers and not isinstance(opened, Image):
            raise InputError(f"{_NAMES[opened.kind]} is drawn for somebody's eyes: give a viewer")
        adapter = stack.enter_context(_lent(device))
        if isinstance(opened, Image):
            return _image_pictures(adapter, opened, asked)
        if isinstance(opened, Mesh):
            return _mesh_pictures(adapter, opened, asked)
        if opened.kind == "points":
            return _splats(adapter, cast("Points", opened), asked)
        return _land(adapter, cast("Terrain", opened), asked)


def _policy(policy: str | Policy, acuity_arcmin: str | float) -> Policy:
    """Raises InputError for an acuity that the policy does not go by."""
    if acuity_from(acuity_arcmin) != HUMAN_ARCMIN and (isinstance(policy, Policy) or ignores_acuity(policy)):
        raise InputError(
            f"acuity_arcmin changes nothing of a policy that says its own or goes by none ({policy}): leave it out"
            if isinstance(policy, str)
            else "acuity_arcmin is of policies that are named: a Policy has its own, leave one of them out"
        )
    return (policy if isinstance(policy, Policy) else Policy.parse(policy, acuity_arcmin)).timeless


class _Asked(NamedTuple):
    """What `render` was asked for, whatever the content is."""

    whole: Display
    wanted: Display
    viewers: list[Viewer]
    policy: Policy
    placement: Placement | Floats | LookAt | None
    overlay: Overlay | SceneOverlay | TerrainOverlay | PointsOverlay | None
    stereo: Stereo


def _image_pictures(device: Device, image: Image, asked: _Asked) -> dict[str, NDArray[np.uint8]]:
    placement, overlay = asked.placement, asked.overlay
    if asked.stereo != "none":
        raise InputError("stereo is for meshes, not for images: leave it out")
    if not isinstance(placement, OnSurface | OnShape | None):
        raise InputError(
            "(4, 4) placements are for meshes, not for images, and a LookAt is for terrains: give OnSurface"
        )
    if overlay not in (None, "levels", "error"):
        raise InputError(
            f"the overlay '{overlay}' is for terrains or for meshes, not for images: give 'levels' or 'error'"
        )
    with Renderer(device, asked.wanted, image, placement) as renderer:
        drawn = renderer.pictures(asked.viewers, asked.policy, overlay=overlay)
        return {name: picture.copy() for name, picture, _ in drawn}


def _mesh_pictures(device: Device, mesh: Mesh, asked: _Asked) -> dict[str, NDArray[np.uint8]]:
    placement, overlay = asked.placement, _scene_overlay("a mesh", asked)
    if overlay == "simplified" and asked.policy.name == "full":
        raise InputError("the overlay 'simplified' shows what a policy leaves out: give one, as contrast+gaze")
    # The whole display says where the mesh stands, whichever panels are drawn.
    stands = mesh_in_room(mesh.bounds, asked.whole) if placement is None else np.asarray(placement, dtype=float)
    simplified = None
    if asked.policy.name != "full":
        from limen.data.mesh.store import tree_of  # Numba and SciPy take a second

        simplified = Simplified(FoldTree(tree_of(mesh)), asked.policy)
    with SceneRenderer(
        device, asked.wanted, mesh, room_from_mesh=stands, stereo=asked.stereo, simplified=simplified
    ) as scene:
        seen = scene.pictures(asked.viewers, overlay=overlay)
        return {name: picture.copy() for name, picture, _ in seen}


def _scene_overlay(what: str, asked: _Asked) -> SceneOverlay | None:
    """The overlay, if it is one of meshes and points; raises InputError also for placements that are not for them."""
    overlay, placement = asked.overlay, asked.placement
    if overlay not in (None, "panels", "simplified"):
        raise InputError(f"the overlay '{overlay}' is not for {what}: give 'panels' or 'simplified'")
    if isinstance(placement, OnSurface | OnShape | LookAt):
        others = "terrains" if isinstance(placement, LookAt) else "images"
        raise InputError(
            f"placements of the kind {type(placement).__name__} are for {others}: {what} takes a (4, 4) matrix"
        )
    return overlay


def _splats(device: Device, points: Points, asked: _Asked) -> dict[str, NDArray[np.uint8]]:
    from limen.layers.points.renderer import PointsRenderer

    placement, overlay = asked.placement, _scene_overlay("a cloud of points", asked)
    if asked.stereo != "none":
        raise InputError("points are drawn for one eye: leave out stereo")
    stands = (
        mesh_in_room(points.bounds, asked.whole, up=points.up, tilt_deg=points.tilt_deg)
        if placement is None
        else np.asarray(placement, float)
    )
    with PointsRenderer(device, asked.wanted, points, room_from_file=stands) as renderer:
        drawn = renderer.pictures(asked.viewers, asked.policy, overlay=overlay)
        return {name: picture.copy() for name, picture, _ in drawn}


def _land(device: Device, terrain: Terrain, asked: _Asked) -> dict[str, NDArray[np.uint8]]:
    placement, overlay = asked.placement, asked.overlay
    if overlay not in (None, "panels", "patches"):
        raise InputError(f"the overlay '{overlay}' is not for a terrain: give 'panels' or 'patches'")
    if not isinstance(placement, LookAt | None):
        raise InputError(f"a placement of the kind {type(placement).__name__} is not for a terrain: give a LookAt")
    if asked.stereo != "none":
        raise InputError("a terrain is drawn for one eye: leave out stereo")
    settings = TerrainSettings(placement or LookAt())
    with TerrainRenderer(
        device, asked.wanted, terrain, settings=settings, whole=asked.whole, reference_m=asked.viewers[0].position_m
    ) as renderer:
        drawn = renderer.pictures(asked.viewers, asked.policy, overlay=overlay)
        return {name: picture.copy() for name, picture, _ in drawn}


def _lent(device: Device | None) -> AbstractContextManager[Device]:
    """The caller's adapter, which stays open, or one for this call."""
    return open_device() if device is None else nullcontext(device)
