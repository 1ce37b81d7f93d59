"""Renderers of small contents of every kind."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from limen.frame.renderer import Renderer
from limen.layers.base import Layer
from support.contents import kind, knot, layer, layers, terrain, world
from support.frames import MEMORY, WALL, Make

__all__ = ["kind", "knot", "layer", "layers", "make", "terrain", "world"]


@pytest.fixture
def make(device: Any, layer: Layer) -> Iterator[Make]:
    """Makes renderers of the layer."""
    made: list[Renderer] = []

    def renderer(**options: Any) -> Renderer:
        made.append(Renderer(device, WALL, [layer], **({"gpu_bytes": MEMORY} | options)))
        return made[-1]

    yield renderer
    for each in made:
        each.close()
