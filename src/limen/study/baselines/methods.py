"""Ways to find the panels of a triangle: limen's own, and those that it is compared with."""

from __future__ import annotations

from typing import Literal, TypeAlias

from limen.layers.mesh.draw.sort import TriangleSorter
from limen.layers.mesh.draw.sorter import Sorter
from limen.study.baselines.sort_paper import PaperSorter
from limen.study.baselines.sort_whole import OctreeSorter, WholeScene

__all__ = ["METHODS", "Method"]

Method: TypeAlias = Literal["limen", "paper", "hierarchy", "per-panel"]
METHODS: dict[Method, type[Sorter]] = {
    "limen": TriangleSorter,
    "paper": PaperSorter,
    "hierarchy": OctreeSorter,
    "per-panel": WholeScene,
}
"""Ways to find the panels of a triangle: limen's own, and those that it is compared with."""
