"""Loops over the moments of normals: how far those of a region are from a steady bend."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MOMENTS = 23
"""Of a region, weighted by area: 1; x (3); x x (6, upper triangle); n (3); x n (9); n n (1)."""

_STIFF = 1e-4  # of the region's own extent: across a flat region the bend is not known, and taken for none


@njit(cache=True, nogil=True)
def star_moments(triangles, place, normal, sums):
    """Add the moments of all corners of the triangles around each vertex to its row of ``sums`` (N, 23)."""
    own = np.empty(MOMENTS)
    for triangle in range(triangles.shape[0]):
        a, b, c = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
        ux, uy, uz = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1], place[b, 2] - place[a, 2]
        vx, vy, vz = place[c, 0] - place[a, 0], place[c, 1] - place[a, 1], place[c, 2] - place[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = math.sqrt(x * x + y * y + z * z)
        for column in range(MOMENTS):
            own[column] = 0.0
        for vertex in (a, b, c):
            px, py, pz = place[vertex, 0], place[vertex, 1], place[vertex, 2]
            nx, ny, nz = normal[vertex, 0], normal[vertex, 1], normal[vertex, 2]
            own[0] += 1.0
            own[1] += px
            own[2] += py
            own[3] += pz
            own[4] += px * px
            own[5] += px * py
            own[6] += px * pz
            own[7] += py * py
            own[8] += py * pz
            own[9] += pz * pz
            own[10] += nx
            own[11] += ny
            own[12] += nz
            own[13] += px * nx
            own[14] += px * ny
            own[15] += px * nz
            own[16] += py * nx
            own[17] += py * ny
            own[18] += py * nz
            own[19] += pz * nx
            own[20] += pz * ny
            own[21] += pz * nz
            own[22] += nx * nx + ny * ny + nz * nz
        for vertex in (a, b, c):
            for column in range(MOMENTS):
                sums[vertex, column] += area * own[column]


@njit(cache=True, nogil=True)
def bends(sums, ripple2):
    """The mean square of what is left of normals beside their best linear bend, for rows of moments.

    With places and normals from their means: ``|n|^2 - tr(D^T C^-1 D)`` for ``C = <x x^T>`` and ``D = <x n^T>``.
    """
    for row in range(sums.shape[0]):
        weight = sums[row, 0]
        if weight <= 0.0:
            ripple2[row] = 0.0
            continue
        mx, my, mz = sums[row, 1] / weight, sums[row, 2] / weight, sums[row, 3] / weight
        c00, c01, c02 = (
            sums[row, 4] / weight - mx * mx,
            sums[row, 5] / weight - mx * my,
            sums[row, 6] / weight - mx * mz,
        )
        c11, c12, c22 = (
            sums[row, 7] / weight - my * my,
            sums[row, 8] / weight - my * mz,
            sums[row, 9] / weight - mz * mz,
        )
        stiff = _STIFF * (c00 + c11 + c22) + 1e-24
        c00, c11, c22 = c00 + stiff, c11 + stiff, c22 + stiff
        # Cholesky: C = L L^T.
        l00 = math.sqrt(c00)
        l10, l20 = c01 / l00, c02 / l00
        l11 = math.sqrt(max(c11 - l10 * l10, 1e-30))
        l21 = (c12 - l20 * l10) / l11
        l22 = math.sqrt(max(c22 - l20 * l20 - l21 * l21, 1e-30))
        left = sums[row, 22] / weight
        for axis in range(3):
            mean = sums[row, 10 + axis] / weight
            d0 = sums[row, 13 + axis] / weight - mx * mean
            d1 = sums[row, 16 + axis] / weight - my * mean
            d2 = sums[row, 19 + axis] / weight - mz * mean
            y0 = d0 / l00
            y1 = (d1 - l10 * y0) / l11
            y2 = (d2 - l20 * y0 - l21 * y1) / l22
            left -= mean * mean + y0 * y0 + y1 * y1 + y2 * y2
        ripple2[row] = max(left, 0.0)


@njit(cache=True, nogil=True)
def nest(parent, vertices, radius, ripple, steep, shares, contrasts):
    """Raise ``ripple`` (N - V,) where a node below is seen sooner, to what makes the node seen as soon as that.

    A small patch that ripples is lost in the mean over a large region around it, but not to the eye. Seen is what has a
    large product of its radius and the share of detail that is seen at its contrast, ``steep`` times its ripple.
    """
    seen = np.empty(radius.shape[0])
    for inner in range(radius.shape[0]):
        contrast = min(steep * ripple[inner], 1.0)
        seen[inner] = radius[inner] * shares[min(np.searchsorted(contrasts, contrast), 255)]
    for inner in range(radius.shape[0]):
        own = seen[inner]
        if own > 0.0:
            share = own / radius[inner]
            code = np.searchsorted(shares, share - 1e-12)
            ripple[inner] = max(ripple[inner], contrasts[min(code, 255)] / steep)
        above = parent[inner + vertices]
        if above >= 0:
            seen[above - vertices] = max(seen[above - vertices], min(own, radius[above - vertices]))
