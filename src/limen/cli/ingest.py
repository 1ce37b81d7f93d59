"""``limen ingest``: make an image ready."""

from __future__ import annotations

from pathlib import Path

import limen.data
from limen.cli.output import DEFAULT, Common, Output

__all__ = ["ingest"]


def ingest(src: Path, dst: Path, *, quality: int = 90, subsampling: str = "444", common: Common = DEFAULT) -> None:
    """Make an image ready: a tiled TIFF with all reduced levels.

    Memory stays bounded for any size. DST appears only when it is complete.

    Parameters
    ----------
    src
        Any image that can be read.
    dst
        The TIFF to write.
    quality
        Of the JPEG tiles, 1 to 100.
    subsampling
        Of their colours: 444, 422 or 420.
    """
    out = Output(common)
    with out.progress(f"reading {src.name}", 1000) as step:
        report = limen.data.ingest(
            src, dst, quality=quality, subsampling=subsampling, progress=lambda done: step.to(round(1000 * done))
        )
    out.result(report)
    out.line(
        f"{report.path}: {report.size[0]} x {report.size[1]} texels, {report.pages} pages, {report.bytes:,} bytes, "
        f"in {report.seconds:.1f} s with {report.peak_rss_mib:.0f} MiB"
    )
