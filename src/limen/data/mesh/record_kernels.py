"""What is asked of two nodes before they become one: what it costs, where the new one is, and what is known of it then.

A node's record holds ``A`` (6), ``b`` (3) and ``c`` of the sum of squared distances from planes, ``x'Ax + 2 b'x + c``
for a way ``x`` from the node's own place: so 32 bits are enough. Beside it are the mean of the normals below the node
and how they bend with place, a symmetric matrix (6), both weighted by area. What two normals differ by beyond their
bend would be lost in the light: it costs as much as if the surface had moved by `SHADE` times that angle.

References
----------
Garland, Heckbert 1997, *Surface Simplification Using Quadric Error Metrics*, sections 4 to 6.
Hoppe 1999, *New Quadric Metric for Simplifying Meshes with Appearance Attributes* (attributes are linear on triangles).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled

__all__ = [
    "APART", "AREA", "BEND", "FIXED", "HEAD", "INNER", "MOVED", "NORMAL", "PLACE", "RIM", "SLOTS", "STAMP",
    "best_place", "cost_of", "merge",
]  # fmt: skip

INNER, RIM, FIXED, APART = 0, 1, 2, 3
"""What a vertex is: inside a surface, on the edge of one, where it is none, or where textures meet.

What is inside may be joined to any, a rim to a rim along it; a node has the larger kind of the two, and its place.
"""

SLOTS = 32
"""32-bit words of a node's record."""

_B, _C, PLACE, HEAD, MOVED, STAMP, NORMAL, BEND, AREA = 6, 9, 10, 13, 14, 15, 16, 19, 25

SHADE = 0.01
"""Of the mesh's size: see above. The bunny's cuts are about as small at the same verdict from 0.005 to 0.05."""

_SHADE2 = np.float32(SHADE * SHADE)
_PULL = 1e-3  # of the planes' weight: how much a new place is drawn to the edge's middle where planes leave it free
_COMPACT = np.float32(1e-5)  # of the planes' weight: how much long edges cost where planes cost nothing


@compiled(fastmath=True)
def _unsteady(record: Any, i: Any, k: Any) -> Any:
    """What the normals of two records lose when both get their mean, beyond how they bend between the two places."""
    x, y, z = record[k + 10] - record[i + 10], record[k + 11] - record[i + 11], record[k + 12] - record[i + 12]
    one, other = record[i + AREA], record[k + AREA]
    both = one + other
    if both <= np.float32(0.0):
        return np.float32(0.0)
    one, other = one / both, other / both
    a, b = i + BEND, k + BEND
    g0, g1 = one * record[a] + other * record[b], one * record[a + 1] + other * record[b + 1]
    g2, g3 = one * record[a + 2] + other * record[b + 2], one * record[a + 3] + other * record[b + 3]
    g4, g5 = one * record[a + 4] + other * record[b + 4], one * record[a + 5] + other * record[b + 5]
    c = record[k + 16] - record[i + 16] - (g0 * x + g1 * y + g2 * z)
    d = record[k + 17] - record[i + 17] - (g1 * x + g3 * y + g4 * z)
    e = record[k + 18] - record[i + 18] - (g2 * x + g4 * y + g5 * z)
    return _SHADE2 * one * other * both * (c * c + d * d + e * e)


@compiled(fastmath=True)
def cost_of(record: Any, kind: Any, u: Any, w: Any) -> Any:
    """About what joining two nodes costs: in the middle of them, or where the one is that may not move."""
    i, k = SLOTS * u, SLOTS * w
    x, y, z = record[k + 10] - record[i + 10], record[k + 11] - record[i + 11], record[k + 12] - record[i + 12]
    from_u = np.float32(0.5) if kind[u] == kind[w] else np.float32(kind[u] < kind[w])
    from_w = from_u - np.float32(1.0)
    two = np.float32(2.0)
    length2 = x * x + y * y + z * z
    bend_u = (
        x * (record[i] * x + two * (record[i + 1] * y + record[i + 2] * z))
        + y * (record[i + 3] * y + two * record[i + 4] * z)
        + record[i + 5] * z * z
    )
    bend_w = (
        x * (record[k] * x + two * (record[k + 1] * y + record[k + 2] * z))
        + y * (record[k + 3] * y + two * record[k + 4] * z)
        + record[k + 5] * z * z
    )
    lean_u = two * (record[i + 6] * x + record[i + 7] * y + record[i + 8] * z)
    lean_w = two * (record[k + 6] * x + record[k + 7] * y + record[k + 8] * z)
    weight = min(record[i] + record[i + 3] + record[i + 5], record[k] + record[k + 3] + record[k + 5])
    cost = from_u * (from_u * bend_u + lean_u) + from_w * (from_w * bend_w + lean_w) + record[i + 9] + record[k + 9]
    return max(cost, np.float32(0.0)) + _COMPACT * length2 * weight + _unsteady(record, i, k)


@compiled(fastmath=True)
def _shift(record: Any, at: Any, x: Any, y: Any, z: Any) -> Any:
    """``b`` and ``c`` of a record, seen from (x, y, z) off its place."""
    rx = record[at] * x + record[at + 1] * y + record[at + 2] * z
    ry = record[at + 1] * x + record[at + 3] * y + record[at + 4] * z
    rz = record[at + 2] * x + record[at + 4] * y + record[at + 5] * z
    bx, by, bz = record[at + 6], record[at + 7], record[at + 8]
    constant = record[at + 9] + x * (rx + 2.0 * bx) + y * (ry + 2.0 * by) + z * (rz + 2.0 * bz)
    return bx + rx, by + ry, bz + rz, constant


@compiled(fastmath=True)
def best_place(record: Any, kind: Any, u: Any, w: Any) -> Any:
    """Where the node of two is to be, as ways from ``u`` and from ``w``."""
    i, k = SLOTS * u, SLOTS * w
    ex = np.float64(record[k + 10]) - record[i + 10]
    ey = np.float64(record[k + 11]) - record[i + 11]
    ez = np.float64(record[k + 12]) - record[i + 12]
    if kind[u] > kind[w]:
        return 0.0, 0.0, 0.0, -ex, -ey, -ez
    if kind[w] > kind[u]:
        return ex, ey, ez, 0.0, 0.0, 0.0
    hx, hy, hz = 0.5 * ex, 0.5 * ey, 0.5 * ez
    ux, uy, uz, _ = _shift(record, i, hx, hy, hz)
    wx, wy, wz, _ = _shift(record, k, -hx, -hy, -hz)
    gx, gy, gz = -(ux + wx), -(uy + wy), -(uz + wz)
    b, c, e = record[i + 1] + record[k + 1], record[i + 2] + record[k + 2], record[i + 4] + record[k + 4]
    a, d, f = record[i] + record[k], record[i + 3] + record[k + 3], record[i + 5] + record[k + 5]
    pull = _PULL * (a + d + f)
    x = y = z = 0.0
    if pull > 0.0:
        m, n, o = a + pull, d + pull, f + pull
        c00, c01, c02 = n * o - e * e, c * e - b * o, b * e - c * n
        c11, c12, c22 = m * o - c * c, b * c - m * e, m * n - b * b
        down = 1.0 / (m * c00 + b * c01 + c * c02)
        for _ in range(2):  # once more from where it led: what planes hold firmly is hardly pulled any more
            x += (c00 * gx + c01 * gy + c02 * gz) * down
            y += (c01 * gx + c11 * gy + c12 * gz) * down
            z += (c02 * gx + c12 * gy + c22 * gz) * down
            gx = -(ux + wx) - (a * x + b * y + c * z)
            gy = -(uy + wy) - (b * x + d * y + e * z)
            gz = -(uz + wz) - (c * x + e * y + f * z)
        if not x * x + y * y + z * z < ex * ex + ey * ey + ez * ez:
            x = y = z = 0.0
    return hx + x, hy + y, hz + z, x - hx, y - hy, z - hz


@compiled
def merge(record: Any, u: Any, w: Any, new: Any, ux: Any, uy: Any, uz: Any, wx: Any, wy: Any, wz: Any) -> None:
    """The record of the node of two that go by (ux, uy, uz) and by (wx, wy, wz)."""
    i, k, m = SLOTS * u, SLOTS * w, SLOTS * new
    b0, b1, b2, c = _shift(record, i, ux, uy, uz)
    d0, d1, d2, e = _shift(record, k, wx, wy, wz)
    for word in range(_B):
        record[m + word] = record[i + word] + record[k + word]
    record[m + 6], record[m + 7], record[m + 8] = b0 + d0, b1 + d1, b2 + d2
    record[m + _C] = max(c + e, 0.0) + _unsteady(record, i, k)
    base, x, y, z = (i, ux, uy, uz) if ux * ux + uy * uy + uz * uz == 0.0 else (k, wx, wy, wz)
    record[m + 10], record[m + 11], record[m + 12] = record[base + 10] + x, record[base + 11] + y, record[base + 12] + z
    one, other = record[i + AREA], record[k + AREA]
    both = one + other
    share = one / both if both > 0.0 else np.float32(0.5)
    for word in range(NORMAL, AREA):
        record[m + word] = share * record[i + word] + (1.0 - share) * record[k + word]
    record[m + AREA] = both
