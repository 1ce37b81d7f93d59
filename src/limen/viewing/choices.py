"""Words that callers choose between, apart from what they choose: a help text needs no renderer."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

__all__ = ["CAMERAS", "MODES", "STEREOS", "Animation", "CameraKind", "Depth", "Mode", "Stereo"]

Animation: TypeAlias = Literal["none", "ripple", "turn"]
"""How a mesh or a cloud moves."""

CameraKind: TypeAlias = Literal["window", "fixed"]
"""What a terrain is seen through: panels as windows, or one picture for the whole display."""

Depth: TypeAlias = Literal["panel", "shared"]
"""Whose depth decides what is in front in a mesh: every panel's own, or the viewer camera's."""

Mode: TypeAlias = Literal["adaptive", "level"]
"""How a terrain's triangles are cut: as few as may be, or one error for each panel."""

Stereo: TypeAlias = Literal["none", "anaglyph", "side-by-side", "sequential"]
"""How a mesh is drawn for two eyes."""

CAMERAS: tuple[CameraKind, ...] = get_args(CameraKind)
MODES: tuple[Mode, ...] = get_args(Mode)
STEREOS: tuple[Stereo, ...] = get_args(Stereo)
