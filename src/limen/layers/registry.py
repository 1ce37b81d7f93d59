"""The kinds of layers that there are: whoever adds one, adds a row here and one in `limen.data.opening`."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from limen.errors import InputError
from limen.extensions import extension
from limen.layers.base import Drawer, Layer
from limen.viewing.placement import InRoom, LookAt, OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import LayerState

if TYPE_CHECKING:
    from limen.gpu.device import Device

__all__ = ["KINDS", "Kind", "check_state", "drawer_of", "kind_of", "layer_of"]


class Kind(NamedTuple):
    """One kind of layers.

    Parameters
    ----------
    noun
        What people call one of them.
    layer
        ``module:class`` of it; its class method ``of`` makes one of content, a policy or none, a placement or none, and
        an overlay.
    drawer
        ``module:class`` of what draws it, made of a device, a layer, and how many bytes it may take.
    placements
        How it can be placed.
    overlays, policies
        What can be shown over it, and what can decide about its detail; ``default_policy`` does unless told otherwise.
    memory_share
        How much of a frame's memory for chunks one of them may take.
    max_quilt_px
        Most pixels that are drawn at once, by the memory that each takes.
    both_eyes
        Whether it draws two eyes at once.
    on_panels
        Whether it lies on panels and is drawn without depth, as a backdrop of all else; then it needs no viewer.
    """

    noun: str
    layer: str
    drawer: str
    placements: tuple[type, ...]
    overlays: tuple[str, ...]
    policies: tuple[str, ...]
    memory_share: float
    max_quilt_px: int
    default_policy: str = "acuity"
    both_eyes: bool = False
    on_panels: bool = False


_SEEN = ("full", "acuity", "contrast")


class _Kinds(dict[str, Kind]):
    """The kinds that limen brings, and those of other packages: entry points of the group ``limen.layers``."""

    def __missing__(self, name: str) -> Kind:
        kind = extension("limen.layers", name)
        if kind is None:
            raise InputError(f"no kind of layers is named '{name}': there are {', '.join(self)}")
        if not isinstance(kind, Kind):
            raise InputError(f"'{name}' of limen.layers is a {type(kind).__name__}, and has to be a Kind")
        self[name] = kind
        return kind


KINDS: dict[str, Kind] = _Kinds(
    {
        "image": Kind(
            noun="an image",
            layer="limen.layers.image.layer:ImageLayer",
            drawer="limen.layers.image.draw.drawer:ImageDrawer",
            placements=(OnSurface, OnShape),
            overlays=("levels", "error"),
            policies=_SEEN,
            memory_share=1.0,
            max_quilt_px=1 << 25,
            on_panels=True,
        ),
        "mesh": Kind(
            noun="a mesh",
            layer="limen.layers.mesh.layer:MeshLayer",
            drawer="limen.layers.mesh.draw.drawer:MeshDrawer",
            placements=(InRoom,),
            overlays=("panels", "simplified"),
            policies=(*_SEEN, "budget", "size"),
            default_policy="full",
            memory_share=0.0,
            max_quilt_px=1 << 26,
            both_eyes=True,
        ),
        "terrain": Kind(
            noun="a terrain",
            layer="limen.layers.terrain.layer:TerrainLayer",
            drawer="limen.layers.terrain.draw.drawer:TerrainDrawer",
            placements=(LookAt,),
            overlays=("panels", "patches"),
            policies=(*_SEEN, "scheel"),
            memory_share=1.0,
            max_quilt_px=1 << 26,
        ),
        "points": Kind(
            noun="a cloud of points",
            layer="limen.layers.points.layer:PointsLayer",
            drawer="limen.layers.points.draw.drawer:PointsDrawer",
            placements=(InRoom,),
            overlays=("panels", "simplified"),
            policies=(*_SEEN, "budget", "size"),
            memory_share=0.25,
            max_quilt_px=1 << 23,
        ),
    }
)


def kind_of(layer: Layer) -> Kind:
    """The row of a layer's kind.

    Raises
    ------
    InputError
        If there is no such kind.
    """
    return KINDS[layer.kind]


def layer_of(content: Any, *, policy: Policy | None = None, placement: Any = None, overlay: str = "") -> Layer:
    """Content as a layer; a layer as it is.

    Parameters
    ----------
    policy, placement
        By default those of its kind.

    Raises
    ------
    InputError
        For a placement that is for another kind, or what is no content.
    """
    name = getattr(content, "kind", None)
    if name is None:
        raise InputError(f"a {type(content).__name__} cannot be shown: open a file with limen.open, or make a layer")
    kind = KINDS[name]
    if hasattr(content, "selector"):
        if policy is not None or placement is not None or overlay:
            raise InputError("a layer has a policy, a placement and an overlay of its own: leave them out here")
        layer: Layer = content
        return layer
    made: Layer = _named(kind.layer).of(content, policy, placement, overlay)
    return made


def drawer_of(device: Device, layer: Layer, gpu_bytes: int) -> Drawer[Any]:
    """What draws a layer."""
    drawer: Drawer[Any] = _named(kind_of(layer).drawer)(device, layer, gpu_bytes)
    return drawer


def _named(name: str) -> Any:
    module, _, part = name.partition(":")
    return getattr(import_module(module), part)


def check_state(kind: Kind, state: LayerState) -> None:
    """Refuse what a kind cannot show.

    Raises
    ------
    InputError
        Naming the placement, the overlay or the policy.
    """
    if not isinstance(state.placement, kind.placements):
        wanted = " or ".join(placement.__name__ for placement in kind.placements)
        raise InputError(f"{kind.noun} is not placed by {type(state.placement).__name__}: give {wanted}")
    if state.overlay not in ("", *kind.overlays):
        raise InputError(f"the overlay '{state.overlay}' is not for {kind.noun}: give {_either(kind.overlays)}")
    if state.policy.name not in kind.policies:
        raise InputError(f"the policy {state.policy.title} is not for {kind.noun}: give {', '.join(kind.policies)}")


def _either(words: Sequence[str]) -> str:
    return " or ".join(f"'{word}'" for word in words)
