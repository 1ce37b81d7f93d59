// Draws the pairs (triangle, panel) that sort.wgsl found: all panels of a quilt, of one eye or two, in one draw.
//
// Vertices are pulled from storage; the panel's matrix is three linear forms of the way from the eye. What lies outside
// the panel's outline and guard band is cut away in the fragment stage; scene_clip.wgsl has the vertex stage for adapters
// that clip by distances, which are spared it.

// 0: the picture. 1: every panel in a colour of its own over the picture.
override OVERLAY: u32 = 0u;

const NO_TEXTURE = 0xffffffffu;

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

struct Varyings {
    @builtin(position) position: vec4<f32>,
    @location(0) way: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec4<f32>,
    @location(3) uv: vec2<f32>,
    @location(4) @interpolate(flat) layer: u32,
    @location(5) @interpolate(flat) view: u32,
    // Pixels inside the first and the last four edges, times w.
    @location(6) inside: vec4<f32>,
    @location(7) inside_too: vec4<f32>,
}

struct Shaded {
    @location(0) way: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) colour: vec4<f32>,
    @location(3) uv: vec2<f32>,
    @location(4) @interpolate(flat) layer: u32,
    @location(5) @interpolate(flat) view: u32,
}

struct Deep {
    @location(0) colour: vec4<f32>,
    @builtin(frag_depth) depth: f32,
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
@group(0) @binding(6) var pictures: texture_2d_array<f32>;
@group(0) @binding(7) var smoothly: sampler;
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
    out.way = way;
    out.normal = corner.normal;
    out.colour = unpack4x8unorm(corner.colour);
    out.uv = corner.uv;
    out.layer = corner.layer;
    out.view = view;
    for (var k = 0u; k < 4u; k++) {
        out.inside[k] = dot(views[view].edges[k].xyz, way);
        out.inside_too[k] = dot(views[view].edges[k + 4u].xyz, way);
    }
    return out;
}

fn linear_of(srgb: vec3<f32>) -> vec3<f32> {
    return select(pow((srgb + 0.055) / 1.055, vec3(2.4)), srgb / 12.92, srgb <= vec3(0.04045));
}

// Hues a golden angle apart, so that neighbours differ.
fn panel_colour(panel: u32) -> vec3<f32> {
    let turn = fract(f32(panel) * 0.618034) * 6.0;
    return clamp(abs(vec3(turn - 3.0, 2.0 - abs(turn - 2.0), 2.0 - abs(turn - 4.0))) - vec3(1.0, 0.0, 0.0), vec3(0.0), vec3(1.0));
}

fn lit(in: Shaded) -> vec4<f32> {
    let texel = textureSample(pictures, smoothly, in.uv, select(in.layer, 0u, in.layer == NO_TEXTURE));
    var colour = vec4(linear_of(in.colour.rgb), in.colour.a);
    if in.layer != NO_TEXTURE {
        colour *= texel;
    }
    var normal = normalize(vec3(
        dot(scene.normal_from_mesh[0].xyz, in.normal),
        dot(scene.normal_from_mesh[1].xyz, in.normal),
        dot(scene.normal_from_mesh[2].xyz, in.normal),
    ));
    let toward_eye = -normalize(in.way);
    // Both sides of a surface are seen.
    normal *= select(-1.0, 1.0, dot(normal, toward_eye) >= 0.0);
    // Half of the light from a fixed place, half from the viewer, so that nothing turns black.
    let direct = 0.5 * max(dot(normal, scene.light.xyz), 0.0) + 0.5 * dot(normal, toward_eye);
    var light = colour.rgb * mix(direct, 1.0, scene.light.w);
    if OVERLAY == 1u {
        light = mix(light, panel_colour(in.view % scene.panels), 0.4);
    }
    return vec4(light, colour.a);
}

fn shared_depth(view: u32, way: vec3<f32>) -> f32 {
    return scene.near / max(dot(scene.forward[views[view].eye].xyz, way), scene.near);
}

fn is_outside(in: Varyings) -> bool {
    return any(min(in.inside, in.inside_too) < vec4(0.0));
}

fn shaded(in: Varyings) -> Shaded {
    return Shaded(in.way, in.normal, in.colour, in.uv, in.layer, in.view);
}

@fragment
fn picture(in: Shaded) -> @location(0) vec4<f32> {
    return vec4(lit(in).rgb, 1.0);
}

@fragment
fn picture_deep(in: Shaded) -> Deep {
    return Deep(vec4(lit(in).rgb, 1.0), shared_depth(in.view, in.way));
}

@fragment
fn cut_picture(in: Varyings) -> @location(0) vec4<f32> {
    let colour = lit(shaded(in));
    if is_outside(in) || colour.a < 0.5 {
        discard;
    }
    return vec4(colour.rgb, 1.0);
}

@fragment
fn cut_picture_deep(in: Varyings) -> Deep {
    let colour = lit(shaded(in));
    if is_outside(in) || colour.a < 0.5 {
        discard;
    }
    return Deep(vec4(colour.rgb, 1.0), shared_depth(in.view, in.way));
}
