// after: gpu/panel_view.wgsl
// Which panels may each triangle touch? By an octree over the triangles, built anew every frame, and every leaf culled to
// every panel's frustum: the comparison of Harish, Narayanan 2013, section 4.2. Depth 3; the leaves alone are kept.
//
//   transform  every vertex: the way from the eye; and the bounds of all
//   count      every triangle: the leaves that it enters
//   scan       where the triangles of each leaf begin
//   fill       the triangles of each leaf
//   cull       every leaf and panel: whether they meet
//   plan       how many do
//   expand     the triangles of every leaf that meets a panel, for this panel
//   finish     how many pairs there are to draw

struct Frame {
    vertices: u32,
    triangles: u32,
    panels: u32,
    pair_capacity: u32,
    eyes: u32,
    member_capacity: u32,
    padding_a: u32,
    padding_b: u32,
    // Per eye, three rows: the way from the eye to a vertex, from the mesh's coordinates.
    eye_from_mesh: array<vec4<f32>, 6>,
}

struct Counters {
    pairs: atomic<u32>,
    members: atomic<u32>,
    hits: atomic<u32>,
}

// Of a scene, in the mesh's coordinates: as numbers that are ordered as those they stand for.
struct Bounds {
    low: array<atomic<u32>, 3>,
    high: array<atomic<u32>, 3>,
}

const LEAVES = 8u;
const ALL_LEAVES = 512u;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> views: array<PanelView>;
@group(0) @binding(2) var<storage, read> positions: array<f32>;
@group(0) @binding(3) var<storage, read> triangles: array<u32>;
@group(0) @binding(4) var<storage, read_write> ways: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> bounds: Bounds;
// Per leaf: how many triangles; after `scan`, where its next one goes, hence after `fill` where they end.
@group(0) @binding(6) var<storage, read_write> tally: array<atomic<u32>>;
// Per leaf: first triangle and how many.
@group(0) @binding(7) var<storage, read_write> leaves: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read_write> members: array<u32>;
// A leaf, a view, and where their pairs begin.
@group(0) @binding(9) var<storage, read_write> hits: array<vec4<u32>>;
@group(0) @binding(10) var<storage, read_write> pairs: array<vec2<u32>>;
@group(0) @binding(11) var<storage, read_write> counters: Counters;
// Workgroups of `expand`; then vertices, instances and firsts of the draw.
@group(0) @binding(12) var<storage, read_write> arguments: array<u32>;

// Numbers that order as the floats do, all above 0.
fn ordered(value: f32) -> u32 {
    let bits = bitcast<u32>(value);
    return select(bits | 0x80000000u, ~bits, (bits & 0x80000000u) != 0u);
}

fn unordered(bits: u32) -> f32 {
    return bitcast<f32>(select(~bits, bits & 0x7fffffffu, (bits & 0x80000000u) != 0u));
}

fn position_of(vertex: u32) -> vec3<f32> {
    return vec3(positions[vertex * 3u], positions[vertex * 3u + 1u], positions[vertex * 3u + 2u]);
}

fn way_of(eye: u32, place: vec4<f32>) -> vec3<f32> {
    let row = eye * 3u;
    return vec3(
        dot(frame.eye_from_mesh[row], place),
        dot(frame.eye_from_mesh[row + 1u], place),
        dot(frame.eye_from_mesh[row + 2u], place),
    );
}

// A workgroup joins its bounds before all workgroups do. Both ends grow from 0: the low one as its complement.
var<workgroup> group_low: array<atomic<u32>, 3>;
var<workgroup> group_high: array<atomic<u32>, 3>;

@compute @workgroup_size(128)
fn transform(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    // Not every driver's workgroup memory begins as zeros.
    if lane < 3u {
        atomicStore(&group_low[lane], 0u);
        atomicStore(&group_high[lane], 0u);
    }
    workgroupBarrier();
    if id.x < frame.vertices {
        let place = position_of(id.x);
        ways[id.y * frame.vertices + id.x] = vec4(way_of(id.y, vec4(place, 1.0)), -1.0);
        for (var axis = 0u; axis < 3u; axis++) {
            atomicMax(&group_low[axis], ~ordered(place[axis]));
            atomicMax(&group_high[axis], ordered(place[axis]));
        }
    }
    workgroupBarrier();
    if lane < 3u {
        atomicMax(&bounds.low[lane], atomicLoad(&group_low[lane]));
        atomicMax(&bounds.high[lane], atomicLoad(&group_high[lane]));
    }
}

struct Box {
    low: vec3<f32>,
    // Of one leaf.
    size: vec3<f32>,
}

fn root() -> Box {
    var low: vec3<f32>;
    var high: vec3<f32>;
    for (var axis = 0u; axis < 3u; axis++) {
        low[axis] = unordered(~atomicLoad(&bounds.low[axis]));
        high[axis] = unordered(atomicLoad(&bounds.high[axis]));
    }
    let margin = vec3(max(max(high.x - low.x, high.y - low.y), high.z - low.z) * 1e-5 + 1e-20);
    return Box(low - margin, (high - low + 2.0 * margin) / f32(LEAVES));
}

// Corners in leaves.
struct Triangle {
    a: vec3<f32>,
    b: vec3<f32>,
    c: vec3<f32>,
    from_leaf: vec3<u32>,
    to_leaf: vec3<u32>,
}

fn triangle_of(number: u32) -> Triangle {
    let box = root();
    let a = (position_of(triangles[number * 3u]) - box.low) / box.size;
    let b = (position_of(triangles[number * 3u + 1u]) - box.low) / box.size;
    let c = (position_of(triangles[number * 3u + 2u]) - box.low) / box.size;
    let most = vec3(f32(LEAVES) - 1.0);
    return Triangle(
        a, b, c,
        vec3<u32>(clamp(floor(min(min(a, b), c)), vec3(0.0), most)),
        vec3<u32>(clamp(floor(max(max(a, b), c)), vec3(0.0), most)),
    );
}

fn parts(axis: vec3<f32>, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> bool {
    let along = vec3(dot(axis, a), dot(axis, b), dot(axis, c));
    let reach = dot(abs(axis), vec3(0.5)) * 1.0001;
    return min(min(along.x, along.y), along.z) > reach || max(max(along.x, along.y), along.z) < -reach;
}

// Akenine-Möller 2001; the box's own axes are left out, since `leaf` is among those that the triangle's extent covers.
fn enters(triangle: Triangle, leaf: vec3<u32>) -> bool {
    if all(triangle.from_leaf == triangle.to_leaf) {
        return true;
    }
    let middle = vec3<f32>(leaf) + 0.5;
    let a = triangle.a - middle;
    let b = triangle.b - middle;
    let c = triangle.c - middle;
    if parts(cross(b - a, c - a), a, b, c) {
        return false;
    }
    var sides = array<vec3<f32>, 3>(b - a, c - b, a - c);
    for (var k = 0u; k < 3u; k++) {
        let side = sides[k];
        if parts(vec3(0.0, -side.z, side.y), a, b, c) || parts(vec3(side.z, 0.0, -side.x), a, b, c)
            || parts(vec3(-side.y, side.x, 0.0), a, b, c) {
            return false;
        }
    }
    return true;
}

@compute @workgroup_size(128)
fn count(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.triangles {
        return;
    }
    let triangle = triangle_of(id.x);
    for (var z = triangle.from_leaf.z; z <= triangle.to_leaf.z; z++) {
        for (var y = triangle.from_leaf.y; y <= triangle.to_leaf.y; y++) {
            for (var x = triangle.from_leaf.x; x <= triangle.to_leaf.x; x++) {
                if enters(triangle, vec3(x, y, z)) {
                    atomicAdd(&tally[(z * LEAVES + y) * LEAVES + x], 1u);
                }
            }
        }
    }
}

var<workgroup> sums: array<u32, 256>;

@compute @workgroup_size(256)
fn scan(@builtin(local_invocation_index) lane: u32) {
    let first = atomicLoad(&tally[lane * 2u]);
    let sum = first + atomicLoad(&tally[lane * 2u + 1u]);
    sums[lane] = sum;
    workgroupBarrier();
    for (var reach = 1u; reach < 256u; reach *= 2u) {
        var before = 0u;
        if lane >= reach {
            before = sums[lane - reach];
        }
        workgroupBarrier();
        sums[lane] += before;
        workgroupBarrier();
    }
    let begin = sums[lane] - sum;
    leaves[lane * 2u] = vec2(begin, first);
    leaves[lane * 2u + 1u] = vec2(begin + first, sum - first);
    atomicStore(&tally[lane * 2u], begin);
    atomicStore(&tally[lane * 2u + 1u], begin + first);
    if lane == 255u {
        atomicStore(&counters.members, sums[255]);
    }
}

@compute @workgroup_size(128)
fn fill(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.triangles {
        return;
    }
    let triangle = triangle_of(id.x);
    for (var z = triangle.from_leaf.z; z <= triangle.to_leaf.z; z++) {
        for (var y = triangle.from_leaf.y; y <= triangle.to_leaf.y; y++) {
            for (var x = triangle.from_leaf.x; x <= triangle.to_leaf.x; x++) {
                if enters(triangle, vec3(x, y, z)) {
                    let place = atomicAdd(&tally[(z * LEAVES + y) * LEAVES + x], 1u);
                    if place < frame.member_capacity {
                        members[place] = id.x;
                    }
                }
            }
        }
    }
}

// Whether a box, given by its middle and half its sides as ways, has a part within a panel's frustum (conservative).
fn meets(view: u32, middle: vec3<f32>, x: vec3<f32>, y: vec3<f32>, z: vec3<f32>) -> bool {
    if beyond(views[view].w.xyz, middle, x, y, z) {
        return false;
    }
    for (var k = 0u; k < views[view].corner_count; k++) {
        if beyond(views[view].edges[k].xyz, middle, x, y, z) {
            return false;
        }
    }
    return true;
}

fn beyond(plane: vec3<f32>, middle: vec3<f32>, x: vec3<f32>, y: vec3<f32>, z: vec3<f32>) -> bool {
    return dot(plane, middle) + abs(dot(plane, x)) + abs(dot(plane, y)) + abs(dot(plane, z)) <= 0.0;
}

@compute @workgroup_size(128)
fn cull(@builtin(global_invocation_id) id: vec3<u32>) {
    let listed = leaves[id.x];
    let eye = views[id.y].eye;
    // What is nearest has no distance where a panel turns its back.
    if listed.y == 0u || views[id.y].x.w <= 0.0 {
        return;
    }
    let box = root();
    let leaf = vec3(id.x % LEAVES, id.x / LEAVES % LEAVES, id.x / (LEAVES * LEAVES));
    let middle = way_of(eye, vec4(box.low + (vec3<f32>(leaf) + 0.5) * box.size, 1.0));
    let x = way_of(eye, vec4(box.size.x * 0.5, 0.0, 0.0, 0.0));
    let y = way_of(eye, vec4(0.0, box.size.y * 0.5, 0.0, 0.0));
    let z = way_of(eye, vec4(0.0, 0.0, box.size.z * 0.5, 0.0));
    if meets(id.y, middle, x, y, z) {
        let first = atomicAdd(&counters.pairs, listed.y);
        hits[atomicAdd(&counters.hits, 1u)] = vec4(id.x, id.y, first, 0u);
    }
}

@compute @workgroup_size(1)
fn plan() {
    arguments[0] = min(atomicLoad(&counters.hits), 65535u);
    arguments[1] = 1u;
    arguments[2] = 1u;
}

@compute @workgroup_size(64)
fn expand(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let all_hits = atomicLoad(&counters.hits);
    for (var number = group.x; number < all_hits; number += groups.x) {
        let hit = hits[number];
        let listed = leaves[hit.x];
        for (var i = lane; i < listed.y; i += 64u) {
            if hit.z + i < frame.pair_capacity {
                pairs[hit.z + i] = vec2(members[listed.x + i], hit.y);
            }
        }
    }
}

@compute @workgroup_size(1)
fn finish() {
    arguments[4] = min(atomicLoad(&counters.pairs), frame.pair_capacity) * 3u;
    arguments[5] = 1u;
    arguments[6] = 0u;
    arguments[7] = 0u;
}
