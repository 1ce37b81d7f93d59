"""Loops over the moments of normals: how far those of a region are from a steady bend."""

from __future__ import annotations

import math

import numpy as np

from limen.compiled import compiled

MOMENTS = 22
"""Of a region, weighted by area: 1; x (3); x x (6, upper triangle); n (3); x n (9)."""

_STIFF = 1e-4  # of the region's own extent: across a flat region the bend is not known, and taken for none


@compiled(error_model="python")
def star_moments(triangles, place, normal, sums):
    """Add the moments of all corners of the triangles around each vertex to its row of ``sums`` (N, 22)."""
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
        for vertex in (a, b, c):
            for column in range(MOMENTS):
                sums[vertex, column] += area * own[column]


@compiled(error_model="python")
def ripples(parent, region, own, ripple2):
    """Mean squares of what the normals below each node are beside those of a surface that bends steadily there.

    A node that is folded shows the mean of its children's normals, bent as its region bends: by the linear function of
    place that fits the region best, ``C^-1 D`` for ``C = <x x^T>`` and ``D = <x n^T>`` about the means. What two
    children of weights ``a`` and ``b`` differ by beyond that, ``e``, is ``a b / (a + b)^2 |e|^2`` in the mean; to it
    come the children's own mean squares (the law of total variance).

    Parameters
    ----------
    parent
        (N,); -1 of a root.
    region
        (N, 22): sums of `star_moments` over all vertices below a node.
    own
        (N, 7): sums over the vertices below a node alone: of areas, of places and of normals times these. Divided by
        the areas here.
    ripple2
        (N,): 0 at first, as it stays for vertices.
    """
    weight = np.zeros(parent.shape[0])  # of the children that were added to a node so far
    mean = np.zeros((parent.shape[0], 6))
    for child in range(parent.shape[0]):
        for column in range(1, 7):
            own[child, column] /= own[child, 0]
        node = parent[child]
        if node < 0:
            continue
        one, other = weight[node], own[child, 0]
        total = one + other
        share = other / total
        added = 0.0
        if one > 0.0:
            added = one / total * share * _unsteady2(region, node, mean, own, child)
        ripple2[node] = (1.0 - share) * ripple2[node] + share * ripple2[child] + added
        for column in range(6):
            mean[node, column] += share * (own[child, 1 + column] - mean[node, column])
        weight[node] = total


@compiled(error_model="python")
def _unsteady2(region, node, mean, own, child):
    """The square of what a child's normal differs from the ``mean`` of a node beyond the bend of the node's region."""
    weight = max(region[node, 0], 1e-300)  # what has no area does not bend
    mx, my, mz = region[node, 1] / weight, region[node, 2] / weight, region[node, 3] / weight
    c00, c01 = region[node, 4] / weight - mx * mx, region[node, 5] / weight - mx * my
    c02, c11 = region[node, 6] / weight - mx * mz, region[node, 7] / weight - my * my
    c12, c22 = region[node, 8] / weight - my * mz, region[node, 9] / weight - mz * mz
    stiff = _STIFF * (c00 + c11 + c22) + 1e-24
    c00, c11, c22 = c00 + stiff, c11 + stiff, c22 + stiff
    x, y, z = own[child, 1] - mean[node, 0], own[child, 2] - mean[node, 1], own[child, 3] - mean[node, 2]
    # C^-1 (x, y, z), by cofactors.
    i00, i01, i02 = c11 * c22 - c12 * c12, c02 * c12 - c01 * c22, c01 * c12 - c02 * c11
    i11, i12, i22 = c00 * c22 - c02 * c02, c01 * c02 - c00 * c12, c00 * c11 - c01 * c01
    down = 1.0 / (c00 * i00 + c01 * i01 + c02 * i02)
    gx, gy, gz = (
        (i00 * x + i01 * y + i02 * z) * down,
        (i01 * x + i11 * y + i12 * z) * down,
        (i02 * x + i12 * y + i22 * z) * down,
    )
    found = 0.0
    for axis in range(3):
        normal = region[node, 10 + axis] / weight
        bend = gx * (region[node, 13 + axis] / weight - mx * normal)
        bend += gy * (region[node, 16 + axis] / weight - my * normal)
        bend += gz * (region[node, 19 + axis] / weight - mz * normal)
        left = own[child, 4 + axis] - mean[node, 3 + axis] - bend
        found += left * left
    return found


@compiled(error_model="python")
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
