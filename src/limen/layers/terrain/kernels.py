"""Compiled parts of `limen.layers.terrain.select` and `limen.layers.terrain.pages`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.compiled import compiled

__all__ = ["PageNumbering", "Tree", "error_px", "finest_demand_m", "nearest_w", "permitted_m", "walk", "wanted_pages"]

_TINY_W = 1e-9
_MOST_PX = 1e30
_LEAST_PX = 1.0 / 16
_ALMOST_ONE = 1.0 - 1e-12
_SHADER_SLACK = 1e-3  # single precision, and derivatives taken as differences
_STACK = 160  # three for each level of a quadtree, and the one looked at


class Tree(NamedTuple):
    """What the walk asks of `limen.data.terrain.model.Nodes` and `PatchTable`."""

    rect: NDArray[np.int32]  # (N, 4)
    low_high_m: NDArray[np.float32]  # (N, 2)
    children: NDArray[np.int32]  # (N, 4)
    first_patch: NDArray[np.int32]  # (N + 1,)
    error_m: NDArray[np.float32]  # (P,)
    roots: int


class PageNumbering(NamedTuple):
    """A pyramid's numbering, one entry a level."""

    columns: NDArray[np.int64]
    rows: NDArray[np.int64]
    first: NDArray[np.int64]


@compiled(error_model="python")
def _spread(form, box):
    """Value of a form in the middle of a box, and how much it differs from that at the most."""
    middle, reach = form[3], 0.0
    for axis in range(3):
        middle += form[axis] * 0.5 * (box[axis] + box[axis + 3])
        reach += abs(form[axis]) * 0.5 * (box[axis + 3] - box[axis])
    return middle, reach


@compiled(error_model="python")
def nearest_w(box, p, forms):
    """Smallest w over a box (column, row, height from and to), and over what panel ``p`` sees of it.

    What it sees is at least as far as the box, in a direction at least as steep to the panel as the flattest to its
    corners, and beyond the near plane. The second number is negative if the panel sees nothing of the box: all of it
    lies beyond one of the outline's edges, or before the near plane.
    """
    for k in range(forms.edge_count[p]):
        middle, reach = _spread(forms.edges[p, k], box)
        if middle + reach < 0.0:
            return 0.0, -1.0
    middle, reach = _spread(forms.w[p], box)
    if middle + reach <= forms.near[p]:
        return 0.0, -1.0
    square = 0.0
    for axis in range(3):
        gap = max(box[axis] - forms.eye[axis], forms.eye[axis] - box[axis + 3], 0.0) * forms.step_m[axis]
        square += gap * gap
    least = middle - reach
    return least, max(least, math.sqrt(square) * forms.cosine[p], forms.near[p])


@compiled(error_model="python")
def error_px(error_m, p, forms, least, seen):
    """How many pixels of panel ``p`` an error of height reaches at most; ``least`` and ``seen`` from `nearest_w`."""
    if error_m <= 0.0:
        return 0.0
    w = max(seen - error_m * forms.w_per_m[p], least, _TINY_W)
    return min(error_m * forms.px_per_m[p] / w, _MOST_PX)


@compiled(error_model="python")
def permitted_m(allowed_px, p, forms, least, seen):
    """The largest error of height whose `error_px` is no more than allowed."""
    per_m = max(forms.px_per_m[p], 1e-300)
    permitted = allowed_px * seen / (per_m + allowed_px * forms.w_per_m[p])
    if least > 0.0:
        permitted = max(permitted, allowed_px * least / per_m)
    return permitted * _ALMOST_ONE


@compiled(error_model="python")
def _box_of(n, tree, box):
    box[0], box[1], box[2] = tree.rect[n, 0], tree.rect[n, 1], tree.low_high_m[n, 0]
    box[3], box[4], box[5] = tree.rect[n, 2], tree.rect[n, 3], tree.low_high_m[n, 1]


@compiled(error_model="python")
def _chosen(n, tree, available, permitted):
    """The coarsest patch that is there and fine enough, else the finest that is there, else -1; and whether it is."""
    finest = -1
    for patch in range(tree.first_patch[n], tree.first_patch[n + 1]):
        if len(available) == 0 or available[patch] or (n < tree.roots and patch == tree.first_patch[n]):
            finest = patch
            if tree.error_m[patch] <= permitted:
                return finest, True
    return finest, False


@compiled(error_model="python")
def _seen_children(n, p, tree, forms, available, box, seen_of):
    """Whether a node can be left for its children: there are some, and of each that panel ``p`` sees a patch is there.

    ``seen_of`` (4, 3) takes the child, or -1 where nothing is seen, and what `nearest_w` says of it.
    """
    some = False
    for k in range(4):
        child = tree.children[n, k]
        seen_of[k, 0] = -1.0
        if child < 0:
            continue
        some = True
        _box_of(child, tree, box)
        least, seen = nearest_w(box, p, forms)
        if seen < 0.0:
            continue
        if _chosen(child, tree, available, np.inf)[0] < 0:
            return False
        seen_of[k, 0], seen_of[k, 1], seen_of[k, 2] = child, least, seen
    return some


@compiled(error_model="python")
def finest_demand_m(tree, forms, drawn, allowed_px, scale):
    """The smallest error that any leaf seen by each panel permits, metres of height, shape (N,); infinite for none.

    A node permits no more than the leaves in it, whose boxes are smaller, so one that permits more than a leaf found
    already is not looked into.
    """
    demand = np.full(len(drawn), np.inf)
    stack, box = np.empty(_STACK + tree.roots, np.int64), np.empty(6)
    for p in range(len(drawn)):
        depth = tree.roots if drawn[p] else 0
        for root in range(depth):
            stack[root] = root
        while depth:
            depth -= 1
            n = stack[depth]
            _box_of(n, tree, box)
            least, seen = nearest_w(box, p, forms)
            if seen < 0.0:
                continue
            permitted = permitted_m(allowed_px[p], p, forms, least, seen) * scale
            if permitted >= demand[p]:
                continue
            leaf = True
            for k in range(4):
                if tree.children[n, k] >= 0:
                    stack[depth] = tree.children[n, k]
                    depth += 1
                    leaf = False
            if leaf:
                demand[p] = permitted
    return demand


@compiled(error_model="python")
def _longer(values):
    longer = np.empty((2 * len(values), values.shape[1]))
    for row in range(len(values)):
        for column in range(values.shape[1]):
            longer[row, column] = values[row, column]
    return longer


@compiled(error_model="python")
def walk(tree, forms, drawn, allowed_px, scale, level_m, available):
    """The cut of every panel that is ``drawn``.

    Parameters
    ----------
    allowed_px
        Largest error of each panel, shape (N,).
    scale
        Errors permitted, in metres of height, are multiplied by it.
    level_m
        Shape (N,): no more is permitted anywhere on a panel.
    available
        Which patches can be drawn, shape (P,), or (0,) if all can.

    Returns
    -------
    pairs
        Shape (M, 3): panel, patch, error in pixels at most.
    importance
        Shape (P,): for patches that are needed (and the first ones of the nodes on the way to them), by how much the
        allowed error would be exceeded if the first patch of the node above were drawn instead.
    """
    pairs, count = np.empty((1024, 3)), 0
    importance = np.zeros(len(tree.error_m))
    stack, box, seen_of = np.empty((_STACK, 4)), np.empty(6), np.empty((4, 3))
    for p in range(len(drawn)):
        if not drawn[p]:
            continue
        least_px = max(allowed_px[p], _LEAST_PX)
        for root in range(tree.roots):
            _box_of(root, tree, box)
            least, seen = nearest_w(box, p, forms)
            if seen < 0.0:
                continue
            stack[0, 0], stack[0, 1], stack[0, 2] = root, least, seen
            stack[0, 3] = error_px(tree.error_m[tree.first_patch[root]], p, forms, least, seen) / least_px
            depth = 1
            while depth:
                depth -= 1
                n, least, seen, excess = int(stack[depth, 0]), stack[depth, 1], stack[depth, 2], stack[depth, 3]
                permitted = min(permitted_m(allowed_px[p], p, forms, least, seen) * scale, level_m[p])
                patch, enough = _chosen(n, tree, available, permitted)
                if not enough and _seen_children(n, p, tree, forms, available, box, seen_of):
                    first = tree.first_patch[n]
                    importance[first] = max(importance[first], excess)
                    without = error_px(tree.error_m[first], p, forms, least, seen) / least_px
                    for k in range(4):
                        if seen_of[k, 0] >= 0.0:
                            for part in range(3):
                                stack[depth, part] = seen_of[k, part]
                            stack[depth, 3] = without
                            depth += 1
                    continue
                importance[patch] = max(importance[patch], excess)
                if count == len(pairs):
                    pairs = _longer(pairs)
                pairs[count, 0], pairs[count, 1] = p, patch
                pairs[count, 2] = error_px(tree.error_m[patch], p, forms, least, seen)
                count += 1
    return pairs[:count], importance


@compiled(error_model="python")
def wanted_pages(pair_panel, pair_box, forms, grid, page, tolerance_px, allowed_px, hides_faint, tau, importance):
    """Marks every page that some pixel of a pair asks for: see `limen.layers.terrain.pages.pages_for_terrain`.

    From the coarsest page down, a page is left for the four below it where what a panel sees of the node in it may ask
    for a finer level, and on panels that hide what is faint, if that may be seen (``tau``, see
    `limen.layers.common.page_detail.Detail`). ``pair_box``, shape (M, 6), and ``forms`` count texels of full resolution
    in place of posts. ``importance``, shape (pages,), takes how many times too large the texels of the next coarser
    level would be.
    """
    stack, box = np.empty((_STACK, 3), np.int64), np.empty(6)
    for pair in range(len(pair_panel)):
        p, whole = pair_panel[pair], pair_box[pair]
        stack[0, 0], stack[0, 1], stack[0, 2] = len(grid.first) - 1, 0, 0
        depth = 1
        while depth:
            depth -= 1
            level, column, row = stack[depth, 0], stack[depth, 1], stack[depth, 2]
            span = page * 2.0**level
            box[2], box[5] = whole[2], whole[5]
            box[0], box[3] = max(whole[0], column * span), min(whole[3], (column + 1) * span)
            box[1], box[4] = max(whole[1], row * span), min(whole[4], (row + 1) * span)
            if box[0] > box[3] or box[1] > box[4]:
                continue
            seen = nearest_w(box, p, forms)[1]
            if seen < 0.0:
                continue
            footprint = seen / forms.px_per_post[p] * (1.0 - _SHADER_SLACK)
            texels = footprint * tolerance_px[p]
            number = grid.first[level] + row * grid.columns[level] + column
            importance[number] = max(importance[number], 2.0 ** (level + 1) / texels)
            if level == 0 or texels >= 2.0**level or (hides_faint[p] and footprint * allowed_px[p] >= tau[number]):
                continue
            for k in range(4):
                x, y = 2 * column + (k & 1), 2 * row + (k >> 1)
                if x < grid.columns[level - 1] and y < grid.rows[level - 1]:
                    stack[depth, 0], stack[depth, 1], stack[depth, 2] = level - 1, x, y
                    depth += 1
