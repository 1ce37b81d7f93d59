"""Terrains in memory, cut into regular grids: a patch source, and its pages of relief and heights."""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from limen.data.pages import GUTTER, PAGE, Pyramid
from limen.data.terrain.model import Nodes, Patch, PatchTable
from limen.data.terrain.tin_tree import exact_patch
from limen.errors import PageError
from support.trees import build_tree


class RasterPages:
    """A page source of RGBA texels in memory; coarser levels are given."""

    def __init__(self, levels: list[Any]) -> None:
        self.pyramid = Pyramid.of((levels[0].shape[1], levels[0].shape[0]))
        assert len(levels) == len(self.pyramid.levels)
        self.levels = levels

    def read_page(self, page: int) -> Any:
        level, column, row = self.pyramid.page_of(page)
        texels = self.levels[level]
        x = np.clip(np.arange(-GUTTER, PAGE + GUTTER) + column * PAGE, 0, texels.shape[1] - 1)
        y = np.clip(np.arange(-GUTTER, PAGE + GUTTER) + row * PAGE, 0, texels.shape[0] - 1)
        return np.ascontiguousarray(texels[y][:, x])


def halved(values: Any, valid: Any) -> tuple[Any, Any]:
    """Means of 2 x 2 valid texels, and how much of each is valid."""
    rows, columns = valid.shape[0] + valid.shape[0] % 2, valid.shape[1] + valid.shape[1] % 2
    share = np.zeros((rows, columns))
    share[: valid.shape[0], : valid.shape[1]] = valid
    total = np.zeros((rows, columns, values.shape[2]))
    total[: valid.shape[0], : valid.shape[1]] = values * valid[..., None]
    inside = np.zeros((rows, columns))
    inside[: valid.shape[0], : valid.shape[1]] = 1
    four = [np.s_[r::2, c::2] for r in (0, 1) for c in (0, 1)]
    weight = sum(share[part] for part in four)
    mean = sum(total[part] for part in four) / np.maximum(weight, 1e-9)[..., None]
    return mean, weight / sum(inside[part] for part in four)


def page_levels(values: Any, valid: Any, coded: Any) -> list[Any]:
    """RGBA levels of a raster: ``coded`` gives three bytes for values, shape (H, W, C) -> (H, W, 3)."""
    share = valid.astype(float)
    levels = []
    for _ in Pyramid.of((valid.shape[1], valid.shape[0])).levels:
        alpha = np.rint(share * 255).astype(np.uint8)
        levels.append(np.dstack([coded(values), alpha]))
        values, share = halved(values, share)
    return levels


def normals_of(heights: Any, spacing_m: tuple[float, float]) -> Any:
    """Unit normals (east, north, up), shape (H, W, 3)."""
    down, right = np.gradient(heights.astype(float), spacing_m[1], spacing_m[0])
    normal = np.dstack([-right, down, np.ones(heights.shape)])
    return normal / np.linalg.norm(normal, axis=2, keepdims=True)


class GridLand:
    """Heights on regular grids: a node's patch has four cells a side, a leaf's more and more down to every post.

    ``broken`` patches raise `PageError`; ``first_post`` moves everything, as a part of a far larger terrain.
    """

    def __init__(
        self, heights: Any, spacing_m: tuple[float, float] = (1.0, 1.0), *, leaf: int = 16,
        roots: tuple[int, int] = (1, 1), void: Any = None,
        broken: tuple[int, ...] = (), first_post: tuple[int, int] = (0, 0),
    ) -> None:  # fmt: skip
        self.heights_m = np.asarray(heights, np.float32)
        self.void = np.zeros(self.heights_m.shape, bool) if void is None else void
        self.spacing_m, self.leaf, self.broken, self.first_post = spacing_m, leaf, set(broken), first_post
        rows, columns = self.heights_m.shape
        self.size_posts = columns + first_post[0], rows + first_post[1]
        self.low_m, self.high_m = float(self.heights_m.min()), float(self.heights_m.max())
        self.low_high_m = self.low_m, self.high_m
        side = (columns - 1) // roots[0]
        assert (roots[0] * side + 1, roots[1] * side + 1) == (columns, rows)
        assert side % leaf == 0
        level = [(c * side, r * side, (c + 1) * side, (r + 1) * side) for r in range(roots[1]) for c in range(roots[0])]
        rects, children = [], []
        self.steps: list[list[int]] = []
        while level:
            following = []
            for left, top, right, bottom in level:
                size = right - left
                rects.append((left, top, right, bottom))
                if size <= leaf:
                    self.steps.append([leaf >> (2 + k) for k in range(leaf.bit_length() - 2)])
                    children.append([-1] * 4)
                    continue
                self.steps.append([size // 4])
                half = size // 2
                first = len(rects) - 1 + (len(level) - level.index((left, top, right, bottom))) + len(following)
                children.append(list(range(first, first + 4)))
                following += [
                    (left + half * c, top + half * r, left + half * (c + 1), top + half * (r + 1))
                    for r in (0, 1) for c in (0, 1)
                ]  # fmt: skip
            level = following
        self.patch_of = [(node, step) for node, steps in enumerate(self.steps) for step in steps]
        parts = [self.heights_m[y0 : y1 + 1, x0 : x1 + 1] for x0, y0, x1, y1 in rects]
        low_high = np.array([(part.min(), part.max()) for part in parts], np.float32)
        offset = np.array([*first_post, *first_post])
        counts = [len(steps) for steps in self.steps]
        self.rects = rects
        self.nodes = Nodes(
            (np.array(rects) + offset).astype(np.int32), low_high, np.array(children, np.int32),
            np.cumsum([0, *counts]).astype(np.int32), roots[0] * roots[1],
        )  # fmt: skip
        node = np.array([node for node, _ in self.patch_of], np.int32)
        cells = np.array([(rects[n][2] - rects[n][0]) // step for n, step in self.patch_of])
        exact = np.array([step == 1 for _, step in self.patch_of])
        # Whatever is drawn lies between the lowest and the highest post.
        error = np.where(exact, 0, low_high[node, 1] - low_high[node, 0])
        self.patches = PatchTable(
            node, error.astype(np.float32), ((cells + 1) ** 2).astype(np.int32), (2 * cells**2).astype(np.int32)
        )
        self.reads: list[int] = []

    @property
    def has_voids(self) -> bool:
        return bool(self.void.any())

    def read_patch(self, patch: int) -> Patch:
        self.reads.append(patch)
        if patch in self.broken:
            raise PageError(f"patch {patch} is broken")
        node, step = self.patch_of[patch]
        return grid_patch(self.heights_m, self.rects[node], step, self.first_post)

    @cached_property
    def relief(self) -> RasterPages:
        normals = normals_of(self.heights_m, self.spacing_m)
        return RasterPages(page_levels(normals, ~self.void, lambda n: np.rint(n * 127.5 + 127.5).astype(np.uint8)))

    @cached_property
    def heights(self) -> RasterPages:
        share = (self.heights_m.astype(float) - self.low_m) / max(self.high_m - self.low_m, 1e-9)
        return RasterPages(page_levels(share[..., None], ~self.void, height_code))


class TinLand(GridLand):
    """Heights triangulated as limen does, one root block; patches that hold every post are made when read."""

    def __init__(self, heights: Any, errors_m: Any, *, leaf: int = 16, max_triangles: int = 200) -> None:
        self.heights_m = np.asarray(heights, np.float32)
        self.void = np.zeros(self.heights_m.shape, bool)
        self.spacing_m, self.size_posts = (1.0, 1.0), self.heights_m.shape[::-1]
        self.low_m, self.high_m = float(self.heights_m.min()), float(self.heights_m.max())
        block = build_tree(self.heights_m, None, errors_m, leaf=leaf, max_triangles=max_triangles)
        self.nodes, self.patches, self.contents = block.nodes, block.patches, block.contents

    def read_patch(self, patch: int) -> Patch:
        content = self.contents[patch]
        if content is not None:
            return content
        left, top, right, bottom = self.nodes.rect[self.patches.node[patch]].tolist()
        part = np.ascontiguousarray(self.heights_m[top : bottom + 1, left : right + 1])
        return exact_patch(part, (left, top, right, bottom))


def height_code(share: Any) -> Any:
    code = np.rint(np.clip(share[..., 0], 0, 1) * (2**24 - 1)).astype(np.int64)
    return np.stack([code >> 16, code >> 8 & 255, code & 255], axis=-1).astype(np.uint8)


def grid_patch(heights: Any, rect: tuple[int, int, int, int], step: int, first_post: tuple[int, int]) -> Patch:
    """Cells of ``step`` posts; at the corners of the node the diagonal starts at the corner."""
    left, top, right, bottom = rect
    cells = (right - left) // step
    row, column = np.mgrid[top : bottom + 1 : step, left : right + 1 : step]
    posts = np.stack([column, row], axis=-1).reshape(-1, 2)
    number = np.arange(len(posts)).reshape(cells + 1, cells + 1)
    i, j = np.mgrid[:cells, :cells]
    last = cells - 1
    falling = (i + j) % 2 == 0
    falling[0, 0] = falling[last, last] = True
    falling[0, last] = falling[last, 0] = False
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    one = np.where(falling[..., None], np.stack([a, d, c], axis=-1), np.stack([a, d, b], axis=-1))
    two = np.where(falling[..., None], np.stack([a, c, b], axis=-1), np.stack([b, d, c], axis=-1))
    on_border = ((i == 0) | (j == 0) | (i == last) | (j == last)) & (step > 1)
    core = list(np.concatenate([one[~on_border], two[~on_border]]))
    rims, sides = [], []
    for triangle in np.concatenate([one[on_border], two[on_border]]).tolist():
        side = _border_of(triangle, cells)
        if side is None:
            core.append(triangle)
        else:
            rims.append(side[1])
            sides.append(side[0])
    borders = number[0], number[:, -1], number[-1], number[:, 0]
    return Patch(
        (posts + np.array(first_post)).astype(np.int32), heights[posts[:, 1], posts[:, 0]],
        np.array(core, np.uint16).reshape(-1, 3), np.array(rims, np.uint16).reshape(-1, 3),
        np.array(sides, np.uint8), tuple(border.astype(np.uint16) for border in borders),
    )  # fmt: skip


def _border_of(triangle: list[int], last: int) -> tuple[int, tuple[int, int, int]] | None:
    """The side on which a triangle has an edge, and the triangle with its apex first; vertices are numbered by rows."""
    at = [divmod(vertex, last + 1) for vertex in triangle]
    for k in range(3):
        (r0, c0), (r1, c1) = at[(k + 1) % 3], at[(k + 2) % 3]
        for side, on in enumerate((r0 == r1 == 0, c0 == c1 == last, r0 == r1 == last, c0 == c1 == 0)):
            if on:
                return side, (triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3])
    return None


def fans(patches: list[Patch], first_vertex: list[int]) -> Any:
    """The plain way to join borders: every rim fanned about its apex with all vertices that lie on its edge, (T, 3)."""
    on_line: dict[tuple[int, int], dict[int, int]] = {}
    for patch, first in zip(patches, first_vertex, strict=True):
        for side, border in enumerate(patch.sides):
            for vertex in border.tolist():
                post = patch.posts[vertex]
                line = on_line.setdefault((side % 2, int(post[1 - side % 2])), {})
                line.setdefault(int(post[side % 2]), first + vertex)
    triangles = []
    for patch, first in zip(patches, first_vertex, strict=True):
        for (apex, a, b), side in zip(patch.rims.tolist(), patch.rim_side.tolist(), strict=True):
            along = side % 2
            line = on_line[along, int(patch.posts[a][1 - along])]
            begin, end = int(patch.posts[a][along]), int(patch.posts[b][along])
            inner = sorted(place for place in line if min(begin, end) < place < max(begin, end))
            inner = inner if begin < end else inner[::-1]
            chain = [first + a, *(line[place] for place in inner), first + b]
            triangles += [(first + apex, one, two) for one, two in pairwise(chain)]
    return np.array(triangles, np.uint32).reshape(-1, 3)
