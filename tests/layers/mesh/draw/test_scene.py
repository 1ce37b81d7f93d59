"""A mesh drawn into quilts: what panels show together is what the eye would see without them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.panel import Panel
from limen.display.quilt import Quilt, pack, pieces
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.mesh.layer import MeshLayer, MeshPart
from limen.viewing.choices import Stereo
from limen.viewing.projection import GUARD_PX, QuiltPanels
from limen.viewing.viewer import Viewer
from support.displays import DISPLAYS
from support.drawing import BLACK, NOWHERE, Easel, drawn_mesh, mesh_view
from support.frames import frame_of, row_of
from support.meshes import plain, square

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

HERE = RoomPlacement(matrix=NOWHERE)


def facing_panel(size_px: tuple[int, int] = (64, 48), **fields: Any) -> Display:
    """One panel of 0.64 x 0.48 m around the origin, looked at along -z."""
    panel = Panel(
        "only", size_px, (-0.32, 0.24, 0.0), (1, 0, 0), (0, -1, 0), (0.64 / size_px[0], 0.48 / size_px[1]), **fields
    )
    return Display("only", (panel,))


def quilt_of(display: Display) -> Quilt:
    """The panel itself where there is one, else all in a quilt with gaps."""
    (quilt,) = pack(display) if len(display.panels) == 1 else pack_outlines(display)
    return quilt


def depth_in_outlines(display: Display, quilt: Quilt, rows: Any) -> NDArray[np.float64]:
    """How far inside the nearest outline the pixels of a quilt lie, pixels: shape (H, W)."""
    y, x = np.mgrid[: quilt.size_px[1], : quilt.size_px[0]] + 0.5
    best = np.full(x.shape, -np.inf)
    for row in rows:
        placed = quilt.quilt_from_panel(display)[row]
        corners = display.panels[quilt.panels[row]].lit_outline_px @ placed[:, :2].T + placed[:, 2]
        step = np.roll(corners, -1, axis=0) - corners
        inward = np.stack([-step[:, 1], step[:, 0]], axis=1) / np.linalg.norm(step, axis=1)[:, None]
        distance = np.min([(x - c[0]) * n[0] + (y - c[1]) * n[1] for c, n in zip(corners, inward, strict=True)], axis=0)
        best = np.maximum(best, distance)
    return best


def draw(device: Any, mesh: Mesh, display: Display, eyes: Any, *, clip: bool = True, **options: Any) -> Any:
    """The one quilt's pixels and depths."""
    view = mesh_view(display, quilt_of(display), mesh, eyes, looking=options.pop("forward", None))
    return drawn_mesh(device, MeshLayer(mesh, clip=clip, **options), view)


def knot(display: Display, triangles: int = 20_000) -> Mesh:
    """A knot that fills the display, in room coordinates."""
    from limen.layers.common.room_placement import mesh_in_room

    mesh = torus_knot(triangles)
    matrix = mesh_in_room(mesh.bounds, display)
    return mesh.deformed((mesh.positions @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32))


def test_a_square_lies_where_geometry_puts_it(device: Any) -> None:
    """A square of 0.2 m, 1 m behind the panel, seen from 1 m before it: half as large, a little to the right and up."""
    mesh = plain([(0.1, 0.0, -1), (0.3, 0.0, -1), (0.3, 0.2, -1), (0.1, 0.2, -1)], [(0, 1, 2), (0, 2, 3)])
    image, _ = draw(device, mesh, facing_panel((640, 480)), (0, 0, 1))
    rows, columns = np.nonzero(image[..., 0])
    assert (columns.min(), columns.max() + 1) == (320 + 50, 320 + 150)
    assert (rows.min(), rows.max() + 1) == (240 - 100, 240)


def test_what_is_nearer_covers_what_is_farther(device: Any) -> None:
    """In front of the panel, on it and behind it; in either order of triangles."""
    red, green = square(-0.5, 0.3, (255, 0, 0, 255)), square(0.3, 0.1, (0, 255, 0, 255))
    for first, second in ((red, green), (green, red)):
        both = plain(
            np.concatenate([first.positions, second.positions]),
            np.concatenate([first.triangles, second.triangles + 4]),
            np.concatenate([first.colours, second.colours]),
        )
        image, _ = draw(device, both, facing_panel(), (0, 0, 1))
        middle, side = image[24, 32], image[24, 32 + 18]
        assert middle[1] > 100 > middle[0]
        assert side[0] > 100 > side[1]


@pytest.mark.parametrize("name", DISPLAYS)
@pytest.mark.parametrize("depth", ["panel", "shared"])
def test_clipping_by_distances_and_cutting_make_the_same_picture(device: Any, name: str, depth: str) -> None:
    display, eye = DISPLAYS[name]
    mesh = knot(display)
    clipped, _ = draw(device, mesh, display, eye, depth=depth)
    cut, _ = draw(device, mesh, display, eye, clip=False, depth=depth)
    inside = depth_in_outlines(display, quilt_of(display), range(len(display.panels))) > 0
    lit = int((clipped[inside][:, :3].max(axis=-1) > 0).sum())
    different = int((np.abs(clipped.astype(int) - cut).max(axis=-1) > 3)[inside].sum())
    assert lit > 1500
    assert different <= lit / 1000


@pytest.mark.parametrize("clip", [True, False])
def test_nothing_is_drawn_beyond_outlines_and_guard(device: Any, clip: bool) -> None:
    """Every pixel of the quilt that no panel comes near stays black, though a wall is behind it all."""
    display, eye = DISPLAYS["stairs"]
    mesh = square(-4.0, 30.0)
    image, _ = draw(device, mesh, display, eye, clip=clip)
    quilt = quilt_of(display)
    facing = QuiltPanels(display, quilt).seen_from(eye).facing
    inside_px = depth_in_outlines(display, quilt, np.flatnonzero(facing))
    lit = image[..., 0] > 0
    assert (inside_px > 0).sum() > 20_000
    assert lit[inside_px > -GUARD_PX + 0.01].all(), "panels are filled to the rim of their guard"
    assert not lit[inside_px < -GUARD_PX - 0.01].any(), "and no pixel beyond is touched"


def test_many_triangles_leave_no_gap(device: Any) -> None:
    """A wall of small triangles behind everything: every pixel of every panel is covered, whoever its triangle is."""
    side = 160
    axis = np.linspace(-30, 30, side)
    x, y = np.meshgrid(axis, axis)
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, -6.0)], axis=1)
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    triangles = np.concatenate(
        [np.stack([corner, corner + 1, corner + side + 1], 1), np.stack([corner, corner + side + 1, corner + side], 1)]
    )
    display, eye = DISPLAYS["stairs"]
    fine, _ = draw(device, plain(places, triangles), display, eye)
    coarse, _ = draw(device, square(-6.0, 30.0), display, eye)
    quilt = quilt_of(display)
    facing = QuiltPanels(display, quilt).seen_from(eye).facing
    clear = np.abs(depth_in_outlines(display, quilt, np.flatnonzero(facing)) + GUARD_PX) > 0.01
    np.testing.assert_array_equal((fine[..., 0] > 0)[clear], (coarse[..., 0] > 0)[clear])


def test_two_eyes_are_two_pictures(device: Any) -> None:
    display = facing_panel((320, 240))
    mesh = knot(display, 4000)
    eyes = np.array([(-0.1, 0, 1.0), (0.1, 0, 1.0)])
    both, _ = draw(device, mesh, display, eyes)
    for copy, eye in enumerate(eyes):
        alone, _ = draw(device, mesh, display, eye)
        different = np.abs(both[:, copy * 320 : (copy + 1) * 320].astype(int) - alone).max(axis=-1) > 3
        assert different.sum() <= 5
    assert (both[:, :320] != both[:, 320:]).any()


def test_stereo_pictures(device: Any) -> None:
    display = facing_panel((320, 240))
    layers = [MeshLayer(torus_knot(4000))]
    viewer = Viewer((0, 0, 1.0), eye_separation_m=0.2)

    def pictures(stereo: Stereo) -> dict[str, NDArray[np.uint8]]:
        with Renderer(device, display, layers, stereo=stereo) as renderer:
            return {name: picture.copy() for name, picture, _ in renderer.pictures(frame_of(renderer, viewer))}

    ((name, wide),) = pictures("side-by-side").items()
    assert (name, wide.shape) == ("only", (240, 640, 4))
    after_another = pictures("sequential")
    np.testing.assert_array_equal(after_another["only@left"], wide[:, :320])
    np.testing.assert_array_equal(after_another["only@right"], wide[:, 320:])
    ((_, mixed),) = pictures("anaglyph").items()
    np.testing.assert_array_equal(mixed[..., 0], wide[:, :320, 0])
    np.testing.assert_array_equal(mixed[..., 1:3], wide[:, 320:, 1:3])
    with pytest.raises(InputError, match="no stereo is named"):
        Renderer(device, display, layers, stereo="polarised")  # type: ignore[arg-type]


def shown_alone(device: Any, display: Display, mesh: Mesh, viewer: Viewer) -> NDArray[np.uint8]:
    """What a renderer shows on the one panel of a display, of a mesh in room coordinates."""
    with Renderer(device, display, [MeshLayer(mesh, HERE)], background=BLACK) as renderer:
        ((_, picture, _),) = renderer.pictures(frame_of(renderer, viewer))
        return picture.copy()


def test_brightness_makes_up_for_the_angle_and_the_panel(device: Any) -> None:
    """Light that falls as the square of the cosine arrives even from 0 to 60 degrees."""
    eye = (0.0, 0.0, 0.4)
    mesh = square(-3.0, 10.0)
    even, made_up = (
        shown_alone(device, display, mesh, Viewer(eye))
        for display in (facing_panel((640, 480)), facing_panel((640, 480), falloff=2.0, gain=0.5))
    )
    x, y = np.meshgrid((np.arange(640) - 319.5) * 0.001, (np.arange(480) - 239.5) * 0.001)
    cosine = 0.4 / np.sqrt(x**2 + y**2 + 0.16)
    code = made_up[..., 0] / 255.0
    light = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    arrives = light * cosine**2
    plain_code = even[..., 0] / 255.0
    wanted = np.where(plain_code <= 0.04045, plain_code / 12.92, ((plain_code + 0.055) / 1.055) ** 2.4)
    ratio = arrives / wanted
    assert ratio.std() / ratio.mean() < 0.01
    corner_cosine = cosine[0, 0]
    assert ratio.mean() == pytest.approx(0.5 * corner_cosine**2, rel=0.03), "the corner gets all the light there is"


def test_a_texture_is_upright_and_in_its_place(device: Any) -> None:
    """Four texels, on a square that faces the eye: red top left, green top right, blue bottom left, white."""
    texels = np.array([[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [255, 255, 255, 255]]], np.uint8)
    texture = texels.repeat(16, axis=0).repeat(16, axis=1)[None]
    flat = square(0.0, 0.2)
    mesh = Mesh(
        None, flat.positions, flat.triangles, flat.normals, flat.colours,
        np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32), np.zeros(4, np.uint32), texture,
    )  # fmt: skip
    image, _ = draw(device, mesh, facing_panel((640, 480)), (0, 0, 1))
    quarter = [image[240 + dy, 320 + dx, :3] > 100 for dy, dx in ((-100, -100), (-100, 100), (100, -100), (100, 100))]
    assert [tuple(map(bool, each)) for each in quarter] == [
        (True, False, False), (False, True, False), (False, False, True), (True, True, True),
    ]  # fmt: skip


def test_holes_of_a_texture_are_seen_through(device: Any) -> None:
    texture = np.full((1, 32, 32, 4), 255, np.uint8)
    texture[0, :, :16, 3] = 0
    flat = square(0.0, 0.2)
    mesh = Mesh(
        None, flat.positions, flat.triangles, flat.normals, flat.colours,
        np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32), np.zeros(4, np.uint32), texture,
    )  # fmt: skip
    image, _ = draw(device, mesh, facing_panel((640, 480)), (0, 0, 1))
    assert image[240, 320 - 100, 0] == 0
    assert image[240, 320 + 100, 0] > 100


def test_a_mesh_moves_between_frames(device: Any) -> None:
    display = facing_panel((320, 240))
    mesh = square(0.0, 0.05)

    def moved(time_s: float) -> Mesh:
        return mesh.deformed(mesh.positions + np.float32([time_s, 0, 0]))

    with Renderer(device, display, [MeshLayer(mesh, HERE, deformed=moved)], background=BLACK) as renderer:
        columns = []
        for time_s in (0.0, 0.1):
            ((_, picture, report),) = renderer.pictures(frame_of(renderer, Viewer((0, 0, 1.0)), time_s=time_s))
            columns.append(np.nonzero(picture[..., 0])[1].mean())
            assert row_of(report).drawn == 2
    assert columns[1] - columns[0] == pytest.approx(50, abs=0.5)


def test_turned_quilts_show_the_same_pictures(device: Any) -> None:
    from limen.layers.mesh.draw.drawer import MeshDrawer

    display = facing_panel((320, 240))
    mesh = knot(display, 4000)
    drawer = MeshDrawer(device, MeshLayer(mesh))
    pictures = []
    with Easel(device) as easel:
        for turn in range(4):
            size = (330, 250) if turn % 2 == 0 else (250, 330)
            quilt = Quilt(size, (0,), ((5, 5),), (turn,))
            view = mesh_view(display, quilt, mesh, (0.1, 0.05, 1.0))
            pictures.append(pieces(display, quilt, easel.picture(drawer, view, MeshPart(NOWHERE)))["only"].copy())
    drawer.destroy()
    lit = int((pictures[0][..., 0] > 0).sum())
    for picture in pictures[1:]:
        different = (np.abs(picture.astype(int) - pictures[0]).max(axis=-1) > 3).sum()
        assert different < lit / 100


def test_shared_depth_is_that_of_the_viewers_camera(device: Any) -> None:
    """Where two panels of the cube meet, the same place has the same depth on both, and it is near / z."""
    from limen.viewing.projection import NEAR_M

    display, eye = DISPLAYS["cube"]
    quilt = quilt_of(display)
    eye_m = np.array(eye)
    forward = np.array([0, 1.2, 0]) - eye_m
    forward /= np.linalg.norm(forward)
    wall = square(-2.0, 30.0)
    _, depth = draw(device, wall, display, eye, depth="shared", forward=forward)
    views = QuiltPanels(display, quilt).seen_from(eye_m)
    checked = 0
    for row, index in enumerate(quilt.panels):
        if not views.facing[row]:
            continue
        panel = display.panels[index]
        assert quilt.quarter_turns[row] == 0
        x, y = quilt.offsets_px[row]
        width, height = panel.size_px
        v, u = np.mgrid[:height, :width] + 0.5
        ways = panel.position_m(np.stack([u, v], axis=-1)) - eye_m
        reach = (-2.0 - eye_m[2]) / np.where(ways[..., 2] < 0, ways[..., 2], np.nan)
        expected = NEAR_M / (reach[..., None] * ways @ forward)
        drawn = depth[y : y + height, x : x + width]
        seen = np.isfinite(expected) & (drawn > 0)
        assert np.abs(drawn[seen] / expected[seen] - 1).max() < 1e-4
        checked += int(seen.sum())
    assert checked > 50_000


def square_of_view(eye: Any, target: Any, size_px: int, fov_deg: float) -> tuple[Display, Quilt]:
    """What a camera would see, as a display: one panel at right angles to the way it looks."""
    from limen.viewing.camera import Camera

    camera = Camera(tuple(eye), tuple(target), (size_px, size_px), fov_deg)
    pitch = 1 / camera.focal_px
    right, down, forward = camera.axes
    origin = np.array(eye) + forward - (right + down) * pitch * size_px / 2
    panel = Panel("eye", (size_px, size_px), tuple(origin), tuple(right), tuple(down), (pitch, pitch))
    return Display("eye", (panel,)), Quilt((size_px, size_px), (0,), ((0, 0),))


def halved(image: NDArray[np.uint8], factor: int) -> NDArray[np.float64]:
    """Averaged in linear light over squares of pixels, back to codes 0 ... 1."""
    code = image[..., :3] / 255.0
    light = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    side = light.shape[0] // factor
    light = light.reshape(side, factor, side, factor, 3).mean(axis=(1, 3))
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * light ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("name", ["cube", "icosahedron", "cave"])
def test_the_eye_sees_the_scene_as_if_the_display_were_not_there(device: Any, name: str) -> None:
    """Through the lit display against a picture drawn from the eye directly, inside panels and along their borders."""
    from limen.frame.simulator import DisplaySimulator
    from limen.layers.mesh.draw.drawer import MeshDrawer
    from limen.viewing.camera import Camera

    display, eye = DISPLAYS[name]
    target = (-1.5, 1.5, -1.5) if name == "cave" else (0.0, 1.2, 0.0)
    size, fov, light = 300, 60.0 if name == "cave" else 30.0, (0.02, 0.03, 0.05)
    mesh = knot(display)
    drawer, easel = MeshDrawer(device, MeshLayer(mesh)), Easel(device, background=light)
    quilt = quilt_of(display)
    drawn = easel.draw(drawer, mesh_view(display, quilt, mesh, eye), MeshPart(NOWHERE))
    lit = DisplaySimulator(device, display, [quilt], guard_px=GUARD_PX)
    camera = Camera(eye, target, (size, size), fov)
    through = lit.read(lit.draw([drawn], camera, samples=4, uneven=False))[..., :3] / 255.0
    lit.destroy()
    flat, whole = square_of_view(eye, target, size * 4, fov)
    direct = halved(easel.picture(drawer, mesh_view(flat, whole, mesh, eye), MeshPart(NOWHERE)), 4)
    easel.destroy()
    drawer.destroy()
    inside, border = regions(display, camera)
    squared = ((through - direct) ** 2).mean(axis=-1)
    assert (inside & ~border).sum() > 5000
    assert (inside & border).sum() > 300
    assert -10 * np.log10(squared[inside & ~border].mean()) >= 38
    assert -10 * np.log10(squared[inside & border].mean()) >= 36


def regions(display: Display, camera: Any) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Pixels of a camera's picture that panels fill, but for the display's rim; and those within 2 px of a border."""
    from PIL import Image, ImageDraw
    from scipy.ndimage import binary_dilation, binary_erosion

    filled, lines = (Image.new("L", camera.size_px) for _ in range(2))
    for panel in display.panels:
        outline = panel.outline_m
        place, depth = camera.project(outline)
        if np.dot(np.array(camera.eye_m) - outline[0], panel.normal) <= 0 or depth.min() < 0.05:
            continue
        corners = [(float(x), float(y)) for x, y in place]
        ImageDraw.Draw(filled).polygon(corners, fill=255)
        ImageDraw.Draw(lines).line([*corners, corners[0]], fill=255)
    return binary_erosion(np.array(filled) > 0, iterations=4), binary_dilation(np.array(lines) > 0, iterations=2)


def test_panels_that_touch_in_a_mapping_do_not_draw_over_each_other(device: Any) -> None:
    """Two panels side by side without a gap: each shows what it shows alone."""
    from dataclasses import replace

    left = facing_panel((64, 48)).panels[0]
    right = replace(left, name="other", origin_m=(0.0, 0.24, 0.5), right=(0.6, 0.0, -0.8))
    mapped = Display("two", (left, right), quilts=(Quilt((128, 48), (0, 1), ((0, 0), (64, 0))),))
    viewer = Viewer((0.1, 0.0, 1.2))
    mesh = torus_knot(4000)
    with Renderer(device, mapped, [MeshLayer(mesh)]) as renderer:
        assert renderer.guard_px == 0
        frame = frame_of(renderer, viewer)
        together = {name: picture.copy() for name, picture, _ in renderer.pictures(frame)}
    for panel in (left, right):
        with Renderer(device, Display("one", (panel,)), [MeshLayer(mesh)]) as renderer:
            assert renderer.guard_px == GUARD_PX
            ((name, alone, _),) = renderer.pictures(frame)
            assert (np.abs(alone.astype(int) - together[name]).max(axis=-1) > 3).sum() <= 5
