// after: gpu/panel_view.wgsl
// A splat that is placed on its panel, and the pixels that it covers there.

// 1: round splats, all pixels that see the disc which faces the eye. 0: square ones.
override ROUND: u32 = 1u;

const ROW = 8388480u;
const NONE = 0xffffffffu;

// The way that a pixel of the quilt sees along: across * x + along * y + base, with a depth of 1.
struct Rays {
    across: vec4<f32>,
    along: vec4<f32>,
    base: vec4<f32>,
    // Left, top, right and bottom of the pixels that may be the panel's.
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

// A splat on its panel. Pixels are two of 16 bits in a word, x in the lower.
struct Placed {
    way: vec3<f32>,
    // Of the squared cosine between a pixel's way and this one: see `covers`.
    reach: f32,
    first: u32,
    last: u32,
    middle: u32,
    view: u32,
    // Bits of a depth from 0 to 1, the nearer the larger; 0 where nothing is to be drawn.
    depth: u32,
    // 1 where all of its pixels are the panel's.
    is_inside: u32,
    padding_a: u32,
    padding_b: u32,
}

@group(0) @binding(0) var<uniform> cloud: Cloud;
@group(0) @binding(1) var<storage, read> views: array<PanelView>;
@group(0) @binding(2) var<storage, read> rays: array<Rays>;
@group(0) @binding(8) var<storage, read> placed: array<Placed>;

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

// Whether a pixel shows a splat. A round one is a disc that faces the eye: what is seen within its angle.
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
