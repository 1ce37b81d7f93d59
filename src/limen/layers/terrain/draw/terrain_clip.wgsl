// after: terrain_common.wgsl
// The vertex stage of terrain.wgsl for adapters that clip by distances: what lies outside a panel's outline and guard band
// never reaches the fragment stage. A file of its own, because a module that names the feature is refused without it.

enable clip_distances;

struct Varyings {
    @builtin(position) position: vec4<f32>,
    @builtin(clip_distances) inside: array<f32, 8>,
    @location(0) place: vec3<f32>,
    @location(1) @interpolate(flat) patch_number: u32,
}

struct Bare {
    @builtin(position) position: vec4<f32>,
    @builtin(clip_distances) inside: array<f32, 8>,
}

@vertex
fn vertex(in: Vertex) -> Varyings {
    let place = placed(in);
    var out: Varyings;
    out.position = position(place);
    for (var k = 0u; k < 8u; k++) {
        out.inside[k] = dot(view.edges[k], place);
    }
    out.place = place.xyz;
    out.patch_number = in.patch_number;
    return out;
}

// For depth alone.
@vertex
fn bare_vertex(in: Vertex) -> Bare {
    let place = placed(in);
    var out: Bare;
    out.position = position(place);
    for (var k = 0u; k < 8u; k++) {
        out.inside[k] = dot(view.edges[k], place);
    }
    return out;
}

