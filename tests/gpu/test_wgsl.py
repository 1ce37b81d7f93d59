"""Every shader of the package is valid, after what its first line names, on the adapter of this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import limen
from limen.gpu.shader import shader_text

SOURCE = Path(limen.__file__).parent
SHADERS = sorted(SOURCE.rglob("*.wgsl"))


@pytest.mark.gpu
@pytest.mark.parametrize("path", SHADERS, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_shader_compiles(path: Path, device: Any) -> None:
    code = shader_text(".".join(["limen", *path.relative_to(SOURCE).parent.parts]), path.name)
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


def test_a_file_stands_after_what_it_stands_on_once_and_what_is_enabled_is_first() -> None:
    text = shader_text("limen.layers.mesh.draw", "scene_clip.wgsl")
    assert text.startswith("enable clip_distances;\n")
    heads = ["struct PanelView", "fn pull(", "fn vertex("]
    assert [text.count(head) for head in heads] == [1, 1, 1]
    assert sorted(heads, key=text.index) == heads
    split = shader_text("limen.layers.image.draw", "lens_split.wgsl")
    assert split.count("fn place_of_slot(") == split.count("fn flat_fragment(") == split.count("fn lens_wishes(") == 1
