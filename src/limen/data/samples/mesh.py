"""A mesh of any size: a bumpy torus knot, closed, smooth, and coloured so that what is mirrored or swapped shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import NO_TEXTURE, Mesh, smooth_normals, weld_numbers
from limen.data.samples.seeds import check_seed
from limen.data.store.atomic import write_bytes
from limen.data.store.ingest import Progress
from limen.data.store.memory import Footprint
from limen.data.store.report import IngestReport
from limen.errors import InputError
from limen.system import interrupts_later

__all__ = ["KNOT_TRIANGLES", "ripple", "sample_mesh", "torus_knot"]

Floats = NDArray[np.float64]

KNOT_TRIANGLES = 69_716
"""601 steps along the knot times 58 around it, two triangles each."""

_MOST_TRIANGLES = 20_000_000
_LENGTH_TO_GIRTH = 601 / 58
_TURNS, _WINDINGS = 2, 3
_RING, _TUBE, _THICKNESS = 0.62, 0.26, 0.12
"""Radii of the torus that carries the knot, and of the knot itself, as shares of the whole."""
_BUMPS = 7
_TEXTURE_PX = (256, 1024)


def sample_mesh(
    path: str | Path, size: int = KNOT_TRIANGLES, seed: int = 0, progress: Progress | None = None
) -> IngestReport:
    """Write the knot number ``seed``: with coloured vertices as PLY, with a texture as GLB, as the name says.

    The same bytes on every run. ``size`` is about how many triangles it has.

    Raises
    ------
    InputError
        If the name ends in neither, or the size cannot be meant.
    StorageError
        If the disk refuses.
    """
    path = Path(path)
    writers: dict[str, Callable[[Mesh], bytes]] = {".ply": _as_ply, ".glb": _as_glb}
    suffix = path.suffix.lower()
    if suffix not in writers:
        raise InputError(
            f"{path}: the sample is a PLY, or a GLB with a texture; give it a name that ends in .ply or .glb"
        )
    with Footprint() as used:
        mesh = torus_knot(size, seed, textured=suffix == ".glb")
        write_bytes(path, writers[suffix](mesh))
    if progress is not None:
        progress(1.0)
    return IngestReport.of("mesh", path, used, size=mesh.size, seed=seed, vertices=len(mesh.positions))


def torus_knot(triangles: int = KNOT_TRIANGLES, seed: int = 0, *, textured: bool = False) -> Mesh:
    """A bumpy (2, 3) torus knot of about that many triangles, about the origin, of radius 1.

    Parameters
    ----------
    triangles
        48 to 20,000,000; the default is met exactly.
    seed
        Another number, other bumps.
    textured
        Colour comes from a texture (a chequered map of the tube, its first row and column cut at a seam) instead of
        from the vertices.

    Raises
    ------
    InputError
        If the number of triangles or the seed lies outside.
    """
    if not 48 <= triangles <= _MOST_TRIANGLES:
        raise InputError(f"a sample mesh has 48 to {_MOST_TRIANGLES:,} triangles, not {triangles}")
    check_seed(seed)
    around = max(3, round(math.sqrt(triangles / 2 / _LENGTH_TO_GIRTH)))
    along = max(8, round(triangles / 2 / around))
    # With a texture the first row and column exist twice, at either end of the picture.
    rows, columns = (along + 1, around + 1) if textured else (along, around)
    u, v = np.meshgrid(np.arange(rows) / along, np.arange(columns) / around, indexing="ij")
    places = _knot(u.ravel() % 1.0, v.ravel() % 1.0, seed)
    places = (places / np.linalg.norm(places, axis=1).max()).astype(np.float32)
    faces = _faces(along, around, rows, columns)
    white = np.full((len(places), 4), 255, np.uint8)
    return Mesh(
        path=None,
        positions=places,
        triangles=faces,
        normals=smooth_normals(places, faces, weld_numbers(places)),
        colours=white if textured else _colours(places, u.ravel(), v.ravel()),
        uv=(np.stack([u.ravel(), v.ravel()], axis=1) * (1 if textured else 0)).astype(np.float32),
        layers=np.full(len(places), 0 if textured else NO_TEXTURE, np.uint32),
        textures=_texture() if textured else np.zeros((0, 1, 1, 4), np.uint8),
    )


def ripple(
    mesh: Mesh, time_s: float, *, amplitude: float = 0.03, wavelength: float = 0.35, period_s: float = 2.0
) -> Mesh:
    """What ``mesh``, at rest, becomes as a wave runs outward through it: something that moves, for demonstrations.

    ``amplitude`` and ``wavelength`` are shares of the radius of its bounding box. Where a vertex goes depends on its
    place alone, so nothing that is closed comes apart.
    """
    low, high = mesh.bounds
    centre = (low + high) / 2
    radius = np.float32(max(float(np.linalg.norm(high - low)) / 2, 1e-30))
    local = (mesh.positions - centre) / radius
    distance = np.sqrt(np.einsum("ij,ij->i", local, local))
    phase = np.float32(2 * math.pi) * (distance / np.float32(wavelength) - np.float32(time_s / period_s % 1.0))
    return mesh.deformed(mesh.positions + local * (radius * np.float32(amplitude) * np.sin(phase))[:, None])


def _curve(angle: Floats) -> tuple[Floats, Floats]:
    """Places (N, 3) of the knot's axis, and the normals there (N, 3) of the torus that carries it."""
    turn, wind = _TURNS * angle, _WINDINGS * angle
    outward = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    normal = outward * np.cos(wind)[:, None] + np.sin(wind)[:, None] * np.array([0.0, 0.0, 1.0])
    return outward * _RING + normal * _TUBE, normal


def _knot(u: Floats, v: Floats, seed: int) -> Floats:
    """Places at ``u`` along and ``v`` around the tube, both 0 ... 1 and closed."""
    angle = 2 * math.pi * u
    centre, normal = _curve(angle)
    step = 1e-4
    tangent = _curve(angle + step)[0] - _curve(angle - step)[0]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal -= tangent * np.einsum("ij,ij->i", normal, tangent)[:, None]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    side = np.cross(tangent, normal)
    around = 2 * math.pi * v
    radius = (_THICKNESS * _bumps(u, v, seed))[:, None]
    return np.asarray(centre + radius * (normal * np.cos(around)[:, None] + side * np.sin(around)[:, None]))


def _bumps(u: Floats, v: Floats, seed: int) -> Floats:
    """Waves with whole numbers of periods along and around: closed and smooth; 0.6 ... 1.4."""
    chance = np.random.default_rng([seed, 0x6B6E6F74])
    height = np.zeros_like(u)
    for _ in range(_BUMPS):
        along, around = int(chance.integers(9, 40)), int(chance.integers(-3, 4))
        height += np.sin(2 * math.pi * (along * u + around * v + chance.random())) / _BUMPS
    return 1.0 + 0.4 * height


def _faces(along: int, around: int, rows: int, columns: int) -> NDArray[np.uint32]:
    """Two triangles a cell of the grid, counter-clockwise from outside; grids without a seam close on themselves."""
    i, j = (index.ravel() for index in np.meshgrid(np.arange(along), np.arange(around), indexing="ij"))
    after, beside = (i + 1) % rows, (j + 1) % columns
    a, b, c, d = i * columns + j, after * columns + j, after * columns + beside, i * columns + beside
    return np.stack([a, c, b, a, d, c], axis=1).reshape(-1, 3).astype(np.uint32)


def _colours(places: NDArray[np.float32], u: Floats, v: Floats) -> NDArray[np.uint8]:
    """Red grows with x, green with y, blue with z; a chequered pattern follows the tube."""
    share = 0.5 + 0.45 * places.astype(float)
    shade = np.where((np.floor(u * 60) + np.floor(v * 6)) % 2 == 0, 1.0, 0.72)
    colours = np.full((len(places), 4), 255, np.uint8)
    colours[:, :3] = np.rint(255 * share * shade[:, None])
    return colours


def _texture() -> NDArray[np.uint8]:
    """One layer, (1, 256, 1024, 4): red grows to the right, green downward, squares of 32 texels."""
    height, width = _TEXTURE_PX
    y, x = np.mgrid[:height, :width]
    dark = ((x // 32 + y // 32) % 2).astype(bool)
    texels = np.stack([x * 255 // (width - 1), y * 255 // (height - 1), np.where(dark, 60, 200)], axis=-1)
    return np.concatenate([texels, np.full((height, width, 1), 255)], axis=-1).astype(np.uint8)[None]


def _as_ply(mesh: Mesh) -> bytes:
    """Little-endian binary, with normals and colours."""
    rows = np.empty(len(mesh.positions), [("place", "<f4", 3), ("normal", "<f4", 3), ("colour", "u1", 4)])
    rows["place"], rows["normal"], rows["colour"] = mesh.positions, mesh.normals, mesh.colours
    faces = np.empty(mesh.size, [("corners", "u1"), ("triangle", "<u4", 3)])
    faces["corners"], faces["triangle"] = 3, mesh.triangles
    floats = [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    codes = [f"property uchar {name}" for name in ("red", "green", "blue", "alpha")]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment limen sample mesh",
        f"element vertex {len(rows)}",
        *floats,
        *codes,
        f"element face {len(faces)}",
        "property list uchar uint vertex_indices",
        "end_header\n",
    ]
    return "\n".join(header).encode() + rows.tobytes() + faces.tobytes()


def _as_glb(mesh: Mesh) -> bytes:
    with interrupts_later():
        import trimesh
    from PIL import Image as Picture

    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Picture.fromarray(mesh.textures[0, ..., :3]), metallicFactor=0.0, roughnessFactor=1.0
    )
    visual = trimesh.visual.TextureVisuals(uv=mesh.uv * [1, -1] + [0, 1], material=material)
    made: Any = trimesh.Trimesh(
        mesh.positions, mesh.triangles, vertex_normals=mesh.normals, visual=visual, process=False
    )
    return bytes(made.export(file_type="glb", include_normals=True))
