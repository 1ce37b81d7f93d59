"""The eye on the GPU is the eye on the CPU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import limen
from limen.vision.castle_csf import FREQUENCY_CPD, LUMINANCE_CD_M2
from limen.vision.tables import SIDE, sensitivity_tables

# Appended to sensitivity.wgsl, as a shader that uses it would be.
ASKING = """
@group(0) @binding(0) var<storage, read> asked: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> answered: array<vec2f>;
@compute @workgroup_size(64) fn ask(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&answered) {
        let a = asked[2u * id.x];
        answered[id.x] = vec2f(sensitivity(a.x, a.y, a.z, a.w, asked[2u * id.x + 1u].x), resolution_cpd(a.y, a.z));
    }
}
"""


def test_the_tables_are_small_and_finite():
    tables = sensitivity_tables()
    assert tables.sustained.shape == tables.transient.shape == (SIDE, SIDE)
    assert tables.buffer.dtype == np.float32
    assert tables.buffer.shape == (2 * SIDE * SIDE + SIDE,)
    assert np.isfinite(tables.buffer).all()


def on_the_gpu(device: Any, questions: np.ndarray, constants: dict[str, float] | None = None) -> np.ndarray:
    """Sensitivity and resolution for rows of frequency, eccentricity, luminance, flicker and area."""
    import wgpu

    from limen.gpu.shader import shader_text

    gpu, usage = device.wgpu, wgpu.BufferUsage
    rows = np.zeros((len(questions), 8), np.float32)
    rows[:, :5] = questions
    module = gpu.create_shader_module(code=shader_text("limen.vision", "sensitivity.wgsl") + ASKING)
    pipeline = gpu.create_compute_pipeline(
        layout="auto", compute={"module": module, "entry_point": "ask", "constants": constants or {}}
    )
    given = gpu.create_buffer_with_data(data=rows, usage=usage.STORAGE)
    answer = gpu.create_buffer(size=8 * len(rows), usage=usage.STORAGE | usage.COPY_SRC)
    tables = gpu.create_buffer_with_data(data=sensitivity_tables().buffer, usage=usage.STORAGE)
    groups = [
        gpu.create_bind_group(
            layout=pipeline.get_bind_group_layout(number),
            entries=[{"binding": n, "resource": {"buffer": buffer}} for n, buffer in enumerate(buffers)],
        )
        for number, buffers in enumerate(([given, answer], [tables]))
    ]
    encoder = gpu.create_command_encoder()
    compute = encoder.begin_compute_pass()
    compute.set_pipeline(pipeline)
    for number, group in enumerate(groups):
        compute.set_bind_group(number, group)
    compute.dispatch_workgroups(-(-len(rows) // 64))
    compute.end()
    gpu.queue.submit([encoder.finish()])
    return np.frombuffer(gpu.queue.read_buffer(answer), np.float32).reshape(-1, 2).astype(float)


def questions_over_the_whole_range(count: int) -> np.ndarray:
    """Random places of the models' range and beyond it, and the corners."""
    rng = np.random.default_rng(11)

    def log_even(low: float, high: float) -> np.ndarray:
        return np.exp(rng.uniform(np.log(low), np.log(high), count))

    flicker = np.where(rng.random(count) < 0.5, 0, rng.uniform(0, 60, count))
    columns = [log_even(0.03, 90), rng.uniform(0, 60, count), log_even(0.005, 2e4), flicker, log_even(1e-3, 1e3)]
    ends = [[*FREQUENCY_CPD, 4.0], [0.0, 20.0], [*LUMINANCE_CD_M2, 100.0], [0.0, 5.0], [1.0]]
    corners = np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 5)
    return np.concatenate([np.stack(columns, axis=1), corners]).astype(np.float32).astype(float)


@pytest.mark.gpu
def test_the_gpu_sees_what_the_cpu_sees(device: Any) -> None:
    questions = questions_over_the_whole_range(60_000)
    found = on_the_gpu(device, questions)
    truth = limen.sensitivity(*questions.T)
    visible = truth > 1e-6  # what needs a million times full contrast needs no second digit
    assert visible.mean() > 0.5
    np.testing.assert_allclose(found[visible, 0], truth[visible], rtol=0.002)
    assert found[~visible, 0].max() < 2e-6
    resolved = limen.resolution_cpd(questions[:, 1], questions[:, 2])
    np.testing.assert_allclose(found[:, 1], resolved, rtol=0.001)


@pytest.mark.gpu
def test_the_other_side_of_the_field_is_an_override(device: Any) -> None:
    questions = questions_over_the_whole_range(2000)
    questions[:, 1] %= 20
    found = on_the_gpu(device, questions, {"falloff_k0": 0.0239853, "falloff_k1": 0.0189038})[:, 0]
    truth = limen.sensitivity(*questions.T, field="temporal")
    visible = truth > 1e-6
    np.testing.assert_allclose(found[visible], truth[visible], rtol=0.002)
