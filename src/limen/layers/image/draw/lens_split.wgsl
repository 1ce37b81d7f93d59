// after: lens_mesh.wgsl
// Cuts cells so often that nothing is drawn farther from where
// it belongs than viewers see: right-angled triangles are halved, across their longest side, as long as its middle is off
// (Evans, Kirkpatrick, Townsend 2001).
//
//   lens_survey           one workgroup a cell: how often sides have to be halved at most
//   lens_split            one workgroup a cell, for one step after the other from the finest: which middles become corners
//   lens_split_counts     one workgroup a cell: counts the triangles of every step
//   lens_split_triangles  one workgroup a cell: makes them
//
// A cell is a grid of 2^FINEST by 2^FINEST squares. All places but its corners are the middle of the longest sides of two
// triangles: at step s, which is the largest power of two that divides both coordinates, a place is a centre if it is an
// odd multiple of s along both axes (the longest side is a diagonal of the square around it), else a side. A middle becomes
// a corner if it is off, or if any finer one needs it to be; along the border, neighbours tell one another. So no corner
// ever lies on another triangle's side.

override FINEST: u32 = 8u;

const WORD = 32u;

struct Pass {
    step: u32,
    centres: u32,
    padding: vec2<u32>,
}

@group(0) @binding(16) var<storage, read_write> split: array<atomic<u32>>;
@group(1) @binding(0) var<uniform> now: Pass;

fn grid() -> u32 {
    return 1u << FINEST;
}

// Which word of the corners' bits, and which bit of it.
fn bit_of(number: u32, place: vec2<u32>) -> vec2<u32> {
    let across = grid() + 1u;
    let words = (across * across + WORD - 1u) / WORD;
    let bit = place.y * across + place.x;
    return vec2<u32>(number * words + bit / WORD, 1u << (bit % WORD));
}

fn is_split(number: u32, place: vec2<u32>) -> bool {
    let bit = bit_of(number, place);
    return (atomicLoad(&split[bit.x]) & bit.y) != 0u;
}

fn set_split(number: u32, place: vec2<u32>) {
    let bit = bit_of(number, place);
    atomicOr(&split[bit.x], bit.y);
}

// Make a middle a corner, in all cells that have it.
fn split_at(number: u32, place: vec2<u32>) {
    set_split(number, place);
    let beside = cells[number].beside;
    let last = grid();
    if place.x == 0u && beside.x >= 0 {
        set_split(u32(beside.x), vec2<u32>(last, place.y));
    }
    if place.y == 0u && beside.y >= 0 {
        set_split(u32(beside.y), vec2<u32>(place.x, last));
    }
    if place.x == last && beside.z >= 0 {
        set_split(u32(beside.z), vec2<u32>(0u, place.y));
    }
    if place.y == last && beside.w >= 0 {
        set_split(u32(beside.w), vec2<u32>(place.x, 0u));
    }
}

// log2 of a place's step; FINEST for the cell's corners.
fn step_of(place: vec2<u32>) -> u32 {
    return min(firstTrailingBit(place.x | place.y | grid()), FINEST);
}

fn is_centre(place: vec2<u32>, step: u32) -> bool {
    return ((place.x >> step) & (place.y >> step) & 1u) == 1u;
}

fn in_cell(place: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(place) / f32(grid());
}

// How far from where they belong places between two corners would be drawn, in pixels: asked are the middle and, for where
// magnification changes at once, the middles of both halves.
fn miss_px(cell: LensCell, a: vec2<u32>, b: vec2<u32>) -> f32 {
    let panel = cell.names.x;
    let from_a = pixel_of(cell, in_cell(a));
    let to_b = pixel_of(cell, in_cell(b));
    let first = place_through_lenses(panel, from_a).texel;
    let last = place_through_lenses(panel, to_b).texel;
    var miss = 0.0;
    for (var k = 1; k < 4; k++) {
        let along = 0.25 * f32(k);
        let exact = place_through_lenses(panel, mix(from_a, to_b, along));
        let off = mix(first - exact.texel, last - exact.texel, along);
        miss = max(miss, length(step_for(exact.right, exact.down, off)));
    }
    return miss;
}

// Where the longest side begins whose middle a place is; it ends as far beyond.
fn longest_from(number: u32, place: vec2<u32>, step: u32) -> vec2<u32> {
    let s = 1u << step;
    if !is_centre(place, step) {
        // Sides go along the axis on which the place is an odd multiple.
        return select(place - vec2<u32>(0u, s), place - vec2<u32>(s, 0u), ((place.x >> step) & 1u) == 1u);
    }
    if step + 1u == FINEST {
        return select(place - s, vec2<u32>(place.x - s, place.y + s), wishes[number].y == 1u);
    }
    // From the middle of the square of which this one is a quarter.
    let odd = (place + s) >> vec2<u32>(step + 1u) & vec2<u32>(1u);
    return select(place - s, place + s, odd == vec2<u32>(1u));
}

// How many places a step has, of either kind, and the k-th of them.
fn places_of(step: u32, centres: bool) -> u32 {
    let half = grid() >> (step + 1u);
    return select(2u * half * (half + 1u), half * half, centres);
}

fn place_of(k: u32, step: u32, centres: bool) -> vec2<u32> {
    let half = grid() >> (step + 1u);
    let odd = 2u * (k % half) + 1u;
    let line = k / half;
    var place = vec2<u32>(odd, 2u * line);
    if centres {
        place.y++;
    } else if line > half {
        place = vec2<u32>(2u * (line - half - 1u), odd);
    }
    return place << vec2<u32>(step);
}

// The largest error that is not seen at a place, in pixels.
fn unseen_px(cell: LensCell, place: vec2<u32>) -> f32 {
    let panel = cell.names.x;
    // Between what is asked, a quarter more may be wrong: at a crease, and inside of a triangle.
    return 0.8 * ERROR_PX * max(tolerance_px(panel, pixel_of(cell, in_cell(place))), 1.0);
}

fn needed_by_finer(number: u32, place: vec2<u32>, step: u32) -> bool {
    let s = 1u << step;
    if is_centre(place, step) {
        return is_split(number, place - vec2<u32>(s, 0u)) || is_split(number, place + vec2<u32>(s, 0u))
            || is_split(number, place - vec2<u32>(0u, s)) || is_split(number, place + vec2<u32>(0u, s));
    }
    if step == 0u {
        return false;
    }
    let half = i32(s / 2u);
    for (var k = 0; k < 4; k++) {
        let finer = vec2<i32>(place) + vec2<i32>(select(-half, half, (k & 1) == 1), select(-half, half, k >= 2));
        if all(finer >= vec2<i32>()) && all(finer <= vec2<i32>(i32(grid()))) && is_split(number, vec2<u32>(finer)) {
            return true;
        }
    }
    return false;
}

fn is_wanted(step: u32, halvings: u32) -> bool {
    return step + halvings >= FINEST;
}

// Of the step that is measured everywhere.
const SURVEYED = 4u;

@compute @workgroup_size(64)
fn lens_survey(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = number_of(group);
    if number >= frame.cells {
        return;
    }
    let cell = cells[number];
    if lane == 0u {
        atomicStore(&largest[0], 0u);
        let last = grid();
        let falling = miss_px(cell, vec2<u32>(), vec2<u32>(last));
        let rising = miss_px(cell, vec2<u32>(0u, last), vec2<u32>(last, 0u));
        wishes[number].y = select(0u, 1u, rising < falling);
    }
    storageBarrier();
    workgroupBarrier();
    let step = FINEST - min(SURVEYED, FINEST);
    for (var kind = 0u; kind < 2u; kind++) {
        for (var k = lane; k < places_of(step, kind == 1u); k += LANES) {
            let place = place_of(k, step, kind == 1u);
            let begin = longest_from(number, place, step);
            raise(0u, miss_px(cell, begin, 2u * place - begin) / unseen_px(cell, place));
        }
    }
    workgroupBarrier();
    if lane == 0u {
        // Each halving leaves a quarter of an error, where magnification changes at once a half; some more is expected.
        let left = log2(max(1.5 * raised_to(0u), 1e-6)) * select(0.5, 1.0, creased(cell.names.x));
        let halvings = u32(clamp(f32(FINEST - step) + ceil(left), 0.0, f32(FINEST)));
        wishes[number].x = halvings;
        atomicMax(&drawn.halvings, halvings);
    }
}

@compute @workgroup_size(64)
fn lens_split(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = number_of(group);
    if number >= frame.cells || !is_wanted(now.step, atomicLoad(&drawn.halvings)) {
        return;
    }
    let cell = cells[number];
    let measured = is_wanted(now.step, wishes[number].x);
    let centres = now.centres == 1u;
    for (var k = lane; k < places_of(now.step, centres); k += LANES) {
        let place = place_of(k, now.step, centres);
        var wanted = needed_by_finer(number, place, now.step);
        if !wanted && measured {
            let begin = longest_from(number, place, now.step);
            wanted = miss_px(cell, begin, 2u * place - begin) > unseen_px(cell, place);
        }
        if wanted {
            split_at(number, place);
        }
    }
}

// The finest step that there is, if its triangles fit with those of all coarser ones.
fn finest_that_fits() -> u32 {
    let finest = FINEST - atomicLoad(&drawn.halvings);
    var total = 2u * frame.cells;
    var step = FINEST;
    while step > finest {
        total += atomicLoad(&drawn.counts[step - 1u]);
        if total > frame.max_triangles {
            break;
        }
        step--;
    }
    return step;
}

@compute @workgroup_size(64)
fn lens_split_counts(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = number_of(group);
    if number >= frame.cells {
        return;
    }
    let finest = FINEST - atomicLoad(&drawn.halvings);
    let across = (grid() >> finest) + 1u;
    for (var k = lane; k < across * across; k += LANES) {
        let place = vec2<u32>(k % across, k / across) << vec2<u32>(finest);
        if step_of(place) < FINEST && is_split(number, place) {
            // On the border, one of the two triangles is the neighbour's.
            let border = any(place == vec2<u32>()) || any(place == vec2<u32>(grid()));
            atomicAdd(&drawn.counts[step_of(place)], select(2u, 1u, border));
        }
    }
}

// Whether a place is a corner of triangles; those of the cell are it from the start.
fn is_corner(number: u32, place: vec2<u32>, finest: u32) -> bool {
    let step = step_of(place);
    return step == FINEST || (step >= finest && is_split(number, place));
}

// The k-th of the triangles that there may be, two at every place and two at every smallest square; and whether there is.
struct Found {
    there: bool,
    a: vec2<u32>,
    b: vec2<u32>,
    apex: vec2<u32>,
}

// The step of the places that are asked; the cell's own middle is always among them.
fn asked_step(finest: u32) -> u32 {
    return min(finest, FINEST - 1u);
}

fn max_triangles(finest: u32) -> u32 {
    let across = grid() >> asked_step(finest);
    return 2u * ((across + 1u) * (across + 1u) + across * across);
}

fn triangle_at(number: u32, k: u32, finest: u32) -> Found {
    let squares = grid() >> asked_step(finest);
    let places = (squares + 1u) * (squares + 1u);
    let scale = vec2<u32>(asked_step(finest));
    let second = k % 2u == 1u;
    if k / 2u < places {
        // Over the longest side whose middle the place is: there if its third corner is, and if it is not halved.
        let middle = vec2<u32>(k / 2u % (squares + 1u), k / 2u / (squares + 1u)) << scale;
        if is_corner(number, middle, finest) {
            return Found();
        }
        let a = longest_from(number, middle, step_of(middle));
        let aside = vec2<i32>(a) - vec2<i32>(middle);
        let apex = vec2<i32>(middle) + select(1, -1, second) * vec2<i32>(-aside.y, aside.x);
        let inside = all(apex >= vec2<i32>()) && all(apex <= vec2<i32>(i32(grid())));
        let third = vec2<u32>(clamp(apex, vec2<i32>(), vec2<i32>(i32(grid()))));
        return Found(inside && is_corner(number, third, finest), a, 2u * middle - a, third);
    }
    // Over the diagonal of a smallest square, from a centre to the corner across: never halved.
    let number_of_square = k / 2u - places;
    let square = vec2<u32>(number_of_square % squares, number_of_square / squares);
    let a = square + ((square + 1u) & vec2<u32>(1u));
    let b = 2u * square + 1u - a;
    let apex = select(vec2<u32>(a.x, b.y), vec2<u32>(b.x, a.y), second) << scale;
    return Found(is_corner(number, apex, finest), a << scale, b << scale, apex);
}

var<workgroup> count: atomic<u32>;

fn unfinished(cell: LensCell, place: vec2<u32>) -> Corner {
    return Corner(pixel_of(cell, in_cell(place)), vec2<f32>(), cell.names.x, 0u);
}

@compute @workgroup_size(64)
fn lens_split_triangles(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let number = number_of(group);
    if number >= frame.cells {
        return;
    }
    let cell = cells[number];
    let finest = finest_that_fits();
    if lane == 0u {
        atomicStore(&count, 0u);
    }
    workgroupBarrier();
    for (var k = lane; k < max_triangles(finest); k += LANES) {
        if triangle_at(number, k, finest).there {
            atomicAdd(&count, 1u);
        }
    }
    workgroupBarrier();
    let corner_count = 3u * atomicLoad(&count);
    workgroupBarrier();
    if lane == 0u {
        begin = atomicAdd(&drawn.vertices, corner_count);
        atomicStore(&count, 0u);
    }
    workgroupBarrier();
    for (var k = lane; k < max_triangles(finest); k += LANES) {
        let found = triangle_at(number, k, finest);
        if found.there {
            let first = begin + 3u * atomicAdd(&count, 1u);
            corners[first] = unfinished(cell, found.a);
            corners[first + 1u] = unfinished(cell, found.b);
            corners[first + 2u] = unfinished(cell, found.apex);
        }
    }
    storageBarrier();
    workgroupBarrier();
    // What is costly comes last, where all invocations have work.
    for (var k = lane; k < corner_count; k += LANES) {
        corners[begin + k].texel = place_through_lenses(cell.names.x, corners[begin + k].pixel).texel;
    }
}
