// after: mesh_common.wgsl
// The vertex stage of scene.wgsl for adapters that clip by distances: what lies outside a panel's outline and guard band
// never reaches the fragment stage. A file of its own, because a module that names the feature is refused without it.

enable clip_distances;

struct Varyings {
    @builtin(position) position: vec4<f32>,
    @builtin(clip_distances) inside: array<f32, 8>,
    @location(0) way: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec4<f32>,
    @location(3) uv: vec2<f32>,
    @location(4) @interpolate(flat) layer: u32,
    @location(5) @interpolate(flat) view: u32,
}

@vertex
fn vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) instance: u32) -> Varyings {
    let pulled = pull(index, instance);
    let view = pulled.view;
    let way = pulled.way;
    let corner = corners[pulled.number];
    var out: Varyings;
    out.position = pulled.position;
    for (var k = 0u; k < 8u; k++) {
        out.inside[k] = dot(views[view].edges[k].xyz, way);
    }
    out.way = way;
    out.normal = corner.normal;
    out.colour = unpack4x8unorm(corner.colour);
    out.uv = corner.uv;
    out.layer = corner.layer;
    out.view = view;
    return out;
}
