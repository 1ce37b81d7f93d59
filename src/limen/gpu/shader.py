"""WGSL files lie beside the module that uses them.

They are valid alone, or after the file that their first line says they follow.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

from limen.gpu.device import Device

__all__ = ["load_shader", "shader_text"]


@cache
def shader_text(package: str, name: str) -> str:
    """The text of ``name`` in a package: ``shader_text("limen.layers.image.draw", "image.wgsl")``."""
    return (files(package) / name).read_text(encoding="utf-8")


def load_shader(device: Device, package: str, *names: str) -> Any:
    """A compiled shader module of files behind each other; wgpu's messages call it by the last one's name."""
    code = "\n".join(shader_text(package, name) for name in names)
    return device.wgpu.create_shader_module(label=names[-1], code=code)
