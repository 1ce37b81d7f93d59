"""What a camera sees of the lit display, against rays cast with plain NumPy; and projectors."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import Quilt, pack
from limen.errors import DeviceLimitError
from limen.frame.simulator_uniforms import BACK, BEZEL, LIT_FRAME, LIT_PANEL, UNLIT
from limen.gpu.shader import shader_text
from limen.gpu.structs import wgsl_struct
from limen.viewing.camera import Camera

Texels = NDArray[np.uint8]
Floats = NDArray[np.float64]
Draw = Callable[..., Texels]

_SIZE_PX = (160, 120)


def linear(srgb: Any) -> Floats:
    code = np.asarray(srgb) / 255.0
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)


def coded(light: Floats) -> Floats:
    return 255 * np.where(light <= 0.0031308, light * 12.92, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055)


# ---------------------------------------------------------------------------- content


def picture_of(panel: Panel, number: int) -> Texels:
    """Red grows to the right, green downward; blue, a chequer and a mark at the top left tell panels apart."""
    width, height = panel.size_px
    y, x = np.mgrid[:height, :width]
    blue = 40 + 150 * ((x // 8 + y // 8) % 2) + 10 * (number % 5)
    picture = np.stack([30 + 220 * x // width, 30 + 220 * y // height, blue], axis=-1).astype(np.uint8)
    picture[: height // 4, : width // 6] = 255
    return picture


def filled(display: Display, quilts: Sequence[Quilt]) -> list[Texels]:
    """The quilts with every panel's picture where the maps put it; magenta, which must never be seen, elsewhere."""
    found = []
    for quilt in quilts:
        texels = np.zeros((quilt.size_px[1], quilt.size_px[0], 4), np.uint8)
        texels[:] = (255, 0, 255, 255)
        for index, quilt_from_panel in zip(quilt.panels, quilt.quilt_from_panel(display), strict=True):
            panel = display.panels[index]
            picture = picture_of(panel, index)
            y, x = np.mgrid[: panel.size_px[1], : panel.size_px[0]] + 0.5
            place = np.stack([x, y], axis=-1).reshape(-1, 2)
            inside = edge_px(panel, place).min(axis=1) >= 0
            column, row = np.floor(place[inside] @ quilt_from_panel[:, :2].T + quilt_from_panel[:, 2]).astype(int).T
            texels[row, column, :3] = picture.reshape(-1, 3)[inside]
        found.append(texels)
    return found


# ---------------------------------------------------------------------------- the plain way


def edge_px(panel: Panel, place_px: Floats) -> Floats:
    """Distance inside every edge of the outline: (N, K)."""
    corners = panel.lit_outline_px
    step = np.roll(corners, -1, axis=0) - corners
    away = place_px[:, None] - corners
    return (step[:, 0] * away[..., 1] - step[:, 1] * away[..., 0]) / np.linalg.norm(step, axis=1)


def bilinear(panel: Panel, picture: Texels, place_px: Floats) -> Floats:
    """Linear light (N, 3) of a panel's own picture, of which only pixels inside the outline count."""
    corner = np.floor(place_px - 0.5).astype(int)
    share = place_px - 0.5 - corner
    total, weight = np.zeros((len(place_px), 3)), np.zeros((len(place_px), 1))
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        column, row = corner[:, 0] + dx, corner[:, 1] + dy
        own = edge_px(panel, np.stack([column, row], axis=1) + 0.5).min(axis=1) >= -1e-3
        w = np.where(dx, share[:, 0], 1 - share[:, 0]) * np.where(dy, share[:, 1], 1 - share[:, 1]) * own
        rows, columns = np.clip(row, 0, picture.shape[0] - 1), np.clip(column, 0, picture.shape[1] - 1)
        total += linear(picture[rows, columns]) * w[:, None]
        weight += w[:, None]
    return total / np.maximum(weight, 1e-6)


def cast(display: Display, camera: Camera, samples: int, *, lit: Sequence[int] | None = None) -> Floats:
    """Codes (H, W, 3) that the camera sees: the nearest panel on every ray."""
    width, height = camera.size_px
    total = np.zeros((height, width, 3))
    places = (np.arange(samples) + 0.5) / samples
    for dy in places:
        for dx in places:
            y, x = np.mgrid[:height, :width]
            rays = camera.rays(np.stack([x + dx, y + dy], axis=-1)).reshape(-1, 3)
            total += cast_rays(display, np.array(camera.eye_m), rays, lit).reshape(height, width, 3)
    return coded(total / samples**2)


def cast_rays(display: Display, eye_m: Floats, rays: Floats, lit: Sequence[int] | None) -> Floats:
    light, nearest = np.zeros((len(rays), 3)), np.full(len(rays), np.inf)
    for index, panel in enumerate(display.panels):
        normal = np.array(panel.normal)
        nudge_m = (np.array(panel.nudge_px) * panel.pitch_m) @ np.array([panel.right, panel.down])
        relative = np.array(panel.origin_m) - nudge_m - eye_m
        slope = rays @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (relative @ normal) / slope
            away = rays * distance[:, None] - relative
        place = np.stack([away @ panel.right, away @ panel.down], axis=1) / panel.pitch_m
        # The camera's near plane: rays are one metre long along its axis.
        hit = (distance > 0.01) & (distance < nearest) & np.isfinite(place).all(axis=1)
        hit[hit] = edge_px(panel, place[hit]).min(axis=1) >= 0
        nearest[hit] = distance[hit]
        cosine = np.abs(slope[hit]) / np.linalg.norm(rays[hit], axis=1)
        if relative @ normal > 0:
            light[hit] = linear(BACK) * (0.35 + 0.65 * cosine)[:, None]
        elif lit is not None and index not in lit:
            light[hit] = linear(UNLIT)
        else:
            shine = cosine**panel.falloff  # the gain is in the pictures
            light[hit] = bilinear(panel, picture_of(panel, index), place[hit]) * shine[:, None]
    return light


# ---------------------------------------------------------------------------- fixtures


@pytest.fixture
def draw(device: Any) -> Iterator[Draw]:
    """Draws a display that shows its pictures; frees everything afterwards."""
    import wgpu

    from limen.frame.simulator import DisplaySimulator

    made: list[Any] = []

    def upload(texels: Texels) -> Any:
        height, width = texels.shape[:2]
        texture = device.wgpu.create_texture(
            size=(width, height, 1),
            format="rgba8unorm-srgb",
            usage=wgpu.TextureUsage.COPY_DST | wgpu.TextureUsage.TEXTURE_BINDING,
        )
        layout = {"bytes_per_row": width * 4, "rows_per_image": height}
        device.wgpu.queue.write_texture({"texture": texture}, np.ascontiguousarray(texels), layout, (width, height, 1))
        made.append(texture)
        return texture

    def drawn(
        display: Display, camera: Camera, quilts: Sequence[Quilt] | None = None, texels: Any = None, **options: Any
    ) -> Texels:
        quilts = pack(display) if quilts is None else quilts
        textures = [upload(one) for one in (filled(display, quilts) if texels is None else texels)]
        lit = DisplaySimulator(device, display, quilts, guard_px=options.pop("guard_px", 0.0))
        try:
            return lit.read(lit.draw(textures, camera, **options))[..., :3]
        finally:
            lit.destroy()

    yield drawn
    for texture in made:
        texture.destroy()


def triangle() -> Display:
    """One tilted triangle of 90 x 70 pixels, oblong ones."""
    right, down = np.array([0.8, 0.36, -0.48]), np.array([0.0, -0.8, -0.6])
    panel = Panel(
        name="sail",
        size_px=(90, 70),
        origin_m=(-0.4, 0.3, 0.1),
        right=tuple(right),
        down=tuple(down),
        pitch_m=(0.01, 0.012),
        outline_px=((3.5, 2.0), (86.0, 30.0), (20.0, 68.0)),
    )
    return Display("sail", (panel,))


def cube() -> Display:
    return Display.preset("cube").scaled(1 / 32)  # 32 x 32 pixels a side


def cave() -> Display:
    return Display.preset("cave").scaled(1 / 32)  # 64 x 64


SCENES = {
    "cube from outside": (cube, Camera((0.5, 1.55, 0.7), (0.0, 1.2, 0.0), _SIZE_PX, 30.0)),
    "cube from below": (cube, Camera((0.3, 0.8, -0.6), (0.0, 1.2, 0.0), _SIZE_PX, 30.0)),
    "cave from inside": (cave, Camera((0.3, 1.6, 0.4), (-0.6, 1.1, -1.5), _SIZE_PX, 80.0)),
    "cave from outside": (cave, Camera((4.0, 4.5, 6.0), (0.0, 1.3, 0.0), _SIZE_PX, 40.0)),
    "tilted triangle": (triangle, Camera((0.2, 0.1, 1.6), (0.0, 0.0, 0.0), _SIZE_PX, 45.0)),
    "its back": (triangle, Camera((0.2, -0.4, -1.6), (0.0, 0.0, 0.0), _SIZE_PX, 45.0)),
    "off the axis, on its side": (
        cube,
        Camera((0.5, 1.55, 0.7), (0.0, 1.2, 0.0), _SIZE_PX, 30.0, up=(1.0, 0.2, 0.0), axis_px=(60.0, 95.0)),
    ),
}


def agree(found: Texels, expected: Floats, *, off: float = 2.0, share: float = 0.003) -> None:
    """Within ``off`` codes everywhere but in a few pixels at edges, where a ray may fall on either side."""
    differs = np.abs(found.astype(float) - expected).max(axis=-1) > off
    assert differs.mean() <= share, f"{differs.sum()} pixels differ, by up to {np.abs(found - expected).max():.0f}"


# ---------------------------------------------------------------------------- tests


@pytest.mark.parametrize(("name", "dtype"), [("Frame", LIT_FRAME), ("Panel", LIT_PANEL)])
def test_the_shader_has_the_dtypes_struct(name: str, dtype: Any) -> None:
    text = re.sub(r"^\s*//.*\n", "", shader_text("limen.frame", "simulator.wgsl"), flags=re.MULTILINE)
    assert wgsl_struct(name, dtype) in text


@pytest.mark.gpu
@pytest.mark.parametrize("scene", SCENES)
def test_the_camera_sees_what_rays_meet(draw: Draw, scene: str) -> None:
    make, camera = SCENES[scene]
    display = make()
    expected = cast(display, camera, samples=3)
    assert expected.std() > 5, "the camera looks past the display"
    # A third of a camera's pixel is less than a quilt's pixel here: beyond, the shader averages and the rays do not.
    agree(draw(display, camera, samples=3), expected)


@pytest.mark.gpu
def test_turned_panels_in_several_quilts_show_the_same(draw: Draw) -> None:
    display, camera = cube(), SCENES["cube from outside"][1]
    side = display.panels[0].size_px[0]
    quilts = [
        Quilt((side, 2 * side), (3, 0), ((0, 0), (0, side)), (1, 2)),
        Quilt((3 * side, side + 9), (4, 1, 2), ((0, 9), (side, 0), (2 * side, 4)), (3, 0, 1)),
    ]
    expected = cast(display, camera, samples=2)
    agree(draw(display, camera, quilts, samples=2), expected)
    np.testing.assert_array_less(
        np.abs(draw(display, camera, quilts, samples=2).astype(int) - draw(display, camera, samples=2)).max(), 2
    )


@pytest.mark.gpu
def test_panels_without_a_quilt_are_unlit(draw: Draw) -> None:
    display, camera = cube(), SCENES["cube from outside"][1]
    quilts = pack(display, panels=[0])
    agree(draw(display, camera, quilts, samples=2), cast(display, camera, 2, lit=[0]))


@pytest.mark.gpu
def test_falloff_is_seen_if_asked_for_and_gain_is_the_pictures_own(draw: Draw) -> None:
    panels = tuple(replace(panel, gain=0.4, falloff=2.0) for panel in cube().panels)
    display, camera = Display("dim", panels), SCENES["cube from outside"][1]
    agree(draw(display, camera, samples=2), cast(display, camera, 2))
    even = draw(display, camera, samples=2, uneven=False)
    agree(even, cast(cube(), camera, 2))


@pytest.mark.gpu
def test_a_nudged_panel_hangs_where_its_picture_is_right(draw: Draw) -> None:
    panels = tuple(replace(panel, nudge_px=(5.0, -3.0)) for panel in cube().panels)
    display, camera = Display("nudged", panels), SCENES["cube from outside"][1]
    agree(draw(display, camera, samples=3), cast(display, camera, 3))


@pytest.mark.gpu
def test_an_eye_among_panels_sees_those_that_reach_behind_it(draw: Draw) -> None:
    """A wall, a floor and a ceiling that pass through the plane of the eye: clipped, not turned inside out."""
    wall = Panel("wall", (200, 100), (-1.0, 1.0, -3.0), (0, 0, 1), (0, -1, 0), (0.03, 0.02))
    floor = Panel("floor", (100, 200), (-1.0, -1.0, -3.0), (1, 0, 0), (0, 0, 1), (0.02, 0.03))
    near = Panel("near", (64, 64), (-0.02, -0.001, -0.2), (1, 0, 0), (0, 0, 1), (0.0005, 0.01))
    display = Display("corridor", (wall, floor, near))
    camera = Camera((0.0, 0.0, 0.0), (-0.2, -0.2, -1.0), _SIZE_PX, 90.0)
    agree(draw(display, camera, samples=3), cast(display, camera, 3), off=4.0, share=0.01)


@pytest.mark.gpu
def test_no_ray_slips_between_panels_that_share_an_edge(draw: Draw) -> None:
    """A closed room of 60 x 60 panels a wall, all white: wherever one looks, nothing but white."""
    count = 12
    axes = np.eye(3)
    panels = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            right, normal = axes[(axis + 1) % 3], -sign * axes[axis]
            down = np.cross(right, normal)
            for u in range(count):
                for v in range(count):
                    origin = sign * axes[axis] + right * (2 * u / count - 1) + down * (2 * v / count - 1)
                    name = f"w{axis}{'+' if sign > 0 else '-'}/{u},{v}"
                    panels.append(
                        Panel(name, (8, 8), tuple(origin), tuple(right), tuple(down), (0.25 / count, 0.25 / count))
                    )
    display = Display("room", tuple(panels))
    quilts = pack(display)
    white = [np.full((quilt.size_px[1], quilt.size_px[0], 4), 255, np.uint8) for quilt in quilts]
    for target in ((1.0, 0.3, 0.2), (-0.4, 0.9, -1.0), (0.1, -1.0, 0.4)):
        camera = Camera((0.013, -0.21, 0.107), target, (320, 240), 100.0)
        assert draw(display, camera, quilts, white, samples=2).min() == 255


@pytest.mark.gpu
def test_a_frame_surrounds_the_picture_and_never_covers_a_neighbour(draw: Draw) -> None:
    side, pitch_m, bezel_m = 64, 0.01, 0.08
    one = Panel("one", (side, side), (-0.64, 0.32, 0.0), (1, 0, 0), (0, -1, 0), (pitch_m, pitch_m), bezel_m=bezel_m)
    other = replace(one, name="other", origin_m=(0.0, 0.32, 0.0), bezel_m=0.0)
    display, camera = Display("two", (one, other)), Camera((0.0, 0.0, 2.0), (0, 0, 0), (200, 120), 40.0)
    found = draw(display, camera, samples=2).astype(int)
    y, x = np.mgrid[:120, :200] + 0.5
    rays = camera.rays(np.stack([x, y], axis=-1)) * 2.0
    left, above = rays[..., 0], rays[..., 1]
    margin = 0.02
    lit = (np.abs(left) < 0.64 - margin) & (np.abs(above) < 0.32 - margin) & (np.abs(left) > margin)
    around = (left > -0.72 + margin) & (left < 0 - margin) & (np.abs(above) < 0.4 - margin)
    frame = around & ((left < -0.64 - margin) | (np.abs(above) > 0.32 + margin))
    beyond = (left < -0.72 - margin) | (np.abs(above) > 0.4 + margin)
    assert (np.abs(found[frame] - BEZEL) <= 1).all()
    assert (found[beyond] == 0).all()
    assert (found[lit].max(axis=-1) > 40).all()
    dark = draw(display, camera, samples=2, frames=False)
    assert (dark[frame] == 0).all()
    np.testing.assert_array_equal(dark[lit], found[lit])


@pytest.mark.gpu
def test_the_guard_band_is_read_and_nothing_beyond_it(draw: Draw) -> None:
    """A panel that is white, its guard band too, in a quilt that is red beyond: white to the very edge."""
    display = triangle()
    quilt = Quilt((120, 100), (0,), ((15, 15),))
    y, x = np.mgrid[:100, :120] + 0.5
    inside = (
        edge_px(display.panels[0], np.stack([x - 15, y - 15], axis=-1).reshape(-1, 2)).min(axis=1).reshape(100, 120)
    )
    camera = SCENES["tilted triangle"][1]
    for guard_px in (0.0, 1.5):
        texels = np.zeros((100, 120, 4), np.uint8)
        texels[:] = (255, 0, 0, 255)
        texels[inside >= -guard_px] = 255
        found = draw(display, camera, [quilt], [texels], guard_px=guard_px, samples=1).astype(int)
        assert found.max() == 255
        assert (found[..., 0] - found[..., 1]).max() <= 1


@pytest.mark.gpu
def test_each_eye_has_its_copy(draw: Draw) -> None:
    display, camera = cube(), SCENES["cube from outside"][1]
    quilts = pack(display)
    (texels,) = filled(display, quilts)
    both = np.concatenate([np.zeros_like(texels), texels], axis=1)
    one = draw(display, camera, quilts, [texels])
    agree(draw(display, camera, quilts, [both], copy=1), one.astype(float), off=1.0, share=0.0)
    assert draw(display, camera, quilts, [both], copy=0, frames=False).max() == 0


@pytest.mark.gpu
@pytest.mark.parametrize("zoom", [1.0, 2.9, 7.3])
def test_a_fine_pattern_far_away_is_its_mean_light(draw: Draw, zoom: float) -> None:
    """Stripes one pixel wide, up to 22 to a camera's pixel: half the light, code 188, and no moire."""
    panel = Panel("far", (1500, 1000), (-0.75, 0.5, -1.0), (1, 0, 0), (0, -1, 0), (0.001, 0.001))
    display = Display("far", (panel,))
    quilts = pack(display)
    texels = np.full((1000, 1500, 4), 255, np.uint8)
    texels[::2, ::2, :3] = 0
    texels[1::2, 1::2, :3] = 0
    height = round(333 / zoom)
    fov_deg = 2 * np.degrees(np.arctan(0.4))
    camera = Camera((0.0, 0.0, 0.0), (0.1, 0.0, -1.0), (round(1.2 * height), height), float(fov_deg))
    found = draw(display, camera, quilts, [texels], samples=3).astype(float)
    assert abs(found.mean() - 188) < 1.5
    assert found.std() < 4


@pytest.mark.gpu
def test_a_projector_lights_the_panels_with_their_own_pictures(draw: Draw) -> None:
    """A projector's picture, thrown back on the panels, is the quilt: 45 dB, and often more."""
    display = cube()
    projector = Camera((0.5, 1.7, 0.8), (0.0, 1.2, 0.0), (1280, 960), 34.0, axis_px=(600.0, 460.0))
    quilts = pack(display)
    soft = [blurred(texels) for texels in filled(display, quilts)]
    thrown = draw(display, projector, quilts, soft, samples=3, uneven=False, frames=False)
    reached = 0
    for quilt, texels in zip(quilts, soft, strict=True):
        for index, (left, top) in zip(quilt.panels, quilt.offsets_px, strict=True):
            panel = display.panels[index]
            if np.dot(np.array(projector.eye_m) - panel.centre_m, panel.normal) < 0:
                continue
            y, x = np.mgrid[: panel.size_px[1], : panel.size_px[0]] + 0.5
            place, _ = projector.project(panel.position_m(np.stack([x, y], axis=-1)))
            assert (place >= 1).all()
            assert (place <= np.array(projector.size_px) - 1).all()
            back = coded(sampled(thrown, place))
            own = texels[top : top + panel.size_px[1], left : left + panel.size_px[0], :3]
            error = np.mean((back - own) ** 2)
            assert 10 * np.log10(255**2 / error) >= 45, panel.name
            reached += 1
    assert reached == 3


def blurred(texels: Texels) -> Texels:
    """Softer than a pixel, as content is that was drawn without aliasing."""
    from scipy.ndimage import gaussian_filter

    return np.rint(gaussian_filter(texels.astype(float), (0.8, 0.8, 0))).astype(np.uint8)


def sampled(picture: Texels, place: Floats) -> Floats:
    """Linear light between the pixels of a picture."""
    from scipy.ndimage import map_coordinates

    x, y = place[..., 0] - 0.5, place[..., 1] - 0.5
    light = linear(picture)
    return np.stack([map_coordinates(light[..., band], [y, x], order=1) for band in range(3)], axis=-1)


@pytest.mark.gpu
def test_what_cannot_be_drawn_is_said(device: Any, draw: Draw) -> None:
    from limen.frame.simulator import DisplaySimulator

    display = cube()
    with pytest.raises(ValueError, match="at least one quilt"):
        DisplaySimulator(device, display, [])
    with pytest.raises(ValueError, match="as many textures, got 2"):
        draw(display, SCENES["cube from outside"][1], None, filled(display, pack(display)) * 2)
    with pytest.raises(ValueError, match="holds no copy 1"):
        draw(display, SCENES["cube from outside"][1], copy=1)
    with pytest.raises(ValueError, match="samples must be from 1"):
        draw(display, SCENES["cube from outside"][1], samples=0)
    huge = Camera((0, 0, 1), (0, 0, 0), (device.max_texture_px + 1, 4))
    with pytest.raises(DeviceLimitError, match="make it smaller"):
        draw(display, huge)


@pytest.mark.gpu
def test_cameras_of_several_sizes_take_turns(device: Any) -> None:
    """Nothing is left of the last picture, and nothing on the adapter afterwards."""
    import wgpu

    from limen.frame.simulator import DisplaySimulator

    display = cube()
    quilts = pack(display)
    size = quilts[0].size_px
    texture = device.wgpu.create_texture(
        size=(*size, 1), format="rgba8unorm-srgb", usage=wgpu.TextureUsage.COPY_DST | wgpu.TextureUsage.TEXTURE_BINDING
    )
    layout = {"bytes_per_row": size[0] * 4, "rows_per_image": size[1]}
    device.wgpu.queue.write_texture({"texture": texture}, filled(display, quilts)[0], layout, (*size, 1))
    camera = SCENES["cube from outside"][1]
    before = living()
    lit = DisplaySimulator(device, display, quilts)
    first = lit.read(lit.draw([texture], camera))
    lit.draw([texture], replace(camera, size_px=(64, 48)))
    lit.draw([texture], replace(camera, target_m=(9.0, 9.0, 9.0)), samples=1)
    np.testing.assert_array_equal(lit.read(lit.draw([texture], camera)), first)
    lit.destroy()
    assert living() == before
    texture.destroy()


def living() -> dict[str, int]:
    """How many objects of each kind the adapter holds for us."""
    import gc

    import wgpu

    gc.collect()
    counts = wgpu.diagnostics.object_counts.get_dict()
    return {
        name: row["count"]
        for name, row in counts.items()
        if name in ("Buffer", "Texture", "BindGroupLayout", "RenderPipeline", "Sampler")
    }
