// Colours that several kinds of content have in common.

fn linear_of(srgb: vec3<f32>) -> vec3<f32> {
    return select(pow((srgb + 0.055) / 1.055, vec3(2.4)), srgb / 12.92, srgb <= vec3(0.04045));
}

// A colour of its own for every number: a step of the golden section around the circle of hues.
fn hue(number: u32) -> vec3<f32> {
    let turn = fract(f32(number & 0xffffu) * 0.618034) * 6.0;
    return clamp(
        abs(vec3(turn - 3.0, 2.0 - abs(turn - 2.0), 2.0 - abs(turn - 4.0))) - vec3(1.0, 0.0, 0.0), vec3(0.0), vec3(1.0)
    );
}
