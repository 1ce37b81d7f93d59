"""An adapter that wgpu sees; where nothing answers, or only OpenGL, Mesa's software Vulkan.

OpenGL lacks much of what makes drawing fast, so it is what limen draws with only where Vulkan cannot be had. With root
and apt Vulkan is installed; without root its packages are fetched with apt's own resolver, unpacked in a cache folder,
and the Vulkan loader is pointed at them. On other systems we can only say what to install.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from launcher.run import Result, run
from launcher.state import Checkout, SetupError
from launcher.variables import home_is_writable, merged, runtime_variables

__all__ = ["cache_folder", "find", "loader_variables", "unpack_private"]

_PACKAGES = ("mesa-vulkan-drivers", "libvulkan1")
_APT = ("-y", "-qq", "--no-install-recommends", "-o", "DPkg::Lock::Timeout=120", "-o", "Acquire::Retries=2",
        "-o", "Acquire::http::Timeout=20")  # fmt: skip


@dataclass(frozen=True)
class Seen:
    """What wgpu answered: the backends of its adapters, what to do where there is none, how to get Vulkan."""

    backends: frozenset[str]
    advice: str
    cure: str

    @property
    def suffices(self) -> bool:
        return bool(self.backends - {"OpenGL"})


def find(checkout: Checkout, say: Callable[[str], None]) -> dict[str, str]:
    """Variables under which an adapter is seen (mostly none); raise with the system's cure where there is no way.

    OpenGL alone is used only where nothing else can be had, and this is said.
    """
    seen = _probe(checkout, {})
    if seen.suffices:
        return {}
    why = "only OpenGL answers here" if seen.backends else "no graphics driver here"
    tried = []
    for way in _ways(checkout, why, say):
        found = way()
        if isinstance(found, dict):
            if _probe(checkout, found).suffices:
                return found
            found = "the driver was installed, and wgpu still sees no Vulkan"
        tried.append(f"(tried: {found})")
    if not seen.backends:
        raise SetupError(" ".join([seen.advice, *tried]), code=2)
    say(" ".join([f"{why}, which is slower; {seen.cure}", *tried]))
    return {}


def _ways(checkout: Checkout, why: str, say: Callable[[str], None]) -> Iterator[Callable[[], dict[str, str] | str]]:
    if platform.system() != "Linux" or not shutil.which("apt-get"):
        return
    if os.geteuid() == 0:
        yield lambda: _install_system_wide(why, say)
    folder = cache_folder(checkout)
    if folder and shutil.which("dpkg"):
        yield lambda: _fetch_private(folder, why, say)


def _probe(checkout: Checkout, found: Mapping[str, str]) -> Seen:
    """Ask wgpu, in a process of its own: a broken driver may crash it."""
    script = checkout.root / "src" / "limen" / "gpu" / "adapters.py"
    variables = merged({**os.environ, **runtime_variables(checkout.root)}, found)
    result = run([checkout.python, "-P", script], variables=variables, timeout_s=120)
    answer: dict[str, Any] = {}
    for line in result.text.splitlines():
        with contextlib.suppress(ValueError):
            answer |= json.loads(line)
    if "advice" not in answer or ("adapters" not in answer and result.code > 0):
        raise SetupError(f"could not ask wgpu for adapters: {result.reason}")
    backends = frozenset(str(adapter["backend"]) for adapter in answer.get("adapters", ()))
    return Seen(backends, str(answer["advice"]), str(answer["cure"]))


def _install_system_wide(why: str, say: Callable[[str], None]) -> dict[str, str] | str:
    say(f"{why}; installing Mesa's software Vulkan: apt-get install {' '.join(_PACKAGES)}")
    variables = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    result = _with_fresh_lists(
        lambda: run(["apt-get", "install", *_APT, *_PACKAGES], variables=variables),
        lambda: run(["apt-get", "update", "-qq"], variables=variables),
    )
    return f"apt-get: {result.reason}" if result.code else {}


def _with_fresh_lists(attempt: Callable[[], Result], update: Callable[[], Result]) -> Result:
    """Update the package lists only if it does not work with those that are there."""
    first = attempt()
    if first.code == 0:
        return first
    renewed = update()
    return attempt() if renewed.code == 0 else renewed


def _fetch_private(folder: Path, why: str, say: Callable[[str], None]) -> dict[str, str] | str:
    """Fetch and unpack the packages without root, or find them unpacked by an earlier set-up."""
    home = folder / f"mesa-{_system_name()}"
    if not home.exists():
        say(f"{why}; fetching Mesa's software Vulkan (about 50 MB) into {home}")
        with tempfile.TemporaryDirectory(prefix=".mesa-", dir=folder) as scratch:
            tree = Path(scratch) / "tree"
            reason = unpack_private(Path(scratch), tree)
            if reason:
                return f"apt-get download: {reason}"
            if not home.exists():
                tree.rename(home)
    return loader_variables(home)


def unpack_private(scratch: Path, tree: Path) -> str:
    """Let apt resolve and download what is not installed, into folders of ours; an empty answer: it worked."""
    options = [
        "-o",
        f"Dir::Cache={scratch}",
        "-o",
        f"Dir::Cache::archives={scratch / 'archives'}",
        "-o",
        "Debug::NoLocking=true",
    ]
    options += ["-o", "APT::Sandbox::User="]
    lists = ["-o", f"Dir::State::Lists={scratch / 'lists'}"]
    (scratch / "archives" / "partial").mkdir(parents=True)
    (scratch / "lists" / "partial").mkdir(parents=True)
    command = ["apt-get", "install", "--download-only", "--reinstall", *_APT, *options]
    result = run([*command, *_PACKAGES])
    if result.code:
        result = run(["apt-get", "update", "-qq", *options, *lists])
        if result.code == 0:
            result = run([*command, *lists, *_PACKAGES])
    if result.code:
        return result.reason
    packages = sorted((scratch / "archives").glob("*.deb"))
    for package in packages:
        result = run(["dpkg", "-x", package, tree])
        if result.code:
            return result.reason
    return "" if any(p.name.startswith("mesa-vulkan-drivers") for p in packages) else "apt-get fetched nothing"


def loader_variables(home: Path) -> dict[str, str]:
    """Point the loader at an unpacked tree; its files name ``/usr/lib`` and so are written anew."""
    libraries = sorted(
        {path.parent for path in home.rglob("lib*.so*") if path.is_file()}, key=lambda p: (len(p.parts), p)
    )
    manifests = []
    for original in sorted(home.glob("usr/share/vulkan/icd.d/*.json")):
        content = json.loads(original.read_text())
        name = Path(content["ICD"]["library_path"]).name
        place = next((folder / name for folder in libraries if (folder / name).exists()), None)
        if place is None or not re.search(r"lvp|radeon|intel", original.name):
            continue
        content["ICD"]["library_path"] = str(place)
        manifest = home / original.name
        text = json.dumps(content)
        if not manifest.exists() or manifest.read_text() != text:
            manifest.write_text(text)
        manifests.append(str(manifest))
    return {
        "VK_DRIVER_FILES": os.pathsep.join(manifests),
        "LD_LIBRARY_PATH": os.pathsep.join(map(str, libraries)),
    }


def cache_folder(checkout: Checkout) -> Path | None:
    """Where fetched drivers live: shared by all checkouts if the home allows.

    Both loader variables are lists separated by colons, so a path with one in it cannot be used.
    """
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "limen"
    for folder in ([home] if home_is_writable() else []) + [checkout.root / ".cache"]:
        if os.pathsep in str(folder):
            continue
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return None


def _system_name() -> str:
    """``debian-12-x86_64``: an unpacked driver fits one release of one system."""
    try:
        release = platform.freedesktop_os_release()
    except OSError:
        release = {}
    return f"{release.get('ID', 'linux')}-{release.get('VERSION_ID', '0')}-{platform.machine()}"
