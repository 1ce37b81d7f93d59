"""Plain references for triangulations of a terrain: joining patches at their borders, and the error by brute force."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from limen.data.terrain.model import Patch

Post = tuple[int, int]
Triangle = tuple[Post, Post, Post]


def hills(rows: int, columns: int, *, seed: int = 0, roughness: float = 0.6, relief_m: float = 100.0):
    """Heights (rows, columns) of a random surface with spectrum 1 / f^(1 + roughness)."""
    rng = np.random.default_rng(seed)
    size = 1 << (max(rows, columns) - 1).bit_length()
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    frequency[0, 0] = np.inf
    noise = rng.standard_normal((size, size // 2 + 1)) + 1j * rng.standard_normal((size, size // 2 + 1))
    surface = np.fft.irfft2(noise * frequency ** (-1.0 - roughness), (size, size))[:rows, :columns]
    return (surface / max(surface.std(), 1e-12) * relief_m).astype(np.float32)


def side_posts(patches: Iterable[Patch]) -> set[Post]:
    """All vertices on the borders of patches."""
    return {(int(x), int(y)) for p in patches for side in p.sides for x, y in p.posts[side]}


def fanned(patch: Patch, border: set[Post]) -> list[Triangle]:
    """Triangles of a patch whose rims carry all posts of ``border`` that lie on them."""
    posts = [(int(x), int(y)) for x, y in patch.posts]
    triangles = [(posts[a], posts[b], posts[c]) for a, b, c in patch.core]
    for apex, a, b in patch.rims:
        (ax, ay), (bx, by) = posts[a], posts[b]
        steps = max(abs(bx - ax), abs(by - ay))
        dx, dy = (bx - ax) // steps, (by - ay) // steps
        ends = [(ax + k * dx, ay + k * dy) for k in range(steps + 1)]
        ends = [end for k, end in enumerate(ends) if k in (0, steps) or end in border]
        triangles += [(posts[apex], ends[k], ends[k + 1]) for k in range(len(ends) - 1)]
    return triangles


def twice_area(triangle: Triangle) -> int:
    """Positive where it turns counter-clockwise seen from above: columns go east and rows south."""
    (ax, ay), (bx, by), (cx, cy) = triangle
    return -((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


def open_edges(triangles: Iterable[Triangle]) -> Counter[tuple[Post, Post]]:
    """Directed edges without the opposite one: those around the whole where nothing is missing and nothing twice."""
    edges = Counter((t[k], t[(k + 1) % 3]) for t in triangles for k in range(3))
    assert max(edges.values()) == 1, "an edge is used twice in the same direction"
    return Counter({edge: 1 for edge in edges if edge[::-1] not in edges})


def vertical_errors_m(heights_m: NDArray[np.float32], triangles: Iterable[Triangle], origin: Post = (0, 0)):
    """|surface - height| (rows, columns) at every post that a triangle covers, else -1; origin is the first post."""
    worst = np.full(heights_m.shape, -1.0)
    z = heights_m.astype(np.float64)
    for triangle in triangles:
        (ax, ay), (bx, by), (cx, cy) = [(x - origin[0], y - origin[1]) for x, y in triangle]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        left, right = min(ax, bx, cx), max(ax, bx, cx) + 1
        top, bottom = min(ay, by, cy), max(ay, by, cy) + 1
        y, x = np.mgrid[top:bottom, left:right]
        b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
        c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
        inside = (b >= -1e-12) & (c >= -1e-12) & (b + c <= 1.0 + 1e-12)
        surface = z[ay, ax] + b * (z[by, bx] - z[ay, ax]) + c * (z[cy, cx] - z[ay, ax])
        error = np.where(inside, abs(surface - z[top:bottom, left:right]), -1.0)
        worst[top:bottom, left:right] = np.maximum(worst[top:bottom, left:right], error)
    return worst


def errors_between_posts_m(heights_m: NDArray[np.float32], triangles: list[Triangle], each: int = 8, seed: int = 0):
    """|triangulation - surface of all posts| at random places in every triangle (T, each)."""
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet((0.5, 0.5, 0.5), (len(triangles), each))  # many near edges
    corners = np.array(triangles)
    z = heights_m.astype(np.float64)
    surface = (weights * z[corners[..., 1], corners[..., 0]][:, None, :]).sum(axis=-1)
    x, y = np.moveaxis((weights[..., None] * corners[:, None]).sum(axis=2), -1, 0)
    i = np.clip(x.astype(int), 0, heights_m.shape[1] - 2)
    j = np.clip(y.astype(int), 0, heights_m.shape[0] - 2)
    u, v = x - i, y - j
    a, b, c, d = z[j, i], z[j, i + 1], z[j + 1, i + 1], z[j + 1, i]
    upper, lower = a + u * (b - a) + v * (c - b), a + v * (d - a) + u * (c - d)
    return abs(surface - np.where(u >= v, upper, lower))
