"""Compiled loops are current, kept where they may be, and never in the way."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest
from numba.core import caching

import limen
from limen import compiled as module

SOURCE = Path(limen.__file__).parent
TINY = {
    "constants.py": "FACTOR = 2.0\n",
    "callee_kernels.py": (
        "from limen.compiled import compiled\nfrom limen.constants import FACTOR\n"
        "@compiled\ndef callee(x):\n    return FACTOR * x\n"
    ),
    "caller_kernels.py": (
        "from limen import callee_kernels\nfrom limen.compiled import compiled\ncallee = callee_kernels.callee\n"
        "@compiled\ndef caller(x):\n    return callee(x) + 1.0\n"
    ),
    # Two of one name in one file.
    "apart_kernels.py": (
        "from limen.compiled import compiled\n@compiled\ndef apart(x):\n    return x\nfirst = apart\n"
        '@compiled(error_model="python")\ndef apart(x):\n    return 7.0 / x\n'
    ),
}
SCRIPT = """
import json, sys
from limen import apart_kernels, caller_kernels
loops = {"caller": caller_kernels.caller, "first": apart_kernels.first, "apart": apart_kernels.apart}
found = {name: loop(10.0) for name, loop in loops.items()}
missed = [name for name, loop in loops.items() if hasattr(loop, "stats") and loop.stats.cache_misses]
print(json.dumps([found, missed]))
"""
AS_WRITTEN = {"caller": 21.0, "first": 10.0, "apart": 0.7}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A copy of the package with three tiny files of loops."""
    folder = tmp_path / "clone/limen"
    folder.mkdir(parents=True)
    for name in ("__init__.py", "compiled.py", "system.py"):
        shutil.copy(SOURCE / name, folder)
    for name, text in TINY.items():
        (folder / name).write_text(text)
    return folder


def run(package: Path, **variables: str) -> tuple[dict[str, float], list[str], str]:
    """What the loops of a copy answer in a process of their own, which it compiled, and what it complained of."""
    ours = ("NUMBA_", "XDG_CACHE_HOME", "PYTHONPATH")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    environment |= {"PYTHONPATH": str(package.parent), "XDG_CACHE_HOME": str(package.parents[1] / "cache")} | variables
    ended = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    found, missed = json.loads(ended.stdout)
    return found, missed, ended.stderr


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_an_edit_is_seen_by_what_it_reaches_and_nothing_else_is_compiled_again(package: Path) -> None:
    assert run(package) == (AS_WRITTEN, ["caller", "first", "apart"], "")
    assert run(package) == (AS_WRITTEN, [], "")
    edit(package / "callee_kernels.py", "FACTOR * x", "FACTOR * x * 10.0")
    assert run(package) == (AS_WRITTEN | {"caller": 201.0}, ["caller"], "")
    edit(package / "constants.py", "2.0", "3.0")
    assert run(package) == (AS_WRITTEN | {"caller": 301.0}, ["caller"], "")


def test_two_checkouts_of_the_same_code_compile_once(package: Path, tmp_path: Path) -> None:
    run(package)
    shutil.copytree(package.parent, tmp_path / "other clone")
    assert run(tmp_path / "other clone/limen", XDG_CACHE_HOME=str(tmp_path / "cache")) == (AS_WRITTEN, [], "")


def test_what_was_cut_short_is_compiled_again(package: Path, tmp_path: Path) -> None:
    run(package)
    files = [path for path in (tmp_path / "cache").rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert len(files) == 8  # of four loops: the callee's code is kept as well
    for path in files:
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run(package) == (AS_WRITTEN, ["caller", "first", "apart"], "")
    assert run(package) == (AS_WRITTEN, [], "")


def test_where_nothing_can_be_kept_loops_are_compiled_in_memory_and_one_line_says_so(package: Path) -> None:
    found, missed, complaint = run(package, NUMBA_CACHE_DIR="/dev/null/nowhere")
    assert (found, missed) == (AS_WRITTEN, ["caller", "first", "apart"])
    assert complaint.count("\n") == 1
    assert complaint.startswith("compiled loops are not kept, so every process compiles them anew: ")


def test_numbas_own_variable_names_the_folder(package: Path, tmp_path: Path) -> None:
    run(package, NUMBA_CACHE_DIR=str(tmp_path / "elsewhere"))
    kept = sorted(path.name.rsplit("-", 1)[0] for path in (tmp_path / "elsewhere").iterdir())
    assert kept == ["limen.apart_kernels", "limen.callee_kernels", "limen.caller_kernels"]
    assert not (tmp_path / "cache").exists()


def test_loops_run_as_plain_python_where_numba_is_told_not_to_compile(package: Path) -> None:
    assert run(package, NUMBA_DISABLE_JIT="1") == (AS_WRITTEN, [], "")


def test_bounds_are_checked_by_code_that_was_compiled_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba would go on with code that does not check them."""
    file, uncached = SOURCE / "layers/image/kernels.py", module._stamp.__wrapped__
    assert uncached(file) == uncached(file)
    before = uncached(file)
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    assert uncached(file) != before


def test_two_processes_that_compile_at_once_never_find_each_others_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each has read the index before the other writes it, and the second to write it is the first to write its code."""
    one, other = (module._CodeFile(str(tmp_path), "loop-1.py311", "stamp") for _ in range(2))
    write_index = one._save_index

    def write_index_after_the_other(overloads: dict[str, str]) -> None:
        other.save("float32", "code for float32")
        write_index(overloads)

    monkeypatch.setattr(one, "_save_index", write_index_after_the_other)
    one.save("float64", "code for float64")
    assert one.load("float64") == "code for float64"
    assert one.load("float32") in (None, "code for float32")
    other.save("float32", "code for float32")
    assert one.load("float32") == "code for float32"
    assert one.load("float64") == "code for float64"


def test_folders_that_were_not_used_for_long_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_base", lambda: tmp_path)
    long_ago = time.time() - (module._UNUSED_DAYS + 1) * 24 * 3600
    stamps = (
        "limen.data.image.halving_kernels-0123456789abcdef",
        "limen.data.image.halving_kernels-fedcba9876543210",
        "limen-somebody's.own",
    )
    for name in stamps:
        (tmp_path / name).mkdir()
        (tmp_path / name / "loop.nbi").touch()
    for name in (stamps[0], stamps[2]):
        os.utime(tmp_path / name, (long_ago, long_ago))
    module._prune.__wrapped__()
    assert {path.name for path in tmp_path.iterdir()} == set(stamps[1:])


def test_a_folder_in_use_is_not_taken_for_an_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_base", lambda: tmp_path)
    folder = module._folder.__wrapped__(SOURCE / "layers/image/kernels.py")
    folder.mkdir()
    long_ago = time.time() - (module._UNUSED_DAYS + 1) * 24 * 3600
    os.utime(folder, (long_ago, long_ago))
    assert module._folder.__wrapped__(SOURCE / "layers/image/kernels.py") == folder
    module._prune.__wrapped__()
    assert folder.exists()


def test_every_import_is_followed() -> None:
    """The quick way of finding them misses none that Python's own parser finds."""
    for path in SOURCE.rglob("*.py"):
        text = path.read_bytes()
        assert imported(text) <= module._imported(text), path


def imported(text: bytes) -> set[Path]:
    names: list[str] = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            assert not node.level, "imports are absolute"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
    return {file for name in names if name.split(".")[0] == "limen" for file in module._files_of(name)}


def test_numba_keeps_code_by_the_names_that_are_overridden_here() -> None:
    """Its cache is not public: where this fails after an update, read `limen.compiled` against numba.core.caching."""
    plain = numba.njit(cache=True)(sum_of)
    assert type(plain._cache) is caching.FunctionCache
    assert type(plain._cache._cache_file) is caching.IndexDataCacheFile
    assert callable(caching.IndexDataCacheFile._data_name)
    assert caching._Cache.__abstractmethods__ == {
        "cache_path",
        "disable",
        "enable",
        "flush",
        "load_overload",
        "save_overload",
    }
    assert caching._CacheLocator.__abstractmethods__ == {"get_cache_path", "get_disambiguator", "get_source_stamp"}
    assert all(hasattr(numba.config, name) for name in module._SETTINGS)


def sum_of(a: float, b: float) -> float:
    return a + b
