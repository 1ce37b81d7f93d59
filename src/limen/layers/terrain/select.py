"""Which patches of a terrain every panel draws: a cut of the quadtree that keeps each panel's error.

References
----------
The paper's one level a panel, and errors in pixels of the panel: *Dynamic level of detail for tiled large
high-resolution displays*. A quadtree of patches with a known error each: Ulrich 2002, *Rendering Massive Terrains
Using Chunked Level of Detail Control*.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Nodes, PatchTable
from limen.errors import InputError
from limen.geometry import Floats
from limen.layers.terrain import kernels
from limen.layers.terrain.forms import TerrainForms, terrain_forms
from limen.viewing.choices import MODES, Mode
from limen.viewing.projection import PanelProjections

__all__ = ["TerrainCut", "select_terrain"]

_STEPS_PER_OCTAVE = 2
_MOST_STEPS = 128
_LEAST_PX = 1 / 16
"""Where a budget asks for coarser patches, a tolerance counts as at least that: no multiple of nothing is more."""


@dataclass(frozen=True, slots=True)
class TerrainCut:
    """The patches of a terrain that one frame needs.

    Parameters
    ----------
    pair_panel, pair_patch
        Which patch is drawn on which panel, shape (M,) each, panel by panel. What a panel sees lies in one patch each.
    pair_error_px
        How far, at most, anything of the patch is from where it should be on that panel, pixels, shape (M,).
    panel_error_px
        The largest of those on each panel, shape (N,); 0 where nothing is drawn.
    patches
        What has to be resident for this cut: all patches drawn, and the first one of every node above them, because a
        node is only left for its children when all of those can be drawn. Distinct, the most important first, (K,).
    importance
        By how much the allowed error is exceeded while a patch is missing, shape (K,); a node's is never more than
        that of the node above it.
    triangles
        Of all pairs, as they are without their neighbours.
    bias_octaves
        Errors permitted were multiplied by two to this power to stay within the budget.
    denied
        Patches that were wanted and did not fit into the budget.
    """

    pair_panel: NDArray[np.int64]
    pair_patch: NDArray[np.int64]
    pair_error_px: Floats
    panel_error_px: Floats
    patches: NDArray[np.int64]
    importance: Floats
    triangles: int
    bias_octaves: float = 0.0
    denied: int = 0

    def __len__(self) -> int:
        return len(self.pair_patch)


def select_terrain(
    nodes: Nodes,
    patches: PatchTable,
    views: PanelProjections,
    quilt_size_px: tuple[int, int],
    room_from_posts: Floats,
    allowed_px: Floats,
    *,
    mode: Mode = "adaptive",
    available: NDArray[np.bool_] | None = None,
    max_triangles: int | None = None,
) -> TerrainCut:
    """The cut of every panel.

    Parameters
    ----------
    views
        The panels as the eye sees them that the picture is drawn for.
    quilt_size_px
        Width and height of all that the clip space of ``views`` spans, copies included.
    room_from_posts
        Affine map of shape (4, 4): (column, row, height in metres) to room metres.
    allowed_px
        The largest error that stays invisible on each panel, pixels, shape (N,); infinite: the panel is not drawn.
    mode
        ``adaptive``: on every panel, a node's coarsest patch that errs by no more than allowed, or its children.
        ``level``: the same, and nowhere on a panel more metres than its most demanding leaf may err by.
    available
        Which patches are resident, shape (P,); the roots' first ones count as resident. A node is left for its
        children if every child seen has one; within a node the coarsest that is fine enough is taken, else the finest.
        By default all are.
    max_triangles
        Budget: where the cut has more, the errors permitted are multiplied by half octaves until it fits.

    Raises
    ------
    InputError
        If shapes disagree, a tolerance is negative or no number, or the terrain is sheared.
    """
    allowed = _checked_allowed(allowed_px, len(views.near))
    if mode not in MODES:
        raise InputError(f"mode must be one of {', '.join(MODES)}, got {mode!r}")
    if available is not None and available.shape != patches.error_m.shape:
        raise InputError(f"available must tell of {len(patches.error_m)} patches, got shape {available.shape}")
    if max_triangles is not None and max_triangles < 1:
        raise InputError(f"max_triangles must be at least 1, got {max_triangles}")
    resident = np.empty(0, dtype=np.bool_) if available is None else np.ascontiguousarray(available, dtype=np.bool_)
    drawn = views.facing & np.isfinite(allowed)
    forms = terrain_forms(views, quilt_size_px, room_from_posts)
    asked = _Asked(_tree(nodes, patches), patches, forms, drawn, allowed, mode, resident)
    cut = _cut_at(asked, 0)
    if max_triangles is None or cut.triangles <= max_triangles:
        return cut
    fitting = _fitting(asked, max_triangles)
    return replace(fitting, denied=max(len(cut.patches) - len(fitting.patches), 0))


def _tree(nodes: Nodes, patches: PatchTable) -> kernels.Tree:
    """What the kernels ask of a terrain."""
    return kernels.Tree(
        np.ascontiguousarray(nodes.rect, dtype=np.int32),
        np.ascontiguousarray(nodes.low_high_m, dtype=np.float32),
        np.ascontiguousarray(nodes.children, dtype=np.int32),
        np.ascontiguousarray(nodes.first_patch, dtype=np.int32),
        np.ascontiguousarray(patches.error_m, dtype=np.float32),
        int(nodes.roots),
    )


class _Asked(NamedTuple):
    tree: kernels.Tree
    patches: PatchTable
    forms: TerrainForms
    drawn: NDArray[np.bool_]
    allowed_px: Floats
    mode: Mode
    available: NDArray[np.bool_]


def _checked_allowed(allowed_px: Floats, panels: int) -> Floats:
    allowed = np.ascontiguousarray(allowed_px, dtype=float)
    if allowed.shape != (panels,):
        raise InputError(f"allowed_px must have one number for each of {panels} panels, got shape {allowed.shape}")
    if not (allowed >= 0).all():
        raise InputError("allowed_px must not be negative, and be a number")
    return allowed


def _fitting(asked: _Asked, max_triangles: int) -> TerrainCut:
    """The first cut, in half octaves, that has no more triangles; the coarsest if none has."""
    low, high = 0, _MOST_STEPS
    fitting = _cut_at(asked, high)
    while high - low > 1:
        middle = (low + high) // 2
        cut = _cut_at(asked, middle)
        if cut.triangles <= max_triangles:
            high, fitting = middle, cut
        else:
            low = middle
    return fitting


def _cut_at(asked: _Asked, steps: int) -> TerrainCut:
    """The cut with errors permitted that are a number of half octaves larger."""
    scale = 2.0 ** (steps / _STEPS_PER_OCTAVE)
    allowed = np.maximum(asked.allowed_px, _LEAST_PX) if steps else asked.allowed_px
    level_m = np.full(len(allowed), np.inf)
    if asked.mode == "level":
        level_m = kernels.finest_demand_m(asked.tree, asked.forms, asked.drawn, allowed, scale)
    pairs, importance = kernels.walk(asked.tree, asked.forms, asked.drawn, allowed, scale, level_m, asked.available)
    panel, patch = pairs[:, 0].astype(np.int64), pairs[:, 1].astype(np.int64)
    panel_error_px = np.zeros(len(allowed))
    np.maximum.at(panel_error_px, panel, pairs[:, 2])
    # A patch without error is important nowhere, and yet drawn: what the panels draw is needed whatever its importance.
    needed = importance > 0
    needed[patch] = True
    wanted = np.flatnonzero(needed)
    wanted = wanted[np.argsort(-importance[wanted], kind="stable")]
    return TerrainCut(
        panel, patch, np.ascontiguousarray(pairs[:, 2]), panel_error_px, wanted, importance[wanted],
        int(asked.patches.triangles[patch].sum(dtype=np.int64)), steps / _STEPS_PER_OCTAVE,
    )  # fmt: skip
