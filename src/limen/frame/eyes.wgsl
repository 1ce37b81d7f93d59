// Two eyes' quilts side by side become one anaglyph: red of the left eye, green and blue of the right.

@group(0) @binding(0) var both: texture_2d<f32>;

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn anaglyph(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<u32>(position.xy);
    let width = textureDimensions(both).x / 2u;
    let left = textureLoad(both, pixel, 0);
    let right = textureLoad(both, pixel + vec2(width, 0u), 0);
    return vec4(left.r, right.gb, 1.0);
}
