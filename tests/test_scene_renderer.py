"""Whole frames of a mesh: quilts of any size show the same, and what cannot be is said."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.errors import DeviceLimitError, InputError
from limen.layers.mesh import renderer as scene
from limen.layers.mesh.renderer import SceneRenderer
from limen.layers.mesh.select import FoldTree, select_mesh
from limen.viewing.camera import Camera
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

VIEWER = Viewer((0.2, 1.7, 0.3), time_s=2.5)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return torus_knot(3000)


@pytest.fixture(scope="module")
def wall() -> Display:
    """24 panels of 96 x 60 pixels."""
    return Display.preset("rostock").scaled(0.05)


def pictures(renderer: Any, viewer: Viewer = VIEWER, **options: Any) -> dict[str, NDArray[np.int64]]:
    return {name: picture[..., :3].astype(int) for name, picture, _ in renderer.pictures(viewer, **options)}


def assert_same(one: NDArray[Any], other: NDArray[Any], but: float = 0.002) -> None:
    """But for edges, which fall on another side of a pixel's middle where it lies elsewhere in a quilt."""
    assert one.shape == other.shape
    assert (np.abs(one.astype(int) - other).max(axis=-1) > 8).mean() <= but


@pytest.mark.parametrize("stereo", ["none", "anaglyph", "side-by-side", "sequential"])
def test_many_quilts_show_what_one_shows(device: Any, mesh: Mesh, wall: Display, stereo: Any) -> None:
    from limen.layers.mesh.renderer import SceneRenderer, SceneReport

    with (
        SceneRenderer(device, wall, mesh, stereo=stereo) as one,
        SceneRenderer(device, wall, mesh, stereo=stereo, max_quilt_px=30_000) as many,
    ):
        assert len(one.quilts) == 1
        assert len(many.quilts) > 3
        assert sum(len(quilt.panels) for quilt in many.quilts) == 24
        together, apart = pictures(one), pictures(many)
        assert set(together) == set(apart)
        for name, picture in together.items():
            assert_same(picture, apart[name], 0.004)
        assert sum(int((picture.max(axis=-1) > 40).sum()) for picture in together.values()) > 1000
        reports = [one.frame(VIEWER), many.frame(VIEWER)]
        assert {(type(report), report.time_s, report.panels_active) for report in reports} == {(SceneReport, 2.5, 24)}
        assert reports[0].triangles == pytest.approx(reports[1].triangles, rel=0.01)


def test_a_camera_sees_the_same_of_many_quilts(device: Any, mesh: Mesh, wall: Display) -> None:
    """Quilts of one size keep their own pixels while the display is looked at."""
    from limen.layers.mesh.renderer import SceneRenderer

    camera = Camera(VIEWER.position_m, (0.0, 1.5, -1.5), (160, 120), 60.0)
    seen = []
    for max_quilt_px in (1 << 26, 30_000):
        with SceneRenderer(device, wall, mesh, max_quilt_px=max_quilt_px) as renderer:
            seen += renderer.seen(VIEWER, [camera])
    assert (seen[0][..., :3].max(axis=-1) > 40).mean() > 0.05
    assert_same(seen[0][..., :3], seen[1][..., :3], 0.01)


@pytest.mark.parametrize(("stereo", "widest"), [("none", 256), ("side-by-side", 128)])
def test_the_quilts_of_an_adapter_of_small_textures(
    device: Any, mesh: Mesh, wall: Display, stereo: Any, widest: int
) -> None:
    """No quilt is larger than the adapter's textures: for two eyes, half as wide."""
    from limen.layers.mesh.renderer import SceneRenderer

    with SceneRenderer(replace(device, max_texture_px=256), wall, mesh, stereo=stereo) as renderer:
        assert len(renderer.quilts) > 1
        assert max(quilt.size_px[0] for quilt in renderer.quilts) <= widest
        assert len(pictures(renderer)) == 24


def test_a_mapping_that_the_adapter_cannot_hold_is_named(device: Any, mesh: Mesh, wall: Display) -> None:
    from limen.display.quilt import pack
    from limen.layers.mesh.renderer import SceneRenderer

    (packed,) = pack(wall)
    mapped = Display("mapped", wall.panels, quilts=(replace(packed, output="HDMI-1"),))
    small = replace(device, max_texture_px=packed.size_px[0])
    with SceneRenderer(small, mapped, mesh) as renderer:
        assert [name for name, *_ in renderer.quilt_pictures(VIEWER)] == ["HDMI-1"]
    with pytest.raises(DeviceLimitError, match=r"quilt 'HDMI-1'.* several quilts"):
        SceneRenderer(small, mapped, mesh, stereo="side-by-side")


def test_two_eyes_that_are_one_see_the_same(device: Any, mesh: Mesh, wall: Display) -> None:
    from limen.layers.mesh.renderer import SceneRenderer

    with SceneRenderer(device, wall, mesh, stereo="sequential") as renderer:
        seen = pictures(renderer, replace(VIEWER, eye_separation_m=0.0))
    for panel in wall.panels:
        assert_same(seen[f"{panel.name}@left"], seen[f"{panel.name}@right"], 0.004)


def test_quilts_come_whole_and_by_name(device: Any, mesh: Mesh, wall: Display) -> None:
    from limen.layers.mesh.renderer import SceneRenderer

    with SceneRenderer(device, wall, mesh, max_quilt_px=60_000) as renderer:
        whole = [(name, picture.shape[:2]) for name, picture, _ in renderer.quilt_pictures(VIEWER)]
        assert whole == [(f"quilt-{n}", quilt.size_px[::-1]) for n, quilt in enumerate(renderer.quilts)]


def test_no_camera_sees_two_pictures_at_once(device: Any, mesh: Mesh, wall: Display) -> None:
    from limen.layers.mesh.renderer import SceneRenderer

    with (
        SceneRenderer(device, wall, mesh, stereo="side-by-side") as renderer,
        pytest.raises(InputError, match="shows two pictures at once"),
    ):
        renderer.seen(VIEWER, [])


def test_wherever_a_viewer_stands_there_are_pictures(device: Any, mesh: Mesh, wall: Display) -> None:
    """In the plane of all panels, behind them, inside the mesh and very far away."""
    from limen.layers.mesh.renderer import SceneRenderer

    with SceneRenderer(device, wall, mesh, background=(0, 0, 0)) as renderer:
        for place, lit in (((0, 1.5, -1.5), False), ((0, 1.5, -9), False), ((0, 1.5, -1.4), True), ((0, 1, 1e5), True)):
            seen = pictures(renderer, Viewer(place))
            assert len(seen) == 24
            assert any(picture.any() for picture in seen.values()) == lit, place


def test_a_cut_is_chosen_anew_only_when_something_moves(device: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    knot = torus_knot(3000)
    chosen: list[int] = []

    def counted(*args: Any, **kwargs: Any) -> Any:
        chosen.append(1)
        return select_mesh(*args, **kwargs)

    monkeypatch.setattr(scene, "select_mesh", counted)
    simplified = scene.Simplified(FoldTree(build_vertex_tree(knot)), Policy.parse("contrast+gaze"))
    with SceneRenderer(device, Display.window((160, 120)), knot, simplified=simplified) as renderer:
        viewer = Viewer((0.0, 0.0, 3.0), gaze=(0.0, 0.0, -1.0))
        first = [picture.copy() for _, picture, _ in renderer.pictures(viewer)]
        again = [picture.copy() for _, picture, _ in renderer.pictures(replace(viewer, time_s=1.0))]
        assert len(chosen) == 1
        np.testing.assert_array_equal(first, again)
        looks = [replace(viewer, gaze=(0.6, 0.0, -0.8)), replace(viewer, position_m=(0.0, 0.1, 3.0)), viewer]
        counts = [next(iter(renderer.pictures(look)))[2].left for look in looks]
        assert len(chosen) == 4
        assert counts[2] > counts[0]
        renderer.room_from_mesh = renderer.room_from_mesh @ np.diag([0.5, 0.5, 0.5, 1.0])
        assert next(iter(renderer.pictures(viewer)))[2].left < counts[2]
        assert len(chosen) == 5
