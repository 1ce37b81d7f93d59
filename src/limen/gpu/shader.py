"""WGSL files lie beside the module that uses them and are valid alone."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

from limen.gpu.device import Device

__all__ = ["load_shader", "shader_text"]


@cache
def shader_text(package: str, name: str) -> str:
    """The text of ``name`` in a package: ``shader_text("limen.draw", "image.wgsl")``."""
    return (files(package) / name).read_text(encoding="utf-8")


def load_shader(device: Device, package: str, name: str) -> Any:
    """A compiled shader module; its label is the file's name, which wgpu's messages repeat."""
    return device.wgpu.create_shader_module(label=name, code=shader_text(package, name))
