"""``limen sample``: deterministic data at any size."""

from __future__ import annotations

from pathlib import Path

import limen.data
from limen.cli.output import DEFAULT, Common, Output
from limen.errors import InputError

__all__ = ["sample"]

_SIZES = {
    "mesh": "how many triangles a mesh has",
    "terrain": "how many posts a side has",
    "points": "how many points there are",
}
"""What ``--size`` means, of anything but an image."""


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
    if kind in _SIZES:
        for option, value in (("--gigapixels", gigapixels), ("--aspect", aspect)):
            if value is not None:
                raise InputError(f"{option} is of images: leave it out; --size says {_SIZES[kind]}")
    match kind:
        case "image":
            _image(output, out, gigapixels, size, seed, aspect)
        case "mesh":
            _mesh(output, out, size, seed)
        case "terrain":
            _terrain(output, out, size, seed)
        case "points":
            _points(output, out, size, seed)
        case _:
            raise InputError(f"there is no sample of kind {kind!r}; the kinds are image, terrain, points and mesh")


def _points(output: Output, out: Path, size: int | None, seed: int) -> None:
    with output.progress(f"scanning {out.name}", 1000) as step:
        report = limen.data.sample_points(
            out, limen.data.HALL_POINTS if size is None else size, seed, lambda done: step.to(round(1000 * done))
        )
    output.result(report)
    output.line(
        f"{report.path}: {report.size:,} points, {report.bytes:,} bytes, in {report.seconds:.1f} s with "
        f"{report.peak_rss_mib:.0f} MiB"
    )


def _terrain(output: Output, out: Path, size: int | None, seed: int) -> None:
    with output.progress(f"making {out.name}", 1000) as step:
        report = limen.data.sample_terrain(
            out, 4096 if size is None else size, seed, progress=lambda done: step.to(round(1000 * done))
        )
    output.result(report)
    output.line(
        f"{report.path}: {report.size[0]} x {report.size[1]} posts, {report.spacing_m:g} m apart, "
        f"{report.bytes:,} bytes, in {report.seconds:.1f} s with {report.peak_rss_mib:.0f} MiB"
    )


def _mesh(output: Output, out: Path, size: int | None, seed: int) -> None:
    report = limen.data.sample_mesh(out, limen.data.KNOT_TRIANGLES if size is None else size, seed)
    output.result(report)
    output.line(
        f"{report.path}: {report.size:,} triangles, {report.vertices:,} vertices, {report.bytes:,} bytes, "
        f"in {report.seconds:.1f} s"
    )


def _image(
    output: Output, out: Path, gigapixels: float | None, size: int | None, seed: int, aspect: float | None
) -> None:
    if size is not None and gigapixels is not None:
        raise InputError("--size and --gigapixels both say how large; give one of them")
    with output.progress(f"drawing {out.name}", 1000) as step:
        report = limen.data.sample_image(
            out,
            gigapixels=1.0 if gigapixels is None else gigapixels,
            width_px=size,
            seed=seed,
            progress=lambda done: step.to(round(1000 * done)),
            aspect=aspect,
        )
    output.result(report)
    output.line(
        f"{report.path}: {report.size[0]} x {report.size[1]} texels, {report.pages} pages, {report.bytes:,} bytes, "
        f"in {report.seconds:.1f} s with {report.peak_rss_mib:.0f} MiB"
    )
