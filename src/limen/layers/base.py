"""What a kind of layer is: content, what decides about its detail, and what draws it. No GPU and no files here.

A frame is made in five steps: `Selector.select` says what every layer is to show and which chunks that takes; the
chunks are asked for, and what has come is handed to `Selector.take` and `Drawer.upload`; `Selector.resolve` says what
can be shown of it now; `Drawer.prepare` and `Drawer.draw` draw it, quilt by quilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.geometry import Floats
from limen.stream.chunks import Allocator, Index, Resident, Streaming, Update
from limen.viewing.projection import QuiltView
from limen.viewing.state import FrameState, LayerState

__all__ = ["STILL", "Cut", "CutCounts", "Drawer", "Layer", "Residents", "Selector", "Turn", "in_order"]

Part = TypeVar("Part")
Part_contra = TypeVar("Part_contra", contravariant=True)
Residents: TypeAlias = Sequence[Resident]
"""What is there of each of a selector's sources."""


class Turn(NamedTuple):
    """What dragging and the wheel have done to what is behind a window."""

    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    nearer: float = 1.0


STILL = Turn()


class CutCounts(NamedTuple):
    """What is told of one layer in one frame."""

    items: int = 0
    """What it is made of, in the quilt that has most of it: pages of an image, triangles of a mesh, patches of a
    terrain, splats of points."""
    drawn: int = 0
    """Triangles or splats, once for every panel that they are drawn on."""
    panels_active: int = 0
    error_px: float = 0.0
    """The largest that is left out or made wrong, in pixels of its panel."""
    allowed_px: tuple[float, float] | None = None
    """The smallest and the largest error that active panels may have, where it is one for each panel."""
    distance_factor: float | None = None
    """How many times farther away all viewers would have to be for nobody to see what is left out: 1 or less, where
    they are nobody can. None where that is not known."""


@dataclass(frozen=True, slots=True, eq=False)
class Cut(Generic[Part]):
    """What one layer shows in one frame.

    Parameters
    ----------
    parts
        One for each view that it was selected for: what its drawer draws there.
    counts
        Of all of them.
    wanted, soon
        Chunks of each source, the most important first: those that the frame shows, and those that will be wanted
        shortly.
    drawn
        Chunks of each source that are drawn, in place of missing ones too; known when it has been resolved.
    near_m
        How far from each view's nearest eye the layer begins: one for each part.
    """

    parts: tuple[Part, ...]
    counts: CutCounts
    wanted: tuple[Index, ...] = ()
    soon: tuple[Index | None, ...] = ()
    drawn: tuple[Index, ...] = ()
    near_m: tuple[float, ...] = ()


class Selector(Protocol[Part]):
    """Decides what a layer shows on a display: arrays in, arrays out; no clock, no waiting, no GPU."""

    @property
    def sources(self) -> tuple[Streaming, ...]:
        """What chunks are read from: nothing, or one source and more."""
        ...

    def complete(self, state: LayerState) -> None:
        """Wait for what is still being found out about the content (its contrast); live frames do without it."""
        ...

    def select(
        self, views: Sequence[QuiltView], state: LayerState, frame: FrameState, resident: Residents, *, live: bool
    ) -> Cut[Part]:
        """What the layer is to show on these views.

        ``live``: as the next of many frames, which may remember the ones before; else by itself.
        """
        ...

    def take(self, source: int, update: Update[Any]) -> None:
        """What has come of a source, and gone, for selectors that look into chunks."""
        ...

    def resolve(self, cut: Cut[Part], resident: Residents) -> Cut[Part]:
        """What of it can be shown by what is there now."""
        ...

    def close(self) -> None: ...


class Drawer(Protocol[Part_contra]):
    """Draws what a selector chose: the only part of a layer that sees the GPU."""

    @property
    def allocators(self) -> tuple[Allocator, ...]:
        """Where chunks of each source lie."""
        ...

    def upload(self, source: int, update: Update[Any]) -> None:
        """Copy what has come of a source to where it is drawn from."""
        ...

    def prepare(self, view: QuiltView, part: Part_contra, overlay: str) -> None:
        """What has to be found out by the GPU before drawing; may wait for it."""
        ...

    def draw(self, encoder: Any, target: Any, view: QuiltView, part: Part_contra, overlay: str) -> None:
        """Record the passes of one view into a `limen.gpu.targets.Target`."""
        ...

    def triangles(self, *, wait: bool) -> int:
        """How many triangles the last view had beside those of the cut; 0 where only waiting for the GPU would tell."""
        ...

    def destroy(self) -> None: ...


class Layer(Protocol):
    """One thing shown: content, and how it looks. Knows no GPU."""

    kind: ClassVar[str]

    @property
    def name(self) -> str: ...

    @property
    def overlay_word(self) -> str:
        """What is shown over it when somebody asks for an overlay: one of its kind's words."""
        ...

    @property
    def alone_because(self) -> str:
        """Why it can only be shown alone, in words that follow "beside other layers"; nothing if it need not."""
        ...

    def state(self, time_s: float, display: Display) -> LayerState:
        """How it lies on a whole display at a time: by its own flight, turning, moving lenses."""
        ...

    def turned(self, state: LayerState, turn: Turn, display: Display) -> LayerState:
        """The same after it was dragged."""
        ...

    def selector(self, display: Display, whole: Display) -> Selector[Any]:
        """What decides about it on a display, which may be a part of a whole one."""
        ...


def in_order(parts: Sequence[tuple[NDArray[np.int64], Floats]]) -> Index:
    """Distinct numbers of several lists with their importance, the most important first."""
    if len(parts) == 1:
        return parts[0][0]
    numbers, importance = (np.concatenate([part[which] for part in parts]) for which in (0, 1))
    ordered = numbers[np.argsort(-importance, kind="stable")].astype(np.int64)
    _, first = np.unique(ordered, return_index=True)
    return np.asarray(ordered[np.sort(first)])
