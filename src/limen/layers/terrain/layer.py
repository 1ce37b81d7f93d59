"""A terrain as a layer: from where it is looked at, how it looks, and which of its patches and pages are drawn."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import msgspec

from limen.data.image.file import Image
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats, Vec3
from limen.layers.base import STILL, Turn
from limen.layers.common.known_contrast import KnownContrast
from limen.layers.terrain.look import TerrainLook
from limen.layers.terrain.look_at import fitted_range_m, in_flight
from limen.layers.terrain.patches import patch_streaming
from limen.layers.terrain.selector import Scenery, TerrainSelector, TerrainSettings
from limen.stream.chunks import Streaming
from limen.stream.pages import page_streaming
from limen.viewing.placement import LookAt
from limen.viewing.policy import Policy
from limen.viewing.standing import standing_viewer
from limen.viewing.state import LayerState

if TYPE_CHECKING:
    from limen.data.terrain.file import Terrain

__all__ = ["Draped", "TerrainLayer"]


class Draped(NamedTuple):
    """A picture that lies on a terrain.

    ``texel_from_post`` is an affine map of shape (2, 3) from column and row, see
    `limen.data.terrain.drape.texel_from_post`.
    """

    image: Image
    texel_from_post: Floats


@dataclass(frozen=True, slots=True, eq=False)
class TerrainLayer:
    """A terrain and how it is shown.

    Parameters
    ----------
    look
        Colours, light and contour lines.
    settings
        From where it is looked at, and how its detail is chosen.
    policy
        How viewers decide about detail.
    reference_m
        The reference eye, see `limen.layers.terrain.look_at`; by default that of somebody who stands before the
        display.
    draped
        A picture that lies on it.
    overlay
        ``panels`` shows how panels are seen, ``patches`` every triangle flat and every patch in a hue of its own.
    """

    kind: ClassVar[str] = "terrain"
    terrain: Terrain
    look: TerrainLook = field(default_factory=TerrainLook)
    settings: TerrainSettings = field(default_factory=TerrainSettings)
    policy: Policy = field(default_factory=Policy)
    reference_m: Vec3 | None = None
    draped: Draped | None = None
    overlay: str = ""

    @classmethod
    def of(cls, terrain: Terrain, policy: Policy | None, placement: Any, overlay: str) -> TerrainLayer:
        """A terrain of which all is seen, unless it is looked at from elsewhere."""
        if not isinstance(placement, LookAt | None):
            raise InputError(f"a placement of the kind {type(placement).__name__} is not for a terrain: give a LookAt")
        return cls(terrain, settings=TerrainSettings(placement or LookAt()), policy=policy or Policy(), overlay=overlay)

    @property
    def name(self) -> str:
        return self.terrain.name

    def eye_m(self, display: Display) -> Vec3:
        """The reference eye before a whole display."""
        return self.reference_m or standing_viewer(display).position_m

    @property
    def alone_because(self) -> str:
        return ""

    @property
    def overlay_word(self) -> str:
        return self.overlay or "panels"

    def state(self, time_s: float, display: Display) -> LayerState:
        look_at = in_flight(self.settings.look_at, self.settings.flight, self.terrain, time_s)
        return LayerState(placement=look_at, policy=self.policy, overlay=self.overlay)

    def turned(self, state: LayerState, turn: Turn, display: Display) -> LayerState:
        """To the right: the land turns that way."""
        if turn == STILL:
            return state
        look = state.placement
        assert isinstance(look, LookAt)
        range_m = look.range_m or fitted_range_m(self.terrain, display, self.eye_m(display), look)
        placement = msgspec.structs.replace(
            look,
            heading_deg=look.heading_deg - turn.yaw_deg,
            pitch_deg=min(max(look.pitch_deg + turn.pitch_deg, 1.0), 90.0),
            range_m=range_m * turn.nearer,
        )
        return msgspec.structs.replace(state, placement=placement)

    def selector(self, display: Display, whole: Display) -> TerrainSelector:
        terrain, draped = self.terrain, self.draped
        scenery = Scenery(terrain.size_posts, terrain.spacing_m, terrain.nodes, terrain.patches, terrain.relief.pyramid)
        sources: tuple[Streaming, ...] = (
            patch_streaming(terrain),
            page_streaming(terrain.relief),
            page_streaming(terrain.heights),
        )
        contrast = None
        if draped is not None:
            contrast = KnownContrast(draped.image)
            scenery = scenery.draped(draped.image.pyramid, draped.texel_from_post, partial(contrast.detail, display))
            sources = *sources, page_streaming(draped.image)
        return TerrainSelector(
            scenery, display, self.settings, whole=whole, reference_m=self.eye_m(whole), sources=sources,
            contrast=contrast,
        )  # fmt: skip
