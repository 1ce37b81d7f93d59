"""Opening an adapter, or saying why not."""

from __future__ import annotations

import os
import sys
from typing import Any

import pytest

from limen.errors import NoAdapterError
from limen.gpu.device import open_device
from processes import PYTHON, finished

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
