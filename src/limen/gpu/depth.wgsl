// The bits of depth, which every adapter reads back.

@group(0) @binding(0) var depths: texture_2d<f32>;

@vertex
fn whole(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn bits(@builtin(position) at: vec4<f32>) -> @location(0) u32 {
    return bitcast<u32>(textureLoad(depths, vec2<i32>(at.xy), 0).x);
}
