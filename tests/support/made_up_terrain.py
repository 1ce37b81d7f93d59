"""Terrains whose numbers are made up, and eyes before displays that look at them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from limen.data.terrain.model import Nodes, PatchTable, metric_from_posts
from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import pack
from limen.geometry import Floats
from limen.viewing.projection import PanelProjections, QuiltPanels

LEAF, BLOCK = 32, 256


def made_up_terrain(seed: int, roots: tuple[int, int] = (2, 1)) -> tuple[Nodes, PatchTable]:
    """A quadtree of ragged blocks; errors fall from node to child and from patch to patch, to 0 in the leaves."""
    random = np.random.default_rng(seed)
    columns, rows = roots[0] * BLOCK - random.integers(0, 100), roots[1] * BLOCK - random.integers(0, 100)
    rects, heights, children, firsts, node_of, errors, triangles = [], [], [], [0], [], [], []
    pending = []
    for row in range(roots[1]):
        for column in range(roots[0]):
            rect = (column * BLOCK, row * BLOCK, min((column + 1) * BLOCK, columns), min((row + 1) * BLOCK, rows))
            rects.append(rect)
            heights.append((0.0, 100.0))
            pending.append((len(rects) - 1, 20.0, BLOCK))
    while pending:
        node, error, size = pending.pop(0)
        while len(children) <= node:
            children.append([-1] * 4)
            firsts.append(0)
            node_of.append([])
            errors.append([])
        leaf = size <= LEAF
        steps = sorted(random.uniform(0.3 * error, error, random.integers(1, 4)), reverse=True)
        if leaf:
            steps.append(0.0)
        errors[node], node_of[node] = steps, [node] * len(steps)
        if leaf:
            continue
        c0, r0, c1, r1 = rects[node]
        half = size // 2
        for k in range(4):
            left, above = c0 + half * (k & 1), r0 + half * (k >> 1)
            if left < c1 and above < r1:
                rects.append((left, above, min(left + half, c1), min(above + half, r1)))
                low, high = heights[node]
                heights.append(tuple(sorted(random.uniform(low, high, 2))))
                children[node][k] = len(rects) - 1
                pending.append((len(rects) - 1, steps[-1], half))
    first = np.concatenate([[0], np.cumsum([len(part) for part in errors])]).astype(np.int32)
    error_m = np.array([error for part in errors for error in part], np.float32)
    triangles = (200 / (0.05 + error_m)).astype(np.int32) + 8
    nodes = Nodes(
        np.array(rects, np.int32), np.array(heights, np.float32), np.array(children, np.int32), first,
        roots[0] * roots[1],
    )  # fmt: skip
    table = PatchTable(np.concatenate(node_of).astype(np.int32), error_m, triangles // 2, triangles)
    return nodes, table


@dataclass(frozen=True)
class Scene:
    views: PanelProjections
    quilt_size_px: tuple[int, int]
    room_from_posts: Floats

    def placed(self, posts: Floats) -> Floats:
        """Column, row, height, shape (..., 3): the way from the eye, metres."""
        return posts @ self.room_from_posts[:3, :3].T + self.room_from_posts[:3, 3] - self.views.eye_m

    def pixel(self, panel: int, posts: Floats) -> tuple[Floats, Floats]:
        """Where places are drawn, quilt pixels from its middle, and w: the projection, one place at a time."""
        clip = self.placed(posts) @ self.views.clip[panel].T
        half = np.array(self.quilt_size_px) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            return clip[..., :2] / clip[..., 2:] * half, clip[..., 2]

    def sees(self, panel: int, posts: Floats) -> Floats:
        """Whether places are drawn within the panel's outline and guard."""
        way = self.placed(posts)
        inside = (way @ self.views.edges[panel].T >= 0).all(axis=-1)
        return np.asarray(
            self.views.facing[panel] & inside & (way @ self.views.clip[panel, 2] > self.views.near[panel])
        )


def made_up_scene(seed: int, panels: int = 2, columns: int = 512, rows: int = 256) -> Scene:
    """Panels of a folded wall, an eye before them, and a terrain behind, beside or through them."""
    random = np.random.default_rng(seed)
    made = []
    for number in range(panels):
        turn = Rotation.from_euler("yxz", random.uniform(-0.5, 0.5, 3))
        right, down = turn.apply([1.0, 0, 0]), turn.apply([0, -1.0, 0])
        origin = (number * 0.5 - 0.25 * panels, 0.3, random.uniform(-0.2, 0.2))
        made.append(Panel(f"p{number}", (400, 260), origin, tuple(right), tuple(down), (0.001, 0.0011)))
    display = Display("made up", tuple(made))
    (quilt,) = pack(display)
    eye = random.uniform([-0.5, -0.4, 0.6], [0.5, 0.4, 2.0])
    turn = Rotation.from_euler("xyz", random.uniform([-0.2, -3, -0.4], [1.5, 3, 0.4])).as_matrix()
    metric = metric_from_posts((3.0, 4.0), float(random.uniform(0.5, 3)))
    size_m = 10 ** random.uniform(0, 1.3)
    room = np.eye(4)
    room[:3, :3] = turn * size_m / (columns * 3.0)
    # A place of the terrain lies about where the eye looks through the display.
    post = np.append(random.uniform([0, 0, 0], [columns, rows, 100.0]), 1.0)
    ahead = np.array([0.0, 0.15, 0.0]) - eye
    room[:3, 3] = eye + ahead * random.uniform(0.2, 1) * size_m - room[:3, :3] @ (metric @ post)[:3]
    return Scene(QuiltPanels(display, quilt).seen_from(eye), quilt.size_px, room @ metric)
