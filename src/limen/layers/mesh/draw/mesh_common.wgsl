// after: gpu/panel_view.wgsl
// What all vertex stages of meshes read, and how they pull a vertex.

// Where vertices come from. 0: pairs of a triangle and a panel. 1: the same, warped to their panels already. 2: the mesh
// itself, every instance for another panel.
override SOURCE: u32 = 0u;

struct Corner {
    normal: vec3<f32>,
    // sRGB and opacity, a byte each.
    colour: u32,
    uv: vec2<f32>,
    layer: u32,
    padding: u32,
}

struct Scene {
    vertices: u32,
    panels: u32,
    // Of the viewer's camera, for a depth that all panels share.
    near: f32,
    padding: u32,
    // Per eye: where the viewer's camera looks.
    forward: array<vec4<f32>, 2>,
    // Three rows: normals in the room, from the mesh's coordinates.
    normal_from_mesh: array<vec4<f32>, 3>,
    // Toward the light, in the room; share of light that comes from everywhere.
    light: vec4<f32>,
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
