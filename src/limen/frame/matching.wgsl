// Panels are matched to each other: every pixel of a finished quilt times its panel's gain, and what is made up for where
// light falls off at a slant. The target multiplies what it holds by what is returned, in linear light.
//
// A panel is dimmer at an angle: those that are seen straight are dimmed to match. Harish, Narayanan 2013, section 4.1.1.

struct Matched {
    // Of outline and guard band, in the target's clip space.
    corners: array<vec4<f32>, 8>,
    // The way from the eye through a pixel of the target: across * x + along * y + base.
    across: vec3<f32>,
    gain: f32,
    along: vec3<f32>,
    falloff: f32,
    base: vec3<f32>,
    // Smallest cosine between a panel's normal and the way to the eye that brightness makes up for.
    least_cosine: f32,
    // Away from the viewers, along the panel's normal.
    forward: vec3<f32>,
    padding: f32,
}

@group(0) @binding(0) var<storage, read> panels: array<Matched>;

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) panel: u32,
}

// A fan of triangles about the first corner.
@vertex
fn outline(@builtin(vertex_index) number: u32, @builtin(instance_index) panel: u32) -> Corner {
    let side = number % 3u;
    return Corner(panels[panel].corners[select(number / 3u + side, 0u, side == 0u)], panel);
}

@fragment
fn share(in: Corner) -> @location(0) vec4<f32> {
    let way = panels[in.panel].across * in.position.x + panels[in.panel].along * in.position.y + panels[in.panel].base;
    let cosine = dot(panels[in.panel].forward, way) / length(way);
    let slant = min(panels[in.panel].least_cosine / max(cosine, 1e-4), 1.0);
    return vec4(vec3(panels[in.panel].gain * pow(slant, panels[in.panel].falloff)), 1.0);
}
