"""``limen sample``: deterministic data at any size."""

from __future__ import annotations

from pathlib import Path

import limen.data
from limen.cli.output import DEFAULT, Common, Output
from limen.errors import InputError

__all__ = ["sample"]

_LATER = ("terrain", "points", "mesh")


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
    """Make deterministic data: an imaginary map with detail at every scale.

    Parameters
    ----------
    kind
        What to make: image.
    out
        The file to write.
    gigapixels
        How large, in 1e9 texels (1 unless --size is given).
    size
        How wide, in texels, instead of --gigapixels.
    seed
        Another number, another world.
    aspect
        Width by height; the wall of a room of 416 panels, 133120 x 11520, unless given.
    """
    output = Output(common)
    if kind in _LATER:
        raise InputError(f"sample {kind} is not made yet; only image is")
    if kind != "image":
        raise InputError(f"there is no sample of kind {kind!r}; the kinds are image, {', '.join(_LATER)}")
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
