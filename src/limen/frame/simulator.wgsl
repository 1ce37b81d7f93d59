// What somebody sees of the lit display: every panel's outline in the room, with its pixels from the quilt.
//
//   lit_*   one polygon per panel, seen from one place in each of the camera's pixels
//   sum_*   adds what was seen from several places (share 1 / places), or copies it into the camera's picture
//
// Pixels of a panel are as the processor's twin in limen.layers.common.simulator_uniforms lays them out.

// What one picture counts in the sum.
override SHARE: f32 = 1.0;

const CORNERS: u32 = 8u;
// Most places in a pixel's footprint, along each of its sides, at which the quilt is read.
const MOST_TAPS: f32 = 8.0;
// This far from every edge, the four pixels around a place lie inside the outline.
const DEEP_PX: f32 = 1.5;

struct Frame {
    // Clip space of the way d from the eye to a place: (x.d, y.d, near, w.d).
    x: vec4<f32>,
    y: vec4<f32>,
    w: vec4<f32>,
    near: f32,
    // Places along each side of a camera's pixel.
    samples: f32,
    // Where this eye's copy of the quilt begins.
    copy_px: f32,
    // How far beyond the outline the quilt's pixels are the panel's.
    guard_px: f32,
    // 1: that the panels' light falls off at a slant is seen. Their gain is in the quilts.
    uneven: u32,
    // 1: backs, frames and unlit panels have their colours; 0: they are black.
    frames: u32,
    padding: vec2<u32>,
}

struct Panel {
    // Relative to the eye, metres; the last corner is repeated.
    corners: array<vec4<f32>, 8>,
    // The same in pixels of the quilt.
    corners_px: array<vec4<f32>, 8>,
    // x * edge.x + y * edge.y + edge.z is the distance inside an edge of the lit outline, in pixels of the quilt.
    edges: array<vec4<f32>, 8>,
    normal: vec4<f32>,
    // Of what is not lit; w > 0: it is a back, darker where it is seen at a slant.
    colour: vec4<f32>,
    lit: u32,
    falloff: f32,
    padding: vec2<u32>,
}

// All that a fragment deep inside a panel needs, so that it reads nothing but the quilt.
struct Seen {
    @builtin(position) clip: vec4<f32>,
    @location(0) place_px: vec2<f32>,
    @location(1) way: vec3<f32>,
    // Distances inside the eight edges.
    @location(2) inside: vec4<f32>,
    @location(3) inside_too: vec4<f32>,
    @location(4) @interpolate(flat) normal: vec3<f32>,
    @location(5) @interpolate(flat) colour: vec4<f32>,
    @location(6) @interpolate(flat) falloff: f32,
    @location(7) @interpolate(flat) lit: u32,
    @location(8) @interpolate(flat) panel: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> panels: array<Panel>;
@group(0) @binding(2) var bilinear: sampler;
@group(1) @binding(0) var picture: texture_2d<f32>;

// A fan of triangles around the first corner.
@vertex
fn lit_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) index: u32) -> Seen {
    let step = vertex % 3u;
    let corner = min(select(vertex / 3u + step, 0u, step == 0u), CORNERS - 1u);
    let way = panels[index].corners[corner].xyz;
    let place = vec3(panels[index].corners_px[corner].xy, 1.0);
    var seen: Seen;
    seen.clip = vec4(dot(frame.x.xyz, way), dot(frame.y.xyz, way), frame.near, dot(frame.w.xyz, way));
    seen.place_px = place.xy;
    seen.way = way;
    for (var edge = 0u; edge < 4u; edge += 1u) {
        seen.inside[edge] = dot(panels[index].edges[edge].xyz, place);
        seen.inside_too[edge] = dot(panels[index].edges[edge + 4u].xyz, place);
    }
    seen.normal = panels[index].normal.xyz;
    seen.colour = panels[index].colour;
    seen.falloff = panels[index].falloff;
    seen.lit = panels[index].lit;
    seen.panel = index;
    return seen;
}

@fragment
fn lit_fragment(seen: Seen) -> @location(0) vec4<f32> {
    // Derivatives first: they must not depend on where neighbours branch to.
    let across = dpdx(seen.place_px) / frame.samples;
    let along = dpdy(seen.place_px) / frame.samples;
    let cosine = abs(dot(normalize(seen.way), seen.normal));
    if seen.lit == 0u {
        let slant = mix(1.0, 0.35 + 0.65 * cosine, seen.colour.w);
        return vec4(seen.colour.rgb * slant * f32(frame.frames), 1.0);
    }
    var light = footprint(seen, across, along);
    if frame.uneven == 1u {
        light *= pow(max(cosine, 1e-6), seen.falloff);
    }
    return vec4(light, 1.0);
}

// The mean over the parallelogram that a camera's pixel (or its share of one) covers on the panel.
fn footprint(seen: Seen, across: vec2<f32>, along: vec2<f32>) -> vec3<f32> {
    let taps = clamp(ceil(vec2(length(across), length(along))), vec2(1.0), vec2(MOST_TAPS));
    let reach = 0.5 * (length(across) + length(along));
    let nearest = min(seen.inside, seen.inside_too);
    let inside = min(min(nearest.x, nearest.y), min(nearest.z, nearest.w));
    let deep = inside - reach >= DEEP_PX - frame.guard_px;
    let scale = 1.0 / vec2<f32>(textureDimensions(picture));
    var sum = vec4(0.0);
    for (var row = 0.5; row < taps.y; row += 1.0) {
        for (var column = 0.5; column < taps.x; column += 1.0) {
            let tap = seen.place_px + across * (column / taps.x - 0.5) + along * (row / taps.y - 0.5);
            if deep {
                let place = (tap + vec2(frame.copy_px, 0.0)) * scale;
                sum += vec4(textureSampleLevel(picture, bilinear, place, 0.0).rgb, 1.0);
            } else {
                sum += own_pixels(seen.panel, tap);
            }
        }
    }
    // A corner so sharp that no pixel's centre lies in it is as dark as it would be in reality.
    return sum.rgb / max(sum.a, 1e-6);
}

// Bilinear, from those of the four pixels that are the panel's own; the last component is the weight found.
fn own_pixels(panel: u32, place: vec2<f32>) -> vec4<f32> {
    let last = vec2<i32>(textureDimensions(picture)) - 1;
    let corner = floor(place - 0.5) + 0.5;
    let share = place - corner;
    var sum = vec4(0.0);
    for (var neighbour = 0u; neighbour < 4u; neighbour += 1u) {
        let step = vec2(f32(neighbour & 1u), f32(neighbour >> 1u));
        let weights = mix(1.0 - share, share, step);
        let centre = corner + step;
        if is_own(panel, centre) {
            let pixel = clamp(vec2<i32>(floor(centre + vec2(frame.copy_px, 0.0))), vec2(0), last);
            sum += vec4(textureLoad(picture, pixel, 0).rgb, 1.0) * weights.x * weights.y;
        }
    }
    return sum;
}

fn is_own(panel: u32, centre: vec2<f32>) -> bool {
    for (var edge = 0u; edge < CORNERS; edge += 1u) {
        // 0.001: centres on the outline itself count.
        if dot(panels[panel].edges[edge].xyz, vec3(centre, 1.0)) < -frame.guard_px - 0.001 {
            return false;
        }
    }
    return true;
}

@vertex
fn sum_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn sum_fragment(@builtin(position) place: vec4<f32>) -> @location(0) vec4<f32> {
    return textureLoad(picture, vec2<i32>(place.xy), 0) * SHARE;
}
