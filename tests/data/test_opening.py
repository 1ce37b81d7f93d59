"""The table of kinds: what is in files, what is made of them, and what is refused, whatever the kind."""

from __future__ import annotations

import errno
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from limen.data import opening
from limen.errors import FormatError, InputError, MissingFileError, StorageError

FILES = {"terrain": ("a.tif", 200), "points": ("a.laz", 5000), "mesh": ("a.glb", 500), "image": ("w.tif", 600)}
READY = {"terrain": "b.terrain", "points": "b.points", "mesh": "b.mesh", "image": "b.tif"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of every kind."""
    folder = tmp_path_factory.mktemp("made")
    for kind, (name, size) in FILES.items():
        opening.sample(kind, folder / name, size=size)
    return folder


def test_every_name_in_the_table_is_there() -> None:
    assert set(opening.KINDS) == set(FILES)
    for kind in opening.KINDS.values():
        for name in filter(None, (kind.is_one, kind.open, kind.info, kind.ingest, kind.sample)):
            module, _, part = name.partition(":")
            assert callable(getattr(import_module(module), part)), name


@pytest.mark.parametrize("kind", FILES)
def test_a_file_keeps_its_kind_through_all_doors(kind: str, made: Path, tmp_path: Path) -> None:
    file, ready = made / FILES[kind][0], tmp_path / READY[kind]
    done: list[float] = []
    report = opening.ingest(file, ready, progress=done.append)
    assert (report.kind, report.path, done[-1]) == (kind, str(ready), 1.0)
    assert report.flat().keys() >= {"kind", "path", "size", "bytes", "seconds", "peak_rss_mib", "notes", *report.facts}
    for path in (file, ready):
        told = opening.info(path)
        assert opening.kind_of_file(path) == told.kind == kind
        assert (told.path, told.size) == (str(path), report.size)  # type: ignore[attr-defined]
        described = told.described()
        assert described.facts["size"]
        assert all(len(row) == len(described.columns) for row in described.rows)
    content: Any = opening.open_content(ready)
    assert content.kind == kind
    if kind == "image":
        content.close()
    assert ("not made ready yet" in opening.info(file).described().facts) == (kind in ("terrain", "points"))


@pytest.mark.parametrize("kind", FILES)
def test_a_full_disk_is_named_and_leaves_what_was_there(
    kind: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready = tmp_path / READY[kind]
    opening.ingest(made / FILES[kind][0], ready)
    before = {path: path.stat().st_size for path in tmp_path.rglob("*")}

    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("limen.data.store.zarr_group.write_bytes", full)
    monkeypatch.setattr("limen.data.image.bigtiff.BigTiffWriter.finish", full)
    with pytest.raises(StorageError, match="the disk is full") as told:
        opening.ingest(made / FILES[kind][0], ready)
    assert str(ready) in str(told.value)
    assert {path: path.stat().st_size for path in tmp_path.rglob("*")} == before


@pytest.mark.parametrize("target", FILES)
@pytest.mark.parametrize("kind", ["terrain", "points", "mesh"])
def test_what_is_named_as_another_kind_is_said(kind: str, target: str, made: Path, tmp_path: Path) -> None:
    if kind != target:
        with pytest.raises(InputError, match=rf"is {opening.KINDS[kind].noun}; .*name DST so: .*{READY[kind]}"):
            opening.ingest(made / FILES[kind][0], tmp_path / READY[target])
    assert not list(tmp_path.iterdir())


def test_what_looks_like_a_picture_may_be_made_a_terrain(made: Path, tmp_path: Path) -> None:
    assert opening.kind_of_file(made / "w.tif") == "image"
    assert opening.ingest(made / "w.tif", tmp_path / "b.terrain", band=1).kind == "terrain"


@pytest.mark.parametrize(("option", "of"), [("quality", "image"), ("subsampling", "image"), ("band", "terrain")])
@pytest.mark.parametrize("kind", FILES)
def test_options_of_another_kind_are_refused_by_name(kind: str, option: str, of: str, made: Path) -> None:
    if kind != of:
        with pytest.raises(InputError, match=f"--{option} is of {of}s: leave it out, or name DST so: .*{READY[of]}"):
            opening.ingest(made / FILES[kind][0], made / READY[kind], **{option: 1})
    with pytest.raises(InputError, match="--colour is of nothing here: leave it out"):
        opening.ingest(made / FILES[kind][0], made / READY[kind], colour=1)


@pytest.mark.parametrize("ending", [".tif", ".terrain", ".points", ".mesh", ".laz"])
def test_what_is_not_there_is_said_at_every_door(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"nowhere{ending}"
    for door in (opening.open_content, opening.info):
        with pytest.raises(MissingFileError, match="nowhere"):
            door(path)
    with pytest.raises(MissingFileError, match="nowhere"):
        opening.ingest(path, tmp_path / "b.tif" if ending == ".tif" else tmp_path / "b.mesh")
    with pytest.raises(InputError, match="is a folder"):
        opening.info(tmp_path)


@pytest.mark.parametrize("kind", ["terrain", "points", "mesh"])
def test_only_an_image_is_a_picture(kind: str, made: Path) -> None:
    with pytest.raises(FormatError, match=f"is {opening.KINDS[kind].noun}, and an image is wanted here"):
        opening.open_picture(made / FILES[kind][0])
    with opening.open_picture(made / "w.tif") as image:
        assert image.size_px[0] == 600
