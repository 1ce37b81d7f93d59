"""Opening an adapter, or saying why not."""

from __future__ import annotations

import gc
import os
import sys
from typing import Any

import numpy as np
import pytest

from limen.errors import NoAdapterError
from limen.gpu.device import open_device
from limen.gpu.targets import DEPTH_FORMAT, Targets
from support.processes import PYTHON, finished

pytestmark = pytest.mark.drawing

_NOWHERE = {
    "VK_DRIVER_FILES": "/nonexistent",
    "VK_ICD_FILENAMES": "/nonexistent",
    "LIBGL_DRIVERS_PATH": "/nonexistent",
    "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent",
}


@pytest.mark.gpu
def test_the_adapters_own_limits_are_granted(device: Any) -> None:
    offered = device.wgpu.adapter.limits
    assert device.max_texture_px == offered["max-texture-dimension-2d"]
    assert device.max_layers == offered["max-texture-array-layers"]
    assert device.adapter_name


@pytest.mark.gpu
def test_an_unknown_adapter_is_named_with_those_there_are(device: Any) -> None:
    with pytest.raises(NoAdapterError, match="no graphics adapter is called 'voodoo': there are .*" + "[a-z]"):
        open_device(prefer="voodoo")


@pytest.mark.gpu
@pytest.mark.skipif(sys.platform != "linux", reason="hides drivers the way Linux loads them")
def test_without_any_driver_there_is_an_exception_with_a_cure() -> None:
    attempt = "try: open_device()\nexcept Exception as e: print(type(e).__name__, e)"
    code = f"from limen.gpu.device import open_device\n{attempt}"
    done = finished([*PYTHON, "-c", code], timeout_s=60, env={**os.environ, **_NOWHERE})
    assert done.returncode == 0
    assert done.stdout.startswith("NoAdapterError no graphics adapter was found: ")
    assert done.stdout.count("\n") == 1


def _drawn_depth(device: Any) -> float:
    """What a triangle reads of a depth that was cleared to a quarter; 0 where it was not drawn."""
    targets = Targets(device)
    size_px = (16, 16)
    encoder = device.wgpu.create_command_encoder()
    cleared = {"depth_clear_value": 0.25, "depth_load_op": "clear", "depth_store_op": "store"}
    depth = targets.texture(size_px, DEPTH_FORMAT).create_view()
    encoder.begin_render_pass(color_attachments=[], depth_stencil_attachment={"view": depth, **cleared}).end()
    device.wgpu.queue.submit([encoder.finish()])
    read = targets.read_depth(size_px)
    targets.destroy()
    assert np.ptp(read) == 0
    return float(read[0, 0])


@pytest.mark.gpu
def test_devices_beside_each_other_and_one_after_another_all_draw(device: Any) -> None:
    """On OpenGL they are in one context; what one of them ends must not be the others' end."""
    for _ in range(2):
        with open_device() as beside:
            assert (_drawn_depth(device), _drawn_depth(beside)) == (0.25, 0.25)
        beside.destroy()  # a second time, which must not count
        del beside
        gc.collect()  # wgpu frees a device when nobody holds it any more
        assert _drawn_depth(device) == 0.25


@pytest.mark.gpu
def test_the_last_that_gives_a_device_back_ends_it() -> None:
    """In a process of its own, where nobody else holds one."""
    code = (
        "from limen.gpu import device\n"
        "first, second = device.open_device(), device.open_device()\n"
        "assert (first.wgpu is second.wgpu) == first.is_opengl\n"
        "first.destroy(); first.destroy()\n"
        "second.wait()\n"
        "second.destroy()\n"
        "assert not device._shared\n"
        "third = device.open_device(); third.wait()\n"
        "assert third.wgpu is not second.wgpu\n"
        "fourth = device.open_device(); del third; fourth.wait(); fourth.destroy()\n"
        "assert not device._shared\n"
        "print('ended')"
    )
    done = finished([*PYTHON, "-c", code], timeout_s=120)
    assert done.stdout == "ended\n", done.stderr


@pytest.mark.gpu
def test_what_is_made_of_one_description_is_made_once(device: Any) -> None:
    def layout(kind: str) -> Any:
        entries = [{"binding": 0, "visibility": 1, "buffer": {"type": kind}}]
        return device.kept("create_bind_group_layout", entries=entries)

    assert layout("uniform") is layout("uniform")
    assert layout("uniform") is not layout("read-only-storage")
    by_layout = [device.kept("create_pipeline_layout", bind_group_layouts=[layout("uniform")]) for _ in range(2)]
    assert by_layout[0] is by_layout[1]
    other = device.kept("create_pipeline_layout", bind_group_layouts=[layout("read-only-storage")])
    assert other is not by_layout[0]
