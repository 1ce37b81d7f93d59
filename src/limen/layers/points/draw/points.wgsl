// after: gpu/colour.wgsl, splat.wgsl
// Splats of a cloud of points, through the panels of a quilt, in three steps: every pair of an item and a panel is placed;
// what is nearest in each pixel is found; and each pixel is coloured once.
//
// The nearest is found in one of three ways that give the same picture: by 64-bit atomics (points_wide.wgsl), by 32-bit
// atomics in two passes, the nearest depth first and then the first pair that has it, or by quads and the depth test.
// Ids count down from 0xffffffff, so that the first pair of equal depths is the largest; 0 is nothing.

// 0: the picture. 1: every panel in a colour of its own. 2: simplified nodes in a colour of their level.
override OVERLAY: u32 = 0u;
// Words from one pixel's id to the next one's: two where keys are of 64 bits.
override WORDS: u32 = 1u;

const GROUP = 128u;
const TOP = 0x80000000u;
const CHUNK_NODES = 4681u;
const ALL_AROUND = 255u;

struct ChunkRow {
    origin: vec3<f32>,
    step: f32,
    radius: f32,
    padding_a: f32,
    padding_b: f32,
    padding_c: f32,
}

struct Node {
    way: vec3<f32>,
    radius: f32,
    normal: vec3<f32>,
    cone: u32,
    rgb: vec3<f32>,
    level: u32,
}

@group(0) @binding(3) var<storage, read> pairs: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> nodes: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read> tops: array<u32>;
@group(0) @binding(6) var<storage, read> chunks: array<ChunkRow>;
@group(0) @binding(7) var<storage, read_write> placing: array<Placed>;
@group(0) @binding(9) var<storage, read_write> depths: array<atomic<u32>>;
@group(0) @binding(10) var<storage, read_write> firsts: array<atomic<u32>>;
@group(0) @binding(11) var<storage, read> ids: array<u32>;

fn signed(byte: u32) -> f32 {
    return f32(i32(byte << 24u) >> 24u) / 127.0;
}

fn unpacked(code: u32) -> vec3<f32> {
    let x = signed(code & 0xffu);
    let y = signed((code >> 8u) & 0xffu);
    let z = 1.0 - abs(x) - abs(y);
    let under = max(-z, 0.0);
    return normalize(vec3(x - select(-under, under, x >= 0.0), y - select(-under, under, y >= 0.0), z));
}

fn turned(rows: array<vec4<f32>, 3>, vector: vec4<f32>) -> vec3<f32> {
    return vec3(dot(rows[0], vector), dot(rows[1], vector), dot(rows[2], vector));
}

fn level_of(node: u32) -> u32 {
    if node >= 585u { return 0u; }
    if node >= 73u { return 1u; }
    if node >= 9u { return 2u; }
    return select(4u, 3u, node >= 1u);
}

fn node_of(item: u32) -> Node {
    var out: Node;
    var place: vec3<f32>;
    var packed: u32;
    var colour: u32;
    if (item & TOP) != 0u {
        let row = (item ^ TOP) * 6u;
        place = vec3(bitcast<f32>(tops[row]), bitcast<f32>(tops[row + 1u]), bitcast<f32>(tops[row + 2u]));
        out.radius = bitcast<f32>(tops[row + 3u]) * cloud.unit_m;
        packed = tops[row + 4u];
        colour = tops[row + 5u];
        out.level = 5u;
    } else {
        let slot = item / CHUNK_NODES;
        let words = nodes[item];
        let chunk = chunks[slot];
        place = chunk.origin + chunk.step * vec3(f32(words.x & 0xffffu), f32(words.x >> 16u), f32(words.y & 0xffffu));
        let code = (words.y >> 16u) & 0xffu;
        out.radius = select(exp2((f32(code) - 255.0) / 12.0), 0.0, code == 0u) * chunk.radius * cloud.unit_m;
        packed = words.z;
        colour = words.w;
        out.level = level_of(item - slot * CHUNK_NODES);
    }
    out.way = turned(cloud.way_from_cloud, vec4(place, 1.0));
    out.cone = (packed >> 16u) & 0xffu;
    out.normal = turned(cloud.normal_from_cloud, vec4(unpacked(packed), 0.0));
    out.rgb = linear_of(unpack4x8unorm(colour).rgb);
    return out;
}

// ---------------------------------------------------------------------------------------------------- placing

// The pixels between which a sphere is seen along an axis: where (f - t w) . d = r |f - t w| for f = that axis's form.
fn extent(form: vec3<f32>, w: vec3<f32>, way: vec3<f32>, radius: f32) -> vec2<f32> {
    let r2 = radius * radius;
    let wd = dot(w, way);
    let fd = dot(form, way);
    let a = wd * wd - r2 * dot(w, w);
    let b = fd * wd - r2 * dot(form, w);
    let c = fd * fd - r2 * dot(form, form);
    let root = sqrt(max(b * b - a * c, 0.0));
    return vec2(b - root, b + root) / a;
}

@compute @workgroup_size(128)
fn place(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.x + id.y * ROW;
    let pair = cloud.first + row;
    if pair >= cloud.end {
        return;
    }
    let node = node_of(pairs[pair].x);
    let view = pairs[pair].y;
    let x = views[view].x;
    let y = views[view].y;
    let w = views[view].w;
    var out: Placed;
    out.way = node.way;
    out.view = view;
    let away2 = dot(node.way, node.way);
    out.reach = away2 * away2 / (away2 + node.radius * node.radius);
    let deep = dot(w.xyz, node.way);
    let near = x.w;
    if deep >= near {
        let bounds = rays[view].bounds;
        let size = vec2(f32(cloud.width), f32(cloud.height));
        // Clip space to pixels of the quilt.
        let across = (x.xyz + w.xyz) * (size.x * 0.5);
        let along = (w.xyz - y.xyz) * (size.y * 0.5);
        let middle = floor(vec2(dot(across, node.way), dot(along, node.way)) / deep);
        var low = bounds.xy;
        var high = bounds.zw - 1.0;
        if deep > node.radius * 1.001 {
            let wide = extent(across, w.xyz, node.way, node.radius);
            let tall = extent(along, w.xyz, node.way, node.radius);
            // Pixels whose centres lie between, and the one that holds the middle.
            low = max(low, min(ceil(vec2(wide.x, tall.x) - 0.5), middle));
            high = min(high, max(floor(vec2(wide.y, tall.y) - 0.5), middle));
        }
        if all(low <= high) {
            out.first = u32(low.x) | (u32(low.y) << 16u);
            out.last = u32(high.x) | (u32(high.y) << 16u);
            let held = clamp(middle, vec2(0.0), vec2(65534.0));
            out.middle = select(NONE, u32(held.x) | (u32(held.y) << 16u), all(middle == held));
            out.depth = bitcast<u32>(min(near / deep, 1.0));
            let corners = array<vec2<f32>, 4>(low, high, vec2(low.x, high.y), vec2(high.x, low.y));
            out.is_inside = 1u;
            for (var k = 0u; k < 4u; k++) {
                if !is_on_panel(view, way_of(view, vec2<u32>(corners[k]))) {
                    out.is_inside = 0u;
                }
            }
        }
    }
    placing[row] = out;
}

// ---------------------------------------------------------------------------------------------------- 32 bits, two passes

@compute @workgroup_size(128)
fn nearest(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.x + id.y * ROW;
    let pair = cloud.first + row;
    if pair >= cloud.end || placed[row].depth == 0u {
        return;
    }
    let splat = placed[row];
    let first = pixel_of(splat.first);
    let last = pixel_of(splat.last);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            if covers(splat, vec2(x, y)) {
                atomicMax(&depths[y * cloud.stride + x], splat.depth);
            }
        }
    }
}

@compute @workgroup_size(128)
fn first_of_nearest(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.x + id.y * ROW;
    let pair = cloud.first + row;
    if pair >= cloud.end || placed[row].depth == 0u {
        return;
    }
    let splat = placed[row];
    let first = pixel_of(splat.first);
    let last = pixel_of(splat.last);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let pixel = y * cloud.stride + x;
            if atomicLoad(&depths[pixel]) == splat.depth && covers(splat, vec2(x, y)) {
                atomicMax(&firsts[pixel], NONE - pair);
            }
        }
    }
}

// ---------------------------------------------------------------------------------------------------- quads

struct Quad {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) row: u32,
}

struct Found {
    @location(0) id: u32,
    @builtin(frag_depth) depth: f32,
}

@vertex
fn quad(@builtin(vertex_index) corner: u32, @builtin(instance_index) row: u32) -> Quad {
    let splat = placed[row];
    let first = vec2<f32>(pixel_of(splat.first));
    let last = vec2<f32>(pixel_of(splat.last)) + 1.0;
    // Two triangles: corners 0 1 2, 2 1 3.
    let number = select(corner, array<u32, 3>(2u, 1u, 3u)[max(corner, 3u) - 3u], corner > 2u);
    let which = vec2((number & 1u) != 0u, (number & 2u) != 0u);
    let at = select(first, last, which);
    let size = vec2(f32(cloud.width), f32(cloud.height));
    let ndc = vec2(at.x / size.x * 2.0 - 1.0, 1.0 - at.y / size.y * 2.0);
    let shown = splat.depth != 0u;
    return Quad(vec4(select(vec2(2.0), ndc, shown), 0.5, 1.0), row);
}

@fragment
fn found(in: Quad) -> Found {
    let splat = placed[in.row];
    if !covers(splat, vec2<u32>(in.position.xy)) {
        discard;
    }
    return Found(NONE - cloud.first - in.row, bitcast<f32>(splat.depth));
}

// ---------------------------------------------------------------------------------------------------- colouring

@vertex
fn whole(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(corner & 1u) * 4.0 - 1.0, f32(corner >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn id_at(at: vec4<f32>) -> u32 {
    let pixel = vec2<u32>(at.xy);
    return ids[(pixel.y * cloud.stride + pixel.x) * WORDS];
}

@fragment
fn colour(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let id = id_at(at);
    if id == 0u {
        return vec4(cloud.background.rgb, 1.0);
    }
    let pair = pairs[NONE - id];
    return colour_of(node_of(pair.x), pair.y);
}

struct Deep {
    @location(0) colour: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

// The same among other things, which have their own depth.
@fragment
fn colour_deep(@builtin(position) at: vec4<f32>) -> Deep {
    let id = id_at(at);
    if id == 0u {
        discard;
    }
    let pair = pairs[NONE - id];
    let node = node_of(pair.x);
    let deep = dot(views[pair.y].w.xyz, node.way);
    return Deep(colour_of(node, pair.y), min(views[pair.y].x.w / deep, 1.0));
}

fn colour_of(node: Node, view: u32) -> vec4<f32> {
    let toward_eye = -normalize(node.way);
    var light = node.rgb;
    let facing = dot(node.normal, toward_eye);
    if cloud.is_lit != 0u && node.cone != ALL_AROUND {
        // Both sides of a surface are seen. Half of the light from a fixed place, half from the viewer.
        let normal = node.normal * select(-1.0, 1.0, facing >= 0.0);
        let direct = 0.5 * max(dot(normal, cloud.light.xyz), 0.0) + 0.5 * dot(normal, toward_eye);
        light *= mix(direct, 1.0, cloud.light.w);
    }
    if OVERLAY == 1u {
        light = mix(light, hue(view), 0.4);
    }
    if OVERLAY == 2u && node.level > 0u {
        let margin = asin(clamp(node.radius / length(node.way), 0.0, 1.0));
        let rim = node.cone == ALL_AROUND || abs(asin(clamp(facing, -1.0, 1.0))) <= f32(node.cone) * 0.01236848 + margin;
        // Blue where little was simplified to green where much was; on silhouettes from red to yellow.
        let much = f32(node.level) / 5.0;
        let tint = select(mix(vec3(0.05, 0.2, 1.0), vec3(0.1, 1.0, 0.2), much), mix(vec3(1.0, 0.05, 0.05), vec3(1.0, 0.9, 0.1), much), rim);
        light = mix(light, tint, 0.6);
    }
    return vec4(light, 1.0);
}
