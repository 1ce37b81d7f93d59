"""One layout, written once: NumPy's offsets are WGSL's."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from limen.gpu.shader import load_shader, shader_text
from limen.gpu.structs import check_layout, wgsl_struct
from limen.layers.image.draw import uniforms as records

STRUCTS = {"Frame": records.FRAME, "Panel": records.PANEL, "PageQuad": records.PAGE_QUAD, "Level": records.LEVEL}


@pytest.mark.parametrize("name", STRUCTS)
def test_the_shader_has_the_dtypes_struct(name: str) -> None:
    text = re.sub(r"^\s*//.*\n", "", shader_text("limen.layers.image.draw", "image.wgsl"), flags=re.MULTILINE)
    assert wgsl_struct(name, STRUCTS[name]) in text


@pytest.mark.parametrize(
    "fields",
    [
        [("level", "<i4"), ("place", "<f4", 2)],
        [("place", "<f4", 3), ("more", "<f4", 4)],
        [("places", "<f4", (3, 4)), ("level", "<i4")],
    ],
)
def test_a_layout_that_wgsl_would_pad_is_refused(fields: Any) -> None:
    with pytest.raises(ValueError, match="padding"):
        check_layout(np.dtype(fields))


@pytest.mark.gpu
@pytest.mark.parametrize("name", STRUCTS)
def test_the_gpu_reads_fields_where_numpy_puts_them(name: str, device: Any, tmp_path: Any) -> None:
    """Each field's first number comes back as itself from a shader made of the dtype alone."""
    import wgpu

    dtype = STRUCTS[name]
    rows = np.zeros(2, dtype)
    flat = rows.view(np.uint32).reshape(2, -1)
    flat[:] = np.arange(flat.size).reshape(flat.shape) + 0x40000000  # also valid floats
    reads, expected = [], []
    for field in dtype.names or ():
        shape = dtype[field].shape
        index = "" if not shape else ".x" if len(shape) == 1 else "[1].x"
        reads.append(f"out[{len(reads)}] = bitcast<u32>(rows[1].{field}{index});")
        value = rows[1][field] if not shape else rows[1][field][0] if len(shape) == 1 else rows[1][field][1, 0]
        expected.append(np.asarray(value).reshape(1).view(np.uint32)[0])
    code = (
        wgsl_struct(name, dtype)
        + f"\n@group(0) @binding(0) var<storage, read> rows: array<{name}>;\n"
        + "@group(0) @binding(1) var<storage, read_write> out: array<u32>;\n"
        + "@compute @workgroup_size(1) fn main() {\n"
        + "\n".join(reads)
        + "\n}"
    )
    gpu = device.wgpu
    usage = wgpu.BufferUsage
    given = gpu.create_buffer_with_data(data=rows, usage=usage.STORAGE)
    out = gpu.create_buffer(size=4 * len(reads), usage=usage.STORAGE | usage.COPY_SRC)
    pipeline = gpu.create_compute_pipeline(
        layout="auto", compute={"module": gpu.create_shader_module(code=code), "entry_point": "main"}
    )
    group = gpu.create_bind_group(
        layout=pipeline.get_bind_group_layout(0),
        entries=[{"binding": 0, "resource": {"buffer": given}}, {"binding": 1, "resource": {"buffer": out}}],
    )
    encoder = gpu.create_command_encoder()
    compute = encoder.begin_compute_pass()
    compute.set_pipeline(pipeline)
    compute.set_bind_group(0, group)
    compute.dispatch_workgroups(1)
    compute.end()
    gpu.queue.submit([encoder.finish()])
    assert np.frombuffer(gpu.queue.read_buffer(out), np.uint32).tolist() == expected


@pytest.mark.gpu
def test_a_shader_is_loaded_from_beside_its_module(device: Any) -> None:
    assert load_shader(device, "limen.layers.image.draw", "image.wgsl").label == "image.wgsl"
