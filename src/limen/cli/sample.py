"""``limen sample``: deterministic data at any size."""

from __future__ import annotations

from pathlib import Path

from limen.cli.output import DEFAULT, Common, Output
from limen.data import opening

__all__ = ["sample"]


def sample(
    kind: str,
    out: Path,
    *,
    gigapixels: float | None = None,
    size: int | None = None,
    seed: int = 0,
    aspect: float | None = None,
    common: Common = DEFAULT,
) -> None:
    """Make deterministic data: an imaginary map with detail at every scale, mountains, a scanned hall, or a torus knot.

    Parameters
    ----------
    kind
        What to make: image, terrain, points or mesh.
    out
        The file to write: .tif for an image or a terrain's heights; .las, .laz or .ply (with normals) for points; for a
        mesh .ply, or .glb with a texture.
    gigapixels
        How large an image, in 1e9 texels (1 unless --size is given).
    size
        How wide an image, in texels, instead of --gigapixels; how many posts along each side
        of a terrain (4096), 30 m apart; how many points (1,000,000); how many triangles of a mesh, about (69,716).
    seed
        Another number, another world.
    aspect
        Width by height of an image; the wall of a room of 416 panels, 133120 x 11520, unless given.
    """
    output = Output(common)
    asked = {"gigapixels": gigapixels, "size": size, "aspect": aspect}
    given = {name: value for name, value in asked.items() if value is not None}
    with output.progress(f"making {out.name}", 1000) as step:
        report = opening.sample(kind, out, seed=seed, progress=lambda done: step.to(round(1000 * done)), **given)
    output.report(report, opening.KINDS[kind].items)
