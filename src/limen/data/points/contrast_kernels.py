"""How far the colour of a node may be from what its sphere meets: top down, with lists of what is near.

What a node finds is darker or brighter than itself, and gives its code. A neighbour that holds nothing that would raise
the code is passed over. Any other is looked into, if it is a group of 64 points: of these, those count that meet the
node. So nodes of 8, 64 and 512 points look at the very points, but at few of them.

Tuples go along: ``lists``, the two tables of `limen.data.points.near_kernels` and room to work in; ``store``, decoded
chunks (`limen.data.points.decode_kernels`), the luminances among them as whole numbers, which of them are near, and
where from the chunk's origin; ``light``, the display's channels (3, 256) and its black, cd/m2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.compiled import compiled
from limen.data.points.decode_kernels import FAR, GROUP, GROUP_NUMBERS, INNER, decoded
from limen.data.points.light_kernels import BRIGHTER, DARKER, code_of, light_of
from limen.data.points.near_kernels import MOST_NEAR, ROOM, WIDE, below, first_list, keep, pick
from limen.data.points.nodes import FAN, LEVEL_BEGIN

__all__ = ["chunk_contrasts"]

_BEGIN = LEVEL_BEGIN
_ENOUGH = 128
"""What is seen is used when it is so much, and less of what comes then has to be looked at."""

_FAR_BITS = np.int32(FAR.view(np.int32))


@compiled(error_model="python")
def _group_range(groups: Any, bits: Any, at: int, x: float, y: float, z: float, reach: float) -> Any:
    """Lowest and highest luminance of those points of a group that meet a sphere.

    Luminances come as the bits of their numbers, int32, which are in the same order: the least of whole numbers is
    found in wide registers, that of float32 is not, for there might be a NaN among them.
    """
    low, high, begin = _FAR_BITS, np.int32(0), np.uint64(at)
    for n in range(GROUP):
        i = begin + np.uint64(n)
        dx, dy, dz = groups[i] - x, groups[i + np.uint64(GROUP)] - y, groups[i + np.uint64(2 * GROUP)] - z
        both = groups[i + np.uint64(3 * GROUP)] + reach
        meets = dx * dx + dy * dy + dz * dz <= both * both
        light = bits[i + np.uint64(4 * GROUP)]
        low = min(low, light if meets else _FAR_BITS)
        high = max(high, light if meets else np.int32(0))
    return np.int32(low).view(np.float32), np.int32(high).view(np.float32)


@compiled(error_model="python")
def _mark_group(groups: Any, at: int, x: float, y: float, z: float, reach: float, low: float, high: float,
                marks: Any) -> int:  # fmt: skip
    """Which points of a group meet a sphere and are darker than ``low`` or brighter than ``high``; how many."""
    begin, count = np.uint64(at), np.int32(0)
    for n in range(GROUP):
        i = begin + np.uint64(n)
        dx, dy, dz = groups[i] - x, groups[i + np.uint64(GROUP)] - y, groups[i + np.uint64(2 * GROUP)] - z
        both, light = groups[i + np.uint64(3 * GROUP)] + reach, groups[i + np.uint64(4 * GROUP)]
        mark = np.int32((dx * dx + dy * dy + dz * dz <= both * both) & ((light < low) | (light > high)))
        marks[n] = mark
        count += mark
    return count  # type: ignore[return-value]


@compiled(error_model="python")
def _seen_range(seen: Any, bits: Any, count: int, sphere: Any) -> Any:
    """Lowest and highest luminance of what of the first entries meets a sphere."""
    x, y, z, reach = sphere[0], sphere[1], sphere[2], sphere[3]
    low, high = _FAR_BITS, np.int32(0)
    for i in range(-(-count // WIDE) * WIDE):
        dx, dy, dz, both = seen[0, i] - x, seen[1, i] - y, seen[2, i] - z, seen[3, i] + reach
        meets = dx * dx + dy * dy + dz * dz <= both * both
        low = min(low, bits[4, i] if meets else _FAR_BITS)
        high = max(high, bits[5, i] if meets else np.int32(0))
    return np.int32(low).view(np.float32), np.int32(high).view(np.float32)


@compiled(error_model="python")
def _sphere(inner: Any, slot: int, node: int, slack: float, sphere: Any) -> bool:
    """The sphere of a node, a little larger; whether there is one."""
    for part in range(4):
        sphere[part] = inner[slot, part, node]
    sphere[3] += slack
    return bool(sphere[0] != FAR)


@compiled(error_model="python")
def _raise(codes: Any, node: int, shown: float, low: float, high: float) -> None:
    if low <= high:
        codes[node] = max(codes[node], code_of(shown, low, high))


@compiled(error_model="python")
def _tell(node: int, row: int, count: int, chunk: int, nodes: Any, light: Any, lists: Any, store: Any, sphere: Any,
          codes: Any) -> None:  # fmt: skip
    """The code of a node of level 3 or 4 with ``sphere``, from what of the level below meets it."""
    ids, near = lists[0], lists[1]
    inner, groups, bits, slots, offsets = store
    shown = light_of(nodes, chunk, node, light[0], light[1])
    codes[node] = code_of(shown, inner[slots[0], 4, node], inner[slots[0], 5, node])
    for k in range(count):
        least, most = near[row, 4, k], near[row, 5, k]
        if least >= shown * DARKER[codes[node]] and most <= shown * BRIGHTER[codes[node]]:
            continue
        which, other = ids[row, k] // INNER, ids[row, k] % INNER
        if ids[row, k] >= 0 and other >= _BEGIN[2]:
            least, most = _group_range(
                groups, bits, (slots[which] * GROUP + other - _BEGIN[2]) * GROUP_NUMBERS,
                sphere[0] - offsets[which, 0], sphere[1] - offsets[which, 1], sphere[2] - offsets[which, 2], sphere[3],
            )  # fmt: skip
        _raise(codes, node, shown, least, most)


@compiled(error_model="python")
def _append(groups: Any, at: int, x: float, y: float, z: float, picked: Any, count: int, seen: Any, held: int) -> None:
    """Points of a group, moved, behind what is ``seen`` (6, N): spheres with a range of luminance."""
    for n in range(count):
        i, to = np.uint64(at + picked[n]), held + n
        light = groups[i + np.uint64(4 * GROUP)]
        seen[0, to], seen[1, to] = groups[i] + x, groups[i + np.uint64(GROUP)] + y
        seen[2, to], seen[3, to] = groups[i + np.uint64(2 * GROUP)] + z, groups[i + np.uint64(3 * GROUP)]
        seen[4, to], seen[5, to] = light, light


@compiled(error_model="python")
def _use(seen: Any, seen_bits: Any, held: int, spheres: Any, shown: Any, twig: int, codes: Any, limits: Any) -> None:
    """Raise the codes of a node of level 2 and its children by what is seen, and with them the ``limits`` (2,): what
    lies between them raises no code any more.
    """
    for k in range(held, -(-held // WIDE) * WIDE):
        seen[0, k], seen[1, k], seen[2, k], seen[3, k] = FAR, np.float32(0.0), np.float32(0.0), np.float32(0.0)
    limits[0], limits[1] = np.float32(0.0), np.float32(np.inf)
    for k in range(1 + FAN):
        node = twig if k == 0 else FAN * twig + k
        if spheres[k, 0] != FAR:
            if held > 0:
                low, high = _seen_range(seen, seen_bits, held, spheres[k])
                _raise(codes, node, shown[k], low, high)
            limits[0] = max(limits[0], np.float32(shown[k] * DARKER[codes[node]]))
            limits[1] = min(limits[1], np.float32(shown[k] * BRIGHTER[codes[node]]))


@compiled(error_model="python")
def _tell_twig(twig: int, count: int, slack: float, chunk: int, nodes: Any, light: Any, lists: Any, store: Any,
               spheres: Any, seen: Any, seen_bits: Any, codes: Any) -> None:  # fmt: skip
    """Codes of a node of level 2 and its children, from entries in row 2: first from its own points.

    ``spheres`` (9, 4) and ``seen`` are overwritten.
    """
    ids, near, marks, picked = lists
    inner, groups, bits, slots, offsets = store
    own = (slots[0] * GROUP + twig - _BEGIN[2]) * GROUP_NUMBERS
    shown, limits = np.empty(1 + FAN, np.float32), np.empty(2, np.float32)
    for k in range(1 + FAN):
        node = twig if k == 0 else FAN * twig + k
        if _sphere(inner, slots[0], node, slack, spheres[k]):
            shown[k] = light_of(nodes, chunk, node, light[0], light[1])
            low, high = inner[slots[0], 4, node], inner[slots[0], 5, node]
            if k > 0:
                low, high = _group_range(groups, bits, own, spheres[k, 0], spheres[k, 1], spheres[k, 2], spheres[k, 3])
            codes[node] = code_of(shown[k], low, high)
    held = 0
    _use(seen, seen_bits, held, spheres, shown, twig, codes, limits)
    for n in range(count):
        entry = ids[2, n]
        if entry == twig or (near[2, 4, n] >= limits[0] and near[2, 5, n] <= limits[1]):
            continue
        which, node = entry // INNER, entry % INNER
        if entry < 0 or node < _BEGIN[2]:
            for part in range(6):
                seen[part, held] = near[2, part, n]
            held += 1
        else:
            at = (slots[which] * GROUP + node - _BEGIN[2]) * GROUP_NUMBERS
            x, y, z = offsets[which, 0], offsets[which, 1], offsets[which, 2]
            a, b, c, reach = spheres[0, 0] - x, spheres[0, 1] - y, spheres[0, 2] - z, spheres[0, 3]
            if _mark_group(groups, at, a, b, c, reach, limits[0], limits[1], marks) > 0:
                found = pick(marks, GROUP, picked)
                _append(groups, at, x, y, z, picked, found, seen, held)
                held += found
        if held >= _ENOUGH:
            _use(seen, seen_bits, held, spheres, shown, twig, codes, limits)
            held = 0
    if held > 0:
        _use(seen, seen_bits, held, spheres, shown, twig, codes, limits)


@compiled(error_model="python")
def _contrasts(
    chunk: int,
    roots: int,
    slack: float,
    nodes: Any,
    light: Any,
    lists: Any,
    store: Any,
    seen: Any,
    seen_bits: Any,
    codes: Any,
) -> None:
    """Codes (585,) of the inner nodes of a chunk, of whose root ``roots`` entries are in row 4.

    Rows 4, 3, 2 hold what meets a node of that level, rows 6 and 5 what of the level below meets one of level 4 and 3.
    """
    ids, near, marks, picked = lists
    inner, slots, offsets = store[0], store[3], store[4]
    sphere, spheres, slot = np.empty(4, np.float32), np.empty((9, 4), np.float32), slots[0]
    _sphere(inner, slot, 0, slack, sphere)
    under_root = below(ids, near, 4, roots, inner, slots, offsets, sphere, 6)
    _tell(0, 6, under_root, chunk, nodes, light, lists, store, sphere, codes)
    for branch in range(1, 1 + FAN):
        if not _sphere(inner, slot, branch, slack, sphere):
            break
        meets = keep(ids, near, 6, under_root, 4, roots, sphere, marks, picked, 3)
        under = below(ids, near, 3, meets, inner, slots, offsets, sphere, 5)
        _tell(branch, 5, under, chunk, nodes, light, lists, store, sphere, codes)
        for twig in range(FAN * branch + 1, FAN * branch + 1 + FAN):
            if not _sphere(inner, slot, twig, slack, sphere):
                break
            near_twig = keep(ids, near, 5, under, 3, meets, sphere, marks, picked, 2)
            _tell_twig(twig, near_twig, slack, chunk, nodes, light, lists, store, spheres, seen, seen_bits, codes)


@compiled(error_model="python")
def chunk_contrasts(
    first: int, cloud: Any, tops: Any, met: Any, lengths: Any, scale: Any, light: Any, cache: Any, codes: Any
) -> None:
    """Codes (K, 585) of all inner nodes of the chunks from ``first`` on; the first of each is that of its root.

    Parameters
    ----------
    cloud
        Nodes of all chunks as bytes (C, 4681, 16) and as uint16 (C, 4681, 8); how many points they are; frames (C, 5)
        float32 as `limen.data.points.node_kernels.build_chunks` makes them.
    tops, met, lengths
        The spheres, lists and lengths of `limen.data.points.near_kernels.top_contrasts`.
    scale
        (256,) float32: radii of codes, of the largest.
    light
        Channels (3, 256) float32 and black of the display, cd/m2.
    cache
        Chunks that stay decoded, S of them: ``inner`` (S, 6, 585) and ``groups`` (S * 64 * 320,) float32; whose each is
        (S,) and when it was wanted last (S,), at first -1 and 0; and where each chunk is (C,), at first -1.
    """
    ids, near = np.empty((7, ROOM), np.int64), np.empty((7, 6, ROOM), np.float32)
    marks, picked = np.empty(ROOM, np.int32), np.empty(ROOM, np.int64)
    near_chunks, slots = np.empty(MOST_NEAR, np.int64), np.empty(MOST_NEAR, np.int64)
    offsets = np.empty((MOST_NEAR, 3), np.float32)
    inner, groups = cache[0], cache[1]
    lists, store = (ids, near, marks, picked), (inner, groups, groups.view(np.int32), slots, offsets)
    seen = np.empty((6, _ENOUGH + GROUP + WIDE), np.float32)
    seen_bits = seen.view(np.int32)
    for chunk in range(first, first + codes.shape[0]):
        roots = np.int64(lengths[chunk])
        count, slack = first_list(chunk, tops, met, roots, cloud[3], ids, near, near_chunks, offsets)
        decoded(near_chunks, count, cloud, scale, light, cache, slots)
        _contrasts(chunk, roots, slack, cloud[0], light, lists, store, seen, seen_bits, codes[chunk - first])
