"""./limen from an empty home where no driver answers, or OpenGL alone, Vulkan alone, or both: what is brought and used.

wgpu, the drivers and the starts are real; the states are made by hiding drivers from their loaders. apt-get and dpkg
are stand-ins that let the machine's own Vulkan driver appear.
"""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from limen.gpu.adapters import list_adapters
from support.processes import PYTHON, finished

ROOT = Path(__file__).resolve().parents[1]

pytestmark = [pytest.mark.gpu, pytest.mark.skipif(sys.platform != "linux", reason="hides drivers as Linux loads them")]

_APT = """#!{python}
import json, pathlib, sys
words, said = sys.argv[1:], pathlib.Path({said!r})
with said.open("a") as file:
    file.write(" ".join(words) + "\\n")
if {fails}:
    sys.exit("no network")
if "--download-only" in words:
    archives = next(w.partition("=")[2] for w in words if w.startswith("Dir::Cache::archives="))
    (pathlib.Path(archives) / "mesa-vulkan-drivers_1.deb").touch()
elif "install" in words:
    pathlib.Path({manifest!r}).write_text({driver!r})
"""
_DPKG = """#!{python}
import pathlib, sys
tree = pathlib.Path(sys.argv[3])
(tree / "usr/lib").mkdir(parents=True)
(tree / "usr/share/vulkan/icd.d").mkdir(parents=True)
(tree / "usr/lib/{name}").symlink_to({library!r})
(tree / "usr/share/vulkan/icd.d/lvp_icd.json").write_text({driver!r})
"""
_START = """
import os, runpy, sys
os.geteuid = lambda: {user}
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture(scope="module")
def backends() -> set[str]:
    return {adapter.backend for adapter in list_adapters()}


@pytest.fixture(scope="module")
def vulkan_driver() -> dict[str, Any]:
    """The manifest of Mesa's software driver, wherever it is."""
    named = os.environ.get("VK_DRIVER_FILES", "").split(os.pathsep)
    places = [Path(name) for name in named if name] or sorted(Path("/usr/share/vulkan/icd.d").glob("*.json"))
    for place in places:
        if place.name.startswith("lvp"):
            return dict(json.loads(place.read_text()))
    pytest.skip("NO SOFTWARE VULKAN, so bringing it was not tested: ./limen test installs it")


@dataclass
class Machine:
    """A fresh checkout, whose environment is made already, and an empty home."""

    root: Path
    variables: dict[str, str]
    said: Path

    def doctor(self, user: int = 0) -> subprocess.CompletedProcess[str]:
        start = [*PYTHON, "-P", "-c", _START.format(user=user), self.root / "limen", "doctor", "--json"]
        return finished(start, timeout_s=120, env=self.variables)

    @property
    def asked(self) -> list[str]:
        return self.said.read_text().splitlines() if self.said.exists() else []


def machine(folder: Path, driver: dict[str, Any], opengl: bool, vulkan: bool, network: bool) -> Machine:
    root, tools, home = folder / "checkout", folder / "bin", folder / "home"
    for new in (root, tools, home):
        new.mkdir()
    for name in ("limen", "pyproject.toml"):
        shutil.copy(ROOT / name, root)
    shutil.copytree(ROOT / "tools", root / "tools", ignore=shutil.ignore_patterns("__pycache__"))
    (root / "src").symlink_to(ROOT / "src")
    (root / ".venv").symlink_to(sys.prefix)
    manifest, said = folder / "driver.json", folder / "said"
    text, library = json.dumps(driver), _library(driver)
    fill = {"python": sys.executable, "said": str(said), "manifest": str(manifest), "driver": text}
    fill |= {"fails": not network, "library": library, "name": Path(library).name}
    for name, script in (("apt-get", _APT), ("dpkg", _DPKG), ("uv", "#!/bin/sh\nexit 3\n")):
        (tools / name).write_text(script.format(**fill) if name != "uv" else script)
        (tools / name).chmod(0o755)
    if vulkan:
        manifest.write_text(text)
    variables = {
        "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", "HOME": str(home), "VK_DRIVER_FILES": str(manifest),
        "LD_LIBRARY_PATH": os.environ.get("LD_LIBRARY_PATH", ""),
    }  # fmt: skip
    if not opengl:
        variables |= {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent", "LIBGL_DRIVERS_PATH": "/nonexistent"}
    _stamp(root)
    return Machine(root, variables, said)


def _library(driver: dict[str, Any]) -> str:
    """The driver's file: manifests may name it alone, as the loader finds it."""
    named = Path(str(driver["ICD"]["library_path"]))
    found = sorted(Path("/usr/lib").glob(f"*/{named.name}"))
    return str(named if named.is_absolute() or not found else found[0])


def _stamp(root: Path) -> None:
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        state = importlib.import_module("launcher.state")
    finally:
        sys.path.pop(0)
    checkout = state.Checkout(root)
    checkout.notes.mkdir()
    checkout.write_stamp(state.Stamp(environment=checkout.environment_fingerprint()))


@pytest.mark.parametrize(
    ("opengl", "vulkan", "network", "user", "first", "words"),
    [
        pytest.param(False, False, True, 0, "Vulkan", "no graphics driver here; installing", id="none"),
        pytest.param(False, False, True, 1000, "Vulkan", "no graphics driver here; fetching", id="none, not root"),
        pytest.param(False, False, False, 0, None, "(tried: apt-get: no network)", id="none, no network"),
        pytest.param(True, False, True, 0, "Vulkan", "only OpenGL answers here; installing", id="OpenGL"),
        pytest.param(True, False, True, 1000, "Vulkan", "only OpenGL answers here; fetching", id="OpenGL, not root"),
        pytest.param(True, False, False, 0, "OpenGL", "which is slower; install one", id="OpenGL, no network"),
        pytest.param(False, True, True, 0, "Vulkan", "", id="Vulkan"),
        pytest.param(True, True, True, 0, "Vulkan", "", id="both"),
    ],
)
def test_what_is_brought_and_used(
    opengl: bool, vulkan: bool, network: bool, user: int, first: str | None, words: str,
    tmp_path: Path, vulkan_driver: dict[str, Any], backends: set[str],
) -> None:  # fmt: skip
    if opengl and "OpenGL" not in backends:
        pytest.skip("NO OPENGL ADAPTER, so starts with OpenGL were not tested: apt-get install libegl1 libgl1-mesa-dri")
    here = machine(tmp_path, vulkan_driver, opengl, vulkan, network)
    done = here.doctor(user)
    found = json.loads(done.stdout)["adapters"]
    assert [adapter["backend"] for adapter in found][:1] == ([first] if first else []), done.stderr
    assert done.returncode == (0 if first else 2)
    told = [line for line in done.stderr.splitlines() if line.startswith("limen: ") and "ready in" not in line]
    assert bool(here.asked) == bool(words)
    assert words in " ".join(told)
    assert len(told) == (0 if not words else 1 if network else 3), "two ways tried, and what came of it"
    if first and words:
        before = len(here.asked)
        again = here.doctor(user)
        assert (json.loads(again.stdout)["adapters"][0]["backend"], again.stderr) == (first, "")
        assert len(here.asked) == before, "what was found once is not looked for at every start"
