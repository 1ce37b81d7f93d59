"""Which pages pixels really need: counted by the GPU on a reduced grid, with the functions that draw.

The selectors decide without it, from geometry alone. Feedback is for mappings that no selector knows, and it
is the witness that the selectors left nothing out.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 4 (the visibility pass).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import wgpu
from numpy.typing import NDArray

from limen.display.quilt import Quilt
from limen.errors import InputError
from limen.geometry import Vec3
from limen.gpu.buffers import GrowingBuffer
from limen.gpu.device import Device
from limen.gpu.shader import load_shader
from limen.layers.image.draw import uniforms as records
from limen.layers.image.select import ImageOnDisplay
from limen.viewing.tolerance import Tolerance

__all__ = ["Coverage", "Feedback"]

_RING = 3
_GROUP_PX = 8  # the shader's workgroup_size
_ORDER = 5  # steps through the jitter's places so that neighbours do not follow one another
_NUMBERS = {"frame": 0, "panels": 1, "eyes": 2, "levels": 4, "coverage": 8, "finer": 9, "lenses": 10}


class Coverage(NamedTuple):
    """Pages and how many sampled pixels need each of them."""

    pages: NDArray[np.int64]
    coverage: NDArray[np.int64]


class Feedback:
    """Counts pages for one image on one display. Results come a frame or more later and are never waited for."""

    def __init__(self, device: Device, view: ImageOnDisplay) -> None:
        self._device, self._view = device, view
        self._whole = Quilt((1, 1), tuple(range(len(view.display.panels))), ((0, 0),) * len(view.display.panels))
        storage = wgpu.BufferUsage.STORAGE
        self._buffers = {
            name: GrowingBuffer(device, name, storage) for name in ("panels", "eyes", "levels", "finer", "lenses")
        }
        self._buffers["frame"] = GrowingBuffer(device, "frame", wgpu.BufferUsage.UNIFORM)
        self._buffers["levels"].write(records.level_rows(view.pyramid))
        self._buffers["finer"].write(records.log2_tau(view.detail.tau).astype(np.float32))
        self._bytes = view.pyramid.page_count * 4
        create = device.wgpu.create_buffer
        usage = storage | wgpu.BufferUsage.COPY_SRC | wgpu.BufferUsage.COPY_DST
        self._coverage = create(label="coverage", size=self._bytes, usage=usage)
        usage = wgpu.BufferUsage.MAP_READ | wgpu.BufferUsage.COPY_DST
        self._free = [create(label=f"coverage {n}", size=self._bytes, usage=usage) for n in range(_RING)]
        self._waiting: list[tuple[Any, Any]] = []  # (buffer, promise), oldest first
        self._latest: Coverage | None = None
        self._layout = self._bind_group_layout()
        self._pipeline = device.kept(
            "create_compute_pipeline",
            label="feedback",
            layout=device.kept("create_pipeline_layout", bind_group_layouts=[self._layout]),
            compute={"module": load_shader(device, "limen.layers.image.draw", "image.wgsl"), "entry_point": "feedback"},
        )

    def run(
        self,
        tolerance: Tolerance,
        *,
        divisor: int = 8,
        frame: int = 0,
        bias: int = 0,
        eye_m: Vec3 | None = None,
    ) -> bool:
        """Count the pages that one pixel in ``divisor`` x ``divisor`` needs, another one each ``frame``.

        Returns
        -------
        bool
            False if all readbacks are still under way; nothing is counted then.
        """
        if not 1 <= divisor <= 64:
            raise InputError(f"feedback's divisor must lie from 1 to 64, got {divisor}")
        self._collect()
        if not self._free:
            return False
        self._write(tolerance, divisor, frame, bias, eye_m)
        buffer = self._free.pop()
        encoder = self._device.wgpu.create_command_encoder(label="feedback")
        encoder.clear_buffer(self._coverage, 0, self._bytes)
        compute = encoder.begin_compute_pass()
        compute.set_pipeline(self._pipeline)
        compute.set_bind_group(0, self._group())
        width, height = self._view.display.arrays.size_px.max(axis=0)
        cell = divisor * _GROUP_PX
        compute.dispatch_workgroups(-(-int(width) // cell), -(-int(height) // cell), len(self._whole.panels))
        compute.end()
        encoder.copy_buffer_to_buffer(self._coverage, 0, buffer, 0, self._bytes)
        self._device.wgpu.queue.submit([encoder.finish()])
        self._waiting.append((buffer, buffer.map_async(wgpu.MapMode.READ)))
        return True

    def latest(self) -> Coverage | None:
        """The newest result that has come back, or ``None`` before the first; does not wait."""
        self._collect()
        return self._latest

    def read(self) -> Coverage:
        """The result of the last `run`, waited for.

        Raises
        ------
        RuntimeError
            If nothing was ever run.
        """
        for _, promise in self._waiting:
            promise.sync_wait()
        self._collect()
        if self._latest is None:
            raise RuntimeError("Feedback.read() before any Feedback.run()")
        return self._latest

    def destroy(self) -> None:
        for _, promise in self._waiting:
            promise.sync_wait()
        self._collect()
        for buffer in [*self._free, self._coverage, *self._buffers.values()]:
            buffer.destroy()
        self._free.clear()
        self._pipeline = self._layout = None

    # ------------------------------------------------------------------ steps of a run

    def _collect(self) -> None:
        """Take over what has been mapped since the last call."""
        while self._waiting and self._waiting[0][0].map_state == "mapped":
            buffer, _ = self._waiting.pop(0)
            counts = np.frombuffer(buffer.read_mapped(copy=False), np.uint32)
            pages = np.flatnonzero(counts)
            self._latest = Coverage(pages, counts[pages].astype(np.int64))
            del counts
            buffer.unmap()
            self._free.append(buffer)

    def _write(self, tolerance: Tolerance, divisor: int, frame: int, bias: int, eye_m: Vec3 | None) -> None:
        view, buffers = self._view, self._buffers
        place = frame * _ORDER % (divisor * divisor) if divisor % _ORDER else frame % (divisor * divisor)
        lenses, tables = records.lens_rows(view, self._whole)
        buffers["lenses"].write(lenses)
        row = records.frame_row(view, (1, 1), tolerance, eye_m, bias=bias, divisor=divisor, tables=tables)
        row["jitter_px"] = place % divisor, place // divisor
        buffers["frame"].write(row)
        buffers["panels"].write(records.panel_rows(view, self._whole, eye_m))
        buffers["eyes"].write(records.eye_rows(view, self._whole, tolerance))

    def _group(self) -> Any:
        resources = {name: {"buffer": buffer.buffer} for name, buffer in self._buffers.items()}
        resources["coverage"] = {"buffer": self._coverage}
        entries = [{"binding": number, "resource": resources[name]} for name, number in _NUMBERS.items()]
        return self._device.wgpu.create_bind_group(layout=self._layout, entries=entries)

    def _bind_group_layout(self) -> Any:
        kinds = {"frame": "uniform", "coverage": "storage"}
        entries = [
            {
                "binding": number,
                "visibility": wgpu.ShaderStage.COMPUTE,
                "buffer": {"type": kinds.get(name, "read-only-storage")},
            }
            for name, number in _NUMBERS.items()
        ]
        return self._device.kept("create_bind_group_layout", entries=entries)
