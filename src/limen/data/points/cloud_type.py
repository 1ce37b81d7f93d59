"""Whether a file holds points, without reading them."""

from __future__ import annotations

from pathlib import Path

__all__ = ["cloud_type", "is_points"]

_MAGIC = {b"LASF": "las", b"ASTM-E57": "e57"}
_MESH_ELEMENTS = ("face", "tristrips", "edge")
_LONGEST_HEADER = 1 << 16


def is_points(path: str | Path) -> bool:
    """Whether it is to be opened as points: a folder that was made ready, or a cloud of points."""
    path = Path(path)
    return path.suffix.lower() == ".points" or cloud_type(path) is not None


def cloud_type(path: Path) -> str | None:
    """Which kind of cloud (``las``, ``e57``, ``ply``) by the file's first bytes; None if it is none.

    A PLY is one if it has no elements of faces, or none in them.
    """
    if not path.is_file():
        return None
    with path.open("rb") as file:
        head = file.read(8)
        for magic, kind in _MAGIC.items():
            if head.startswith(magic):
                return kind
        if head[:4] not in (b"ply\n", b"ply\r"):
            return None
        header = (head + file.read(_LONGEST_HEADER)).split(b"end_header")[0].decode("latin-1")
    elements = [line.split() for line in header.splitlines() if line.startswith("element")]
    counts = {words[1]: words[2] for words in elements if len(words) == 3}
    return None if any(counts.get(name, "0") != "0" for name in _MESH_ELEMENTS) else "ply"
