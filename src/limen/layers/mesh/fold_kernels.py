"""Loops over vertex trees: which nodes are folded, which triangles are left, and what a budget buys.

Rows that the loops take are those of `limen.layers.points.kernels`, whose measures they share.
"""

from __future__ import annotations

import math

import numpy as np

from limen.compiled import compiled
from limen.layers.common.sphere_kernels import (
    bin_of,
    code_of,
    contrast_of,
    diameter_px,
    is_outside,
    least_allowed_m,
    lit_range,
)
from limen.layers.mesh.facing import DIRECTIONS

_UNFOLDED = -1

CREST = math.sqrt(2.0)
"""Amplitude of a sine over the root of its mean square: of light, over what normals ripple by."""

REGION_SHARE = 0.48
"""Half a wavelength of what folding changes inside the surface, over the radius of the region of support, which reaches
a ring of triangles farther than what is folded.

The one constant that is calibrated: with it the independent observer does not see what is folded, from the true
distance, at the gaze and away from it (docs/explain/observer.md)."""

HIDDEN, INTERIOR, SILHOUETTE = 0, 1, 2


@compiled
def direction_of(x, y, z):
    """The cell of directions, `DIRECTIONS` along a side of a face, that a way lies in: counted as cells of normals."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, u, v, most = 0, y, z, ax
        if x < 0:
            face = 1
    elif ay >= az:
        face, u, v, most = 2, x, z, ay
        if y < 0:
            face = 3
    else:
        face, u, v, most = 4, x, y, az
        if z < 0:
            face = 5
    column = min(int((u / most + 1.0) * 0.5 * DIRECTIONS), DIRECTIONS - 1)
    row = min(int((v / most + 1.0) * 0.5 * DIRECTIONS), DIRECTIONS - 1)
    return face * DIRECTIONS * DIRECTIONS + row * DIRECTIONS + column


@compiled
def facing_of(mask, row, front, back, x, y, z, sine, spread_sines):
    """`HIDDEN`, `INTERIOR` or `SILHOUETTE`, for a node seen along ``x, y, z``: to the eye, in the mesh's coordinates.

    ``sine`` of the angle within which all of it is seen; wider than the widest spread, anything may be.
    """
    if sine > spread_sines[spread_sines.shape[0] - 1]:
        return SILHOUETTE
    spread = 0
    while sine > spread_sines[spread]:
        spread += 1
    cell = direction_of(x, y, z)
    faces, hides = False, False
    for word in range(6):
        faces = faces or (mask[row, word] & front[spread, cell, word]) != 0
        hides = hides or (mask[row, word] & back[spread, cell, word]) != 0
    if faces and hides:
        return SILHOUETTE
    return INTERIOR if faces else HIDDEN


@compiled
def _is_within(x, y, z, sine, cones):
    """Whether a sphere that is seen along ``x, y, z``, of a sine of half its angle, meets any of some cones."""
    length = math.sqrt(x * x + y * y + z * z)
    for row in range(cones.shape[0]):
        cosine = (x * cones[row, 0] + y * cones[row, 1] + z * cones[row, 2]) / max(length, 1e-300)
        if math.acos(min(max(cosine, -1.0), 1.0)) <= cones[row, 3] + math.asin(sine):
            return True
    return False


@compiled
def shading_code(code, toward_light, toward_eye, spread, margin, ambient):
    """The contrast code of a proxy's light against that of normals within ``spread`` radians of its own.

    Colours differ by ``code``; light and colours multiply, so their ratios do.
    """
    sign = 1.0 if toward_eye >= 0.0 else -1.0  # both sides are seen, each lit as the front
    low, high = lit_range(sign * toward_light, spread, False)
    head_low, head_high = lit_range(toward_eye, spread + margin, True)
    share = 0.5 * (1.0 - ambient)
    shown = ambient + share * (max(sign * toward_light, 0.0) + abs(toward_eye))
    least, most = ambient + share * (low + head_low), ambient + share * (high + head_high)
    ratio = max(most / shown, shown / max(least, 1e-9))
    contrast = contrast_of(code)
    if contrast >= 1.0:
        return 255
    ratio *= (1.0 + contrast) / (1.0 - contrast)
    combined = (ratio - 1.0) / (ratio + 1.0)
    return code_of(combined)


@compiled
def ripple_code(code, ripple, nx, ny, nz, x, y, z, light):
    """The contrast code of light that ripples as normals do, by ``ripple`` radians about a steady bend in the mean.

    ``x, y, z`` is the unit way to the eye.
    """
    toward_light = nx * light[0] + ny * light[1] + nz * light[2]
    toward_eye = nx * x + ny * y + nz * z
    sign = 1.0 if toward_eye >= 0.0 else -1.0
    falls = 1.0 if sign * toward_light > 0.0 else 0.0
    # What is across the normal: light changes by its product with the change of the normal.
    ax = falls * (light[0] - toward_light * nx) + x - toward_eye * nx
    ay = falls * (light[1] - toward_light * ny) + y - toward_eye * ny
    az = falls * (light[2] - toward_light * nz) + z - toward_eye * nz
    share = 0.5 * (1.0 - light[3])
    shown = light[3] + share * (max(sign * toward_light, 0.0) + abs(toward_eye))
    steep = math.sqrt(ax * ax + ay * ay + az * az)
    # Where light falls along the normal its change is of the second order, and there is always some: half the square.
    amplitude = CREST * share * (steep * ripple + 0.5 * ripple * ripple) / shown
    return code_of(amplitude + contrast_of(code))


@compiled
def _change_m(
    x, y, z, reach, nx, ny, nz, code, displacement, spread, ripple, mask, inner, front, back, spread_sines, place,
    normals_in_room, light, shares, by_displacement, openings,
):  # fmt: skip
    """How a node is seen from an eye at 0, and the largest length that would be invisible at full contrast if what
    folding changes is: (face, metres).

    ``x, y, z`` and ``reach`` are its region's sphere and ``displacement`` its own, in metres; other arguments are
    those of `fold`, of this node.
    """
    away = math.sqrt(x * x + y * y + z * z)
    if away <= reach:
        return SILHOUETTE, 2.0 * reach
    rx = normals_in_room[0, 0] * nx + normals_in_room[0, 1] * ny + normals_in_room[0, 2] * nz
    ry = normals_in_room[1, 0] * nx + normals_in_room[1, 1] * ny + normals_in_room[1, 2] * nz
    rz = normals_in_room[2, 0] * nx + normals_in_room[2, 1] * ny + normals_in_room[2, 2] * nz
    ex, ey, ez = -x / away, -y / away, -z / away
    toward_eye = min(max(rx * ex + ry * ey + rz * ez, -1.0), 1.0)
    # Half is the angle of the cone of normals and of the cone in which the region is seen. All by sines and cosines:
    # inverse functions took most of a cut's time.
    sine = reach / away
    cosine = math.sqrt(1.0 - sine * sine)
    sine_half = math.sin(spread) * cosine + math.cos(spread) * sine
    cosine_half = math.cos(spread) * cosine - math.sin(spread) * sine
    tilt, level = abs(toward_eye), math.sqrt(1.0 - toward_eye * toward_eye)
    # The way back to the eye in the mesh's coordinates: the transposed map, which only turns and scales.
    bx = -(place[0, 0] * x + place[1, 0] * y + place[2, 0] * z)
    by = -(place[0, 1] * x + place[1, 1] * y + place[2, 1] * z)
    bz = -(place[0, 2] * x + place[1, 2] * y + place[2, 2] * z)
    # A surface moves along its normals; what an eye sees of that is across the line of sight.
    moved = displacement
    if cosine_half > 0.0 and tilt > sine_half:
        face = INTERIOR if toward_eye > 0.0 else HIDDEN
        moved *= level * cosine_half + tilt * sine_half
    else:
        face = facing_of(mask, inner, front, back, bx, by, bz, sine, spread_sines)
    if face == HIDDEN and not _is_within(-bx, -by, -bz, sine, openings):
        return face, moved
    toward_light = rx * light[0] + ry * light[1] + rz * light[2]
    if not by_displacement:
        if light[4] != 0.0:
            code = shading_code(code, toward_light, toward_eye, spread, math.asin(sine), light[3])
        return face, 2.0 * reach * (1.0 if face == SILHOUETTE else shares[code])
    # Seen at a slant, what changes is so much narrower one way.
    slant = 1.0
    if cosine_half > 0.0 and tilt < cosine_half:
        slant = tilt * cosine_half + level * sine_half
    ripples = code
    if light[4] != 0.0:
        ripples = ripple_code(code, ripple, rx, ry, rz, ex, ey, ez, light)
    seen_m = REGION_SHARE * reach * slant * shares[ripples]
    if face == SILHOUETTE or moved <= seen_m:
        return face, max(seen_m, moved)
    if light[4] != 0.0:
        code = shading_code(code, toward_light, toward_eye, spread, math.asin(sine), light[3])
    return face, max(seen_m, moved * shares[code])


@compiled
def fold(
    parent, vertices, normal, middle, radius, displacement, contrast, spread, ripple, mask, lost, front, back,
    spread_sines, panels, eyes, place, size, normals_in_room, light, shares, mode, by_displacement, openings, limit,
    state, kept, faces, histogram,
):  # fmt: skip
    """Decide about every node, parents first.

    Parameters
    ----------
    spread
        (N - V,): the largest angle between a proxy's normal and those of its region, radians.
    ripple
        (N - V,): how far normals below the node are from a steady bend, root of the mean square, radians.
    lost
        (N + 1,): triangles that vanish when a node is folded and none above it is; the last, those that never do.
    panels
        (P, 30), see `limen.layers.points.kernels`.
    place, size, normals_in_room
        (3, 4): from the mesh's coordinates to the way from the eye; the largest factor by which that stretches; (3, 3)
        for normals.
    mode
        0: by pixels alone. 1: by what eyes see.
    by_displacement
        What silhouettes change is as wide as the surface moves, and not as the region.
    openings
        (K, 4): where what faces away is seen all the same, see `limen.layers.mesh.holes`.
    limit
        Nodes are folded up to this ``k``.
    state
        (N + 1,): filled with the node that stands for each; -1 for an inner node that is not folded.
    kept
        (N - V,) float64, filled with the smallest ``k`` from the root down to each node that was asked; -1 elsewhere.
    faces
        (N - V,) int8, filled with `HIDDEN`, `INTERIOR` or `SILHOUETTE` for each node that was asked.
    histogram
        (256,), or empty: nothing is folded then, and `lost` is added to the bins of those.

    Returns
    -------
    How many triangles are left, how many nodes were asked, the largest ``k`` folded, and the
    largest region folded in pixels.
    """
    counting = histogram.shape[0] > 0
    state[parent.shape[0]] = _UNFOLDED  # what triangles die at that never do
    left, asked, largest, widest = lost[parent.shape[0]], 0, 0.0, 0.0
    for node in range(parent.shape[0] - 1, -1, -1):
        above = parent[node]
        if above >= 0 and state[above] >= 0:
            state[node] = state[above]
            continue
        if node < vertices:
            state[node] = node
            continue
        inner = node - vertices
        best = math.inf if above < 0 else kept[above - vertices]
        asked += 1
        mx, my, mz = middle[inner, 0], middle[inner, 1], middle[inner, 2]
        x = place[0, 0] * mx + place[0, 1] * my + place[0, 2] * mz + place[0, 3]
        y = place[1, 0] * mx + place[1, 1] * my + place[1, 2] * mz + place[1, 3]
        z = place[2, 0] * mx + place[2, 1] * my + place[2, 2] * mz + place[2, 3]
        reach = radius[inner] * size
        pixels, seen = 0.0, False
        for panel in range(panels.shape[0]):
            if not is_outside(x, y, z, reach, panels[panel]):
                seen = True
                pixels = max(pixels, diameter_px(x, y, z, reach, panels[panel]))
        k = 0.0
        if seen:
            k = pixels
            if mode == 1:
                faces[inner], seen_m = _change_m(
                    x, y, z, reach, normal[node, 0], normal[node, 1], normal[node, 2], np.int64(contrast[inner]),
                    displacement[inner] * size, spread[inner], ripple[inner], mask, inner, front, back, spread_sines,
                    place, normals_in_room, light, shares, by_displacement, openings,
                )  # fmt: skip
                if seen_m == 0.0:
                    k = 0.0
                else:
                    allowed = least_allowed_m(x, y, z, reach, eyes)
                    if allowed > 0.0:
                        k = min(pixels, seen_m / allowed)
        k = min(k, best)
        kept[inner] = k
        if counting:
            histogram[bin_of(k)] += lost[node]
            state[node] = _UNFOLDED
        elif k <= limit:
            state[node] = node
            if lost[node] > 0 or k > 0.0:
                largest = max(largest, k)
                if seen:
                    widest = max(widest, pixels)
        else:
            state[node] = _UNFOLDED
            left += lost[node]
    return left, asked, largest, widest


@compiled
def count_left(dies_at, state, begin, end):
    """How many of the triangles ``begin`` to ``end`` are left: those whose node is not folded, nor any above."""
    count = 0
    for triangle in range(begin, end):
        count += state[dies_at[triangle]] == _UNFOLDED
    return count


@compiled
def emit(triangles, dies_at, state, begin, end, first, out):
    """Write the corners' proxies of the triangles that are left, from row ``first`` of ``out`` on."""
    row = first
    for triangle in range(begin, end):
        if state[dies_at[triangle]] == _UNFOLDED:
            for corner in range(3):
                out[row, corner] = state[triangles[triangle, corner]]
            row += 1


@compiled
def deaths(triangles, parent, dies_at, lost):
    """The node of every triangle that takes two of its corners together first, into ``dies_at`` (T,); `lost` counts.

    Where no node does, the triangle never vanishes: that is the number of nodes (which is never folded).
    """
    nodes = parent.shape[0]
    for triangle in range(triangles.shape[0]):
        a, b, c = np.int64(triangles[triangle, 0]), np.int64(triangles[triangle, 1]), np.int64(triangles[triangle, 2])
        # Parents have larger numbers: whoever is lowest climbs, until two meet.
        while a != b and a != c and b != c:
            if a < b and a < c:
                a = np.int64(parent[a])
                if a < 0:
                    a = nodes + 3
            elif b < c:
                b = np.int64(parent[b])
                if b < 0:
                    b = nodes + 4
            else:
                c = np.int64(parent[c])
                if c < 0:
                    c = nodes + 5
            if min(a, b, c) >= nodes or (a >= nodes) + (b >= nodes) + (c >= nodes) >= 2:
                break
        node = nodes
        if a in (b, c):
            node = a
        elif b == c:
            node = b
        dies_at[triangle] = min(node, nodes)
        lost[dies_at[triangle]] += 1


@compiled
def spreads(triangles, parent, vertices, place, normal, cosine):
    """The smallest cosine between a proxy's normal and any normal in its region, into ``cosine`` (N - V,).

    A triangle with a corner below the node is in the region with its own normal and those of its corners. All above a
    node with normals more than a right angle away count as such, so climbing ends there.
    """
    held = np.empty((4, 3))
    for triangle in range(triangles.shape[0]):
        a, b, c = np.int64(triangles[triangle, 0]), np.int64(triangles[triangle, 1]), np.int64(triangles[triangle, 2])
        ux, uy, uz = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1], place[b, 2] - place[a, 2]
        vx, vy, vz = place[c, 0] - place[a, 0], place[c, 1] - place[a, 1], place[c, 2] - place[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = math.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            held[3, 0], held[3, 1], held[3, 2] = x / length, y / length, z / length
        for axis in range(3):
            held[0, axis], held[1, axis], held[2, axis] = normal[a, axis], normal[b, axis], normal[c, axis]
            if length <= 0.0:
                held[3, axis] = held[0, axis]
        for corner in range(3):
            node = np.int64(parent[triangles[triangle, corner]])
            while node >= 0:
                inner = node - vertices
                if cosine[inner] < 0.0:
                    break
                x, y, z = normal[node, 0], normal[node, 1], normal[node, 2]
                for row in range(4):
                    product = x * held[row, 0] + y * held[row, 1] + z * held[row, 2]
                    if product < cosine[inner]:
                        cosine[inner] = product
                node = np.int64(parent[node])
    for joined in range(vertices, parent.shape[0]):
        above = np.int64(parent[joined])
        if above >= 0 and cosine[joined - vertices] < 0.0:
            cosine[above - vertices] = -1.0
