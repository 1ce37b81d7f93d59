// The vertex stage of scene.wgsl for adapters that clip by distances: what lies outside a panel's outline and guard band
// never reaches the fragment stage. A file of its own, because a module that names the feature is refused without it.

enable clip_distances;

// Where vertices come from. 0: pairs of a triangle and a panel. 1: the same, warped to their panels already. 2: the mesh
// itself, every instance for another panel.
override SOURCE: u32 = 0u;

struct PanelView {
    x: vec4<f32>,
    y: vec4<f32>,
    w: vec4<f32>,
    edges: array<vec4<f32>, 8>,
    corners: array<vec4<f32>, 8>,
    corner_count: u32,
    eye: u32,
    padding: vec2<u32>,
}

struct Corner {
    normal: vec3<f32>,
    colour: u32,
    uv: vec2<f32>,
    layer: u32,
    padding: u32,
}

struct Scene {
    vertices: u32,
    panels: u32,
    near: f32,
    padding: u32,
    forward: array<vec4<f32>, 2>,
    normal_from_mesh: array<vec4<f32>, 3>,
    light: vec4<f32>,
}

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

// As sort_paper.wgsl leaves it.
struct Warped {
    position: vec4<f32>,
    way: vec3<f32>,
    number: u32,
}

struct Pulled {
    position: vec4<f32>,
    way: vec3<f32>,
    number: u32,
    view: u32,
}

@group(0) @binding(0) var<uniform> scene: Scene;
@group(0) @binding(1) var<storage, read> views: array<PanelView>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> ways: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> pairs: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> corners: array<Corner>;
@group(0) @binding(8) var<storage, read> warped: array<Warped>;

fn pull(index: u32, instance: u32) -> Pulled {
    if SOURCE == 1u {
        let ready = warped[index];
        return Pulled(ready.position, ready.way, ready.number, pairs[index / 3u].y);
    }
    var number = index;
    var view = instance;
    if SOURCE == 0u {
        let pair = pairs[index / 3u];
        number = triangles[pair.x * 3u + index % 3u];
        view = pair.y;
    }
    let way = ways[views[view].eye * scene.vertices + number].xyz;
    let position = vec4(
        dot(views[view].x.xyz, way), dot(views[view].y.xyz, way), views[view].x.w, dot(views[view].w.xyz, way)
    );
    return Pulled(position, way, number, view);
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
