"""`render`: what every panel shows of any content, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from limen.data.opening import open_content
from limen.display.display import Display
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.gpu.device import Device, open_device
from limen.layers.base import Layer
from limen.layers.registry import KINDS, kind_of, layer_of
from limen.viewing.choices import Stereo
from limen.viewing.placement import InRoom, LookAt, Placement
from limen.viewing.policy import Policy, ignores_acuity
from limen.viewing.viewer import Viewer
from limen.vision.acuity import HUMAN_ARCMIN, acuity_from

if TYPE_CHECKING:
    from limen.data.image.file import Image
    from limen.data.mesh.mesh import Mesh
    from limen.data.points.file import Points
    from limen.data.terrain.file import Terrain

    Shown: TypeAlias = Image | Mesh | Points | Terrain | Layer | str | Path

__all__ = ["render"]


def render(
    content: Shown | Sequence[Shown],
    display: Display,
    viewers: Sequence[Viewer] = (),
    policy: str | Policy | None = None,
    *,
    panels: str | Sequence[str] = "*",
    acuity_arcmin: str | float = HUMAN_ARCMIN,
    placement: Placement | InRoom | LookAt | ArrayLike | None = None,
    overlay: str | None = None,
    stereo: Stereo = "none",
    scale: float = 1.0,
    device: Device | None = None,
) -> dict[str, NDArray[np.uint8]]:
    """What each panel shows: detail as the policy asks for.

    Parameters
    ----------
    content
        An opened image, mesh, terrain or cloud of points, or a file's path; or a layer, that brings its own policy,
        placement and overlay; or several of these, in one picture.
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
        Of one content alone. How the image lies on the display, and the lenses that it is seen through
        (`limen.viewing.placement.OnSurface`):
        by default fitted inside the unrolled surface, centred, without any. Of a mesh or points, the affine map from
        its coordinates to the room, metres, shape (4, 4): by default `limen.layers.common.room_placement.mesh_in_room`.
        Of a terrain, a `limen.LookAt`: from where it is looked at by the first viewer; by default all of it is seen.
    overlay
        ``levels`` tints every pixel of an image by the level drawn, ``error`` by how far lenses draw it from where it
        belongs, ``panels`` a mesh by the panel that shows it and a
        terrain by how its panels are seen, ``patches`` shows a terrain's triangles, ``simplified`` what stands for
        much of a mesh or points.
    stereo
        Of a mesh, see `limen.frame.renderer.Renderer`; with ``sequential`` there are ``name@left`` and
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
    several = content if isinstance(content, list | tuple) else [content]
    if len(several) != 1 and placement is not None:
        raise InputError("several contents are placed each by itself: give layers, as limen.MeshLayer")
    with ExitStack() as stack:
        layers = [_layer(each, policy, acuity_arcmin, placement, overlay or "", stack) for each in several]
        needing = [kind_of(layer).noun for layer in layers if not kind_of(layer).on_panels]
        if needing and not viewers:
            raise InputError(f"{needing[0]} is drawn for somebody's eyes: give a viewer")
        adapter = stack.enter_context(open_device() if device is None else nullcontext(device))
        wanted = display.select(panels).scaled(scale)
        # The whole display says where things lie, whichever panels are drawn.
        renderer = stack.enter_context(Renderer(adapter, wanted, layers, whole=display, stereo=stereo))
        frame = renderer.state(viewers[0].time_s if viewers else 0.0, viewers=tuple(viewers))
        return {picture.name: picture.pixels.copy() for picture in renderer.pictures(frame)}


def _layer(
    shown: Any, policy: str | Policy | None, acuity_arcmin: str | float, placement: Any, overlay: str, stack: ExitStack
) -> Layer:
    """One of what is shown as a layer; what is opened for it is closed with the stack."""
    opened: Any = open_content(shown) if isinstance(shown, str | Path) else shown
    if opened is not shown and hasattr(opened, "close"):
        stack.callback(opened.close)
    if hasattr(opened, "selector"):
        chosen = policy if policy is None or isinstance(policy, Policy) else _policy(policy, acuity_arcmin)
        return layer_of(opened, policy=chosen, placement=placement, overlay=overlay)
    name = getattr(opened, "kind", None)
    chosen = None if name is None else _policy(policy or KINDS[name].default_policy, acuity_arcmin)
    return layer_of(opened, policy=chosen, placement=placement, overlay=overlay)


def _policy(policy: str | Policy, acuity_arcmin: str | float) -> Policy:
    """Raises InputError for an acuity that the policy does not go by."""
    if acuity_from(acuity_arcmin) != HUMAN_ARCMIN and (isinstance(policy, Policy) or ignores_acuity(policy)):
        raise InputError(
            f"acuity_arcmin changes nothing of a policy that says its own or goes by none ({policy}): leave it out"
            if isinstance(policy, str)
            else "acuity_arcmin is of policies that are named: a Policy has its own, leave one of them out"
        )
    return (policy if isinstance(policy, Policy) else Policy.parse(policy, acuity_arcmin)).timeless
