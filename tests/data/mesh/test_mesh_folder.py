"""Meshes made ready: what was written comes back, nothing else is taken for it, and nothing is left half done."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import limen
from limen import system as machine
from limen.data import ingest_mesh, sample_mesh
from limen.data.mesh import store as mesh_folder
from limen.data.mesh.mesh import Mesh
from limen.data.mesh.store import open_mesh_folder, tree_of
from limen.data.mesh.tree_build import build_vertex_tree
from limen.errors import FormatError, InputError, MissingFileError


@pytest.fixture(scope="module", params=["knot.ply", "knot.glb"])
def made(request: Any, tmp_path_factory: Any) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("meshes")
    sample_mesh(folder / request.param, 3000)
    report = ingest_mesh(folder / request.param, folder / "knot.mesh")
    assert report.size > 2900
    assert report.facts["nodes"] > report.facts["vertices"]
    return folder / request.param, folder / "knot.mesh"


def same(one: Any, other: Any) -> None:
    for ours, theirs in zip(one, other, strict=True):
        np.testing.assert_array_equal(ours, theirs)
        assert ours.dtype == theirs.dtype


def test_what_was_written_comes_back_bit_for_bit(made: tuple[Path, Path]) -> None:
    source, folder = made
    mesh, read = limen.open(source), limen.open(folder)
    assert isinstance(mesh, Mesh)
    assert isinstance(read, Mesh)
    for name in ("positions", "triangles", "normals", "colours", "uv", "layers", "textures"):
        np.testing.assert_array_equal(getattr(read, name), getattr(mesh, name))
    same(tree_of(read), build_vertex_tree(mesh))


def test_a_tree_is_only_of_the_mesh_that_it_was_made_of(made: tuple[Path, Path]) -> None:
    mesh = open_mesh_folder(made[1])
    moved = mesh.deformed(mesh.positions * np.array([1, 2, 1], np.float32))
    painted = replace(mesh, colours=255 - mesh.colours)
    fewer = replace(mesh, triangles=mesh.triangles[:500])
    for other in (moved, painted, fewer):
        assert other.path == mesh.path
        same(tree_of(other), build_vertex_tree(other))


def test_what_is_damaged_or_something_else_is_said(made: tuple[Path, Path], tmp_path: Path) -> None:
    source, folder = made
    broken = tmp_path / "broken.mesh"
    shutil.copytree(folder, broken)
    chunk = next(path for path in broken.rglob("tree/mask/c/**/*") if path.is_file())
    held = bytearray(chunk.read_bytes())
    held[len(held) // 2] ^= 0xFF
    chunk.write_bytes(held)
    with pytest.raises(FormatError, match="copy it again"):
        tree_of(open_mesh_folder(broken))
    chunk.unlink()
    with pytest.raises(FormatError, match="missing or cut short"):
        open_mesh_folder(broken)
    with pytest.raises(MissingFileError):
        open_mesh_folder(tmp_path / "nothing.mesh")
    with pytest.raises(InputError, match=r"ends in \.mesh"):
        ingest_mesh(source, tmp_path / "knot.tree")
    (tmp_path / "mine.mesh").mkdir()
    (tmp_path / "mine.mesh" / "letters").write_text("dear")
    with pytest.raises(InputError, match="is there already"):
        ingest_mesh(source, tmp_path / "mine.mesh")
    assert (tmp_path / "mine.mesh" / "letters").read_text() == "dear"


def test_nothing_is_left_of_what_was_interrupted(
    made: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(mesh_folder, "seal", stop)
    with pytest.raises(KeyboardInterrupt):
        ingest_mesh(made[0], tmp_path / "knot.mesh")
    assert not list(tmp_path.iterdir())


def test_trees_of_large_meshes_are_kept_until_the_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_folder, "_WORTH_KEEPING", 1000)
    monkeypatch.setattr(machine, "cache_folder", lambda: tmp_path)
    sample_mesh(tmp_path / "knot.ply", 2000)
    built: list[int] = []

    def counted(mesh: Mesh) -> Any:
        built.append(mesh.size)
        return build_vertex_tree(mesh)

    monkeypatch.setattr(mesh_folder, "build_vertex_tree", counted)
    first, again = (tree_of(limen.open(tmp_path / "knot.ply")) for _ in range(2))  # type: ignore[arg-type]
    assert len(built) == 1
    same(first, again)
    sample_mesh(tmp_path / "knot.ply", 2400)
    tree_of(limen.open(tmp_path / "knot.ply"))  # type: ignore[arg-type]
    assert len(built) == 2
    monkeypatch.setattr(machine, "cache_folder", lambda: tmp_path / "gone")
    tree_of(limen.open(tmp_path / "knot.ply"))  # type: ignore[arg-type]
    assert len(built) == 3, "without a place to keep it, it is built"
