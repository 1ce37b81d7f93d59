// What all vertex stages of terrains read, and where they put a vertex.

struct Terrain {
    origin_post: vec2<i32>,
    origin_height_m: f32,
    exaggeration: f32,
    spacing_m: vec2<f32>,
    low_m: f32,
    range_m: f32,
    tint_from_m: f32,
    tints_per_m: f32,
    sea_level_m: f32,
    contour_interval_m: f32,
    // Toward the sun (east, north, up); share of light that comes from everywhere.
    sun: vec4<f32>,
    sea: vec4<f32>,
    ramp: array<vec4<f32>, 20>,
}

struct TerrainView {
    // Linear forms of (column, row, height, 1), counted from the origin.
    x: vec4<f32>,
    y: vec4<f32>,
    w: vec4<f32>,
    edges: array<vec4<f32>, 8>,
    // The eye's place; the way from there to what has depth 1 at pixel (0, 0), and how it grows to the right and down.
    eye: vec4<f32>,
    way: vec4<f32>,
    way_right: vec4<f32>,
    way_down: vec4<f32>,
    // Of outline and guard band, in the quilt's clip space.
    corners: array<vec4<f32>, 8>,
    tint: vec4<f32>,
    near: f32,
    // log2 of the pixels that detail may be lost over.
    tolerance_log2: f32,
    padding: vec2<u32>,
}

struct Vertex {
    @location(0) post: vec2<u32>,
    @location(1) height_m: f32,
    @location(2) patch_number: u32,
}

@group(0) @binding(0) var<uniform> terrain: Terrain;
// The panel that is drawn.
@group(0) @binding(1) var<uniform> view: TerrainView;

fn placed(in: Vertex) -> vec4<f32> {
    let post = vec2<f32>(vec2<i32>(in.post) - terrain.origin_post);
    return vec4(post, in.height_m - terrain.origin_height_m, 1.0);
}

fn position(place: vec4<f32>) -> vec4<f32> {
    return vec4(
        dot(view.x, place), dot(view.y, place), view.near, dot(view.w, place)
    );
}
