// after: gpu/colour.wgsl, gpu/page.wgsl, terrain_common.wgsl
// Draws a terrain's patches on panels: first the depth of what is nearest, from vertices, and then every pixel's colour
// once, from pages, at its own level. The depth is near / w, so a pixel's place follows from it.
//
// Vertices are whole posts, counted from a post near the eye, so that nothing jitters far from the raster's corner. What
// lies outside a panel's outline and guard band is cut away in the fragment stage; terrain_clip.wgsl has the vertex stage
// for adapters that clip by distances, which are spared it.

// 0: by height. 1: one grey. 2: the image that lies over the terrain.
override COLOURS: u32 = 0u;
override CONTOURS: bool = false;
// Every panel in its tint.
override PANELS: bool = false;
// Some page is not all there yet; else the coarser ones behind it need not be looked for.
override FADING: bool = true;
// There are posts without data.
override HOLES: bool = false;

const PAGE_BITS: u32 = 8u;
const RELIEF: u32 = 0u;
const HEIGHTS: u32 = 1u;
const DRAPE: u32 = 2u;
const LAST_TINT: f32 = 18.0;
const GREY = vec3<f32>(0.6, 0.58, 0.55);
const CONTOUR = vec3<f32>(0.09, 0.04, 0.012);

// Pages of one raster or image.
struct Source {
    // Two rows: texels along x and y for a step of one column, one row.
    texel_from_post: vec4<f32>,
    // The origin post's texel: whole, and the rest.
    offset: vec2<f32>,
    origin: vec2<i32>,
    size_px: vec2<i32>,
    // Of one texel of a layer of the pool: one over powers of two.
    per_texel: vec2<f32>,
    top: u32,
    // 0 until the coarsest page is there; from then on every page has one to stand for it.
    ready: u32,
    padding: vec2<u32>,
    // The table's entry of every level's first page.
    entries: array<vec4<u32>, 6>,
}

struct Varyings {
    @builtin(position) position: vec4<f32>,
    // Column, row and height, counted from the origin.
    @location(0) place: vec3<f32>,
    @location(1) @interpolate(flat) patch_number: u32,
}

struct CutVaryings {
    @builtin(position) position: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) @interpolate(flat) patch_number: u32,
    // Pixels inside the first and the last four edges, times w.
    @location(2) inside: vec4<f32>,
    @location(3) inside_too: vec4<f32>,
}

struct Surface {
    place: vec3<f32>,
    // How the place changes over a pixel.
    right: vec3<f32>,
    down: vec3<f32>,
}

@group(0) @binding(2) var<uniform> sources: array<Source, 3>;
// Per page of all sources: slot << 12 | faded in (of 127) << 5 | levels coarser.
@group(0) @binding(3) var<storage, read> table: array<u32>;
@group(0) @binding(4) var relief_pool: texture_2d_array<f32>;
@group(0) @binding(5) var heights_pool: texture_2d_array<f32>;
@group(0) @binding(6) var drape_pool: texture_2d_array<f32>;
@group(0) @binding(7) var bilinear: sampler;
@group(1) @binding(0) var depths: texture_2d<f32>;

// ---------------------------------------------------------------- geometry

@vertex
fn vertex(in: Vertex) -> CutVaryings {
    let place = placed(in);
    var out: CutVaryings;
    out.position = position(place);
    for (var k = 0u; k < 4u; k++) {
        out.inside[k] = dot(view.edges[k], place);
        out.inside_too[k] = dot(view.edges[k + 4u], place);
    }
    out.place = place.xyz;
    out.patch_number = in.patch_number;
    return out;
}

// A panel's outline and guard band: a fan of triangles about its first corner.
@vertex
fn outline(@builtin(vertex_index) number: u32) -> @builtin(position) vec4<f32> {
    let side = number % 3u;
    // At depth 0: before nothing, and behind all that is drawn.
    return view.corners[select(number / 3u + side, 0u, side == 0u)];
}

// ---------------------------------------------------------------- pages

// The share of heights' range, how it grows with a texel along x and y, and the share of valid posts. Decoded before texels
// are blended: samplers blend bytes to some 8 bits, where the height has 24.
fn height_at(slot: Slot, texel: vec2<f32>) -> vec4<f32> {
    let first = floor(texel - 0.5);
    let behind = texel - 0.5 - first;
    let at = vec2<i32>(slot.corner + first);
    var rows = array<vec3<f32>, 2>();
    for (var k = 0; k < 2; k++) {
        let left = height_of(textureLoad(heights_pool, at + vec2<i32>(0, k), slot.layer, 0));
        let right = height_of(textureLoad(heights_pool, at + vec2<i32>(1, k), slot.layer, 0));
        let middle = mix(left, right, behind.x);
        rows[k] = vec3<f32>(middle.x, right.x - left.x, middle.y);
    }
    let height = mix(rows[0], rows[1], behind.y);
    return vec4<f32>(height.xy, rows[1].x - rows[0].x, height.z);
}

fn height_of(texel: vec4<f32>) -> vec2<f32> {
    let code = dot(round(texel.rgb * 255.0), vec3<f32>(65536.0, 256.0, 1.0));
    return vec2<f32>(code / 16777215.0, texel.a);
}

fn texel_at(source: u32, slot: u32, texel: vec2<f32>) -> vec4<f32> {
    let place = place_of_slot(slot);
    // At a page's rim the sampler reads half a texel farther, which the gutter holds.
    let inside = clamp(texel, vec2<f32>(1.0 - GUTTER), vec2<f32>(PAGE + GUTTER - 1.0));
    if source == HEIGHTS {
        return height_at(place, inside);
    }
    // Counted so that nothing is rounded, and the same is read in every slot.
    let at = (place.corner + floor(inside * 2048.0 + 0.5) / 2048.0) * sources[source].per_texel;
    if source == RELIEF {
        return textureSampleLevel(relief_pool, bilinear, at, place.layer, 0.0);
    }
    return textureSampleLevel(drape_pool, bilinear, at, place.layer, 0.0);
}

struct Seen {
    light: vec4<f32>,
    // How far its page has faded in, and of which level it is.
    fade: f32,
    level: u32,
}

// What the page of a level, or a coarser one in its stead, shows at a place, which is counted in texels of full
// resolution: from the source's origin, and in whole ones from its corner.
fn page_seen(source: u32, fine: vec2<f32>, whole: vec2<i32>, level: u32) -> Seen {
    let bits = vec2<u32>(level + PAGE_BITS);
    let cell = vec2<u32>(whole >> bits);
    let columns = u32((sources[source].size_px.x - 1) >> bits.x) + 1u;
    let entry = table[sources[source].entries[level >> 2u][level & 3u] + cell.y * columns + cell.x];
    let up = entry & 0x1fu;
    let shown = level + up;
    let corner = vec2<i32>((cell >> vec2<u32>(up)) << vec2<u32>(shown + PAGE_BITS));
    let per_texel = bitcast<f32>((127u - shown) << 23u);  // 2 to the power of -shown
    let texel = (vec2<f32>(sources[source].origin - corner) + fine) * per_texel;
    var light = texel_at(source, entry >> 12u, texel);
    if source == HEIGHTS {
        light = vec4<f32>(light.x, light.yz * per_texel, light.w);
    }
    return Seen(light, f32((entry >> 5u) & 0x7fu) / 127.0, shown);
}

// What pages of one level show: each as far as it has come and faded in, what is coarser where it has not.
fn page_light(source: u32, fine: vec2<f32>, whole: vec2<i32>, level: u32) -> vec4<f32> {
    var seen = page_seen(source, fine, whole, level);
    if !FADING {
        return seen.light;
    }
    var light = seen.fade * seen.light;
    var left = 1.0 - seen.fade;
    while left > 0.0 && seen.level < sources[source].top {
        seen = page_seen(source, fine, whole, seen.level + 1u);
        light += left * seen.fade * seen.light;
        left *= 1.0 - seen.fade;
    }
    return light;
}

fn texels_from(source: u32, step: vec2<f32>) -> vec2<f32> {
    let map = sources[source].texel_from_post;
    return vec2<f32>(dot(map.xy, step), dot(map.zw, step));
}

// The source at a place, where the larger side of a pixel (Heckbert 1983), and detail that may be lost, ask for a level.
fn sampled(source: u32, at: Surface) -> vec4<f32> {
    let across = texels_from(source, at.right.xy);
    let along = texels_from(source, at.down.xy);
    let footprint2 = max(dot(across, across), dot(along, along));
    let wanted = 0.5 * log2(max(footprint2, 1e-30)) + view.tolerance_log2;
    let level = clamp(wanted, 0.0, f32(sources[source].top));
    let fine = texels_from(source, at.place.xy) + sources[source].offset;
    let lower = u32(level);
    let whole = clamp(sources[source].origin + vec2<i32>(floor(fine)), vec2<i32>(), sources[source].size_px - 1);
    let light = page_light(source, fine, whole, lower);
    let share = level - f32(lower);
    if share <= 0.0 {
        return light;
    }
    return mix(light, page_light(source, fine, whole, lower + 1u), share);
}

fn in_source(source: u32, place: vec2<f32>) -> bool {
    let texel = texels_from(source, place) + sources[source].offset + vec2<f32>(sources[source].origin);
    return all(texel >= vec2<f32>()) && all(texel <= vec2<f32>(sources[source].size_px));
}

// ---------------------------------------------------------------- colours

fn tint_of(height_m: f32) -> vec3<f32> {
    if height_m <= terrain.sea_level_m {
        return terrain.sea.rgb;
    }
    let at = clamp((height_m - terrain.tint_from_m) * terrain.tints_per_m, 0.0, LAST_TINT);
    let first = u32(at);
    return mix(terrain.ramp[first].rgb, terrain.ramp[first + 1u].rgb, at - f32(first));
}

// How much of a pixel lines at multiples of an interval cover. They fade where they come nearer to each other than 4 px;
// on a level, which would be one line all over, there is none.
fn line_share(height_m: f32, interval_m: f32, slope_m_per_px: f32, width_px: f32) -> f32 {
    let apart_px = interval_m / max(slope_m_per_px, 1e-30);
    let lines = height_m / interval_m;
    let away_px = abs(lines - round(lines)) * apart_px;
    let cover = clamp(0.5 * width_px + 0.5 - away_px, 0.0, 1.0);
    return select(0.0, cover * smoothstep(4.0, 8.0, apart_px), apart_px < 1e4);
}

fn contoured(colour: vec3<f32>, height_m: f32, slope_m_per_px: f32) -> vec3<f32> {
    let interval = terrain.contour_interval_m;
    let fine = 0.5 * line_share(height_m, interval, slope_m_per_px, 1.2);
    let fifth = 0.85 * line_share(height_m, 5.0 * interval, slope_m_per_px, 1.8);
    return mix(colour, CONTOUR, max(fine, fifth));
}

// Lambert's law, of the terrain as it is exaggerated. The mean of normals is shorter than one where they differ, and its
// light is the mean of theirs.
fn lit(normal: vec3<f32>) -> f32 {
    let stretched = normal / vec3<f32>(1.0, 1.0, terrain.exaggeration);
    let direction = stretched * (length(normal) / max(length(stretched), 1e-30));
    return mix(max(dot(direction, terrain.sun.xyz), 0.0), 1.0, terrain.sun.w);
}

// Of the triangle, from how places change over a pixel: metres east, north and up.
fn facet(right: vec3<f32>, down: vec3<f32>) -> vec3<f32> {
    let metric = vec3<f32>(terrain.spacing_m.x, -terrain.spacing_m.y, 1.0);
    let normal = cross(right * metric, down * metric);
    return normal * (select(-1.0, 1.0, normal.z >= 0.0) / max(length(normal), 1e-30));
}

// Linear light; a hue lies over the colour by its share.
fn light(at: Surface, normal: vec3<f32>, hue: vec4<f32>) -> vec3<f32> {
    var height_m = at.place.z + terrain.origin_height_m;
    var slope_m_per_px = length(vec2<f32>(at.right.z, at.down.z));
    if (COLOURS == 0u || CONTOURS) && sources[HEIGHTS].ready != 0u {
        let share = sampled(HEIGHTS, at);
        height_m = terrain.low_m + share.x * terrain.range_m;
        slope_m_per_px = length(vec2<f32>(dot(share.yz, at.right.xy), dot(share.yz, at.down.xy))) * terrain.range_m;
    }
    var colour = GREY;
    if COLOURS == 0u {
        colour = tint_of(height_m);
    }
    if COLOURS == 2u && sources[DRAPE].ready != 0u && in_source(DRAPE, at.place.xy) {
        let drape = sampled(DRAPE, at);
        colour = mix(colour, drape.rgb, drape.a);
    }
    colour = mix(colour, hue.rgb, hue.a) * lit(normal);
    if CONTOURS {
        colour = contoured(colour, height_m, slope_m_per_px);
    }
    return colour;
}

// Of the unit normal, coded, and the share of valid posts.
fn relief(at: Surface) -> vec4<f32> {
    return sampled(RELIEF, at);
}

fn is_hole(at: Surface) -> bool {
    return HOLES && sources[RELIEF].ready != 0u && relief(at).a < 0.5;
}

fn depth_at(pixel: vec2<i32>) -> f32 {
    return textureLoad(depths, pixel, 0).x;
}

// The smaller of two steps: depth is linear on a plane, and the larger one may lead to what lies behind.
fn step(before: f32, here: f32, after: f32) -> f32 {
    return select(after - here, here - before, abs(here - before) < abs(after - here));
}

// The colour of what is nearest in every pixel of a panel.
@fragment
fn picture(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return picture_at(position);
}

fn picture_at(position: vec4<f32>) -> vec4<f32> {
    let pixel = vec2<i32>(position.xy);
    let depth = depth_at(pixel);
    let right = step(depth_at(pixel - vec2(1, 0)), depth, depth_at(pixel + vec2(1, 0))) / depth;
    let down = step(depth_at(pixel - vec2(0, 1)), depth, depth_at(pixel + vec2(0, 1))) / depth;
    let way = view.way.xyz + position.x * view.way_right.xyz + position.y * view.way_down.xyz;
    let at = Surface(
        view.eye.xyz + way / depth, (view.way_right.xyz - right * way) / depth, (view.way_down.xyz - down * way) / depth
    );
    var normal = facet(at.right, at.down);
    if sources[RELIEF].ready != 0u {
        normal = relief(at).xyz * (255.0 / 127.5) - 1.0;
    }
    var colour = light(at, normal, vec4<f32>());
    if PANELS {
        colour = mix(colour, view.tint.rgb * (0.3 + 0.7 * lit(normal)), view.tint.a);
    }
    return vec4<f32>(colour, 1.0);
}

// The same where depth is not attached, and so tests nothing.
@fragment
fn picture_alone(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    if depth_at(vec2<i32>(position.xy)) <= 0.0 {
        discard;
    }
    return picture_at(position);
}

struct Deep {
    @location(0) colour: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}

// The same among other things, which have their own depth.
@fragment
fn picture_deep(@builtin(position) position: vec4<f32>) -> Deep {
    let depth = depth_at(vec2<i32>(position.xy));
    if depth <= 0.0 {
        discard;
    }
    return Deep(picture_at(position), depth);
}

// Every triangle flat, every patch in a hue of its own.
fn flat_light(at: Surface, patch_number: u32) -> vec4<f32> {
    return vec4<f32>(light(at, facet(at.right, at.down), vec4<f32>(hue(patch_number), 0.35)), 1.0);
}

fn is_cut(in: CutVaryings) -> bool {
    return any(min(in.inside, in.inside_too) < vec4(0.0));
}

// Of a triangle that is being drawn.
fn surface(place: vec3<f32>) -> Surface {
    return Surface(place, dpdx(place), dpdy(place));
}

@fragment
fn solid(in: Varyings) {
    if is_hole(surface(in.place)) {
        discard;
    }
}

@fragment
fn cut_solid(in: CutVaryings) {
    if is_hole(surface(in.place)) || is_cut(in) {
        discard;
    }
}

// On OpenGL, whose clip space is from -w to w: wgpu makes z of it by 2 z - w, so that of a depth near 0, which is what
// counts far away, only the first of 24 bits are left. So the depth is computed once more. position.w is 1 / w here.
@fragment
fn deep(in: Varyings) -> @builtin(frag_depth) f32 {
    if is_hole(surface(in.place)) {
        discard;
    }
    return view.near * in.position.w;
}

@fragment
fn cut_deep(in: CutVaryings) -> @builtin(frag_depth) f32 {
    if is_hole(surface(in.place)) || is_cut(in) {
        discard;
    }
    return view.near * in.position.w;
}

@fragment
fn patches(in: Varyings) -> @location(0) vec4<f32> {
    let at = surface(in.place);
    if is_hole(at) {
        discard;
    }
    return flat_light(at, in.patch_number);
}

@fragment
fn cut_patches(in: CutVaryings) -> @location(0) vec4<f32> {
    let at = surface(in.place);
    if is_hole(at) || is_cut(in) {
        discard;
    }
    return flat_light(at, in.patch_number);
}
