// Pages in layers of a pool: 256 texels a side and a gutter around them, so many a layer (limen.gpu.pool).

const PAGE: f32 = 256.0;
const GUTTER: f32 = 4.0;
const SIDE: f32 = 264.0;
const COLUMNS: u32 = 15u;

struct Slot {
    corner: vec2<f32>,
    layer: i32,
}

fn place_of_slot(slot: u32) -> Slot {
    let row = slot / COLUMNS;
    let cell = vec2<f32>(f32(slot % COLUMNS), f32(row % COLUMNS));
    return Slot(cell * SIDE + GUTTER, i32(row / COLUMNS));
}
