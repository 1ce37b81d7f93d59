// after: image.wgsl
// Cuts what is looked at through lenses into triangles, between whose corners
// places of the image are interpolated, and draws them.
//
//   lens_wishes     one workgroup a cell: into how many parts it wants its sides to be cut
//   lens_counts     one invocation a cell: counts the triangles
//   lens_triangles  one workgroup a cell: makes them
//   lens_vertex, lens_fragment
//
// Cells share their sides: each side is cut into as many parts as the more demanding of its two cells wants, so there are
// no cracks. Sides are numbered left, above, right, below.

// 0: not cut. 1: all into SEGMENTS. 2: as in Papadopoulos, Kaufman 2013. The fourth way is lens_split.wgsl's.
override MODE: u32 = 0u;
// Whether pixels look their places up, and do not interpolate them.
override EXACT: u32 = 0u;
override SEGMENTS: u32 = 16u;
override MOST: u32 = 64u;
override SUB_EDGE_PX: f32 = 4.0;
override ERROR_PX: f32 = 0.5;

const LANES = 64u;
const SHARES = 11u;
const CELLS_A_ROW = 32768u;
// Samples of a side.
const STEPS = 16u;

struct LensCell {
    // Left, top, right, bottom, between pixels.
    rect_px: vec4<f32>,
    // The cells beside, or -1.
    beside: vec4<i32>,
    // The panel, and nothing.
    names: vec4<u32>,
}

struct Corner {
    pixel: vec2<f32>,
    // From the panel's first page.
    texel: vec2<f32>,
    panel: u32,
    padding: u32,
}

// What is drawn indirectly; then of lens_split.wgsl how often sides are halved at most; and how many triangles there would be
// if sides were cut less, by share_of_parts, or of lens_split.wgsl those of every step.
struct Drawn {
    vertices: atomic<u32>,
    instances: u32,
    first_vertex: u32,
    first_instance: u32,
    halvings: atomic<u32>,
    counts: array<atomic<u32>, SHARES>,
}

@group(0) @binding(11) var<storage, read> cells: array<LensCell>;
@group(0) @binding(12) var<storage, read_write> wishes: array<vec4<u32>>;
@group(0) @binding(13) var<storage, read_write> corners: array<Corner>;
@group(0) @binding(14) var<storage, read_write> drawn: Drawn;
@group(0) @binding(15) var<storage, read> drawn_corners: array<Corner>;

// Largest values of all lanes, as bits: numbers that are not negative keep their order.
var<workgroup> largest: array<atomic<u32>, 4>;
var<workgroup> begin: u32;

fn pixel_of(cell: LensCell, place: vec2<f32>) -> vec2<f32> {
    return cell.rect_px.xy + place * (cell.rect_px.zw - cell.rect_px.xy);
}

fn raise(slot: u32, value: f32) {
    atomicMax(&largest[slot], bitcast<u32>(max(value, 0.0)));
}

fn raised_to(slot: u32) -> f32 {
    return bitcast<f32>(atomicLoad(&largest[slot]));
}

// By which step on the display the texel is changed so.
fn step_for(right: vec2<f32>, down: vec2<f32>, change: vec2<f32>) -> vec2<f32> {
    let area = right.x * down.y - right.y * down.x;
    return vec2<f32>(down.y * change.x - down.x * change.y, right.x * change.y - right.y * change.x) / area;
}

// ---------------------------------------------------------------- how often

// The curvature of lenses between two places, over each lens's largest: algorithm 1 of the paper.
fn lens_factor(panel: u32, first: vec2<f32>, other: vec2<f32>) -> f32 {
    var a = panels[panel].scale * first + panels[panel].offset;
    var b = panels[panel].scale * other + panels[panel].offset;
    var factor = 0.0;
    for (var k = i32(frame.lenses) - 1; k >= 0; k--) {
        let row = 3u * (panel * frame.lenses + u32(k));
        let sheet_a = sheet_at(row, a);
        let sheet_b = sheet_at(row, b);
        let turned = length(sheet_b.slope - sheet_a.slope);
        factor = max(factor, turned / max(distance(a, b), 1e-20) * lenses[row + 2u].w);
        a -= sheet_a.falls * (a - lenses[row].xy);
        b -= sheet_b.falls * (b - lenses[row].xy);
    }
    return factor;
}

fn side_end(side: u32, along: f32) -> vec2<f32> {
    let far = f32(side / 2u);
    return select(vec2<f32>(far, along), vec2<f32>(along, far), side % 2u == 1u);
}

fn acuity_wish(cell: LensCell, lane: u32) -> vec4<u32> {
    let panel = cell.names.x;
    let side = lane / STEPS;
    let along = f32(lane % STEPS + 1u) / f32(STEPS);
    raise(side, lens_factor(panel, pixel_of(cell, side_end(side, 0.0)), pixel_of(cell, side_end(side, along))));
    workgroupBarrier();
    var wish: vec4<u32>;
    for (var k = 0u; k < 4u; k++) {
        let first = pixel_of(cell, side_end(k, 0.0));
        let last = pixel_of(cell, side_end(k, 1.0));
        let view = min(distance(first, last) / SUB_EDGE_PX, f32(MOST));
        let acuity = max(view - 1.0, 0.0) / max(tolerance_px(panel, 0.5 * (first + last)), 1.0);
        wish[k] = u32(ceil(min(raised_to(k), 1.0) * acuity + 1.0 - 1e-3));
    }
    return wish;
}

// Whether any lens has a crease, where its magnification changes at once.
fn creased(panel: u32) -> bool {
    for (var k = 0u; k < frame.lenses; k++) {
        let shape = lenses[3u * (panel * frame.lenses + k) + 1u];
        if u32(shape.z) == 0u || u32(shape.w) == 2u {
            return true;
        }
    }
    return false;
}

fn number_of(group: vec3<u32>) -> u32 {
    return group.y * CELLS_A_ROW + group.x;
}

@compute @workgroup_size(64)
fn lens_wishes(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = number_of(group);
    if number >= frame.cells {
        return;
    }
    let cell = cells[number];
    // Not all adapters begin with zeros here.
    if lane < 4u {
        atomicStore(&largest[lane], 0u);
    }
    workgroupBarrier();
    var wish = vec4<u32>(1u);
    if MODE == 1u {
        wish = vec4<u32>(SEGMENTS);
    } else if MODE == 2u {
        wish = acuity_wish(cell, lane);
    }
    if lane == 0u {
        wishes[number] = wish;
    }
}

// ---------------------------------------------------------------- triangles

// Into how many parts a cell's sides and its inside are cut.
struct Parts {
    sides: vec4<u32>,
    inside: vec2<u32>,
}

fn parts_of(number: u32, share: f32) -> Parts {
    let wish = wishes[number];
    var sides = wish;
    for (var k = 0u; k < 4u; k++) {
        let other = cells[number].beside[k];
        if other >= 0 {
            sides[k] = max(sides[k], wishes[other][(k + 2u) % 4u]);
        }
    }
    sides = vec4<u32>(max(floor(vec4<f32>(sides) * share), vec4<f32>(1.0)));
    let inside = vec2<u32>(max(wish.y, wish.w), max(wish.x, wish.z));
    var within = vec2<u32>(max(floor(vec2<f32>(inside) * share), vec2<f32>(1.0)));
    if any(sides > vec4<u32>(1u)) || any(within > vec2<u32>(1u)) {
        // There is a ring around the inside, whose outer corners are those of the sides.
        within = max(within, vec2<u32>(2u));
    }
    return Parts(sides, within);
}

fn inner_triangles(parts: Parts) -> u32 {
    return 2u * (max(parts.inside.x, 2u) - 2u) * (max(parts.inside.y, 2u) - 2u);
}

fn side_triangles(parts: Parts, side: u32) -> u32 {
    return parts.sides[side] + parts.inside[1u - side % 2u] - 2u;
}

fn triangles_of(parts: Parts) -> u32 {
    if parts.inside.x == 1u {
        return 2u;
    }
    var count = inner_triangles(parts);
    for (var side = 0u; side < 4u; side++) {
        count += side_triangles(parts, side);
    }
    return count;
}

fn share_of_parts(k: u32) -> f32 {
    return exp2(-0.5 * f32(k));
}

// How much of the parts that are wanted there is room for; nothing is cut if there is none for the least.
fn share_that_fits() -> f32 {
    for (var k = 0u; k < SHARES; k++) {
        if atomicLoad(&drawn.counts[k]) <= frame.max_triangles {
            return share_of_parts(k);
        }
    }
    return 0.0;
}

@compute @workgroup_size(64)
fn lens_counts(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < frame.cells {
        for (var k = 0u; k < SHARES; k++) {
            atomicAdd(&drawn.counts[k], triangles_of(parts_of(id.x, share_of_parts(k))));
        }
    }
}

// Three places in a cell, from 0 to 1.
struct Triangle {
    a: vec2<f32>,
    b: vec2<f32>,
    c: vec2<f32>,
}

// One half of a quad, cut along the diagonal in whose middle less is wrong.
fn half_of(cell: LensCell, low: vec2<f32>, high: vec2<f32>, half: u32) -> Triangle {
    let panel = cell.names.x;
    let across = vec2<f32>(high.x, low.y);
    let below = vec2<f32>(low.x, high.y);
    let middle = place_through_lenses(panel, pixel_of(cell, 0.5 * (low + high)));
    let falling = place_through_lenses(panel, pixel_of(cell, low)).texel
        + place_through_lenses(panel, pixel_of(cell, high)).texel;
    let rising = place_through_lenses(panel, pixel_of(cell, across)).texel
        + place_through_lenses(panel, pixel_of(cell, below)).texel;
    let off_falling = length(step_for(middle.right, middle.down, 0.5 * falling - middle.texel));
    let off_rising = length(step_for(middle.right, middle.down, 0.5 * rising - middle.texel));
    if off_falling <= off_rising {
        return Triangle(low, high, select(across, below, half == 1u));
    }
    return Triangle(across, below, select(low, high, half == 1u));
}

// How many of the first steps along a strip between two lines go along the outer one, if both are gone along evenly.
fn outer_steps(step: u32, outer: u32, inner: u32) -> u32 {
    let both = max(outer + inner, 1u);
    return (2u * step * outer + both) / (2u * both);
}

// A triangle of the strip between a side and the line that the inside begins with.
fn side_triangle(parts: Parts, side: u32, step: u32) -> Triangle {
    let outer = parts.sides[side];
    let length_parts = parts.inside[1u - side % 2u];
    let inner = length_parts - 2u;
    // Not by a difference: what is the same place has to be the same number.
    let across = parts.inside[side % 2u];
    let line = f32(select(1u, across - 1u, side >= 2u)) / f32(across);
    let before = outer_steps(step, outer, inner);
    let after = outer_steps(step + 1u, outer, inner);
    let along = f32(before) / f32(outer);
    let along_inner = f32(1u + step - before) / f32(length_parts);
    let edge = f32(side / 2u);
    var third: vec2<f32>;
    if after > before {
        third = vec2<f32>(f32(after) / f32(outer), edge);
    } else {
        third = vec2<f32>(f32(2u + step - before) / f32(length_parts), line);
    }
    // Sides above and below go along x, and lie at y.
    let first = vec2<f32>(along, edge);
    let second = vec2<f32>(along_inner, line);
    if side % 2u == 1u {
        return Triangle(first, second, third);
    }
    return Triangle(first.yx, second.yx, third.yx);
}

fn triangle_of(cell: LensCell, parts: Parts, number: u32) -> Triangle {
    if parts.inside.x == 1u {
        return half_of(cell, vec2<f32>(0.0), vec2<f32>(1.0), number);
    }
    var step = number;
    let inner = inner_triangles(parts);
    if step < inner {
        let columns = parts.inside.x - 2u;
        let quad = vec2<u32>(step / 2u % columns, step / 2u / columns) + 1u;
        let inside = vec2<f32>(parts.inside);
        return half_of(cell, vec2<f32>(quad) / inside, vec2<f32>(quad + 1u) / inside, step % 2u);
    }
    step -= inner;
    var side = 0u;
    while side < 3u && step >= side_triangles(parts, side) {
        step -= side_triangles(parts, side);
        side++;
    }
    return side_triangle(parts, side, step);
}

fn corner_at(cell: LensCell, place: vec2<f32>) -> Corner {
    let pixel = pixel_of(cell, place);
    return Corner(pixel, place_through_lenses(cell.names.x, pixel).texel, cell.names.x, 0u);
}

@compute @workgroup_size(64)
fn lens_triangles(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = number_of(group);
    if number >= frame.cells {
        return;
    }
    let cell = cells[number];
    let parts = parts_of(number, share_that_fits());
    let count = triangles_of(parts);
    if lane == 0u {
        begin = atomicAdd(&drawn.vertices, 3u * count);
    }
    workgroupBarrier();
    for (var k = lane; k < count; k += LANES) {
        let first = begin + 3u * k;
        let triangle = triangle_of(cell, parts, k);
        corners[first] = corner_at(cell, triangle.a);
        corners[first + 1u] = corner_at(cell, triangle.b);
        corners[first + 2u] = corner_at(cell, triangle.c);
    }
}

// ---------------------------------------------------------------- drawn

struct LensVertex {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) panel: u32,
    // The first corner's texel, and the way from there: small numbers are interpolated well.
    @location(1) @interpolate(flat) first: vec2<f32>,
    @location(2) @interpolate(linear) beyond: vec2<f32>,
}

@vertex
fn lens_vertex(@builtin(vertex_index) index: u32) -> LensVertex {
    let corner = drawn_corners[index];
    let first = drawn_corners[index - index % 3u].texel;
    return LensVertex(position_of(corner.panel, corner.pixel), corner.panel, first, corner.texel - first);
}

// How far a place of the image is drawn from where it belongs, in pixels.
fn error_px(panel: u32, pixel: vec2<f32>, texel: vec2<f32>) -> f32 {
    var belongs = pixel;
    for (var k = 0; k < 4; k++) {
        let place = place_through_lenses(panel, belongs);
        belongs += step_for(place.right, place.down, texel - place.texel);
    }
    return distance(belongs, pixel);
}

@fragment
fn lens_fragment(vertex: LensVertex) -> @location(0) vec4<f32> {
    var right = dpdx(vertex.beyond);
    var down = dpdy(vertex.beyond);
    let panel = vertex.panel;
    if TURNED {
        let turn = panels[panel].turn;
        let across = right;
        right = turn.x * across + turn.y * down;
        down = turn.x * down - turn.y * across;
    }
    let pixel = panel_pixel(panel, vertex.position.xy);
    if !in_outline(panel, pixel) {
        discard;
    }
    var place = in_image(panel, Place(true, vertex.first + vertex.beyond, right, down));
    if EXACT == 1u {
        place = place_through_lenses(panel, pixel);
    }
    if !place.seen {
        return vec4<f32>();
    }
    let light = light_at(panel, pixel, place);
    if OVERLAY == 3u && light.a > 0.0 {
        return with_error(light, error_px(panel, pixel, place.texel));
    }
    return light;
}
