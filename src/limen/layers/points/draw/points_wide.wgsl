// after: splat.wgsl
// The nearest splat of every pixel in one pass, for adapters with 64-bit atomics: depth in the upper half of a key, the
// pair's id in the lower. What is placed, and which pixels it covers, is as in points.wgsl.

@group(0) @binding(9) var<storage, read_write> keys: array<atomic<u64>>;

@compute @workgroup_size(128)
fn nearest_wide(@builtin(global_invocation_id) id: vec3<u32>) {
    let row = id.x + id.y * ROW;
    let pair = cloud.first + row;
    if pair >= cloud.end || placed[row].depth == 0u {
        return;
    }
    let splat = placed[row];
    let key = (u64(splat.depth) << 32u) | u64(NONE - pair);
    let first = pixel_of(splat.first);
    let last = pixel_of(splat.last);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            if covers(splat, vec2(x, y)) {
                atomicMax(&keys[y * cloud.stride + x], key);
            }
        }
    }
}
