// A panel of a quilt as one eye sees it: linear forms of the way from the eye (limen.layers.common.panel_uniforms).

struct PanelView {
    x: vec4<f32>,
    y: vec4<f32>,
    w: vec4<f32>,
    // Signed pixels inside an edge and its guard, times w; and a number of the way of sorting.
    edges: array<vec4<f32>, 8>,
    // Toward the corners; and a number of the way of sorting.
    corners: array<vec4<f32>, 8>,
    corner_count: u32,
    eye: u32,
    padding: vec2<u32>,
}
