"""Every shader of the package is valid, alone or after the one that it follows, on the adapter of this machine."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import limen

SOURCE = Path(limen.__file__).parent
SHADERS = sorted(SOURCE.rglob("*.wgsl"))


@pytest.mark.gpu
@pytest.mark.parametrize("path", SHADERS, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_shader_compiles(path: Path, device: Any) -> None:
    code = path.read_text(encoding="utf-8")
    if code.startswith("// Follows"):
        first = re.findall(r"\w+\.wgsl", code.splitlines()[0])
        code = "".join((path.parent / name).read_text(encoding="utf-8") for name in first) + code
    if "enable clip_distances;" in code and not device.can_clip:
        pytest.skip("THIS ADAPTER HAS NO CLIP DISTANCES: the shader that needs them was not compiled")
    if "atomic<u64>" in code and not device.has_wide_atomics:
        pytest.skip("THIS ADAPTER HAS NO 64-BIT ATOMICS: the shader that needs them was not compiled")
    device.wgpu.create_shader_module(label=path.name, code=code)


@pytest.mark.gpu
def test_an_invalid_shader_is_noticed(device: Any) -> None:
    """The test above means something only if this driver complains at all."""
    with pytest.raises(Exception, match="nonsense"):
        device.wgpu.create_shader_module(code="fn f() { nonsense(); }")


def test_there_are_shaders() -> None:
    if not SHADERS:
        pytest.skip("no .wgsl in the package yet")
