// after: gpu/colour.wgsl, mesh_common.wgsl
// Draws the pairs (triangle, panel) that sort.wgsl found: all panels of a quilt, of one eye or two, in one draw.
//
// Vertices are pulled from storage; the panel's matrix is three linear forms of the way from the eye. What lies outside
// the panel's outline and guard band is cut away in the fragment stage; scene_clip.wgsl has the vertex stage for adapters
// that clip by distances, which are spared it.

// 0: the picture. 1: every panel in a colour of its own over the picture.
override OVERLAY: u32 = 0u;

const NO_TEXTURE = 0xffffffffu;

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

@group(0) @binding(6) var pictures: texture_2d_array<f32>;
@group(0) @binding(7) var smoothly: sampler;

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
        light = mix(light, hue(in.view % scene.panels), 0.4);
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
