"""Where live frames come from: who looks, what hands and keys have changed, and the one clock of all windows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import msgspec

from limen.display.display import Display
from limen.layers.registry import KINDS
from limen.show.canvas import Surface
from limen.show.hands import Hand
from limen.show.show import Show, Tour
from limen.viewing.policy import Policy
from limen.viewing.state import FrameState, LayerState
from limen.viewing.viewer import Viewer

__all__ = ["FrameSource", "LiveFrames"]


class FrameSource(Protocol):
    """What says what every frame shows: people and hands on this machine, or another one."""

    closed: bool

    def next(self, surface: Surface, display: Display) -> FrameState:
        """The frame of a surface's time, on the display that it shows."""
        ...

    def handle(self, event: Mapping[str, Any]) -> bool:
        """Take note of an event; whether frames are other ones from now on, at the same time too."""
        ...

    def framed_from(self, viewer: Viewer) -> Viewer:
        """From where a picture of the display, as this viewer sees it, would be as wide as it."""
        ...


class LiveFrames:
    """Frames of a show as time passes, people walk, and somebody drags and types.

    Parameters
    ----------
    who
        Who looks at what time; or who stands where at first, whom a hand may lead.
    overlay
        Whether overlays are shown at first; by default as the layers say.
    """

    keys = "o overlay   p policy   space pause   q close"

    def __init__(self, show: Show, who: Tour | Viewer, hand: Hand, *, overlay: bool | None = None) -> None:
        self._show, self._who, self._hand, self._overlay = show, who, hand, overlay
        self._overlaid = self._other_policy = False
        self._clock_s, self._last_s, self._paused = 0.0, 0.0, False
        self.closed = False

    def next(self, surface: Surface, display: Display) -> FrameState:
        self._clock_s += 0.0 if self._paused else surface.time_s - self._last_s
        self._last_s = surface.time_s
        if isinstance(self._who, Viewer):
            viewers, time_s = [self._hand.led(replace(self._who, time_s=self._clock_s))], self._clock_s
        else:  # a session's time is that of what was recorded
            viewers = list(self._who(self._clock_s)) or [self._show.stands]
            time_s = viewers[0].time_s
        frame = self._show.frame(
            display, time_s, viewers, turn=self._hand.turn, overlay=self._overlay, paused=self._paused
        )
        self._overlaid = any(state.overlay for state in frame.layers)
        if self._other_policy:
            frame = msgspec.structs.replace(frame, layers=tuple(self._otherwise(*each) for each in self._layers(frame)))
        return self._hand.placed(frame, display, surface)

    def handle(self, event: Mapping[str, Any]) -> bool:
        self._hand.handle(event)
        if event["event_type"] != "key_down":
            return False
        match event["key"]:
            case "o":
                self._overlay = not self._overlaid
            case "p":
                self._other_policy = not self._other_policy
            case " ":
                self._paused = not self._paused
                return False
            case "q" | "Escape":
                self.closed = True
            case _:
                return False
        return True

    def framed_from(self, viewer: Viewer) -> Viewer:
        return self._hand.framed_from(self._who) if isinstance(self._who, Viewer) else viewer

    def _layers(self, frame: FrameState) -> list[tuple[str, LayerState]]:
        return [(layer.kind, state) for layer, state in zip(self._show.layers, frame.layers, strict=True)]

    def _otherwise(self, kind: str, state: LayerState) -> LayerState:
        """In full detail; if it is already, as its kind is drawn where nothing is said."""
        policy = Policy("full") if state.policy.name != "full" else Policy.parse(KINDS[kind].default_policy)
        return msgspec.structs.replace(state, policy=policy)
