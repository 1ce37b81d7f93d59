// after: gpu/panel_view.wgsl
// Which panels does each triangle touch? In the two passes of Harish, Narayanan 2013, section 3.2, for comparison.
//
//   locate   every vertex: the nearest panel on the ray from the eye, through the leaves of an octree
//   assign   every triangle: with three corners on one panel it is that panel's; the others wait       (first pass)
//   project  every panel: its rectangle on the viewer camera's picture plane
//   plan     how many wait
//   search   those that wait: every panel, by rectangles first, then exactly                          (second pass)
//   scan     where the pairs of each panel begin
//   copy     the pairs in the order of their panels, and their vertices, warped to their panels       (split, homography)
//
// The overlap of triangle and panel is tested on directions, as in sort.wgsl: the same test as on the picture plane, which
// also holds beside and behind the eye.

// Of a panel, `edges[k].w` is the guard, in pixels; `corners[0].w` the eye's height above it, or 0 if it is not in front.

struct Frame {
    vertices: u32,
    triangles: u32,
    panels: u32,
    pair_capacity: u32,
    eyes: u32,
    padding_a: u32,
    padding_b: u32,
    padding_c: u32,
    // Leaves in a metre along each axis.
    leaves_per_m: vec4<f32>,
    // Per eye: where it stands among the leaves.
    eye_leaves: array<vec4<f32>, 2>,
    // Per eye, three rows: the way from the eye to a vertex, from the mesh's coordinates.
    eye_from_mesh: array<vec4<f32>, 6>,
    // Per eye, three rows: right, up and forward of the viewer's camera.
    camera: array<vec4<f32>, 6>,
}

struct Counters {
    pairs: atomic<u32>,
    waiting: atomic<u32>,
}

struct Warped {
    position: vec4<f32>,
    way: vec3<f32>,
    number: u32,
}

const NOWHERE = -1.0;
const FAR = 1e30;
const LEAVES = 8;
// Panels that one invocation of `search` tests.
const CHUNK = 256u;
// Of the picture plane, whose unit is the distance to it; rectangles are compared in single precision.
const SLACK = 1e-5;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read_write> views: array<PanelView>;
@group(0) @binding(2) var<storage, read> positions: array<f32>;
@group(0) @binding(3) var<storage, read> triangles: array<u32>;
// The way from the eye, and the number of the panel (in single precision, exact below 2^24) or NOWHERE.
@group(0) @binding(4) var<storage, read_write> ways: array<vec4<f32>>;
// First and end of every leaf's entries; then those, two a row.
@group(0) @binding(5) var<storage, read> leaves: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> waiting: array<u32>;
@group(0) @binding(7) var<storage, read_write> found: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read_write> counters: Counters;
// Workgroups of `search`; vertices, instances and firsts of the draw; workgroups of `copy`.
@group(0) @binding(9) var<storage, read_write> arguments: array<u32>;
// Per view: x0 y0 x1 y1 on the picture plane.
@group(0) @binding(10) var<storage, read_write> extents: array<vec4<f32>>;
// Per view: how many pairs; after `scan`, where the next one goes.
@group(0) @binding(11) var<storage, read_write> tally: array<atomic<u32>>;
@group(0) @binding(12) var<storage, read_write> pairs: array<vec2<u32>>;
@group(0) @binding(13) var<storage, read_write> warped: array<Warped>;

fn entry_of(entry: u32) -> u32 {
    return leaves[u32(LEAVES * LEAVES * LEAVES) + entry / 2u][entry % 2u];
}

// On its outline, without the guard.
fn on_panel(view: u32, way: vec3<f32>, w: f32) -> bool {
    for (var k = 0u; k < views[view].corner_count; k++) {
        let edge = views[view].edges[k];
        if dot(edge.xyz, way) < edge.w * w {
            return false;
        }
    }
    return true;
}

// The nearest panel on a ray from the eye: leaf by leaf along it (Amanatides, Woo 1987), until nothing nearer can come.
fn nearest_panel(eye: u32, way: vec3<f32>) -> f32 {
    let origin = frame.eye_leaves[eye].xyz;
    let step = way * frame.leaves_per_m.xyz;
    let still = step == vec3(0.0);
    let inverse = 1.0 / select(step, vec3(1.0), still);
    let low = select((vec3(0.0) - origin) * inverse, select(vec3(FAR), vec3(-FAR), origin >= vec3(0.0)), still);
    let high = select((vec3(f32(LEAVES)) - origin) * inverse, select(vec3(-FAR), vec3(FAR), origin <= vec3(f32(LEAVES))), still);
    let enters = min(low, high);
    let leaves_at = max(low, high);
    let begin = max(max(enters.x, enters.y), max(enters.z, 0.0));
    let end = min(min(leaves_at.x, leaves_at.y), leaves_at.z);
    if begin > end {
        return NOWHERE;
    }
    let turn = vec3<i32>(sign(step));
    var leaf = clamp(vec3<i32>(floor(origin + step * begin)), vec3(0), vec3(LEAVES - 1));
    var nearest = NOWHERE;
    var distance = FAR;
    loop {
        let listed = leaves[(leaf.z * LEAVES + leaf.y) * LEAVES + leaf.x];
        for (var entry = listed.x; entry < listed.y; entry++) {
            let view = eye * frame.panels + entry_of(entry);
            let w = dot(views[view].w.xyz, way);
            let height = views[view].corners[0].w;
            // Of the ray's length to the vertex; panels that turn their back are not in the way.
            if w > 0.0 && height > 0.0 && height < distance * w && on_panel(view, way, w) {
                distance = height / w;
                nearest = f32(view - eye * frame.panels);
            }
        }
        let sides = select((vec3<f32>(leaf + max(turn, vec3(0))) - origin) * inverse, vec3(FAR), still);
        let next = min(min(sides.x, sides.y), sides.z);
        if distance <= next || next >= end {
            break;
        }
        if sides.x == next {
            leaf.x += turn.x;
        } else if sides.y == next {
            leaf.y += turn.y;
        } else {
            leaf.z += turn.z;
        }
        if any(leaf < vec3(0)) || any(leaf >= vec3(LEAVES)) {
            break;
        }
    }
    return nearest;
}

@compute @workgroup_size(128)
fn locate(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.vertices {
        return;
    }
    let place = vec4(positions[id.x * 3u], positions[id.x * 3u + 1u], positions[id.x * 3u + 2u], 1.0);
    let row = id.y * 3u;
    let way = vec3(
        dot(frame.eye_from_mesh[row], place),
        dot(frame.eye_from_mesh[row + 1u], place),
        dot(frame.eye_from_mesh[row + 2u], place),
    );
    ways[id.y * frame.vertices + id.x] = vec4(way, nearest_panel(id.y, way));
}

@compute @workgroup_size(128)
fn assign(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.triangles {
        return;
    }
    let first = id.y * frame.vertices;
    let a = ways[first + triangles[id.x * 3u]].w;
    let b = ways[first + triangles[id.x * 3u + 1u]].w;
    let c = ways[first + triangles[id.x * 3u + 2u]].w;
    if a >= 0.0 && a == b && b == c {
        emit(id.x, id.y * frame.panels + u32(a));
    } else {
        waiting[atomicAdd(&counters.waiting, 1u)] = id.y * frame.triangles + id.x;
    }
}

// Counts on where there is no more room, so that the processor knows how much is needed.
fn emit(triangle: u32, view: u32) {
    let place = atomicAdd(&counters.pairs, 1u);
    if place < frame.pair_capacity {
        found[place] = vec2(triangle, view);
        atomicAdd(&tally[view], 1u);
    }
}

fn on_picture(eye: u32, way: vec3<f32>) -> vec3<f32> {
    let row = eye * 3u;
    return vec3(
        dot(frame.camera[row].xyz, way), dot(frame.camera[row + 1u].xyz, way), dot(frame.camera[row + 2u].xyz, way)
    );
}

@compute @workgroup_size(128)
fn project(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= frame.panels * frame.eyes {
        return;
    }
    var extent = vec4(FAR, FAR, -FAR, -FAR);
    if views[id.x].corners[0].w > 0.0 {
        for (var k = 0u; k < views[id.x].corner_count; k++) {
            let place = on_picture(views[id.x].eye, views[id.x].corners[k].xyz);
            // A panel that reaches behind the camera has no rectangle on its picture.
            if place.z <= 1e-3 {
                extent = vec4(-FAR, -FAR, FAR, FAR);
                break;
            }
            let at = place.xy / place.z;
            extent = vec4(min(extent.xy, at - SLACK * (1.0 + abs(at))), max(extent.zw, at + SLACK * (1.0 + abs(at))));
        }
    }
    extents[id.x] = extent;
}

@compute @workgroup_size(1)
fn plan() {
    arguments[0] = (atomicLoad(&counters.waiting) + 63u) / 64u;
    arguments[1] = (frame.panels + CHUNK - 1u) / CHUNK;
    arguments[2] = 1u;
}

fn extent_of(eye: u32, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> vec4<f32> {
    let p = on_picture(eye, a);
    let q = on_picture(eye, b);
    let r = on_picture(eye, c);
    if min(min(p.z, q.z), r.z) <= 1e-3 * max(max(length(a), length(b)), length(c)) {
        return vec4(-FAR, -FAR, FAR, FAR);
    }
    let u = p.xy / p.z;
    let v = q.xy / q.z;
    let t = r.xy / r.z;
    let low = min(min(u, v), t);
    let high = max(max(u, v), t);
    return vec4(low - SLACK * (1.0 + abs(low)), high + SLACK * (1.0 + abs(high)));
}

fn overlap(a: vec4<f32>, b: vec4<f32>) -> bool {
    return all(max(a.xy, b.xy) <= min(a.zw, b.zw));
}

@compute @workgroup_size(64)
fn search(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= atomicLoad(&counters.waiting) {
        return;
    }
    let eye = waiting[id.x] / frame.triangles;
    let triangle = waiting[id.x] % frame.triangles;
    let first = eye * frame.vertices;
    let a = ways[first + triangles[triangle * 3u]].xyz;
    let b = ways[first + triangles[triangle * 3u + 1u]].xyz;
    let c = ways[first + triangles[triangle * 3u + 2u]].xyz;
    let extent = extent_of(eye, a, b, c);
    let base = eye * frame.panels;
    let end = min((id.y + 1u) * CHUNK, frame.panels);
    for (var four = id.y * CHUNK; four < end; four += 4u) {
        // Four rectangles at a time: most often none of them overlaps.
        var near = vec4(
            overlap(extent, extents[base + four]), overlap(extent, extents[base + four + 1u]),
            overlap(extent, extents[base + four + 2u]), overlap(extent, extents[base + four + 3u])
        );
        // A loop instead of a condition: software adapters go through what a condition skips, with all lanes off.
        var panel = four;
        while any(near) {
            if near.x && panel < end && touches(base + panel, a, b, c) {
                emit(triangle, base + panel);
            }
            near = vec4(near.yzw, false);
            panel++;
        }
    }
}

fn touches(view: u32, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> bool {
    let toward = views[view].w.xyz;
    let w = vec3(dot(toward, a), dot(toward, b), dot(toward, c));
    let before = w > vec3(0.0);
    if !any(before) {
        return false;
    }
    let through = !all(before);
    let corner_count = views[view].corner_count;
    var within = before;
    for (var k = 0u; k < corner_count; k++) {
        let edge = views[view].edges[k].xyz;
        let distance = vec3(dot(edge, a), dot(edge, b), dot(edge, c));
        let inside = distance > vec3(0.0);
        if !any(inside) {
            return false;
        }
        if through && !any(inside & before) && !horizon_inside(w, distance) {
            return false;
        }
        within &= inside;
    }
    // Most are decided by now. A loop instead of a condition: software adapters go through what a condition skips.
    var apart = false;
    var undecided = !any(within); // a corner of the triangle lies on the panel
    while undecided {
        apart = has_side_between(view, corner_count, a, b, c);
        undecided = false;
    }
    return !apart;
}

// Whether the panel lies wholly beyond one side of a triangle.
fn has_side_between(view: u32, corner_count: u32, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> bool {
    let ab = inner_side(a, b, c);
    let bc = inner_side(b, c, a);
    let ca = inner_side(c, a, b);
    var beyond = vec3(true);
    for (var k = 0u; k < corner_count && any(beyond); k++) {
        let corner = views[view].corners[k].xyz;
        beyond &= vec3(dot(ab.xyz, corner) < ab.w, dot(bc.xyz, corner) < bc.w, dot(ca.xyz, corner) < ca.w);
    }
    return any(beyond);
}

// The plane through the eye and the side from `a` to `b`, positive on the triangle; below w a direction is beyond it. All
// zeros for a triangle that is seen edge-on: it has no inner side.
fn inner_side(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> vec4<f32> {
    let side = cross(a, b - a);
    let slack = length(side) * 1e-6;
    let opposite = dot(side, c);
    return select(vec4(side * sign(opposite), -slack), vec4(0.0), abs(opposite) <= slack * length(c));
}

// Whether a triangle that goes through the plane of the eye parallel to the panel leaves it on an edge's inner side.
fn horizon_inside(w: vec3<f32>, distance: vec3<f32>) -> bool {
    return leaves_inside(w.xy, distance.xy) || leaves_inside(w.yx, distance.yx) || leaves_inside(w.yz, distance.yz)
        || leaves_inside(w.zy, distance.zy) || leaves_inside(w.zx, distance.zx) || leaves_inside(w.xz, distance.xz);
}

fn leaves_inside(w: vec2<f32>, distance: vec2<f32>) -> bool {
    return w.x > 0.0 && w.y <= 0.0 && w.x * distance.y - w.y * distance.x > 0.0;
}

var<workgroup> sums: array<u32, 256>;

// Exclusive prefix sum over the views, in one workgroup: every invocation sums a stretch, the stretches are summed.
@compute @workgroup_size(256)
fn scan(@builtin(local_invocation_index) lane: u32) {
    let views_in_all = frame.panels * frame.eyes;
    let stretch = (views_in_all + 255u) / 256u;
    let begin = min(lane * stretch, views_in_all);
    let end = min(begin + stretch, views_in_all);
    var sum = 0u;
    for (var view = begin; view < end; view++) {
        sum += atomicLoad(&tally[view]);
    }
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
    var next = sums[lane] - sum;
    for (var view = begin; view < end; view++) {
        let count = atomicLoad(&tally[view]);
        atomicStore(&tally[view], next);
        next += count;
    }
    if lane == 0u {
        let drawn = min(atomicLoad(&counters.pairs), frame.pair_capacity);
        arguments[4] = drawn * 3u;
        arguments[5] = 1u;
        arguments[6] = 0u;
        arguments[7] = 0u;
        arguments[8] = min((drawn + 127u) / 128u, 65535u);
        arguments[9] = 1u;
        arguments[10] = 1u;
    }
}

@compute @workgroup_size(128)
fn copy(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let drawn = min(atomicLoad(&counters.pairs), frame.pair_capacity);
    for (var i = id.x; i < drawn; i += groups.x * 128u) {
        let pair = found[i];
        let place = atomicAdd(&tally[pair.y], 1u);
        pairs[place] = pair;
        let first = views[pair.y].eye * frame.vertices;
        let x = views[pair.y].x;
        let y = views[pair.y].y.xyz;
        let w = views[pair.y].w.xyz;
        for (var k = 0u; k < 3u; k++) {
            let number = triangles[pair.x * 3u + k];
            let way = ways[first + number].xyz;
            warped[place * 3u + k] = Warped(vec4(dot(x.xyz, way), dot(y, way), x.w, dot(w, way)), way, number);
        }
    }
}
