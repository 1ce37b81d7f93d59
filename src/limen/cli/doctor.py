"""``limen doctor``: what this machine can do, what is missing, and the command that mends it."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

from limen.calibrate import opencv
from limen.cli.output import DEFAULT, Common, Output
from limen.gpu.adapters import WISH, AdapterInfo, driver_advice, linux_cure, list_adapters
from limen.study.observer import INSTALL, missing_packages

__all__ = ["doctor"]

_PACKAGES = ("limen", "wgpu", "rendercanvas", "glfw", "numpy", "numba", "pyvips", "pyvips-binary", "tifffile",
             "imagecodecs", "simplejpeg", "matplotlib", "msgspec")  # fmt: skip
_LIMITS = {
    "max-texture-dimension-2d": "longest side of a texture, hence of a quilt (px)",
    "max-texture-array-layers": "layers of an array texture, hence pages of one pool",
    "max-buffer-size": "largest buffer (bytes)",
    "max-storage-buffer-binding-size": "largest buffer that a shader sees at once (bytes)",
    "max-storage-buffers-per-shader-stage": "storage buffers of a shader",
}
"""The limits that limen asks for; it needs none of WebGPU's optional features."""

_LEAST_TEXTURE_PX = 8192
_LEAST_MEMORY_GIB, _LEAST_DISK_GIB = 2, 5
_GIB = 2**30


class Finding(msgspec.Struct):
    """What is wrong, and what to type or do about it."""

    problem: str
    cure: str
    stops_drawing: bool = False


class Machine(msgspec.Struct):
    system: str
    python: str
    cpu_cores: int
    memory_gib: float | None
    cache_folder: str
    cache_free_gib: float | None
    window: bool


class Adapter(msgspec.Struct):
    name: str
    backend: str
    kind: str
    driver: str
    limits: dict[str, int]
    features: tuple[str, ...]


class DoctorReport(msgspec.Struct):
    adapters: list[Adapter]
    problems: list[Finding]
    machine: Machine
    versions: dict[str, str | None]


def doctor(*, common: Common = DEFAULT) -> None:
    """What this machine can do, what is missing, and the command that mends it.

    Exit code 0 if limen can draw here (to files, at least), 2 if not.
    """
    out = Output(common)
    report = examine(list_adapters)
    _print(out, report)
    out.result(report)
    if any(problem.stops_drawing for problem in report.problems):
        sys.exit(2)


def examine(adapters: Callable[[], list[AdapterInfo]]) -> DoctorReport:
    """Look at the machine; ``adapters`` is what asks the drivers."""
    found = adapters()
    window_problem = _window_problem()
    machine = _machine(window=window_problem is None)
    versions = {name: _version(name) for name in _PACKAGES}
    problems = [
        *_adapter_problems(found),
        *_package_problems(versions),
        *_machine_problems(machine),
        *_observer_problems(missing_packages()),
        *_opencv_problems(opencv.is_installed()),
    ]
    return DoctorReport(
        adapters=[_adapter(info) for info in found],
        problems=problems + ([window_problem] if window_problem else []),
        machine=machine,
        versions=versions,
    )


def _adapter(info: AdapterInfo) -> Adapter:
    limits = {name: info.limits[name] for name in _LIMITS if name in info.limits}
    return Adapter(info.name, info.backend, info.kind, info.driver, limits, info.features)


def _adapter_problems(found: list[AdapterInfo]) -> list[Finding]:
    if not found:
        return [Finding("there is no graphics adapter: nothing can be drawn", driver_advice(), stops_drawing=True)]
    problems = []
    best = found[0]
    wish = os.environ.get(WISH, "")
    if not best.is_called(wish):
        problems.append(
            Finding(f"no adapter is called '{wish}'", f"change or unset the variable {WISH}", stops_drawing=True)
        )
    if all(info.is_software for info in found):
        problems.append(
            Finding(
                "the only adapter is software: pictures are right, and slow",
                "if this machine has a GPU, install its Vulkan driver and let this user open /dev/dri (group render)",
            )
        )
    if all(info.backend == "OpenGL" for info in found):
        problems.append(Finding("only OpenGL answers, Vulkan does not: drawing is slower", linux_cure()))
    if best.limits.get("max-texture-dimension-2d", 0) < _LEAST_TEXTURE_PX:
        problems.append(
            Finding(f"textures are limited to {best.limits.get('max-texture-dimension-2d')} px", "use smaller quilts")
        )
    return problems


def _package_problems(versions: dict[str, str | None]) -> list[Finding]:
    missing = [name for name, found in versions.items() if found is None]
    # Without the binary wheel pyvips takes the system's library; and limen may run from its sources.
    missing = [name for name in missing if name not in ("pyvips-binary", "limen")]
    if not missing:
        return []
    cure = f"{sys.executable} -m pip install {' '.join(missing)}"
    return [Finding(f"not installed: {', '.join(missing)}", cure, stops_drawing=True)]


def _observer_problems(missing: tuple[str, ...]) -> list[Finding]:
    if not missing:
        return []
    problem = f"the independent observer of `limen verify` is not installed ({', '.join(missing)})"
    return [Finding(problem, " && ".join(INSTALL))]


def _opencv_problems(installed: bool) -> list[Finding]:
    return [] if installed else [Finding("OpenCV, which `limen calibrate` needs, is not installed", opencv.INSTALL)]


def _machine_problems(machine: Machine) -> list[Finding]:
    problems = []
    if machine.memory_gib is not None and machine.memory_gib < _LEAST_MEMORY_GIB:
        problems.append(
            Finding(f"{machine.memory_gib:.1f} GiB of memory", "close other programs, or draw fewer panels at once")
        )
    if machine.cache_free_gib is not None and machine.cache_free_gib < _LEAST_DISK_GIB:
        cure = f"free some of {machine.cache_folder}, or set XDG_CACHE_HOME to a larger disk"
        problems.append(Finding(f"{machine.cache_free_gib:.1f} GiB free for caches", cure))
    return problems


def _machine(window: bool) -> Machine:
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    return Machine(
        system=platform.platform(),
        python=f"{platform.python_version()} ({sys.executable})",
        cpu_cores=_cpu_cores(),
        memory_gib=_memory_gib(),
        cache_folder=str(folder),
        cache_free_gib=_free_gib(folder),
        window=window,
    )


def _cpu_cores() -> int:
    """Those that this process may use, which a container can make fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _memory_gib() -> float | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / _GIB
    except (AttributeError, ValueError, OSError):
        return None  # Windows has no sysconf


def _free_gib(folder: Path) -> float | None:
    """Free space where the folder is, or will be."""
    for place in (folder, *folder.parents):
        try:
            return shutil.disk_usage(place).free / _GIB
        except OSError:
            continue
    return None


def _window_problem() -> Finding | None:
    """Try to open a window system in a process of its own: GLFW may end the one that it is started in."""
    without = "draw to files (show --out DIR), or run under a desktop or `xvfb-run`"
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return Finding("no window can open: neither DISPLAY nor WAYLAND_DISPLAY is set", without)
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-W", "ignore", "-c", "import glfw, sys; sys.exit(not glfw.init())"],
            capture_output=True,
            stdin=subprocess.DEVNULL,
            timeout=30,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Finding("no window can open: the display does not answer", without)
    return None if done.returncode == 0 else Finding("no window can open: GLFW finds no display", without)


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _print(out: Output, report: DoctorReport) -> None:
    out.table(
        "",
        ["adapter", "backend", "kind", "driver"],
        [(a.name, a.backend, a.kind, a.driver) for a in report.adapters],
    )
    if report.adapters:
        best = report.adapters[0]
        out.line()
        out.table("", ["limit", best.backend], [(_LIMITS[name], f"{value:,}") for name, value in best.limits.items()])
        out.line()
    machine = report.machine
    memory = "" if machine.memory_gib is None else f", {machine.memory_gib:.1f} GiB of memory"
    free = (
        "" if machine.cache_free_gib is None else f", {machine.cache_free_gib:.0f} GiB free in {machine.cache_folder}"
    )
    out.line(f"{machine.system}, {machine.cpu_cores} cores{memory}{free}")
    out.line(f"Python {machine.python}, window: {'yes' if machine.window else 'no'}")
    out.line(", ".join(f"{name} {found or 'missing'}" for name, found in report.versions.items()))
    out.line()
    for problem in report.problems:
        out.line(f"{'MISSING' if problem.stops_drawing else 'note'}: {problem.problem}\n    {problem.cure}")
    if not any(problem.stops_drawing for problem in report.problems):
        out.line("limen can draw here.")
