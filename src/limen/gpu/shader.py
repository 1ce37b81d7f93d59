"""WGSL files lie beside the module that uses them, and may stand on others.

``// after: gpu/panel_view.wgsl, mesh_common.wgsl`` in a file's first line names what stands before it: files of
`limen.gpu.wgsl`, and files of its own package.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

from limen.gpu.device import Device

__all__ = ["load_shader", "shader_text"]

_AFTER, _SHARED = "// after: ", "gpu/"


@cache
def shader_text(package: str, name: str) -> str:
    """The text of a file in a package, after all that it stands on: ``shader_text("limen.gpu", "depth.wgsl")``.

    Each file is there once, and what a module enables comes first, where WGSL wants it.
    """
    texts: dict[tuple[str, str], str] = {}
    _collect(package, name, texts)
    lines = [line for text in texts.values() for line in text.splitlines(keepends=True)]
    return "".join(sorted(lines, key=lambda line: not line.startswith("enable ")))


def _collect(package: str, name: str, texts: dict[tuple[str, str], str]) -> None:
    """The files that one stands on, each after its own, and then the file itself."""
    if (package, name) in texts:
        return
    text = (files(package) / name).read_text(encoding="utf-8")
    first = text.split("\n", 1)[0]
    for each in first.removeprefix(_AFTER).split(", ") if first.startswith(_AFTER) else ():
        shared = each.startswith(_SHARED)
        _collect("limen.gpu.wgsl" if shared else package, each.removeprefix(_SHARED), texts)
    texts[package, name] = text


def load_shader(device: Device, package: str, name: str) -> Any:
    """The compiled shader module of a file and of all that it stands on; wgpu's messages call it by the file's name."""
    return device.kept("create_shader_module", label=name, code=shader_text(package, name))
