// The nearest splat of every pixel in one pass, for adapters with 64-bit atomics: depth in the upper half of a key, the
// pair's id in the lower. What is placed, and which pixels it covers, is as in points.wgsl.

override ROUND: u32 = 1u;

const ROW = 8388480u;
const NONE = 0xffffffffu;

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

struct Rays {
    across: vec4<f32>,
    along: vec4<f32>,
    base: vec4<f32>,
    bounds: vec4<f32>,
}

struct Cloud {
    way_from_cloud: array<vec4<f32>, 3>,
    normal_from_cloud: array<vec4<f32>, 3>,
    light: vec4<f32>,
    background: vec4<f32>,
    unit_m: f32,
    is_lit: u32,
    // Where this batch of pairs begins and ends among all.
    first: u32,
    end: u32,
    stride: u32,
    width: u32,
    height: u32,
    padding: u32,
}

struct Placed {
    way: vec3<f32>,
    reach: f32,
    first: u32,
    last: u32,
    middle: u32,
    view: u32,
    depth: u32,
    is_inside: u32,
    padding_a: u32,
    padding_b: u32,
}

@group(0) @binding(0) var<uniform> cloud: Cloud;
@group(0) @binding(1) var<storage, read> views: array<PanelView>;
@group(0) @binding(2) var<storage, read> rays: array<Rays>;
@group(0) @binding(8) var<storage, read> placed: array<Placed>;
@group(0) @binding(9) var<storage, read_write> keys: array<atomic<u64>>;

fn way_of(view: u32, pixel: vec2<u32>) -> vec3<f32> {
    let at = vec2<f32>(pixel) + 0.5;
    return rays[view].across.xyz * at.x + rays[view].along.xyz * at.y + rays[view].base.xyz;
}

fn is_on_panel(view: u32, way: vec3<f32>) -> bool {
    for (var k = 0u; k < 8u; k++) {
        if dot(views[view].edges[k].xyz, way) < 0.0 {
            return false;
        }
    }
    return true;
}

fn pixel_of(word: u32) -> vec2<u32> {
    return vec2(word & 0xffffu, word >> 16u);
}

fn covers(splat: Placed, pixel: vec2<u32>) -> bool {
    let way = way_of(splat.view, pixel);
    if splat.is_inside == 0u && !is_on_panel(splat.view, way) {
        return false;
    }
    if ROUND == 0u || all(pixel == pixel_of(splat.middle)) {
        return true;
    }
    let along = dot(way, splat.way);
    return along > 0.0 && along * along >= splat.reach * dot(way, way);
}

@compute @workgroup_size(128)
fn nearest_wide(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.x + id.y * ROW;
    let pair = cloud.first + row;
    if pair >= cloud.end || placed[row].depth == 0u {
        return;
    }
    let splat = placed[row];
    let key = (u64(splat.depth) << 32u) | u64(NONE - pair);
    let first = pixel_of(splat.first);
    let last = pixel_of(splat.last);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            if covers(splat, vec2(x, y)) {
                atomicMax(&keys[y * cloud.stride + x], key);
            }
        }
    }
}
