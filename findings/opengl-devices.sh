#!/bin/sh
# wgpu-py 0.32.0 (wgpu-native 29.0.1.1) on OpenGL: freeing one device makes another one draw nothing, without an error.
#
# Two devices are opened on one OpenGL adapter, in one process, and both draw. The second, opened last, is destroyed and
# released. From then on every draw of the first is lost: clearing works, triangles do not appear, and no error is raised.
# Opening any other device makes the first draw again. Seen on Mesa's llvmpipe through EGL; on Vulkan both go on drawing.
#
#   before [255, 128, 64, 255], second destroyed [255, 128, 64, 255], second released [0, 0, 0, 255],
#   third opened [255, 128, 64, 255]
#
# What explains it: all devices of an OpenGL adapter are in one context, and each binds its own vertex array when it is
# made and never again. Deleting the bound one leaves none bound, and a draw without one is an error nobody reads.
#
# Exit code: 0 where it is still so, 1 where the first device goes on drawing, 77 without an OpenGL adapter.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check wgpu==0.32.0 numpy==2.2.6
cat > "$folder/devices.py" <<'END'
import gc
import sys

import numpy as np
import wgpu

SHADER = """
@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
@fragment fn colour() -> @location(0) vec4<f32> { return vec4(1.0, 0.5, 0.25, 1.0); }
"""


def drawn(device):
    """One pixel of a triangle that covers everything."""
    usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC
    texture = device.create_texture(size=(64, 64, 1), format="rgba8unorm", usage=usage)
    module = device.create_shader_module(code=SHADER)
    pipeline = device.create_render_pipeline(
        layout=device.create_pipeline_layout(bind_group_layouts=[]),
        vertex={"module": module, "entry_point": "corner"},
        primitive={"topology": "triangle-list"},
        fragment={"module": module, "entry_point": "colour", "targets": [{"format": "rgba8unorm"}]},
    )
    encoder = device.create_command_encoder()
    attachment = {"view": texture.create_view(), "clear_value": (0, 0, 0, 1), "load_op": "clear", "store_op": "store"}
    render_pass = encoder.begin_render_pass(color_attachments=[attachment])
    render_pass.set_pipeline(pipeline)
    render_pass.draw(3)
    render_pass.end()
    device.queue.submit([encoder.finish()])
    layout = {"bytes_per_row": 256, "rows_per_image": 64}
    return np.frombuffer(device.queue.read_texture({"texture": texture}, layout, (64, 64, 1)), np.uint8)[:4].tolist()


try:
    adapters = [a for a in wgpu.gpu.enumerate_adapters_sync() if a.info["backend_type"] == "OpenGL"]
except RuntimeError:
    adapters = []
if not adapters:
    print("skipped: there is no OpenGL adapter")
    sys.exit(77)
print("wgpu", wgpu.__version__, "on", adapters[0].summary)
first = adapters[0].request_device_sync()
second = adapters[0].request_device_sync()
seen = {"before": drawn(first)}
assert drawn(second) == seen["before"] == [255, 128, 64, 255]
second.destroy()
seen["second destroyed"] = drawn(first)
del second
gc.collect()
seen["second released"] = drawn(first)
third = adapters[0].request_device_sync()
seen["third opened"] = drawn(first)
for when, colour in seen.items():
    print(f"{when}: {colour}")
lost = seen["second released"] == [0, 0, 0, 255]
print("still so: the first device draws nothing" if lost else "CHANGED: the first device goes on drawing")
sys.exit(0 if lost else 1)
END
"$folder/venv/bin/python" "$folder/devices.py"
