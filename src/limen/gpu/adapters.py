"""Which graphics adapters there are, and what to install where there is none.

A broken driver can take its process down, and a missing one makes some drivers write to the terminal, so
adapters are listed by a short-lived process: ``python -P adapters.py`` prints two lines of JSON. That is also
why this file imports nothing of limen: the launcher of a checkout runs it by its path.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

__all__ = ["WISH", "AdapterInfo", "adapter_info", "driver_advice", "linux_cure", "list_adapters", "preference"]

WISH = "LIMEN_ADAPTER"
"""The variable that names the adapter to draw with: part of its name or backend, in any case."""


@dataclass(frozen=True, slots=True)
class AdapterInfo:
    """One adapter as wgpu sees it."""

    name: str
    backend: str
    kind: str  # 'DiscreteGPU', 'IntegratedGPU', 'CPU', 'Unknown'
    driver: str
    features: tuple[str, ...]
    limits: dict[str, int]

    @property
    def is_software(self) -> bool:
        return self.kind == "CPU"

    def is_called(self, words: str) -> bool:
        """Whether these are part of its name or backend, in any case."""
        return words.lower() in f"{self.name} {self.driver} via {self.backend}".lower()


def list_adapters(timeout_s: float = 60) -> list[AdapterInfo]:
    """All adapters, that which is drawn with first; empty where there is no driver, or only one that crashes."""
    with tempfile.TemporaryDirectory(prefix="limen-") as runtime:
        # Mesa complains on every start where the session has no runtime folder.
        variables = {"XDG_RUNTIME_DIR": runtime, **os.environ}
        try:
            done = subprocess.run(
                [sys.executable, "-P", __file__],
                capture_output=True,
                stdin=subprocess.DEVNULL,
                env=variables,
                timeout=timeout_s,
                check=False,
            )
            rows = json.loads(done.stdout.splitlines()[-1]).get("adapters", [])
        except (OSError, subprocess.TimeoutExpired, LookupError, ValueError):
            return []
    return sorted((AdapterInfo(**{**row, "features": tuple(row["features"])}) for row in rows), key=preference)


_KINDS = ("DiscreteGPU", "IntegratedGPU", "VirtualGPU", "Unknown", "CPU")


def preference(adapter: AdapterInfo, wish: str | None = None) -> tuple[bool, int, bool]:
    """A key to sort by: what is wished for, then the fastest kind, of one kind anything before OpenGL.

    ``wish`` is part of a name or backend; not given, it is the variable ``LIMEN_ADAPTER``.
    """
    words = os.environ.get(WISH, "") if wish is None else wish
    kind = adapter.kind if adapter.kind in _KINDS else "Unknown"
    return not adapter.is_called(words), _KINDS.index(kind), adapter.backend == "OpenGL"


def driver_advice(system: str | None = None, families: Sequence[str] | None = None) -> str:
    """One sentence: what wgpu looked for and found missing, and the command that mends it on this system.

    Both arguments are for asking about another system: ``platform.system()``'s word, and the ``ID`` and
    ``ID_LIKE`` of its os-release.
    """
    system = system or platform.system()
    if system == "Darwin":
        return "wgpu sees no Metal adapter; update macOS (limen needs 11 or newer on a Mac with Metal)."
    if system == "Windows":
        return "wgpu sees neither a DirectX 12 nor a Vulkan driver; install the newest driver of this machine's GPU."
    return f"wgpu sees neither a Vulkan nor an OpenGL (EGL) driver; {linux_cure(families)}."


_CURES = {
    "debian": "install one with `apt-get install mesa-vulkan-drivers libvulkan1` as root",
    "fedora": "install one with `dnf install mesa-vulkan-drivers vulkan-loader` as root",
    "arch": "install one with `pacman -S vulkan-swrast vulkan-icd-loader` as root",
    "alpine": "and Alpine's musl has no wheels of wgpu: use a glibc system such as Debian",
}
_RELATIVES = {"ubuntu": "debian", "rhel": "fedora", "centos": "fedora"}
_EVERY_CURE = (
    "install the Vulkan loader and a driver: Debian/Ubuntu `mesa-vulkan-drivers libvulkan1`, Fedora "
    "`mesa-vulkan-drivers vulkan-loader`, Arch `vulkan-swrast vulkan-icd-loader`, or the driver of this machine's GPU"
)


def linux_cure(families: Sequence[str] | None = None) -> str:
    """How to get a Vulkan driver on this Linux, or on one of these families."""
    for family in _linux_families() if families is None else families:
        cure = _CURES.get(_RELATIVES.get(family, family))
        if cure:
            return cure
    return _EVERY_CURE


def _linux_families() -> list[str]:
    try:
        release = platform.freedesktop_os_release()
    except OSError:
        return []
    return [release.get("ID", ""), *release.get("ID_LIKE", "").split()]


# What follows runs in the short-lived process.


def _ask_wgpu() -> list[dict[str, Any]]:
    import wgpu  # only here: a driver may fail as soon as it is loaded

    return [asdict(adapter_info(adapter)) for adapter in wgpu.gpu.enumerate_adapters_sync()]


def adapter_info(adapter: Any) -> AdapterInfo:
    """What a ``wgpu.GPUAdapter`` tells of itself."""
    about = adapter.info
    return AdapterInfo(
        name=about.get("device") or about.get("vendor") or "unnamed",
        backend=about.get("backend_type", "?"),
        kind=about.get("adapter_type", "Unknown"),
        driver=about.get("description", ""),
        features=tuple(sorted(adapter.features)),
        limits={name: int(value) for name, value in adapter.limits.items()},
    )


def _answer() -> None:
    """The advice goes first: asking wgpu may end this process."""
    sys.stdout.write(json.dumps({"advice": driver_advice(), "cure": linux_cure()}) + "\n")
    sys.stdout.flush()
    sys.stdout.write(json.dumps({"adapters": _ask_wgpu()}) + "\n")


if __name__ == "__main__":
    _answer()
