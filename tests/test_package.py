"""The package as a whole: public names, imports, errors, sizes of files and functions, every verb's help."""

from __future__ import annotations

import ast
import builtins
import inspect
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import limen
from limen import errors
from limen.cli import app as cli_app

SOURCE = Path(limen.__file__).parent
FILES = sorted(SOURCE.rglob("*.py"))
LONGEST_FILE, LONGEST_FUNCTION = 400, 60
HEAVY = ("wgpu", "numba", "pyvips", "matplotlib", "trimesh")


def names_for_type_checkers() -> dict[str, str]:
    """What the TYPE_CHECKING block of limen/__init__.py imports: name -> module."""
    tree = ast.parse((SOURCE / "__init__.py").read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name: str(node.module) for node in imports for alias in node.names}


def test_the_three_lists_of_public_names_agree() -> None:
    assert sorted(limen.__all__) == sorted(limen._HOMES)
    assert names_for_type_checkers() == limen._HOMES
    assert set(limen.__all__) <= set(dir(limen))


@pytest.mark.parametrize("name", limen.__all__)
def test_a_public_name_is_where_the_table_says(name: str) -> None:
    assert getattr(limen, name) is not None


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        limen.nonsense  # noqa: B018


def imported(module: str, names: Sequence[str]) -> list[str]:
    """Which packages are imported with a module of limen."""
    script = f"import sys, {module}; print(*[name for name in {names!r} if name in sys.modules])"
    return subprocess.check_output([sys.executable, "-c", script], text=True).split()


def test_importing_limen_imports_nothing_heavy() -> None:
    assert imported("limen", HEAVY) == []


def test_the_help_of_show_imports_no_renderer() -> None:
    assert imported("limen.cli.show", _SLOW) == []


def test_showing_an_image_does_not_wait_for_what_terrains_and_sessions_import() -> None:
    """They take longer than everything else that a window wants."""
    rest = "zarr", "rasterio", "scipy.signal", "scipy.spatial", "scipy.stats", "trimesh"
    assert imported("limen.cli.show_content", rest) == []


_READERS = {
    "points.las": {"laspy", "rasterio"},
    "points.ply": set[str](),
    "image.png": {"tifffile", "pyvips"},
    "image.tif": {"tifffile", "pyvips"},
    "heights.asc": {"rasterio"},
    "mesh.ply": {"trimesh", "scipy", "pyvips", "numba"},  # its normals are summed by a compiled loop
}
"""Files, and what is needed of `_SLOW` to say what each of them is."""
_SLOW = (
    "laspy",
    "matplotlib",
    "numba",
    "plyfile",
    "pyvips",
    "rasterio",
    "scipy",
    "tifffile",
    "trimesh",
    "wgpu",
    "zarr",
)


@pytest.mark.parametrize("name", _READERS)
def test_info_imports_what_reads_the_file_and_nothing_that_builds_or_draws(name: str, tmp_path: Path) -> None:
    """Compilers, solvers and renderers take seconds to import."""
    path = tmp_path / name
    write_small(path)
    script = (
        "import sys\nfrom limen.cli.app import main\n"
        f"try: main(['info', {str(path)!r}])\n"
        f"finally: print('imported', *[name for name in {_SLOW!r} if name in sys.modules])"
    )
    answer = subprocess.check_output([sys.executable, "-c", script], text=True).splitlines()
    assert answer[0].startswith(f"{path}: {name.split('.')[0].replace('heights', 'terrain')}")
    assert answer[-1].split()[0] == "imported"
    assert set(answer[-1].split()[1:]) == _READERS[name]


def write_small(path: Path) -> None:
    """A file of a few numbers."""
    places = np.arange(12.0).reshape(4, 3) ** 2
    if path.suffix == ".las":
        import laspy

        header = laspy.LasHeader(point_format=3, version="1.2")
        points = laspy.LasData(header)
        points.x, points.y, points.z = places.T
        points.write(path)
    elif path.suffix in (".png", ".tif"):
        import pyvips

        pyvips.Image.black(300, 200, bands=3).cast("uchar").write_to_file(str(path))
    elif path.suffix == ".asc":
        head = "ncols 3\nnrows 2\nxllcorner 500000\nyllcorner 4000000\ncellsize 30\n"
        path.write_text(f"{head}1 2 3\n4 5 7\n")
    else:
        faces = "element face 1\nproperty list uchar int vertex_indices\n" if path.stem == "mesh" else ""
        names = "".join(f"property float {axis}\n" for axis in "xyz")
        rows = "".join(" ".join(map(str, row)) + "\n" for row in places) + ("3 0 1 3\n" if faces else "")
        path.write_text(f"ply\nformat ascii 1.0\nelement vertex 4\n{names}{faces}end_header\n{rows}")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_files_and_functions_stay_small(path: Path) -> None:
    """The house asks for 400 and 40 lines; 60 leaves room for a docstring and a table."""
    text = path.read_text()
    assert len(text.splitlines()) <= LONGEST_FILE
    functions = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
    long = {node.name: length for node in functions if (length := lines_of(node)) > LONGEST_FUNCTION}
    if not is_compiled(path):
        assert not long, f"functions of more than {LONGEST_FUNCTION} lines: {long}"


def lines_of(node: ast.FunctionDef) -> int:
    """Lines of code: a long docstring is no sin."""
    docstring = node.body[0] if ast.get_docstring(node) else None
    spent = (docstring.end_lineno or 0) - docstring.lineno + 1 if docstring else 0
    return (node.end_lineno or 0) - node.lineno + 1 - spent


def is_compiled(path: Path) -> bool:
    """Numba's loops are long where splitting them would cost arguments or speed."""
    return path.name.startswith("kernels") or path.name.endswith("_kernels.py")


def test_loops_are_compiled_in_one_way() -> None:
    """Numba's own decorators would keep code that an edit elsewhere has made wrong."""
    numbas = ("njit", "jit", "vectorize", "guvectorize", "stencil", "cfunc")
    for path in FILES:
        imports = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
        names = {alias.name for node in imports if node.module == "numba" for alias in node.names}
        assert not names & set(numbas), path


ERRORS = [getattr(errors, name) for name in errors.__all__]


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: error.__name__)
def test_every_error_is_ours_and_a_builtin(error: type[Exception]) -> None:
    assert issubclass(error, errors.LimenError)
    if error is not errors.LimenError:
        own = {errors.LimenError, *ERRORS, Exception, BaseException, object}
        assert [base for base in error.__mro__ if base not in own and hasattr(builtins, base.__name__)]
    assert error.__name__ in (errors.__doc__ or ""), "the tree in the docstring is incomplete"


def test_the_tree_lists_every_error_class() -> None:
    found = [name for name, value in vars(errors).items() if inspect.isclass(value) and issubclass(value, Exception)]
    assert sorted(found) == sorted(errors.__all__)


VERBS = [
    name for name in cli_app._VERBS if (SOURCE / "cli" / f"{name}.py").exists() or (SOURCE / "cli" / name).is_dir()
]


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_answers_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        cli_app.main([verb, "--help"])
    except SystemExit as ended:
        assert not ended.code  # noqa: PT017 - to return is as good as to exit with 0
    assert f"limen {verb}" in capsys.readouterr().out


def test_a_class_name_is_used_once() -> None:
    """One name, one thing: whoever searches for a class finds one. Those of a module alone begin with an underscore."""
    homes: dict[str, list[str]] = {}
    for path in FILES:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(str(path.relative_to(SOURCE)))
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}
