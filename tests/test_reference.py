"""Pages of the reference are as the code is: those that are made of it, and those that are written by hand."""

from __future__ import annotations

import importlib
import importlib.util
import json
import re
import tomllib
import warnings
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zarr

from limen.cli.app import main
from limen.data.image import contrast_file
from limen.data.mesh.store import ingest_mesh
from limen.data.points.ingest import ingest_points
from limen.data.points.nodes import NODE, TOP
from limen.data.samples.mesh import sample_mesh
from limen.data.samples.points import sample_points
from limen.data.terrain.ingest import ingest_terrain
from limen.study.bench.registry import BENCHMARKS
from support.ground import write_dem

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "docs/reference"


def made() -> Any:
    """The tool that writes pages, which is no module of the package."""
    spec = importlib.util.spec_from_file_location("reference", ROOT / "tools/reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("page", ["cli.md", "python.md"])
def test_pages_that_are_made_of_the_code_are_as_it_is(page: str) -> None:
    tool = made()
    assert page in tool.PAGES
    written = (REFERENCE / page).read_text(encoding="utf-8")
    assert tool.PAGES[page]() == written, "the code says something else: run `python tools/reference.py`"


# ---------------------------------------------------------------- what --json prints


def printed(kind: Any, path: str = "") -> set[str]:
    """Paths of all that a type is printed as: ``frames[].layers``, ``frames[].layers[].kind``, ..."""
    match msgspec.inspect.type_info(kind) if isinstance(kind, type) else kind:
        case msgspec.inspect.StructType(fields=fields) | msgspec.inspect.DataclassType(fields=fields):
            begin = f"{path}." if path else ""
            return set().union(*(printed(field.type, begin + field.encode_name) for field in fields))
        case msgspec.inspect.ListType(item_type=item) | msgspec.inspect.VarTupleType(item_type=item):
            below = printed(item, f"{path}[]")
            return {path} if below == {f"{path}[]"} else {path} | below
        case msgspec.inspect.UnionType(types=types):
            return set().union(*(printed(each, path) for each in types))
    return {path}


def type_at(place: str) -> Any:
    """The type at ``module:name``."""
    module, _, name = place.partition(":")
    return getattr(importlib.import_module(module), name)


def rows_of(page: str, heading: str) -> dict[str, list[str]]:
    """The rows of all tables under a heading of a page of the reference, by their first cell."""
    text = (REFERENCE / page).read_text(encoding="utf-8")
    section = re.split(rf"^#+ {re.escape(heading)}$", text, flags=re.MULTILINE)[1]
    section = re.split(r"^#{1,3} ", section, flags=re.MULTILINE)[0]
    cells = [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        for line in section.splitlines()
        if line.startswith("| `")
    ]
    return {row[0].strip("`"): row[1:] for row in cells}


PRINTED: dict[str, str] = {
    "display": "limen.cli.display:DisplayReport",
    "doctor": "limen.cli.doctor:DoctorReport",
    "calibrate boards": "limen.cli.calibrate:BoardsReport",
    "calibrate solve": "limen.cli.calibrate:CalibrateReport",
    "calibrate rehearse": "limen.calibrate.rehearse:Rehearsal",
    "info of an image": "limen.data.image.file:ImageInfo",
    "info of a terrain": "limen.data.terrain.info:TerrainInfo",
    "info of points": "limen.data.points.info:PointsInfo",
    "info of a mesh": "limen.data.mesh.mesh:MeshInfo",
    "traffic of an image, or one-to-one": "limen.study.traffic:Traffic",
    "traffic of a terrain": "limen.study.terrain_traffic:TerrainTraffic",
    "traffic of a mesh or points": "limen.study.scene_traffic:SceneTraffic",
    "verify": "limen.cli.verify:VerifyReport",
}
"""What verbs print, by the headings of the page."""

COLUMNS: dict[str, str] = {
    "bench image, kernels, points, mesh": "limen.study.bench.table:FIGURES",
    "bench panels": "limen.study.bench.panels:_COLUMNS",
    "bench lens": "limen.study.bench.lens:_COLUMNS",
    "bench terrain": "limen.study.bench.terrain:_COLUMNS",
    "bench layers": "limen.study.bench.layers:_COLUMNS",
}
"""Rows of benchmarks."""


@pytest.mark.parametrize("verb", PRINTED)
def test_json_is_told_field_by_field(verb: str) -> None:
    assert set(rows_of("json.md", verb)) == printed(type_at(PRINTED[verb]))


@pytest.mark.parametrize("bench", COLUMNS)
def test_rows_of_benchmarks_are_told(bench: str) -> None:
    assert set(rows_of("json.md", bench)) == set(type_at(COLUMNS[bench]))


def test_every_benchmark_is_told() -> None:
    named = {name for heading in COLUMNS for name in heading.removeprefix("bench ").split(", ")}
    assert named == set(BENCHMARKS)


def test_json_of_demo_is_told_with_the_traffic_of_an_image() -> None:
    traffic = printed(type_at(PRINTED["traffic of an image, or one-to-one"]))
    told = set(rows_of("json.md", "demo"))
    assert printed(type_at("limen.cli.demo:DemoReport")) == (told - {"traffic", "traffic_one_to_one"}) | {
        f"{name}.{field}" for name in ("traffic", "traffic_one_to_one") for field in traffic
    }


@pytest.mark.parametrize(
    ("kind", "made", "ready"),
    [
        ("image", "image.tif --size 600 --aspect 2", "other.tif"),
        ("terrain", "hills.tif --size 300", "hills.terrain"),
        ("points", "hall.las --size 5000", "hall.points"),
        ("mesh", "knot.ply --size 800", "knot.mesh"),
    ],
)
def test_json_of_sample_and_ingest_is_told(
    kind: str,
    made: str,
    ready: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    first = ("kind", "path", "size", "bytes", "seconds", "peak_rss_mib", "notes")
    for verb, words in (("sample", ["sample", kind, *made.split()]), ("ingest", ["ingest", made.split()[0], ready])):
        with pytest.raises(SystemExit, match="0"):
            main([*words, "--json"])
        rows = rows_of("json.md", verb)
        others = {
            row for row, (_, meaning) in rows.items() if " of " in f" {meaning} " and kind in meaning.split(":")[0]
        }
        always = {*first, "seed"} if verb == "sample" else {*first}
        assert tuple(rows)[: len(first)] == first
        assert set(json.loads(capsys.readouterr().out)) == always | (others - {*first})


def test_json_of_show_is_told_field_by_field() -> None:
    from limen.frame.report import FrameReport

    frames = {"frames", "frames[].files"} | printed(FrameReport, "frames[]")
    assert set(rows_of("json.md", "show")) == frames


def test_json_of_a_walk_is_told_field_by_field(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["walk", "--display", "desktop", "--seconds", "1", "--json", str(tmp_path / "walk.csv")])
    assert set(rows_of("json.md", "walk")) == set(json.loads(capsys.readouterr().out))


# ---------------------------------------------------------------- files

WRITTEN: dict[str, tuple[str, ...]] = {
    "A display": ("limen.display.entries:DisplayFile",),
    "A grid": ("limen.display.grid:Grid",),
    "A panel": ("limen.display.entries:PanelEntry",),
    "A mesh of panels": ("limen.display.entries:MeshEntry",),
    "An adjustment": ("limen.display.entries:Adjustment",),
    "A quilt": ("limen.display.entries:QuiltEntry",),
    "A panel in a quilt": ("limen.display.entries:QuiltPanel",),
    "A show": ("limen.show.entries:ShowFile",),
    "A layer": tuple(f"limen.show.entries:{kind}Entry" for kind in ("Image", "Model", "Points", "Terrain")),
    "Placement of an image": ("limen.show.entries:SurfaceEntry",),
    "A lens": ("limen.show.entries:LensEntry",),
    "Placement of a mesh or of points": ("limen.show.entries:RoomEntry",),
    "Placement of a terrain": ("limen.show.entries:CameraEntry",),
    "Style of a mesh": ("limen.show.entries:MeshStyle",),
    "Style of points": ("limen.show.entries:PointsStyle",),
    "Style of a terrain": ("limen.show.entries:TerrainStyle",),
    "Camera files": ("limen.calibrate.camera:_CameraFile",),
}
"""Tables of files that people write, and what reads them."""

_TOLD_APART = ("placement", "style")
"""Fields that have tables of their own."""


def default_of(field: msgspec.inspect.Field) -> object:
    """As it is written in TOML."""
    made = field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
    if made is msgspec.NODEFAULT:
        return "required"
    return "none" if made is None else msgspec.json.decode(msgspec.json.encode(made))


@pytest.mark.parametrize("heading", WRITTEN)
def test_files_are_told_field_by_field_with_their_defaults(heading: str) -> None:
    fields: dict[str, object] = {}
    for place in WRITTEN[heading]:
        told = msgspec.inspect.type_info(type_at(place))
        assert isinstance(told, msgspec.inspect.StructType)
        fields |= {each.encode_name: default_of(each) for each in told.fields}
    fields |= {name: {} for name in _TOLD_APART if name in fields}
    rows = rows_of("files.md", heading)
    assert set(rows) == set(fields)
    for name, default in fields.items():
        cell = rows[name][2]
        written = cell if cell in ("required", "none") else tomllib.loads(f"x = {cell.strip('`')}")["x"]
        assert written == default, f"{heading}, {name}"


FOLDERS: dict[str, tuple[str, str]] = {
    "NAME.terrain": ("limen.data.terrain.store:Header", "hills.terrain"),
    "NAME.points": ("limen.data.points.store:PointsHeader", "hall.points"),
    "NAME.mesh": ("limen.data.mesh.store:MeshHeader", "knot.mesh"),
}


@pytest.fixture(scope="module")
def made_ready(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one of each."""
    folder = tmp_path_factory.mktemp("made")
    ingest_terrain(write_dem(folder / "hills.tif"), folder / "hills.terrain")
    sample_points(folder / "hall.ply", 6000)
    ingest_points(folder / "hall.ply", folder / "hall.points")
    sample_mesh(folder / "knot.glb", 800)
    ingest_mesh(folder / "knot.glb", folder / "knot.mesh")
    return folder


@pytest.mark.parametrize("heading", FOLDERS)
def test_folders_are_told_array_by_array(heading: str, made_ready: Path) -> None:
    place, name = FOLDERS[heading]
    told = {each for cell in rows_of("files.md", heading) for each in cell.replace("`", "").split(", ")}
    with warnings.catch_warnings(action="ignore"):  # files.json is no array, which Zarr remarks
        members = zarr.open_group(made_ready / name, mode="r").members(max_depth=None)
    arrays = {re.sub(r"/\d+$", "/L", path) for path, each in members if isinstance(each, zarr.Array)}
    parts = {*NODE.names, *TOP.names} if heading == "NAME.points" else set()
    known = arrays | parts | set(type_at(place).__struct_fields__)
    assert known <= told
    assert told - known <= {"posts/void", "mesh/textures", "mesh/welds"}  # that not every one has


@pytest.mark.parametrize(("table", "dtype"), [("of a node in a chunk", NODE), ("of a top", TOP)])
def test_nodes_of_points_are_told_byte_by_byte(table: str, dtype: Any) -> None:
    text = (REFERENCE / "files.md").read_text(encoding="utf-8").split(f"| {table} |")[1].split("\n\n")[0]
    ends = {name: (begin, begin + kind.itemsize - 1) for name, (kind, begin) in dtype.fields.items()}
    bytes_of = {name: f"{first}-{last}" if last > first else f"{first}" for name, (first, last) in ends.items()}
    assert dict(re.findall(r"^\| `(\w+)` \| ([\d-]+) \|", text, flags=re.MULTILINE)) == bytes_of


def test_the_first_line_of_contrasts_is_told() -> None:
    assert set(rows_of("files.md", "NAME.contrast")) == set(contrast_file._Header.__struct_fields__)
