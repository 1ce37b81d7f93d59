"""What would have to move for a mesh or a cloud of points: triangles or splats a frame, with nothing kept between."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from limen.data.mesh.mesh import Mesh
from limen.data.mesh.store import tree_of
from limen.data.points.file import Points
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.geometry import Floats
from limen.layers.common.contrast_scale import acuity_scale
from limen.layers.mesh.select import FoldRequest, FoldTree, select_mesh
from limen.layers.points.layer import PointsLayer
from limen.stream.allocators import Slots
from limen.stream.chunks import completed
from limen.study.traffic import FRAMES_PER_S
from limen.track.session import Frame, Session
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, QuiltView, guard_of
from limen.viewing.state import FrameState, LayerState
from limen.viewing.tolerance import STANDS, tolerance_of

__all__ = ["SceneRow", "SceneSession", "SceneTraffic", "count_scene_traffic"]

_FULL = Policy("full")
_VERTEX_BYTES, _INDEX_BYTES, _SPLAT_BYTES = 32, 4, 16
"""Place, normal, colour and place in a texture; one of three corners; a node of a chunk."""

_SLOTS = 4096
"""Chunks kept in memory while counting: 307 MB."""


class SceneRow(msgspec.Struct, frozen=True):
    """One policy in one session."""

    policy: str
    acuity_arcmin: float | None
    items_mean: float
    """Triangles that are left of a mesh, or splats, each of these counted on every panel that shows it."""
    items_p99: float
    bytes_mean: float
    bytes_per_s: float
    """At 30 frames a second, whatever rate was sampled."""
    saving: float
    """Share of the bytes of ``full`` that need not move, 0 to 1."""
    distance_factor: float
    """The largest of any frame: how many times farther away viewers would have to be to see nothing of it."""


class SceneSession(msgspec.Struct, frozen=True):
    name: str
    frames: int
    duration_s: float
    viewers: int
    rows: list[SceneRow]


class SceneTraffic(msgspec.Struct, frozen=True):
    """What ``limen traffic --json`` prints for a mesh or points."""

    content: str
    display: str
    panels: int
    total_px: int
    items: str
    """``triangles`` or ``splats``."""
    size: int
    """Of all there are."""
    rate_hz: float
    sessions: list[SceneSession]


class _Counted(NamedTuple):
    items: int
    bytes: int
    factor: float


class _Source(Protocol):
    def counted(self, view: QuiltView, frame: Frame, policy: Policy) -> _Counted: ...
    def close(self) -> None: ...


def count_scene_traffic(
    content: Mesh | Points,
    name: str,
    display: Display,
    sessions: Sequence[Session],
    policies: Sequence[Policy],
    room_from_content: Floats,
    *,
    rate_hz: float = FRAMES_PER_S,
    advance: Callable[[], None] | None = None,
) -> SceneTraffic:
    """Triangles or splats that every frame of some sessions needs, as if nothing were left from the frame before.

    Parameters
    ----------
    name
        What the content is called.
    display
        The panels that count. Everything is drawn for the first viewer of a frame; all decide how fine.
    room_from_content
        A rotation, one scale and a move, (4, 4).
    advance
        Called after every frame.
    """
    quilts = pack_outlines(display, max_size_px=1 << 16, max_px=1 << 31)
    windows = [QuiltPanels(display, quilt, guard_px=guard_of(display, quilt)) for quilt in quilts]
    counts = _Triangles if isinstance(content, Mesh) else _Splats
    source: _Source = counts(content, display, room_from_content)  # type: ignore[arg-type]
    every = tuple(dict.fromkeys((*policies, _FULL)))
    counted = []
    try:
        for session in sessions:
            frames = list(session.frames(rate_hz))
            seen: dict[Policy, list[_Counted]] = {policy: [] for policy in every}
            for frame in frames:
                views = [QuiltView.of(each, [frame.viewers[0].position_m]) for each in windows]
                for policy in every:
                    parts = [source.counted(view, frame, policy) for view in views]
                    seen[policy].append(
                        _Counted(
                            sum(part.items for part in parts),
                            sum(part.bytes for part in parts),
                            max(part.factor for part in parts),
                        )
                    )
                if advance is not None:
                    advance()
            full = float(np.mean([each.bytes for each in seen[_FULL]]))
            rows = [_row(policy, seen[policy], full) for policy in policies]
            counted.append(SceneSession(session.name, len(frames), session.duration_s, len(session.tracks), rows))
    finally:
        source.close()
    items = "triangles" if isinstance(content, Mesh) else "splats"
    return SceneTraffic(
        name, display.name, len(display.panels), display.total_px, items, content.size, rate_hz, counted
    )


class _Triangles:
    def __init__(self, mesh: Mesh, display: Display, room_from_mesh: Floats) -> None:
        self._foldable, self._stands = FoldTree(tree_of(mesh)), room_from_mesh
        self._whites = [panel.luminance_cd_m2 for panel in display.panels]

    def counted(self, view: QuiltView, frame: Frame, policy: Policy) -> _Counted:
        if not view.facing.any():
            return _Counted(0, 0, 0.0)
        tolerance = tolerance_of(frame.viewers, policy.eyesight, STANDS)
        sight = FoldRequest(view.eyes, self._stands, tolerance, policy, acuity_scale(policy, self._whites))
        cut = select_mesh(self._foldable, sight)
        used = int(np.bincount(cut.triangles.ravel(), minlength=1).astype(bool).sum())
        return _Counted(len(cut), 3 * _INDEX_BYTES * len(cut) + _VERTEX_BYTES * used, cut.reached)

    def close(self) -> None:
        """There is nothing to be closed."""


class _Splats:
    def __init__(self, points: Points, display: Display, room_from_file: Floats) -> None:
        self._selector = PointsLayer(points, lit=True).selector(display, display)
        (source,) = self._selector.sources
        self._stream = source.stream(Slots(min(_SLOTS, points.chunks)), threads=2)
        self._stands = InRoom.of(room_from_file)

    def counted(self, view: QuiltView, frame: Frame, policy: Policy) -> _Counted:
        state, asked = LayerState(placement=self._stands, policy=policy), FrameState(viewers=frame.viewers)
        chosen = self._selector.select([view], state, asked, [self._stream.resident], live=False)
        for number, update in completed([(self._stream, chosen.wanted[0])]):
            self._selector.take(number, update)
        cut = self._selector.resolve(chosen, [self._stream.resident]).parts[0].cut
        return _Counted(len(cut), _SPLAT_BYTES * len(np.unique(cut.pairs[:, 0])), cut.reached)

    def close(self) -> None:
        self._stream.close()


def _row(policy: Policy, counted: Sequence[_Counted], full_bytes: float) -> SceneRow:
    items, moved = (np.array([each[n] for each in counted], dtype=float) for n in range(2))
    return SceneRow(
        policy=policy.title,
        acuity_arcmin=None if policy.name in ("full", "size") else policy.acuity_arcmin,
        items_mean=float(items.mean()),
        items_p99=float(np.percentile(items, 99)),
        bytes_mean=float(moved.mean()),
        bytes_per_s=float(moved.mean()) * FRAMES_PER_S,
        saving=1 - float(moved.mean()) / full_bytes if full_bytes else 0.0,
        distance_factor=max(each.factor for each in counted),
    )
