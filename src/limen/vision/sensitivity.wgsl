// Contrast sensitivity and resolution of the eye, for shaders: the twin of limen.vision.contrast.sensitivity and
// limen.vision.resolution.resolution_cpd (achromatic mechanism, models castle and human).
//
// castleCSF: Ashraf, Mantiuk, Chapiro, Wuerger 2024, Journal of Vision 24(4):5.
// Resolution: Ashraf, Chapiro, Mantiuk 2025, Nature Communications.
//
// Valid alone; another shader is appended to it. Its one binding is limen.vision.tables.sensitivity_tables().buffer.

@group(1) @binding(0) var<storage, read> eye_tables: array<f32>; // sustained 32 x 32, transient 32 x 32, scale 32

// The nasal visual field, the more sensitive one; sensitivity falls by 10^-((k0 + k1 frequency) eccentricity).
override falloff_k0: f32 = 0.0400662;
override falloff_k1: f32 = 0.00813619;

const TABLE_SIDE = 32u;
const TRANSIENT_TABLE = 1024u;
const SCALE_TABLE = 2048u;
const LOWEST_CPD = 0.0625;
const HIGHEST_CPD = 64.0;
const DARKEST_CD_M2 = 0.0113;
const BRIGHTEST_CD_M2 = 10000.0;
const LOG2_10 = 3.321928094887362;
const LOG10_2 = 0.301029995663981;

// Weights of the cubic through the nodes 0, 1, 2, 3 (Lagrange).
fn eye_cubic(place: f32) -> vec4f {
    let a = place;
    let b = place - 1.0;
    let c = place - 2.0;
    let d = place - 3.0;
    return vec4f(-b * c * d / 6.0, a * c * d / 2.0, -a * b * d / 2.0, a * b * c / 6.0);
}

// Place on an axis of the tables, in cells; the axes are even in the logarithm.
fn eye_place(value: f32, lowest: f32, highest: f32) -> f32 {
    return log2(value / lowest) / log2(highest / lowest) * f32(TABLE_SIDE - 1u);
}

// First of the four nodes around a place; the end cells use the four at the end.
fn eye_node(place: f32) -> u32 {
    return u32(clamp(floor(place) - 1.0, 0.0, f32(TABLE_SIDE - 4u)));
}

fn eye_row(first: u32, weights: vec4f) -> f32 {
    let four = vec4f(eye_tables[first], eye_tables[first + 1u], eye_tables[first + 2u], eye_tables[first + 3u]);
    return dot(weights, four);
}

fn eye_table(table: u32, frequency_cpd: f32, luminance_cd_m2: f32) -> f32 {
    let along = eye_place(frequency_cpd, LOWEST_CPD, HIGHEST_CPD);
    let down = eye_place(luminance_cd_m2, DARKEST_CD_M2, BRIGHTEST_CD_M2);
    let column = eye_node(along);
    let row = eye_node(down);
    let weights = eye_cubic(along - f32(column));
    let first = table + row * TABLE_SIDE + column;
    let rows = vec4f(
        eye_row(first, weights),
        eye_row(first + TABLE_SIDE, weights),
        eye_row(first + 2u * TABLE_SIDE, weights),
        eye_row(first + 3u * TABLE_SIDE, weights),
    );
    return dot(eye_cubic(down - f32(row)), rows);
}

// log10 of what summing over the grating's area multiplies: Rovamo, Luntinen, Nasanen 1993.
fn eye_summed(frequency_cpd: f32, area_deg2: f32, critical_deg2: f32, integration_cpd: f32) -> f32 {
    let ratio = frequency_cpd / integration_cpd;
    let critical = critical_deg2 / (1.0 + ratio * ratio);
    return LOG10_2 * (log2(frequency_cpd) + 0.5 * log2(critical / (1.0 + critical / area_deg2)));
}

// x^power for x of 0 or more; pow(0, ...) is not defined everywhere.
fn eye_power(x: f32, power: f32) -> f32 {
    return select(pow(max(x, 1e-30), power), 0.0, x <= 0.0);
}

// One over the smallest visible contrast. Frequency is clamped to 1/16 ... 64, luminance to 0.0113 ... 10000.
fn sensitivity(
    frequency_cpd: f32, eccentricity_deg: f32, luminance_cd_m2: f32, temporal_hz: f32, area_deg2: f32,
) -> f32 {
    let rho = clamp(frequency_cpd, LOWEST_CPD, HIGHEST_CPD);
    let light = clamp(luminance_cd_m2, DARKEST_CD_M2, BRIGHTEST_CD_M2);
    let area = max(area_deg2, 1e-9);

    var band = eye_table(0u, rho, light);
    let peak_cpd = 1.78119 * pow(1.0 + 91.5718 / light, -0.256682);
    if rho < peak_cpd { // below its peak the log-parabola falls to 1 - 0.100207 and no further
        band = max(band, eye_table(0u, peak_cpd, light) + LOG10_2 * log2(1.0 - 0.100207));
    }
    let slow = exp(-eye_power(temporal_hz, 1.3314) / 10.5795);
    let sustained = slow * exp2(LOG2_10 * (band + eye_summed(rho, area, 157.103, 0.702338)));

    let best_hz = 2.41482 * LOG10_2 * log2(light) + 4.7036;
    let off = eye_power(temporal_hz, 0.1898) - eye_power(best_hz, 0.1898);
    let fast = exp(-off * off / 0.0844836);
    let quick = eye_table(TRANSIENT_TABLE, rho, light) + eye_summed(rho, area, 3.81611, 3.01389);
    let transient = fast * exp2(LOG2_10 * quick);

    return (sustained + transient) * exp2(-LOG2_10 * (falloff_k0 + falloff_k1 * rho) * eccentricity_deg);
}

// The highest frequency that people resolve at full contrast, cycles per degree.
fn resolution_cpd(eccentricity_deg: f32, luminance_cd_m2: f32) -> f32 {
    let light = clamp(luminance_cd_m2, DARKEST_CD_M2, BRIGHTEST_CD_M2);
    let down = eye_place(light, DARKEST_CD_M2, BRIGHTEST_CD_M2);
    let row = eye_node(down);
    let scale = eye_row(SCALE_TABLE + row, eye_cubic(down - f32(row)));
    let at_100 = (LOG10_2 * log2(1.0949) - 2.13475) / (-0.043936 * (1.0 + 0.160080 * eccentricity_deg));
    return at_100 * exp2(LOG2_10 * scale);
}
