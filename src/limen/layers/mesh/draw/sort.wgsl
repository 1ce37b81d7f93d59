// after: gpu/panel_view.wgsl
// Which panels does each triangle touch, as each eye sees them? Every frame, on the GPU.
//
//   locate   every vertex: the way from the eye, and the panel in whose core it lies
//   assign   every triangle: with three corners in one core it is that panel's; the others wait
//   plan     how many wait
//   search   those that wait: every panel of the cells they cover, tested exactly
//   finish   how many pairs there are to draw
//
// A panel is the cone from the eye over its outline and guard band, a triangle the cone over itself; both are convex, so
// they are apart exactly if a side of one of them has the other on its outer side (separating axes, on directions instead
// of places, so that nothing divides and a triangle may pass beside or behind the eye).
// The processor's part, the grid of directions, is limen.layers.mesh.directions.

// Of a panel, `edges[k].w` is where, along the edge, the core begins.

struct Frame {
    vertices: u32,
    triangles: u32,
    panels: u32,
    pair_capacity: u32,
    // Per eye: picture planes, cells along a side, where in `grid` its cells and its panels' rectangles begin, in fours.
    grids: array<vec4<u32>, 2>,
    // Per eye: where in `grid` the entries begin, in fours.
    entries: vec4<u32>,
    // Per eye, three rows: the way from the eye to a vertex, from the mesh's coordinates.
    eye_from_mesh: array<vec4<f32>, 6>,
    // Per eye and picture plane, three rows: from directions to cells.
    planes: array<vec4<f32>, 36>,
}

struct Counters {
    pairs: atomic<u32>,
    waiting: atomic<u32>,
}

const NOWHERE = -1.0;
// Of a cell; extents are compared in single precision.
const SLACK = 1e-3;

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> views: array<PanelView>;
@group(0) @binding(2) var<storage, read> positions: array<f32>;
@group(0) @binding(3) var<storage, read> triangles: array<u32>;
// The way from the eye, and the number of the panel (in single precision, exact below 2^24) or NOWHERE.
@group(0) @binding(4) var<storage, read_write> ways: array<vec4<f32>>;
// Per eye: four numbers for every cell (first entry, first that is no core, end); four for every plane and panel (its
// extent, in cells, as bits of x0, y0, x1, y1); entries.
@group(0) @binding(5) var<storage, read> grid: array<u32>;
@group(0) @binding(6) var<storage, read_write> waiting: array<u32>;
@group(0) @binding(7) var<storage, read_write> pairs: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read_write> counters: Counters;
// Workgroups of `search`; then vertices, instances and firsts of the draw.
@group(0) @binding(9) var<storage, read_write> arguments: array<u32>;

fn in_cells(eye: u32, plane: u32, way: vec3<f32>) -> vec3<f32> {
    let row = (eye * 6u + plane) * 3u;
    return vec3(
        dot(frame.planes[row].xyz, way), dot(frame.planes[row + 1u].xyz, way), dot(frame.planes[row + 2u].xyz, way)
    );
}

// First entry, first that is no core, and end.
fn entries_of(first_cell: u32, cell: u32) -> vec3<u32> {
    let row = (first_cell + cell) * 4u;
    return vec3(grid[row], grid[row + 1u], grid[row + 2u]);
}

fn in_core(view: u32, way: vec3<f32>) -> bool {
    let w = dot(views[view].w.xyz, way);
    if w <= 0.0 {
        return false;
    }
    for (var k = 0u; k < views[view].corner_count; k++) {
        let edge = views[view].edges[k];
        if dot(edge.xyz, way) < edge.w * w {
            return false;
        }
    }
    return true;
}

fn core_around(eye: u32, way: vec3<f32>) -> f32 {
    let planes = frame.grids[eye].x;
    let cells = frame.grids[eye].y;
    for (var plane = 0u; plane < planes; plane++) {
        let place = in_cells(eye, plane, way);
        if place.z <= 0.0 || any(place.xy < vec2(0.0)) || any(place.xy >= vec2(place.z * f32(cells))) {
            continue;
        }
        let cell = min(vec2<u32>(place.xy / place.z), vec2(cells - 1u));
        let listed = entries_of(frame.grids[eye].z, (plane * cells + cell.y) * cells + cell.x);
        let entries = frame.entries[eye] * 4u;
        for (var entry = listed.x; entry < listed.y; entry++) {
            let panel = grid[entries + entry];
            if in_core(eye * frame.panels + panel, way) {
                return f32(panel);
            }
        }
        return NOWHERE;
    }
    return NOWHERE;
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
    ways[id.y * frame.vertices + id.x] = vec4(way, core_around(id.y, way));
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

@compute @workgroup_size(1)
fn plan() {
    arguments[0] = (atomicLoad(&counters.waiting) + 63u) / 64u;
    arguments[1] = 1u;
    arguments[2] = 1u;
}

// Counts on where there is no more room, so that the processor knows how much is needed.
fn emit(triangle: u32, view: u32) {
    let place = atomicAdd(&counters.pairs, 1u);
    if place < frame.pair_capacity {
        pairs[place] = vec2(triangle, view);
    }
}

// Extent (x0, y0, x1, y1) of a triangle on a picture plane, in cells; what is behind the plane's horizon is cut off.
fn extent_of(eye: u32, plane: u32, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) -> vec4<f32> {
    let horizon = (length(a) + length(b) + length(c)) * 1e-6;
    let here = in_cells(eye, plane, a);
    let there = in_cells(eye, plane, b);
    let last = in_cells(eye, plane, c);
    let extent = joined(joined(extent_from(here, there, horizon), extent_from(there, last, horizon)),
        extent_from(last, here, horizon));
    return extent + vec4(-SLACK, -SLACK, SLACK, SLACK);
}

// Extent of a place, and of where the line to the next one meets the horizon.
fn extent_from(here: vec3<f32>, there: vec3<f32>, horizon: f32) -> vec4<f32> {
    var extent = vec4(1e30, 1e30, -1e30, -1e30);
    if here.z > horizon {
        extent = (here.xy / here.z).xyxy;
    }
    if (here.z > horizon) != (there.z > horizon) {
        let cut = mix(here.xy, there.xy, (horizon - here.z) / (there.z - here.z)) / horizon;
        extent = joined(extent, cut.xyxy);
    }
    return extent;
}

fn joined(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4(min(a.xy, b.xy), max(a.zw, b.zw));
}

fn panel_extent(first_extent: u32, plane: u32, panel: u32) -> vec4<f32> {
    let row = (first_extent + plane * frame.panels + panel) * 4u;
    return bitcast<vec4<f32>>(vec4(grid[row], grid[row + 1u], grid[row + 2u], grid[row + 3u]));
}

fn overlap(a: vec4<f32>, b: vec4<f32>) -> bool {
    return all(max(a.xy, b.xy) <= min(a.zw, b.zw));
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
    var extents: array<vec4<f32>, 6>;
    // Read once: what differs between eyes is dear to look up in the loops.
    let all_of_eye = frame.grids[eye];
    let cells = all_of_eye.y;
    let first_cell = all_of_eye.z;
    let first_extent = all_of_eye.w;
    let entries = frame.entries[eye] * 4u;
    let last = f32(cells) - 1.0;
    for (var plane = 0u; plane < all_of_eye.x; plane++) {
        let extent = extent_of(eye, plane, a, b, c);
        extents[plane] = extent;
        if !overlap(extent, vec4(0.0, 0.0, last + 1.0, last + 1.0)) {
            continue;
        }
        let from_cell = vec2<u32>(clamp(extent.xy, vec2(0.0), vec2(last)));
        let to_cell = vec2<u32>(clamp(extent.zw, vec2(0.0), vec2(last)));
        let span = to_cell - from_cell + 1u;
        // Going through all panels once is cheaper than through a great many cells.
        let all_panels = span.x * span.y * 2u > frame.panels;
        if all_panels {
            for (var panel = 0u; panel < frame.panels; panel++) {
                var near = overlap(extent, panel_extent(first_extent, plane, panel))
                    && is_new(first_extent, cells, plane, panel, &extents);
                // A loop instead of a condition: software adapters go through what a condition skips.
                while near {
                    emit_touched(triangle, eye * frame.panels + panel, a, b, c);
                    near = false;
                }
            }
            continue;
        }
        for (var y = from_cell.y; y <= to_cell.y; y++) {
            for (var x = from_cell.x; x <= to_cell.x; x++) {
                let listed = entries_of(first_cell, (plane * cells + y) * cells + x);
                for (var entry = listed.x; entry < listed.z; entry++) {
                    let panel = grid[entries + entry];
                    let theirs = panel_extent(first_extent, plane, panel);
                    // They may share many cells: the first speaks for all.
                    let shared_cell = max(from_cell, vec2<u32>(max(theirs.xy, vec2(0.0))));
                    var near = overlap(extent, theirs) && x == shared_cell.x && y == shared_cell.y
                        && is_new(first_extent, cells, plane, panel, &extents);
                    while near {
                        emit_touched(triangle, eye * frame.panels + panel, a, b, c);
                        near = false;
                    }
                }
            }
        }
    }
}

fn emit_touched(triangle: u32, view: u32, a: vec3<f32>, b: vec3<f32>, c: vec3<f32>) {
    if touches(view, a, b, c) {
        emit(triangle, view);
    }
}

// Not met already on an earlier picture plane.
fn is_new(
    first_extent: u32, cells: u32, plane: u32, panel: u32, extents: ptr<function, array<vec4<f32>, 6>>
) -> bool {
    for (var before = 0u; before < plane; before++) {
        let seen = vec4(max((*extents)[before].xy, vec2(0.0)), min((*extents)[before].zw, vec2(f32(cells))));
        if overlap(seen, panel_extent(first_extent, before, panel)) {
            return false;
        }
    }
    return true;
}

@compute @workgroup_size(1)
fn finish() {
    arguments[4] = min(atomicLoad(&counters.pairs), frame.pair_capacity) * 3u;
    arguments[5] = 1u;
    arguments[6] = 0u;
    arguments[7] = 0u;
}
