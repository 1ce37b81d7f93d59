"""Frames of renderers that show one layer, of which something is other than the layer says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from limen.frame.renderer import Renderer
from limen.viewing.state import FrameState
from limen.viewing.viewer import Viewer

__all__ = ["frame_of"]


def frame_of(renderer: Renderer, viewers: Sequence[Viewer], **changed: Any) -> FrameState:
    """The message of a frame for these viewers; ``changed``: fields of its one `limen.viewing.state.LayerState`."""
    frame = renderer.state(0.0, viewers=tuple(viewers))
    (layer,) = frame.layers
    return msgspec.structs.replace(frame, layers=(msgspec.structs.replace(layer, **changed),))
