"""The kinds of data that there are: whoever adds one, adds a row here and one in `limen.layers.registry`.

What reads or makes a kind takes up to a second to import, so functions stand here by name, ``module:function``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from limen.data.store.file_type import existing_file
from limen.data.store.ingest import Progress
from limen.data.store.report import Info, IngestReport
from limen.data.store.tile_cache import CACHE_BYTES
from limen.errors import FormatError, InputError
from limen.extensions import extension

if TYPE_CHECKING:
    from limen.data.image.file import Image
    from limen.data.mesh.mesh import Mesh
    from limen.data.points.file import Points
    from limen.data.terrain.file import Terrain

__all__ = ["KINDS", "DataKind", "info", "ingest", "kind_of_file", "open_content", "open_picture", "sample"]


class DataKind(NamedTuple):
    """One kind of data.

    Parameters
    ----------
    noun, plural
        What people call one of them, and several.
    items
        What its size counts.
    is_one
        Whether a file or a folder holds one, by its name and its first bytes; empty for what is left when no other
        kind claims it. Rows are asked in their order.
    open
        Makes content of a path; ``opens_with`` are options of `open_content` that it hears.
    info
        Says of a path what it is, without making it ready: see `limen.data.store.report.Info`.
    ingest
        Makes a path ready at another, whose name ends in one of ``endings``; hears ``progress``, and the options
        ``ingests_with``.
    sample
        Makes a deterministic one at a path; hears ``size``, ``seed``, ``progress``, and the options ``samples_with``.
    side
        What ``size`` of a sample counts.
    """

    noun: str
    plural: str
    items: str
    is_one: str
    open: str
    info: str
    ingest: str
    sample: str
    side: str
    endings: tuple[str, ...]
    opens_with: tuple[str, ...] = ()
    ingests_with: tuple[str, ...] = ()
    samples_with: tuple[str, ...] = ()


KINDS = {
    "terrain": DataKind(
        noun="a terrain",
        plural="terrains",
        items="posts",
        is_one="limen.data.terrain.elevation_type:is_terrain",
        open="limen.data.terrain.opening:open_terrain",
        info="limen.data.terrain.opening:terrain_info",
        ingest="limen.data.terrain.ingest:ingest_terrain",
        sample="limen.data.samples.terrain:sample_terrain",
        side="posts a side has",
        endings=(".terrain",),
        opens_with=("progress",),
        ingests_with=("band", "spacing_m"),
    ),
    "points": DataKind(
        noun="a cloud of points",
        plural="points",
        items="points",
        is_one="limen.data.points.cloud_type:is_points",
        open="limen.data.points.opening:open_points",
        info="limen.data.points.opening:points_info",
        ingest="limen.data.points.ingest:ingest_points",
        sample="limen.data.samples.points:sample_points",
        side="points there are",
        endings=(".points",),
        opens_with=("progress",),
    ),
    "mesh": DataKind(
        noun="a mesh",
        plural="meshes",
        items="triangles",
        is_one="limen.data.mesh.mesh_type:is_mesh",
        open="limen.data.mesh.opening:open_mesh",
        info="limen.data.mesh.opening:mesh_info",
        ingest="limen.data.mesh.store:ingest_mesh",
        sample="limen.data.samples.mesh:sample_mesh",
        side="triangles a mesh has",
        endings=(".mesh",),
    ),
    "image": DataKind(
        noun="an image",
        plural="images",
        items="texels",
        is_one="",
        open="limen.data.image.file:open_image",
        info="limen.data.image.file:image_info",
        ingest="limen.data.image.ingest:ingest_image",
        sample="limen.data.samples.image:sample_image",
        side="texels an image is wide",
        endings=(".tif", ".tiff"),
        opens_with=("cache_bytes",),
        ingests_with=("quality", "subsampling"),
        samples_with=("gigapixels", "aspect"),
    ),
}
_REST = "image"
"""What nothing else claims is one of these, or is no data at all, which its reader says."""


def open_content(
    path: str | Path, *, cache_bytes: int = CACHE_BYTES, progress: Progress | None = None
) -> Image | Mesh | Points | Terrain:
    """Open a file as what it is: an image, with ``cache_bytes`` for its decoded tiles, a mesh, points, or a terrain.

    A raster of heights of up to 64 million posts, or a cloud of up to 20 million points, is made ready in the cache
    when it is first opened; ``progress`` is called with the fraction done, 0 ... 1. Formats that other packages read
    are entry points of the group ``limen.readers``, named by the file's ending.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FormatError
        If it is none of these, cut short, or so large that it wants ``limen ingest`` first.
    """
    found = _found(path)
    content: Image | Mesh | Points | Terrain
    if isinstance(found, str):
        options = {"cache_bytes": cache_bytes, "progress": progress}
        content = _named(KINDS[found].open)(path, **{name: options[name] for name in KINDS[found].opens_with})
    else:
        content = found(Path(path))
    return content


def open_picture(path: str | Path) -> Image:
    """An image, where nothing else will do; a FormatError says so of anything else, else as `open_content`."""
    found = _found(path)
    if found != _REST:
        what = KINDS[found].noun if isinstance(found, str) else "no image"
        raise FormatError(f"{path}: is {what}, and an image is wanted here; `limen show {path}` draws it")
    image: Image = _named(KINDS[_REST].open)(path)
    return image


def kind_of_file(path: str | Path) -> str:
    """The kind of what is in a file or folder; what another package reads is read for it. Raises as `open_content`."""
    found = _found(path)
    return found if isinstance(found, str) else str(found(Path(path)).kind)


def info(path: str | Path) -> Info:
    """What a file is, or what was made ready in a folder; nothing is made ready for that. Raises as `open_content`."""
    found = _found(path)
    told: Info = _named(KINDS[found].info)(path) if isinstance(found, str) else found(Path(path)).info()
    return told


def ingest(src: str | Path, dst: str | Path, *, progress: Progress | None = None, **options: Any) -> IngestReport:
    """Make a file ready as what the name ``dst`` asks for, see ``endings`` of `DataKind`.

    ``dst`` appears, or is replaced, only when all is written; on any error nothing is left behind. ``progress`` is
    called with the fraction done, 0 ... 1; ``options`` are those of the kind's own function.

    Raises
    ------
    MissingFileError, FormatError
        If there is no such file, or it cannot be used, or read only in part.
    InputError
        If an option is for another kind, ``dst`` is something else already, or named as another kind than ``src`` is.
    StorageError
        If the disk refuses.
    """
    src, dst = existing_file(src), Path(dst)
    target = next((name for name, kind in KINDS.items() if dst.suffix.lower() in kind.endings), _REST)
    for option in (each for each in options if each not in KINDS[target].ingests_with):
        of = [kind for kind in KINDS.values() if option in kind.ingests_with]
        raise _not_for(option, of, f"leave it out, or name DST so: {dst.with_suffix(of[0].endings[0])}" if of else "")
    found = _found(src)
    if not isinstance(found, str):
        raise InputError(f"{src}: is read by another package, and cannot be made ready; it is opened as it is")
    if found not in (target, _REST):  # what is left over may hold heights all the same, which its reader finds out
        ready = dst.with_suffix(KINDS[found].endings[0])
        raise InputError(f"{src}: is {KINDS[found].noun}; to make it ready, name DST so: {ready}")
    report: IngestReport = _named(KINDS[target].ingest)(src, dst, progress=progress, **options)
    return report


def sample(kind: str, path: str | Path, *, progress: Progress | None = None, **options: Any) -> IngestReport:
    """Make deterministic data of a kind: the same bytes on every run, another world for every ``seed``.

    Parameters
    ----------
    options
        ``seed``, ``size`` (see ``side`` of the kind), and those of the kind's own function, which has the defaults.

    Raises
    ------
    InputError
        If there is no such kind, an option is for another one, or a size or a name cannot be meant.
    StorageError
        If the disk refuses.
    """
    if kind not in KINDS:
        raise InputError(f"there is no sample of kind {kind!r}; the kinds are {', '.join(KINDS)}")
    for option in (each for each in options if each not in ("seed", "size", *KINDS[kind].samples_with)):
        of = [each for each in KINDS.values() if option in each.samples_with]
        raise _not_for(option, of, f"leave it out; --size says how many {KINDS[kind].side}")
    report: IngestReport = _named(KINDS[kind].sample)(path, progress=progress, **options)
    return report


def _found(path: str | Path) -> str | Callable[[Path], Any]:
    """The kind of a file, or what reads it if that is of another package."""
    for name, kind in KINDS.items():
        if kind.is_one and _named(kind.is_one)(path):
            return name
    reader: Callable[[Path], Any] | None = extension("limen.readers", Path(path).suffix.lower().removeprefix("."))
    return reader or _REST


def _named(name: str) -> Any:
    module, _, part = name.partition(":")
    return getattr(import_module(module), part)


def _not_for(option: str, kinds: Sequence[DataKind], cure: str) -> InputError:
    of = " and ".join(kind.plural for kind in kinds) or "nothing here"
    return InputError(f"--{option.replace('_', '-')} is of {of}: {cure or 'leave it out'}")
