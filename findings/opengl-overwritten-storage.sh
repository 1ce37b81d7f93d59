#!/bin/sh
# wgpu-py 0.32.0 (wgpu-native 29.0.1.1) on OpenGL: a draw sees what a LATER compute pass writes to a storage buffer.
#
# One command encoder holds eight times: a compute pass that adds 1 to a number in a storage buffer, and a render pass
# whose fragments write that number into their eighth of a picture. WebGPU promises that passes take effect in order, so
# the eighths must show 1, 2, ... 8; on Vulkan they do. On OpenGL (Mesa's llvmpipe) they show
#
#   [[2], [3], [4], [5], [6], [7], [8], [8]]
#
# : fragments still being drawn read what the next compute pass has written already. No validation error is raised.
# Waiting for the queue between the passes gives the right picture. What explains it: on OpenGL wgpu puts a memory barrier
# after a shader has written a buffer, and none between reading it and writing it.
#
# Exit code: 0 where it is still so, 1 where the numbers are in order, 77 without an OpenGL adapter.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check wgpu==0.32.0 numpy==2.2.6
cat > "$folder/overwritten.py" <<'END'
import sys

import numpy as np
import wgpu

DRAWN = """
@group(0) @binding(0) var<storage, read> number: array<u32>;
@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn shown() -> @location(0) u32 { return number[0]; }
"""
WRITTEN = """
@group(0) @binding(0) var<storage, read_write> number: array<u32>;
@compute @workgroup_size(1) fn one_more() { number[0] += 1u; }
"""
SIDE, TIMES, TRIES = 1024, 8, 10


def picture(device, *, wait):
    """What each strip of the picture shows."""
    usage = wgpu.BufferUsage.STORAGE
    buffer = device.create_buffer_with_data(data=np.zeros(1, np.uint32), usage=usage)
    usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC
    texture = device.create_texture(size=(SIDE, SIDE, 1), format="r32uint", usage=usage)

    def bound(kind, stage):
        entry = {"binding": 0, "visibility": stage, "buffer": {"type": kind}}
        layout = device.create_bind_group_layout(entries=[entry])
        group = device.create_bind_group(layout=layout, entries=[{"binding": 0, "resource": {"buffer": buffer}}])
        return device.create_pipeline_layout(bind_group_layouts=[layout]), group

    seen_layout, seen = bound("read-only-storage", wgpu.ShaderStage.FRAGMENT)
    changed_layout, changed = bound("storage", wgpu.ShaderStage.COMPUTE)
    drawn, written = device.create_shader_module(code=DRAWN), device.create_shader_module(code=WRITTEN)
    draw = device.create_render_pipeline(
        layout=seen_layout,
        vertex={"module": drawn, "entry_point": "corner"},
        primitive={"topology": "triangle-list"},
        fragment={"module": drawn, "entry_point": "shown", "targets": [{"format": "r32uint"}]},
    )
    write = device.create_compute_pipeline(
        layout=changed_layout, compute={"module": written, "entry_point": "one_more"}
    )
    encoder = device.create_command_encoder()
    for strip in range(TIMES):
        compute_pass = encoder.begin_compute_pass()
        compute_pass.set_pipeline(write)
        compute_pass.set_bind_group(0, changed)
        compute_pass.dispatch_workgroups(1)
        compute_pass.end()
        load = "load" if strip else "clear"
        attachment = {"view": texture.create_view(), "clear_value": (0, 0, 0, 0), "load_op": load, "store_op": "store"}
        render_pass = encoder.begin_render_pass(color_attachments=[attachment])
        render_pass.set_pipeline(draw)
        render_pass.set_bind_group(0, seen)
        render_pass.set_scissor_rect(0, strip * SIDE // TIMES, SIDE, SIDE // TIMES)
        render_pass.draw(3)
        render_pass.end()
        if wait:
            device.queue.submit([encoder.finish()])
            mark = device.create_buffer(size=4, usage=wgpu.BufferUsage.COPY_SRC)
            device.queue.read_buffer(mark)
            encoder = device.create_command_encoder()
    device.queue.submit([encoder.finish()])
    layout = {"bytes_per_row": 4 * SIDE, "rows_per_image": SIDE}
    texels = np.frombuffer(device.queue.read_texture({"texture": texture}, layout, (SIDE, SIDE, 1)), np.uint32)
    return [np.unique(strip).tolist() for strip in texels.reshape(TIMES, -1)]


try:
    adapters = [a for a in wgpu.gpu.enumerate_adapters_sync() if a.info["backend_type"] == "OpenGL"]
except RuntimeError:
    adapters = []
if not adapters:
    print("skipped: there is no OpenGL adapter")
    sys.exit(77)
print("wgpu", wgpu.__version__, "on", adapters[0].summary)
device = adapters[0].request_device_sync()
right = [[number + 1] for number in range(TIMES)]
waited = picture(device, wait=True)
print("with waiting:   ", waited)
assert waited == right
for _ in range(TRIES):  # a race: it may be right by chance
    found = picture(device, wait=False)
    print("without waiting:", found)
    if found != right:
        print("still so: draws see what later compute passes wrote")
        sys.exit(0)
print("CHANGED: passes take effect in order")
sys.exit(1)
END
"$folder/venv/bin/python" "$folder/overwritten.py"
