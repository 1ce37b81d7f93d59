"""A live window onto a mesh: what dragging, the wheel, keys, resizing and time do to the picture."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import wgpu
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.data.samples.mesh import ripple, torus_knot
from limen.display.display import Display
from limen.errors import InputError
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.mesh.layer import MeshLayer
from limen.show.canvas import Surface
from limen.show.show import Show
from limen.viewing.viewer import Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

STANDER = Viewer((0.0, 0.0, 0.0))
Picture = NDArray[np.int64]


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return torus_knot(3000)


class Screen:
    """Textures instead of a window, and an `App` that draws into them."""

    def __init__(self, device: Any, mesh: Mesh, display: Display | None = None, tour: Any = STANDER, **fields: Any):
        from limen.gpu.buffers import TextureReader
        from limen.show.app import App

        self.device = device
        stereo, animate = fields.pop("stereo", "none"), fields.pop("animate", "none")
        of_layer = {name: fields.pop(name) for name in ("policy", "tree", "overlay", "depth") if name in fields}
        if animate == "ripple":
            of_layer["deformed"] = partial(ripple, mesh)
        layer = MeshLayer(mesh, RoomPlacement(**fields, turning=animate == "turn"), **of_layer)
        show = Show([layer], display, stereo=stereo)
        self.live = App(device, show, display, tour, "eye", overlay="overlay" in of_layer)
        self._reader = TextureReader(device)
        self.title = ""

    def draw(self, time_s: float = 0.0, size_px: tuple[int, int] = (200, 150)) -> Picture:
        usage = wgpu.TextureUsage.RENDER_ATTACHMENT | wgpu.TextureUsage.COPY_SRC
        window_format = wgpu.TextureFormat.rgba8unorm_srgb
        texture = self.device.wgpu.create_texture(size=(*size_px, 1), format=window_format, usage=usage)
        self.title = self.live.draw(0, Surface(texture.create_view(), window_format, size_px, time_s))
        picture = self._reader.read(texture)
        texture.destroy()
        return picture[..., :3].astype(int)

    def drag(self, dx: float, dy: float) -> None:
        self.live.handle({"event_type": "pointer_down", "x": 50.0, "y": 50.0})
        self.live.handle({"event_type": "pointer_move", "x": 50.0 + dx, "y": 50.0 + dy})
        self.live.handle({"event_type": "pointer_up", "x": 50.0 + dx, "y": 50.0 + dy})

    def key(self, name: str) -> None:
        self.live.handle({"event_type": "key_down", "key": name})

    def wheel(self, dy: float) -> None:
        self.live.handle({"event_type": "wheel", "dy": dy, "x": 0.0, "y": 0.0})

    def __enter__(self) -> Screen:
        return self

    def __exit__(self, *_: object) -> None:
        self.live.close()
        self._reader.destroy()


def lit(picture: Picture) -> NDArray[np.bool_]:
    return np.asarray(picture.max(axis=-1) > 40)


def share_apart(a: Picture, b: Picture) -> float:
    return float((np.abs(a - b).max(axis=-1) > 8).mean())


def test_dragging_turns_the_mesh_and_the_start_key_turns_it_back(device: Any, mesh: Mesh) -> None:
    with Screen(device, mesh) as screen, Screen(device, mesh, turn_deg=30.0) as turned:
        first = screen.draw()
        assert 0.05 < lit(first).mean() < 0.8
        screen.drag(100, 0)
        after = screen.draw()
        assert share_apart(after, first) > 0.05
        assert share_apart(after, turned.draw()) < 0.002, "100 pixels are 30 degrees"
        screen.live.handle({"event_type": "pointer_move", "x": 500.0, "y": 10.0})
        np.testing.assert_array_equal(screen.draw(), after, "a pointer without a button turns nothing")
        screen.drag(-30, 1e4)
        assert share_apart(screen.draw(), after) > 0.05
        screen.key("0")
        np.testing.assert_array_equal(screen.draw(), first)
        assert "1 panels" in screen.title


def test_the_wheel_brings_nearer(device: Any, mesh: Mesh) -> None:
    with Screen(device, mesh, size_m=0.02) as screen:
        before = lit(screen.draw()).sum()
        screen.wheel(-100)
        assert lit(screen.draw()).sum() / before == pytest.approx(1.1**2, rel=0.05)
        for _ in range(3):
            screen.wheel(100)
        assert lit(screen.draw()).sum() / before == pytest.approx(1.1**-4, rel=0.05)


def test_keys_tint_and_close(device: Any, mesh: Mesh) -> None:
    with Screen(device, mesh) as screen:
        first = screen.draw()
        screen.key("o")
        tinted = screen.draw()
        assert share_apart(first, tinted) > 0.05
        np.testing.assert_array_equal(lit(tinted), lit(first))
        screen.key("o")
        np.testing.assert_array_equal(screen.draw(), first)
        assert not screen.live.closed
        screen.key("q")
        assert screen.live.closed


@pytest.mark.parametrize("how", ["ripple", "turn"])
def test_time_moves_the_mesh_unless_paused(device: Any, mesh: Mesh, how: str) -> None:
    with Screen(device, mesh, animate=how) as screen:
        first = screen.draw(1.0)
        second = screen.draw(1.7)
        assert share_apart(first, second) > 0.01
        screen.key(" ")
        np.testing.assert_array_equal(screen.draw(9.0), second)
        screen.key(" ")
        assert share_apart(screen.draw(9.4), second) > 0.01
        assert screen.live.last is not None
        assert screen.live.last.time_s == pytest.approx(2.1)


def test_a_window_of_another_size_shows_the_same_mesh(device: Any, mesh: Mesh) -> None:
    """Twice as wide a window: it fills the same share of its height."""
    with Screen(device, mesh) as screen:
        small = lit(screen.draw())
        wide = lit(screen.draw(size_px=(400, 150)))
        large = lit(screen.draw(size_px=(400, 300)))
        assert large.sum() / small.sum() == pytest.approx(4, rel=0.05)
        rows = [np.ptp(np.nonzero(each.any(axis=1))[0]) / each.shape[0] for each in (small, wide, large)]
        assert max(rows) - min(rows) < 0.15
        np.testing.assert_array_equal(lit(screen.draw()), small)


def test_two_eyes_in_a_window(device: Any, mesh: Mesh) -> None:
    with Screen(device, mesh) as one, Screen(device, mesh, stereo="anaglyph") as two:
        mixed = two.draw()
        assert share_apart(mixed, one.draw()) > 0.02
        assert lit(mixed).any()
    for how in ("side-by-side", "sequential"):
        with pytest.raises(InputError, match="one picture at a time"):
            Screen(device, mesh, stereo=how)


def test_dragging_leads_the_viewer_around_a_simulated_display(device: Any, mesh: Mesh) -> None:
    from limen.viewing.standing import standing_viewer

    cube = Display.preset("cube").scaled(0.2)
    with Screen(device, mesh, cube, standing_viewer(cube)) as screen:
        first = screen.draw()
        assert 0.02 < lit(first).mean() < 0.8
        assert screen.live.last is not None
        assert screen.live.last.layers[0].panels_active == 3
        screen.drag(100, 0)  # 30 degrees to the left: straight before the front
        before = screen.draw()
        assert screen.live.last.layers[0].panels_active == 2
        assert share_apart(first, before) > 0.02
        screen.drag(-100 + 360 / 0.3, 0)
        assert share_apart(screen.draw(), first) < 0.005, "all around"
        screen.drag(0, 1e4)
        above = screen.draw()
        assert lit(above).any()
        screen.key("0")
        np.testing.assert_array_equal(screen.draw(), first)
        larger = screen.draw(size_px=(300, 150))
        assert larger.shape == (150, 300, 3)
        assert lit(larger).sum() == pytest.approx(lit(first).sum(), rel=0.1), "the height decides"


def test_dragging_turns_the_head_in_a_room(device: Any, mesh: Mesh) -> None:
    from limen.viewing.standing import standing_viewer

    cave = Display.preset("cave").scaled(0.1)
    with Screen(device, mesh, cave, standing_viewer(cave)) as screen:
        first = lit(screen.draw())
        columns = [np.nonzero(first)[1].mean()]
        screen.drag(40, 0)
        columns.append(np.nonzero(lit(screen.draw()))[1].mean())
        assert columns[1] > columns[0] + 10, "what is dragged to the right goes to the right"
        screen.drag(300, 0)
        assert not lit(screen.draw()).any(), "105 degrees to the left, there is nothing"


def test_the_wheel_leads_to_a_simulated_display_and_across_a_room(device: Any, mesh: Mesh) -> None:
    from limen.viewing.standing import standing_viewer

    for name, nearer in (("cube", 0.7), ("cave", 0.8)):
        display = Display.preset(name).scaled(0.1)
        with Screen(device, mesh, display, standing_viewer(display)) as screen:
            first = screen.draw()
            screen.wheel(100 * np.log(nearer) / np.log(1.1))
            assert lit(screen.draw()).sum() > 1.2 * lit(first).sum(), name
            for _ in range(20):
                screen.wheel(1000)
            assert lit(screen.draw()).sum() < 0.7 * lit(first).sum(), name
            screen.key("0")
            np.testing.assert_array_equal(screen.draw(), first)


def test_a_tour_leads_the_viewer(device: Any, mesh: Mesh) -> None:
    rostock = Display.preset("rostock").scaled(0.05)

    def tour(time_s: float) -> tuple[Viewer, ...]:
        return (Viewer((-1.0 + time_s, 1.7, 0.5), time_s=time_s), Viewer((0.0, 1.7, 0.5), time_s=time_s))

    with Screen(device, mesh, rostock, tour) as screen, Screen(device, mesh, rostock, tour(1.0)[0]) as still:
        first = screen.draw(0.0)
        second = screen.draw(1.0)
        assert share_apart(first, second) > 0.01
        assert share_apart(second, still.draw()) < 0.01, "dragging nothing, one stands where one stood"
        assert screen.live.last is not None
        assert screen.live.last.time_s == 1.0


def test_closing_frees_what_was_made(device: Any, mesh: Mesh, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every texture and buffer that a window made is destroyed with it, also those of earlier sizes."""
    made: list[Any] = []
    destroyed: set[int] = set()
    probes = [
        device.wgpu.create_texture(size=(1, 1, 1), format="r8unorm", usage=wgpu.TextureUsage.COPY_SRC),
        device.wgpu.create_buffer(size=4, usage=wgpu.BufferUsage.COPY_SRC),
    ]
    for name, kind in zip(("create_texture", "create_buffer"), map(type, probes), strict=True):
        create, destroy = getattr(device.wgpu, name), kind.destroy

        def noted(*args: Any, create: Any = create, **options: Any) -> Any:
            made.append(create(*args, **options))
            return made[-1]

        def ended(thing: Any, destroy: Any = destroy) -> None:
            destroyed.add(id(thing))
            destroy(thing)

        monkeypatch.setattr(device.wgpu, name, noted)
        monkeypatch.setattr(kind, "destroy", ended)
    for display in (None, Display.preset("cube").scaled(0.1)):
        with Screen(device, mesh, display, Viewer((0.2, 1.4, 0.6)), stereo="anaglyph") as screen:
            for size_px in ((60, 40), (80, 50)):
                screen.draw(size_px=size_px)
    assert len(made) > 30
    assert not [thing.label for thing in made if id(thing) not in destroyed]


def test_what_a_window_is_asked_for_reaches_the_renderer(device: Any, mesh: Mesh) -> None:
    """The overlay by its name, the depth that panels share, and where somebody before a window looks."""
    from limen.data.mesh.tree_build import build_vertex_tree
    from limen.layers.mesh.select import FoldTree
    from limen.viewing.policy import Policy

    folds = {"policy": Policy("contrast", 6.0, gaze=True), "tree": FoldTree(build_vertex_tree(mesh))}
    with (
        Screen(device, mesh, **folds, overlay="panels") as panels,
        Screen(device, mesh, **folds, overlay="simplified") as folded,
    ):
        assert share_apart(panels.draw(), folded.draw()) > 0.05
    beside = replace(STANDER, gaze=(1.0, 0.0, -0.2))
    with (
        Screen(device, mesh, **folds) as ahead,
        Screen(device, mesh, tour=beside, **folds) as aside,
    ):
        ahead.draw()
        aside.draw()
        assert ahead.live.last is not None
        assert aside.live.last is not None
        assert aside.live.last.layers[0].items < ahead.live.last.layers[0].items, (
            "less is left of what is seen from the corner of the eye"
        )
    with Screen(device, mesh, depth="shared") as screen:
        screen.draw()
        assert screen.live._view._renderer.layers[0].depth == "shared"
