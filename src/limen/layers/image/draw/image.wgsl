// after: gpu/page.wgsl
// Draws an image's pages on panels, and finds the pages that panels need.
//
// Four ways in:
//   flat_*    one quad per (panel, page); the processor chose the pages' slots
//   bent_*    one quad per panel; every pixel maps itself and looks its page up in a table
//   lens_*    of lens_mesh.wgsl: the same in triangles, where the image is seen through lenses
//   feedback  counts, on a reduced grid of pixels, how often every page is needed
//
// All three decide the level with the same functions. The processor's twin of them is limen.layers.image.kernels and shape_kernels.

// 0: bilinear. 1: Catmull-Rom, widened to the pixel's footprint.
override KERNEL: u32 = 1u;
// 0: the picture. 1: the level's colour over the picture. 2: level, levels coarser, panel as numbers. 3: the error's colour
// over the picture.
override OVERLAY: u32 = 0u;
// Some panel of the quilt is turned: else no pixel has to be asked.
override TURNED: bool = false;

const PI: f32 = 3.14159265358979;
const ALMOST_ONE = 0.99999994;
const NO_PAGE: u32 = 0xffffffffu;

struct Frame {
    quilt_px: vec2<f32>,
    image_px: vec2<f32>,
    // The eye point of an image on a shape, in the shape's own frame.
    eye: vec4<f32>,
    eyes: u32,
    bias: i32,
    top: i32,
    // 0: on the surface. 1: plane. 2: cylinder. 3: ellipsoid. 4: on the surface, seen through lenses.
    shape: u32,
    turn: f32,
    divisor: u32,
    jitter_px: vec2<u32>,
    // Of a layer of the pool: one over powers of two.
    layers_per_px: vec2<f32>,
    // Octaves of tolerance over which one level gives way to the next.
    blend: f32,
    // Growth of the tolerance with each degree from the gaze.
    per_deg: f32,
    lenses: u32,
    // Where their tables begin, counted in numbers.
    tables: u32,
    // Of lens_mesh.wgsl.
    cells: u32,
    max_triangles: u32,
}

struct Panel {
    // Where pixel (0, 0) begins in the quilt.
    origin_px: vec2<f32>,
    size_px: vec2<u32>,
    pitch_m: vec2<f32>,
    mip: i32,
    outline_edges: u32,
    // On the surface: texel = scale * pixel + 256 * first + offset.
    scale: vec2<f32>,
    offset: vec2<f32>,
    first_page: vec2<i32>,
    // Of the true panel, where this one is a preview with fewer pixels: for the overlay.
    true_mip: i32,
    true_px: f32,
    // On a shape: the ray through pixel (x, y) is ray + x * ray_right + y * ray_down, in the shape's frame.
    ray: vec4<f32>,
    ray_right: vec4<f32>,
    ray_down: vec4<f32>,
    // How the panel is turned in the quilt: cosine and sine of quarter turns clockwise.
    turn: vec2<f32>,
    // So many pixels around its grid are drawn as well.
    guard_px: f32,
    padding: f32,
    // Inside the outline and its guard where x * edge.x + y * edge.y + edge.z >= 0 for every edge.
    outline: array<vec4<f32>, 8>,
}

struct PageQuad {
    // Left, top, right, bottom: the pixels whose centres lie in the page.
    rect_px: vec4<i32>,
    // Texel of the page drawn = scale * pixel + offset.
    scale: vec2<f32>,
    offset: vec2<f32>,
    panel: u32,
    level: u32,
    slot: u32,
    coarser: u32,
    // Drawn where the logarithm of the tolerance lies between: a finer page is below, a coarser one above.
    from_log2: f32,
    until_log2: f32,
    // Share of this picture of the page, and of finer ones painted over it, while they are exchanged for one another.
    fade: f32,
    over: f32,
}

struct Level {
    columns: u32,
    rows: u32,
    first_page: u32,
    padding: u32,
    colour: vec4<f32>,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> panels: array<Panel>;
// Per panel and eye: foot point on the panel and height over it (m), pixels per metre of distance; then the gaze along
// right, down and normal (zero: unknown), and how far the eye may look beside it (degrees).
@group(0) @binding(2) var<storage, read> eyes: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> quads: array<PageQuad>;
@group(0) @binding(4) var<storage, read> levels: array<Level>;
// Per page of the pyramid: slot << 12 | faded in (of 127) << 5 | levels coarser.
@group(0) @binding(5) var<storage, read> table: array<u32>;
@group(0) @binding(6) var pool: texture_2d_array<f32>;
@group(0) @binding(7) var bilinear: sampler;
@group(0) @binding(8) var<storage, read_write> coverage: array<atomic<u32>>;
// Per page of the pyramid: the logarithm of the tolerance below which its finer pages are drawn.
@group(0) @binding(9) var<storage, read> finer: array<f32>;

// Per panel and lens three rows, see limen.viewing.lens: focus, from the panel's first page, and one over the radii; how far it is
// raised, its even share, drop-off and kind; of a table, where it begins, columns and rows, and for the mode acuity one over
// its sharpest bend. Then all tables.
@group(0) @binding(10) var<storage, read> lenses: array<vec4<f32>>;

// ---------------------------------------------------------------- tolerance and level

// The largest error at a place of a panel that one eye cannot see, in pixels.
fn allowed_px(eye: vec4<f32>, gaze: vec4<f32>, place_m: vec2<f32>) -> f32 {
    let sight = vec3<f32>(place_m - eye.xy, -eye.z);
    var allowed = eye.w * length(sight);
    if any(gaze.xyz != vec3<f32>()) {
        // The angle by its tangent: near the gaze its cosine is flat.
        let aside = exact_atan2(length(cross(sight, gaze.xyz)), dot(sight, gaze.xyz));
        allowed *= 1.0 + frame.per_deg * max(degrees(aside) - gaze.w, 0.0);
    }
    return allowed;
}

// The same for all eyes from a number on, and no more than is given; the most demanding one decides.
fn least_px(panel: u32, place_m: vec2<f32>, first: u32, given: f32) -> f32 {
    var least = given;
    for (var k = first; k < frame.eyes; k++) {
        let row = 2u * (panel * frame.eyes + k);
        least = min(least, allowed_px(eyes[row], eyes[row + 1u], place_m));
    }
    return least;
}

// The largest invisible error at a pixel, in pixels.
fn tolerance_px(panel: u32, pixel: vec2<f32>) -> f32 {
    return least_px(panel, pixel * panels[panel].pitch_m, 0u, select(3.0e38, 0.0, frame.eyes == 0u));
}

// The tolerance as levels: log2 of the texels of full resolution that it spans.
fn tolerance_log2(tolerance_px: f32, footprint: f32) -> f32 {
    return log2(max(tolerance_px * footprint, 1e-30)) + f32(frame.bias);
}

// A: the larger side of a pixel in texels.
fn flat_footprint(panel: u32) -> f32 {
    let size = abs(panels[panel].scale);
    return max(size.x, size.y);
}

// How much of a page is given over to its finer pages.
fn ramp(edge_log2: f32, tolerance_log2: f32) -> f32 {
    return clamp((edge_log2 - tolerance_log2) / frame.blend, 0.0, 1.0);
}

fn in_outline(panel: u32, pixel: vec2<f32>) -> bool {
    for (var k = 0u; k < panels[panel].outline_edges; k++) {
        let edge = panels[panel].outline[k];
        if dot(edge.xy, pixel) + edge.z < 0.0 {
            return false;
        }
    }
    return true;
}

// ---------------------------------------------------------------- shapes

// Where a ray meets the image, and how the place moves to the next pixel right and down, in texels.
struct Place {
    seen: bool,
    texel: vec2<f32>,
    right: vec2<f32>,
    down: vec2<f32>,
}

// Single precision to two units in the last place; the built-in may be off by 4,096 of them.
fn exact_atan(tangent: f32) -> f32 {
    let size = abs(tangent);
    var z = size;
    var base = 0.0;
    if size > 2.414213562 {
        z = -1.0 / size;
        base = 0.5 * PI;
    } else if size > 0.414213562 {
        z = (size - 1.0) / (size + 1.0);
        base = 0.25 * PI;
    }
    let z2 = z * z;
    let tail = ((8.05374449538e-2 * z2 - 1.38776856032e-1) * z2 + 1.99777106478e-1) * z2 - 3.33329491539e-1;
    return sign(tangent) * (base + tail * z2 * z + z);
}

fn exact_atan2(y: f32, x: f32) -> f32 {
    if x > 0.0 {
        return exact_atan(y / x);
    }
    let half_turn = select(-PI, PI, y >= 0.0);
    if x == 0.0 {
        return 0.5 * half_turn;
    }
    return half_turn + exact_atan(y / x);
}

// The quadratic form of the cylinder (x2 + z2) or the ellipsoid (x2 + y2 + z2).
fn form(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return a.x * b.x + a.z * b.z + select(0.0, a.y * b.y, frame.shape == 3u);
}

fn plane_place(ray: vec3<f32>, right: vec3<f32>, down: vec3<f32>) -> Place {
    let t = -frame.eye.z / ray.z;
    let hit = frame.eye.xy + t * ray.xy;
    var place = Place(t > 0.0, hit * frame.image_px, vec2<f32>(), vec2<f32>());
    // The next pixel's hit less this one's, without subtracting large numbers.
    place.right = (-frame.eye.z / (ray.z + right.z)) * (right.xy - ray.xy * (right.z / ray.z)) * frame.image_px;
    place.down = (-frame.eye.z / (ray.z + down.z)) * (down.xy - ray.xy * (down.z / ray.z)) * frame.image_px;
    return place;
}

// How far the hit of ray + step lies from the hit of ray (at parameter t), without subtracting large numbers.
fn step_on_round(hit: vec3<f32>, t: f32, ray: vec3<f32>, step: vec3<f32>) -> vec3<f32> {
    let beside = ray + step;
    let from_hit = hit + t * step;
    let a = form(beside, beside);
    let b = form(from_hit, beside);
    let c = t * (2.0 * form(hit, step) + t * form(step, step));
    let root = sqrt(max(b * b - a * c, 0.0));
    let back = -c / (b + select(-root, root, b >= 0.0));
    return t * step + back * beside;
}

// How far a step on the shape moves the texel; longitude and latitude by the angle between the two places.
fn texel_step(hit: vec3<f32>, step: vec3<f32>) -> vec2<f32> {
    let after = hit + step;
    let longitude = exact_atan2(step.x * hit.z - step.z * hit.x, after.x * hit.x + after.z * hit.z);
    var v = 0.5 * step.y;
    if frame.shape == 3u {
        let radius = length(hit.xz);
        let radius_after = length(after.xz);
        let longer = dot(2.0 * hit.xz + step.xz, step.xz) / max(radius + radius_after, 1e-30);
        v = exact_atan2(step.y * radius - hit.y * longer, radius * radius_after + hit.y * after.y) / PI;
    }
    return vec2<f32>(longitude / frame.turn, v) * frame.image_px;
}

fn round_place(ray: vec3<f32>, right: vec3<f32>, down: vec3<f32>) -> Place {
    var place = Place(false, vec2<f32>(), vec2<f32>(), vec2<f32>());
    let eye = frame.eye.xyz;
    let a = form(ray, ray);
    let b = form(eye, ray);
    let root2 = b * b - a * (form(eye, eye) - 1.0);
    if a == 0.0 || root2 < 0.0 {
        return place;
    }
    let root = sqrt(root2);
    var t = (-b - root) / a;
    if t <= 0.0 {
        t = (-b + root) / a;
    }
    let hit = eye + t * ray;
    var u = 0.5 + exact_atan2(hit.x, hit.z) / frame.turn;
    var v = 0.5 + 0.5 * hit.y;
    // A closed shape has no edge: what lies exactly behind, or at a pole, must not fall off the image.
    if frame.turn > 2.0 * PI - 1e-4 {
        u = clamp(u, 0.0, ALMOST_ONE);
    }
    if frame.shape == 3u {
        v = clamp(0.5 + exact_atan2(hit.y, length(hit.xz)) / PI, 0.0, ALMOST_ONE);
    }
    place.seen = t > 0.0;
    place.texel = vec2<f32>(u, v) * frame.image_px;
    place.right = texel_step(hit, step_on_round(hit, t, ray, right));
    place.down = texel_step(hit, step_on_round(hit, t, ray, down));
    return place;
}

// ---------------------------------------------------------------- lenses

// How far a sheet is raised, 0 ... 1, and how that changes with the way from the focus, in radii.
struct Raised {
    falls: f32,
    slope: vec2<f32>,
}

// The same along one axis: limen.viewing.lens.drop_off, and its derivative.
fn drop_off(distance: f32, even: f32, how: u32) -> vec2<f32> {
    let u = (distance - even) / (1.0 - even);
    if u <= 0.0 {
        return vec2<f32>(1.0, 0.0);
    }
    if u >= 1.0 {
        return vec2<f32>();
    }
    let steep = 1.0 / (1.0 - even);
    if how == 0u {
        return vec2<f32>(1.0 - u, -steep);
    }
    if how == 1u {
        return vec2<f32>(0.5 + 0.5 * cos(PI * u), -0.5 * PI * steep * sin(PI * u));
    }
    if how == 2u {
        if u < 0.5 {
            return vec2<f32>(1.0 - 2.0 * u * u, -4.0 * steep * u);
        }
        return vec2<f32>(2.0 * (1.0 - u) * (1.0 - u), -4.0 * steep * (1.0 - u));
    }
    let rim = exp(-4.5);
    let bell = exp(-4.5 * u * u);
    return vec2<f32>((bell - rim) / (1.0 - rim), -9.0 * steep * u * bell / (1.0 - rim));
}

fn table_height(number: u32) -> f32 {
    let at = frame.tables + number;
    return lenses[at / 4u][at % 4u];
}

// Weights of a uniform cubic B-spline's four knots around a place that lies t behind the second; then their derivatives.
fn spline(t: f32) -> vec4<f32> {
    let s = 1.0 - t;
    return vec4<f32>(s * s * s, 4.0 - 6.0 * t * t + 3.0 * t * t * t, 4.0 - 6.0 * s * s + 3.0 * s * s * s, t * t * t) / 6.0;
}

fn spline_slope(t: f32) -> vec4<f32> {
    let s = 1.0 - t;
    return 0.5 * vec4<f32>(-s * s, 3.0 * t * t - 4.0 * t, 4.0 * s - 3.0 * s * s, t * t);
}

fn raised_by_table(way: vec2<f32>, begin: u32, size: vec2<u32>) -> Raised {
    let steps = 0.5 * vec2<f32>(size - 1u);
    let at = (way + 1.0) * steps;
    let first = floor(at);
    let across = spline(at.x - first.x);
    let across_slope = spline_slope(at.x - first.x);
    let down = spline(at.y - first.y);
    let down_slope = spline_slope(at.y - first.y);
    var height = 0.0;
    var slope = vec2<f32>();
    for (var j = 0; j < 4; j++) {
        let line = u32(clamp(i32(first.y) + j - 1, 0, i32(size.y) - 1));
        var knots: vec4<f32>;
        for (var i = 0; i < 4; i++) {
            let column = u32(clamp(i32(first.x) + i - 1, 0, i32(size.x) - 1));
            knots[i] = table_height(begin + line * size.x + column);
        }
        height += down[j] * dot(across, knots);
        slope += vec2<f32>(down[j] * dot(across_slope, knots), down_slope[j] * dot(across, knots)) * steps;
    }
    let size_way = abs(way);
    let rim = drop_off(max(size_way.x, size_way.y), 0.9, 1u);
    let outward = select(vec2<f32>(0.0, sign(way.y)), vec2<f32>(sign(way.x), 0.0), size_way.x >= size_way.y);
    return Raised(height * rim.x, slope * rim.x + height * rim.y * outward);
}

fn raised(way: vec2<f32>, shape: vec4<f32>, table: vec4<f32>) -> Raised {
    let kind = u32(shape.w);
    if kind == 2u {
        return raised_by_table(way, u32(table.x), vec2<u32>(table.yz));
    }
    if kind == 1u {
        let across = drop_off(abs(way.x), shape.y, u32(shape.z));
        let down = drop_off(abs(way.y), shape.y, u32(shape.z));
        return Raised(across.x * down.x, sign(way) * vec2<f32>(across.y * down.x, across.x * down.y));
    }
    let distance = length(way);
    let falls = drop_off(distance, shape.y, u32(shape.z));
    return Raised(falls.x, falls.y * way / max(distance, 1e-20));
}

// The sheet that a lens raises where a texel lies without it, and how that changes with the texel.
fn sheet_at(row: u32, texel: vec2<f32>) -> Raised {
    let way = (texel - lenses[row].xy) * lenses[row].zw;
    if any(abs(way) >= vec2<f32>(1.0)) {
        return Raised(0.0, vec2<f32>());
    }
    let shape = lenses[row + 1u];
    let sheet = raised(way, shape, lenses[row + 2u]);
    return Raised(shape.x * sheet.falls, shape.x * sheet.slope * lenses[row].zw);
}

// What is seen at a pixel through all lenses; texels count from the panel's first page.
fn place_through_lenses(panel: u32, pixel: vec2<f32>) -> Place {
    let scale = panels[panel].scale;
    var place = Place(false, scale * pixel + panels[panel].offset, vec2<f32>(scale.x, 0.0), vec2<f32>(0.0, scale.y));
    for (var k = i32(frame.lenses) - 1; k >= 0; k--) {
        let row = 3u * (panel * frame.lenses + u32(k));
        let sheet = sheet_at(row, place.texel);
        let from_focus = place.texel - lenses[row].xy;
        place.texel -= sheet.falls * from_focus;
        place.right -= sheet.falls * place.right + dot(sheet.slope, place.right) * from_focus;
        place.down -= sheet.falls * place.down + dot(sheet.slope, place.down) * from_focus;
    }
    return in_image(panel, place);
}

// The same, with whether it lies in the image.
fn in_image(panel: u32, place: Place) -> Place {
    let whole = place.texel + vec2<f32>(panels[panel].first_page) * PAGE;
    return Place(all(whole >= vec2<f32>()) && all(whole < frame.image_px), place.texel, place.right, place.down);
}

// On a shape or through lenses.
fn place_seen(panel: u32, pixel: vec2<f32>) -> Place {
    if frame.shape == 4u {
        return place_through_lenses(panel, pixel);
    }
    return place_on_shape(panel, pixel);
}

fn place_on_shape(panel: u32, pixel: vec2<f32>) -> Place {
    let right = panels[panel].ray_right.xyz;
    let down = panels[panel].ray_down.xyz;
    let ray = panels[panel].ray.xyz + pixel.x * right + pixel.y * down;
    var place: Place;
    if frame.shape == 1u {
        place = plane_place(ray, right, down);
    } else {
        place = round_place(ray, right, down);
    }
    place.seen = place.seen && all(place.texel >= vec2<f32>()) && all(place.texel < frame.image_px);
    return place;
}

// A: the longer of the two steps.
fn footprint_of(place: Place) -> f32 {
    return clamp(sqrt(max(dot(place.right, place.right), dot(place.down, place.down))), 1e-30, 1e30);
}

// floor(log2 A); a thousandth of tolerance as for images on the surface.
fn mip_of(place: Place, true_px: f32) -> i32 {
    return i32(floor(log2(footprint_of(place) / true_px) + 1e-3));
}

// ---------------------------------------------------------------- sampling

// The sampler's place of a texel of a page: counted so that nothing is rounded, and the same is read in every slot.
fn share_of_layer(slot: Slot, texel: vec2<f32>) -> vec2<f32> {
    return (slot.corner + floor(texel * 2048.0 + 0.5) / 2048.0) * frame.layers_per_px;
}

// Catmull-Rom's cubic (Keys 1981, a = -1/2).
fn weight(distance: f32) -> f32 {
    let x = min(abs(distance), 2.0);
    return select(((-0.5 * x + 2.5) * x - 4.0) * x + 2.0, (1.5 * x - 2.5) * x * x + 1.0, x < 1.0);
}

// One sample along an axis: where, its weight, and the texel to go on with.
struct Tap {
    at: f32,
    weight: f32,
    next: f32,
}

// Neighbours whose weights have the same sign share one bilinear sample between them, which halves the samples
// (Sigg, Hadwiger 2005).
fn tap_from(i: f32, texel: f32, narrow: f32) -> Tap {
    let at = i + 0.5;
    let w = weight((at - texel) * narrow);
    let beside = weight((at + 1.0 - texel) * narrow);
    let both = w + beside;
    if w * beside > 0.0 {
        return Tap(at + beside / both, both, i + 2.0);
    }
    return Tap(at, w, i + 1.0);
}

// Catmull-Rom's weights of the four texels around a place that lies so far behind the second.
fn weights_of_four(behind: f32) -> vec4<f32> {
    return vec4<f32>(weight(1.0 + behind), weight(behind), weight(1.0 - behind), weight(2.0 - behind));
}

fn four_of_row(first: vec2<i32>, layer: i32, across: vec4<f32>) -> vec3<f32> {
    return across.x * textureLoad(pool, first, layer, 0).rgb
        + across.y * textureLoad(pool, first + vec2<i32>(1, 0), layer, 0).rgb
        + across.z * textureLoad(pool, first + vec2<i32>(2, 0), layer, 0).rgb
        + across.w * textureLoad(pool, first + vec2<i32>(3, 0), layer, 0).rgb;
}

// Where texels are no smaller than pixels. Sixteen texels are read, not nine places between them: a software adapter
// reads four texels for each of those, and an image shown texel for pixel comes out bit for bit.
fn sharp_magnified(slot: Slot, texel: vec2<f32>) -> vec3<f32> {
    let second = floor(texel - 0.5);
    let across = weights_of_four(texel.x - 0.5 - second.x);
    let down = weights_of_four(texel.y - 0.5 - second.y);
    let first = vec2<i32>(slot.corner + second) - 1;
    return down.x * four_of_row(first, slot.layer, across)
        + down.y * four_of_row(first + vec2<i32>(0, 1), slot.layer, across)
        + down.z * four_of_row(first + vec2<i32>(0, 2), slot.layer, across)
        + down.w * four_of_row(first + vec2<i32>(0, 3), slot.layer, across);
}

// Where pixels span up to two texels.
fn sharp_minified(slot: Slot, texel: vec2<f32>, width: vec2<f32>) -> vec3<f32> {
    let narrow = 1.0 / width;
    // The gutter holds every texel nearer than two footprints of two.
    let first = max(ceil(texel - 0.5 - 2.0 * width), vec2<f32>(-GUTTER));
    let last = min(floor(texel - 0.5 + 2.0 * width), vec2<f32>(PAGE + GUTTER - 1.0));
    var light = vec4<f32>();
    var y = first.y;
    while y <= last.y {
        let along = tap_from(y, texel.y, narrow.y);
        y = along.next;
        if abs(along.weight) < 1e-4 {
            continue;
        }
        var row = vec4<f32>();
        var x = first.x;
        while x <= last.x {
            let across = tap_from(x, texel.x, narrow.x);
            x = across.next;
            if abs(across.weight) < 1e-4 {
                continue;
            }
            let place = share_of_layer(slot, vec2<f32>(across.at, along.at));
            let texels = textureSampleLevel(pool, bilinear, place, slot.layer, 0.0).rgb;
            row += across.weight * vec4<f32>(texels, 1.0);
        }
        light += along.weight * row;
    }
    return light.rgb / light.a;
}

// The light around a texel of a page, over the footprint of one pixel (texels along both axes).
fn sharp(slot: Slot, texel: vec2<f32>, footprint: vec2<f32>) -> vec3<f32> {
    let width = clamp(footprint, vec2<f32>(1.0), vec2<f32>(2.0));
    var light: vec3<f32>;
    if any(width > vec2<f32>(1.0)) {
        light = sharp_minified(slot, texel, width);
    } else {
        light = sharp_magnified(slot, texel);
    }
    return clamp(light, vec3<f32>(), vec3<f32>(1.0));
}

fn smooth_sample(slot: Slot, texel: vec2<f32>) -> vec3<f32> {
    return textureSampleLevel(pool, bilinear, share_of_layer(slot, texel), slot.layer, 0.0).rgb;
}

fn colour_of(slot: u32, texel: vec2<f32>, footprint: vec2<f32>, level: u32, coarser: u32, panel: u32) -> vec4<f32> {
    if OVERLAY == 2u {
        return vec4<f32>(f32(level), f32(coarser), f32(panel), 255.0) / 255.0;
    }
    let place = place_of_slot(slot);
    var light: vec3<f32>;
    if KERNEL == 0u {
        light = smooth_sample(place, texel);
    } else {
        light = sharp(place, texel, footprint);
    }
    return vec4<f32>(light, 1.0);
}

// The overlay of levels. A preview of fewer pixels cannot show the finest levels of the true panel: where it draws its own
// finest (mip), the tint is that of the levels which the true panel would draw there, each by its share.
fn tinted(
    colour: vec4<f32>, panel: u32, texel: vec2<f32>, level: u32, mip: i32, true_mip: i32, tolerance: f32, coarser: u32
) -> vec4<f32> {
    if OVERLAY != 1u {
        return colour;
    }
    var tint = tint_of(level, coarser);
    if i32(level) <= mip {
        let all = share_up_to(panel, texel, level, tolerance);
        var below = 0.0;
        var mixed = vec4<f32>();
        for (var finer_level = u32(max(true_mip, 0)); finer_level < level; finer_level++) {
            let above = clamp(share_up_to(panel, texel, finer_level, tolerance), below, all);
            mixed += (above - below) * tint_of(finer_level, coarser);
            below = above;
        }
        if all > 0.0 {
            tint = (mixed + (all - below) * tint) / all;
        }
    }
    return vec4<f32>(mix(colour.rgb, tint.rgb, tint.a), colour.a);
}

fn tint_of(level: u32, coarser: u32) -> vec4<f32> {
    return levels[clamp(i32(level + coarser), 0, frame.top)].colour;
}

// The overlay of errors: how many pixels what is seen lies from where it belongs, in the colours of Papadopoulos, Kaufman
// 2013, figure 4.
fn with_error(colour: vec4<f32>, error_px: f32) -> vec4<f32> {
    if OVERLAY != 3u {
        return colour;
    }
    var tint = vec3<f32>(1.0, 0.0, 0.0);
    if error_px < 0.1 {
        tint = vec3<f32>(0.2);
    } else if error_px < 0.5 {
        tint = vec3<f32>(0.0, 0.1, 1.0);
    } else if error_px < 1.0 {
        tint = vec3<f32>(0.0, 0.7, 0.1);
    }
    return vec4<f32>(mix(colour.rgb, tint, 0.6), colour.a);
}

// The part of a page in a pixel, from the shares that its finer pages (below) and all that is not coarser (above) have.
fn share_of(below: f32, above: f32) -> f32 {
    if OVERLAY == 2u {
        return select(0.0, 1.0, above > 0.5 && below <= 0.5);
    }
    return above - below;
}

// ---------------------------------------------------------------- flat

// What all pixels of a quad have in common comes with its corners: software adapters took half their time to read it from
// storage for every pixel.
struct FlatVertex {
    @builtin(position) position: vec4<f32>,
    // Scale and offset.
    @location(0) @interpolate(flat) map: vec4<f32>,
    // From and until which tolerance, fade, over.
    @location(1) @interpolate(flat) shares: vec4<f32>,
    // Panel, level, slot, levels coarser.
    @location(2) @interpolate(flat) names: vec4<u32>,
    // Of the panel: where it begins in the quilt, and a pixel's sides, m.
    @location(3) @interpolate(flat) panel_px_m: vec4<f32>,
    // The first two eyes; there are seldom more.
    @location(4) @interpolate(flat) eye_0: vec4<f32>,
    @location(5) @interpolate(flat) gaze_0: vec4<f32>,
    @location(6) @interpolate(flat) eye_1: vec4<f32>,
    @location(7) @interpolate(flat) gaze_1: vec4<f32>,
    @location(8) @interpolate(flat) footprint: f32,
    @location(9) @interpolate(flat) turn: vec2<f32>,
}

// A step in the quilt as one along the panel's rows and columns.
fn unturned(turn: vec2<f32>, step: vec2<f32>) -> vec2<f32> {
    if !TURNED {
        return step;
    }
    return vec2<f32>(turn.x * step.x + turn.y * step.y, turn.x * step.y - turn.y * step.x);
}

fn panel_pixel(panel: u32, quilt_px: vec2<f32>) -> vec2<f32> {
    return unturned(panels[panel].turn, quilt_px - panels[panel].origin_px);
}

// The position in the quilt's clip space of a place of a panel.
fn position_of(panel: u32, pixel: vec2<f32>) -> vec4<f32> {
    let turn = panels[panel].turn;
    let step = vec2<f32>(turn.x * pixel.x - turn.y * pixel.y, turn.x * pixel.y + turn.y * pixel.x);
    let quilt = (panels[panel].origin_px + step) / frame.quilt_px;
    return vec4<f32>(2.0 * quilt.x - 1.0, 1.0 - 2.0 * quilt.y, 0.0, 1.0);
}

// The same of a corner of a rectangle of one panel's pixels.
fn corner_position(panel: u32, rect_px: vec4<f32>, corner: u32) -> vec4<f32> {
    let x = select(rect_px.x, rect_px.z, (corner & 1u) == 1u);
    let y = select(rect_px.y, rect_px.w, corner >= 2u);
    return position_of(panel, vec2<f32>(x, y));
}

@vertex
fn flat_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) index: u32) -> FlatVertex {
    let quad = quads[index];
    let row = 2u * quad.panel * frame.eyes;
    let last = row + 2u * max(frame.eyes, 1u) - 2u;
    return FlatVertex(
        corner_position(quad.panel, vec4<f32>(quad.rect_px), corner),
        vec4<f32>(quad.scale, quad.offset),
        vec4<f32>(quad.from_log2, quad.until_log2, quad.fade, quad.over),
        vec4<u32>(quad.panel, quad.level, quad.slot, quad.coarser),
        vec4<f32>(panels[quad.panel].origin_px, panels[quad.panel].pitch_m),
        eyes[row],
        eyes[row + 1u],
        eyes[min(row + 2u, last)],
        eyes[min(row + 2u, last) + 1u],
        flat_footprint(quad.panel),
        panels[quad.panel].turn,
    );
}

fn flat_tolerance_px(vertex: FlatVertex, pixel: vec2<f32>) -> f32 {
    if frame.eyes == 0u {
        return 0.0;
    }
    let place_m = pixel * vertex.panel_px_m.zw;
    let first = allowed_px(vertex.eye_0, vertex.gaze_0, place_m);
    let second = allowed_px(vertex.eye_1, vertex.gaze_1, place_m);
    return least_px(vertex.names.x, place_m, 2u, min(first, second));
}

@fragment
fn flat_fragment(vertex: FlatVertex) -> @location(0) vec4<f32> {
    let panel = vertex.names.x;
    let pixel = unturned(vertex.turn, vertex.position.xy - vertex.panel_px_m.xy);
    // Pages of neighbouring levels overlap; the shares of all that cover a pixel add up to one. They are painted over
    // each other, the coarsest first, and not added up: the target rounds to 8 bits each time, and the sum of two
    // rounded parts differs by a code from either, which is seen as bands where a picture is smooth.
    let tolerance = tolerance_log2(flat_tolerance_px(vertex, pixel), vertex.footprint);
    let below = ramp(vertex.shares.x, tolerance);
    let own = share_of(below, ramp(vertex.shares.y, tolerance));
    let share = own * vertex.shares.z;
    if share <= 0.0 || !in_outline(panel, pixel) {
        discard;
    }
    let texel = vertex.map.xy * pixel + vertex.map.zw;
    let colour = colour_of(vertex.names.z, texel, abs(vertex.map.xy), vertex.names.y, vertex.names.w, panel);
    let mip = panels[panel].mip + frame.bias;
    let place = panels[panel].scale * pixel + panels[panel].offset;
    let tint = tinted(colour, panel, place, vertex.names.y, mip, panels[panel].true_mip, tolerance, vertex.names.w);
    let seen = with_error(tint, 0.0);
    if OVERLAY == 2u {
        return seen;
    }
    let painted_over = below + own * vertex.shares.w;
    return vec4<f32>(seen.rgb, min(share / max(1.0 - painted_over, share), 1.0));
}

// ---------------------------------------------------------------- bent

struct BentVertex {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) panel: u32,
}

@vertex
fn bent_vertex(@builtin(vertex_index) corner: u32, @builtin(instance_index) panel: u32) -> BentVertex {
    let guard = vec2<f32>(panels[panel].guard_px);
    let rect_px = vec4<f32>(-guard, vec2<f32>(panels[panel].size_px) + guard);
    return BentVertex(corner_position(panel, rect_px, corner), panel);
}

fn page_at(texel: vec2<f32>, level: u32) -> vec2<u32> {
    let cell = vec2<u32>(max(texel, vec2<f32>()) / (PAGE * exp2(f32(level))));
    return min(cell, vec2<u32>(levels[level].columns, levels[level].rows) - 1u);
}

fn page_number(cell: vec2<u32>, level: u32) -> u32 {
    return levels[level].first_page + cell.y * levels[level].columns + cell.x;
}

// The number of the page of a level that covers a texel; where the image lies on the surface, texels are counted from the
// panel's first page, so that single precision suffices anywhere in a gigapixel image.
fn cell_of(panel: u32, texel: vec2<f32>, level: u32) -> vec2<u32> {
    if frame.shape != 0u && frame.shape != 4u {
        return page_at(texel, level);
    }
    let fine = vec2<i32>(floor(texel / PAGE)) + panels[panel].first_page;
    let most = vec2<i32>(i32(levels[level].columns), i32(levels[level].rows)) - 1;
    return vec2<u32>(clamp(fine >> vec2<u32>(level), vec2<i32>(), most));
}

// Up to which share the pages of a level and of all finer ones fill a pixel.
fn share_up_to(panel: u32, texel: vec2<f32>, level: u32, tolerance: f32) -> f32 {
    if i32(level) >= frame.top {
        return 1.0;
    }
    return ramp(finer[page_number(cell_of(panel, texel, level + 1u), level + 1u)], tolerance);
}

// A page as far as it has come and faded in, what is behind it where it has not.
fn page_light(panel: u32, place: Place, level: u32, mip: i32, true_mip: i32, tolerance: f32) -> vec4<f32> {
    var light = vec4<f32>();
    var left = 1.0;
    var step = 0u;
    while left > 0.0 && i32(level + step) <= frame.top {
        let cell = cell_of(panel, place.texel, level + step);
        let entry = table[page_number(cell, level + step)];
        if entry == NO_PAGE {
            break;
        }
        let up = entry & 0x1fu;
        let coarser = step + up;
        let shrink = exp2(-f32(level + coarser));
        // Whole pages first: texels may count from the panel's first one.
        let from_page = panels[panel].first_page - vec2<i32>((cell >> vec2<u32>(up)) << vec2<u32>(level + coarser));
        let texel = (place.texel + vec2<f32>(from_page) * PAGE) * shrink;
        let footprint = sqrt(place.right * place.right + place.down * place.down) * shrink;
        let fade = select(f32((entry >> 5u) & 0x7fu) / 127.0, 1.0, OVERLAY == 2u);
        let colour = colour_of(entry >> 12u, texel, footprint, level, coarser, panel);
        light += left * fade * tinted(colour, panel, place.texel, level, mip, true_mip, tolerance, coarser);
        left *= 1.0 - fade;
        step = coarser + 1u;
    }
    return light;
}

// What is drawn at a pixel that shows a place of the image; nothing where no page has come.
fn light_at(panel: u32, pixel: vec2<f32>, place: Place) -> vec4<f32> {
    let tolerance = tolerance_log2(tolerance_px(panel, pixel), footprint_of(place));
    let mip = clamp(mip_of(place, 1.0) + frame.bias, 0, frame.top);
    let true_mip = mip_of(place, panels[panel].true_px);
    var light = vec4<f32>();
    var below = 0.0;
    for (var level = u32(mip); i32(level) <= frame.top && below < 1.0; level++) {
        let above = max(share_up_to(panel, place.texel, level, tolerance), below);
        let share = share_of(below, above);
        below = above;
        if share > 0.0 {
            light += share * page_light(panel, place, level, mip, true_mip, tolerance);
        }
    }
    return vec4<f32>(light.rgb, select(0.0, 1.0, light.a > 0.0));
}

@fragment
fn bent_fragment(vertex: BentVertex) -> @location(0) vec4<f32> {
    let panel = vertex.panel;
    let pixel = panel_pixel(panel, vertex.position.xy);
    let place = place_on_shape(panel, pixel);
    if !place.seen || !in_outline(panel, pixel) {
        discard;
    }
    let light = light_at(panel, pixel, place);
    if light.a <= 0.0 {
        discard;
    }
    return with_error(light, 0.0);
}

// ---------------------------------------------------------------- feedback

@compute @workgroup_size(8, 8)
fn feedback(@builtin(global_invocation_id) id: vec3<u32>) {
    let panel = id.z;
    let at = id.xy * frame.divisor + frame.jitter_px;
    if any(at >= panels[panel].size_px) {
        return;
    }
    let pixel = vec2<f32>(at) + 0.5;
    if !in_outline(panel, pixel) {
        return;
    }
    var texel: vec2<f32>;
    var mip = panels[panel].mip;
    var footprint = flat_footprint(panel);
    if frame.shape == 0u {
        texel = panels[panel].scale * pixel + panels[panel].offset;
        let whole = texel + vec2<f32>(panels[panel].first_page) * PAGE;
        if any(whole < vec2<f32>()) || any(whole >= frame.image_px) {
            return;
        }
    } else {
        let place = place_seen(panel, pixel);
        if !place.seen {
            return;
        }
        texel = place.texel;
        mip = mip_of(place, 1.0);
        footprint = footprint_of(place);
    }
    let tolerance = tolerance_log2(tolerance_px(panel, pixel), footprint);
    var below = 0.0;
    for (var level = u32(clamp(mip + frame.bias, 0, frame.top)); i32(level) <= frame.top && below < 1.0; level++) {
        let above = max(share_up_to(panel, texel, level, tolerance), below);
        if above > below {
            atomicAdd(&coverage[page_number(cell_of(panel, texel, level), level)], 1u);
        }
        below = above;
    }
}
