"""The graphics adapter, opened once by whoever starts a program and passed to everything that draws.

OpenGL has one context a process, and wgpu's devices of one adapter are all in it. Each binds its vertex array when it
is made, and only then; when the device that was made last is freed, nothing is bound, and what the others draw is black
without a word. So all that open an OpenGL adapter share one device of wgpu's, which ends with the last of them (a
device of wgpu's that is opened beside limen, and ends, still does that). The adapters of Vulkan, Metal and DirectX give
everybody a device of their own.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import weakref
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import wgpu

from limen.errors import NoAdapterError
from limen.gpu.adapters import WISH, adapter_info, driver_advice, preference

__all__ = ["Device", "open_device"]

_CLIP = "clip-distances"
_WIDE = ("shader-int64", "shader-int64-atomic-min-max")

_WANTED_LIMITS = (
    "max-texture-dimension-2d",
    "max-texture-array-layers",
    "max-buffer-size",
    "max-storage-buffer-binding-size",
    "max-storage-buffers-per-shader-stage",
)
"""Limits asked for as large as the adapter has them; without asking, WebGPU grants its small defaults."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Device:
    """An opened adapter and what limen needs to know of it.

    Parameters
    ----------
    wgpu
        The ``wgpu.GPUDevice``.
    adapter_name
        What a person calls the adapter, with its driver.
    max_texture_px
        Longest side of a texture, hence of a quilt.
    max_layers
        Most layers of an array texture.
    max_binding_bytes
        Largest storage buffer that a shader sees.
    is_software
        The 'GPU' is the CPU.
    can_clip
        Vertex stages may clip by distances.
    has_wide_atomics
        Shaders may take the largest of 64-bit numbers atomically.
    is_opengl
        wgpu reaches the adapter through OpenGL: buffers that a draw reads must not be overwritten by a shader after it
        (see `limen.layers.points.draw.drawer`), and ``wgpu`` may be shared with other devices of this process.
    """

    wgpu: Any
    adapter_name: str
    max_texture_px: int
    max_layers: int
    max_binding_bytes: int
    is_software: bool
    can_clip: bool = False
    has_wide_atomics: bool = False
    is_opengl: bool = False
    _kept: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def kept(self, make: str, **description: Any) -> Any:
        """What ``wgpu.create_...`` makes of a description, made once: a shader module, a layout, or a pipeline.

        A pipeline is compiled when it is first drawn with, which takes a software adapter a quarter of a second; all
        that draw with this device share it. They are freed with the device, and by nobody else.
        """
        key = make, _frozen(description)
        if key not in self._kept:
            self._kept[key] = getattr(self.wgpu, make)(**description)
        return self._kept[key]

    def wait(self) -> None:
        """Until everything that was submitted is done: what is read comes after it."""
        # `queue.on_submitted_work_done_sync` of wgpu-py 0.32 fails: it hands over a callback of another kind.
        mark = self.wgpu.create_buffer(label="mark", size=4, usage=wgpu.BufferUsage.COPY_SRC)
        self.wgpu.queue.read_buffer(mark)
        mark.destroy()

    def destroy(self) -> None:
        """Give it back. What was made from it is freed by its owners, before: others may go on with ``wgpu``."""
        self._kept.clear()
        if not _is_held_by_others(self):
            self.wgpu.destroy()

    def __enter__(self) -> Device:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy()


def _frozen(value: Any) -> Hashable:
    """A description as a key. Modules and layouts in it stand for themselves: they are kept as well."""
    if isinstance(value, Mapping):
        return tuple((name, _frozen(each)) for name, each in value.items())
    return tuple(map(_frozen, value)) if isinstance(value, list | tuple) else value


def open_device(*, prefer: str | None = None) -> Device:
    """Open the adapter.

    Parameters
    ----------
    prefer
        Part of an adapter's name or backend (``llvmpipe``, ``vulkan``, ``nvidia``), in any case; ``None`` takes
        what the variable ``LIMEN_ADAPTER`` names, or else the fastest.

    Raises
    ------
    NoAdapterError
        If there is none (or none of that name); the message says what to install.
    """
    _private_runtime_folder()
    adapter = _adapter(prefer)
    is_opengl = adapter.info["backend_type"] == "OpenGL"
    shared = _shared.get(adapter.summary)
    device = _requested(adapter) if shared is None else shared.wgpu
    limits, features = device.limits, device.features
    opened = Device(
        wgpu=device,
        adapter_name=adapter.summary,
        max_texture_px=limits["max-texture-dimension-2d"],
        max_layers=limits["max-texture-array-layers"],
        max_binding_bytes=limits["max-storage-buffer-binding-size"],
        is_software=adapter.info["adapter_type"] == "CPU",
        can_clip=_CLIP in features,
        has_wide_atomics=set(_WIDE) <= set(features),
        is_opengl=is_opengl,
    )
    if is_opengl:
        _shared.setdefault(adapter.summary, _Shared(device, weakref.WeakSet())).holders.add(opened)
    return opened


class _Shared(NamedTuple):
    """A device of wgpu's, and whoever opened it and has not given it back."""

    wgpu: Any
    holders: weakref.WeakSet[Device]


_shared: dict[str, _Shared] = {}
"""By the adapter's name. No more is global than OpenGL's own context is; see the head of this file."""


def _is_held_by_others(device: Device) -> bool:
    """Strike a device off those that share; whether any is left."""
    shared = _shared.get(device.adapter_name)
    if shared is None or shared.wgpu is not device.wgpu:
        return False
    shared.holders.discard(device)
    if shared.holders:
        return True
    del _shared[device.adapter_name]
    return False


def _requested(adapter: Any) -> Any:
    offered = adapter.limits
    wanted = {name: offered[name] for name in _WANTED_LIMITS if name in offered}
    features = [_CLIP] if _CLIP in adapter.features else []
    features += _WIDE if set(_WIDE) <= set(adapter.features) else ()
    try:
        return adapter.request_device_sync(label="limen", required_limits=wanted, required_features=features)
    except RuntimeError as error:
        raise NoAdapterError(f"{adapter.summary} could not be opened: {_one_line(error)}") from None


def _adapter(prefer: str | None) -> Any:
    wish = os.environ.get(WISH, "") if prefer is None else prefer
    try:
        if not wish:
            return wgpu.gpu.request_adapter_sync(power_preference="high-performance")
        adapters = wgpu.gpu.enumerate_adapters_sync()
    except RuntimeError:
        # wgpu's own message counts the backends that it was not built with, over several lines.
        raise NoAdapterError(f"no graphics adapter was found: {driver_advice()}") from None
    if not adapters:
        raise NoAdapterError(f"no graphics adapter was found: {driver_advice()}")
    best = min(adapters, key=lambda adapter: preference(adapter_info(adapter), wish))
    if adapter_info(best).is_called(wish):
        return best
    names = "; ".join(adapter.summary for adapter in adapters)
    said_by = f" ({WISH})" if prefer is None else ""
    raise NoAdapterError(f"no graphics adapter is called '{wish}'{said_by}: there are {names}")


def _private_runtime_folder() -> None:
    """Mesa complains on standard error where ``XDG_RUNTIME_DIR`` is not set (services, containers, cron)."""
    if os.name == "posix" and not os.environ.get("XDG_RUNTIME_DIR"):
        folder = os.path.join(tempfile.gettempdir(), f"limen-runtime-{os.getuid()}")  # noqa: PTH118
        with contextlib.suppress(OSError):
            os.makedirs(folder, mode=0o700, exist_ok=True)  # noqa: PTH103
            os.environ["XDG_RUNTIME_DIR"] = folder


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
