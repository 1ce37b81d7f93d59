"""Meshes: one or two eyes, adapters that hold little, and cuts that are chosen anew only when something moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import limen
from limen.data.mesh.mesh import Mesh
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.samples.mesh import torus_knot
from limen.display.display import Display
from limen.display.quilt import pack
from limen.errors import DeviceLimitError, InputError
from limen.frame.renderer import Renderer
from limen.frame.report import FrameReport
from limen.layers.base import Turn
from limen.layers.mesh import layer as mesh_layer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.mesh.select import FoldTree, select_mesh
from limen.viewing.placement import InRoom, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer
from support.frames import assert_same, drawn, frame_of, row_of

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

VIEWER = Viewer((0.2, 1.7, 0.3), time_s=2.5)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return torus_knot(3000)


@pytest.fixture(scope="module")
def wall() -> Display:
    """24 panels of 96 x 60 pixels."""
    return Display.preset("rostock").scaled(0.05)


@pytest.mark.parametrize("stereo", ["none", "anaglyph", "side-by-side", "sequential"])
def test_many_quilts_show_what_one_shows(device: Any, mesh: Mesh, wall: Display, stereo: Any) -> None:
    with (
        Renderer(device, wall, [MeshLayer(mesh)], stereo=stereo) as one,
        Renderer(device, wall, [MeshLayer(mesh)], stereo=stereo, max_quilt_px=30_000) as many,
    ):
        assert len(one.quilts) == 1
        assert len(many.quilts) > 3
        assert sum(len(quilt.panels) for quilt in many.quilts) == 24
        together, apart = (drawn(each, frame_of(each, VIEWER))[0] for each in (one, many))
        assert set(together) == set(apart)
        for name, picture in together.items():
            assert_same(picture, apart[name], 0.004)
        assert sum(int((picture.max(axis=-1) > 40).sum()) for picture in together.values()) > 1000
        reports = [each.frame(frame_of(each, VIEWER)) for each in (one, many)]
        told = {(type(report), report.time_s, row_of(report).panels_active) for report in reports}
        assert told == {(FrameReport, 2.5, 24)}
        assert row_of(reports[0]).drawn == pytest.approx(row_of(reports[1]).drawn, rel=0.01)


@pytest.mark.parametrize(("stereo", "widest"), [("none", 256), ("side-by-side", 128)])
def test_the_quilts_of_an_adapter_of_small_textures(
    device: Any, mesh: Mesh, wall: Display, stereo: Any, widest: int
) -> None:
    """No quilt is larger than the adapter's textures: for two eyes, half as wide."""
    with Renderer(replace(device, max_texture_px=256), wall, [MeshLayer(mesh)], stereo=stereo) as renderer:
        assert len(renderer.quilts) > 1
        assert max(quilt.size_px[0] for quilt in renderer.quilts) <= widest
        assert len(drawn(renderer, frame_of(renderer, VIEWER))[0]) == 24


def test_a_mapping_that_the_adapter_cannot_hold_is_named(device: Any, mesh: Mesh, wall: Display) -> None:
    (packed,) = pack(wall)
    mapped = Display("mapped", wall.panels, quilts=(replace(packed, output="HDMI-1"),))
    small = replace(device, max_texture_px=packed.size_px[0])
    with Renderer(small, mapped, [MeshLayer(mesh)]) as renderer:
        assert list(drawn(renderer, frame_of(renderer, VIEWER), by="quilts")[0]) == ["HDMI-1"]
    with pytest.raises(DeviceLimitError, match=r"quilt 'HDMI-1'.* several quilts"):
        Renderer(small, mapped, [MeshLayer(mesh)], stereo="side-by-side")


def test_two_eyes_that_are_one_see_the_same(device: Any, mesh: Mesh, wall: Display) -> None:
    with Renderer(device, wall, [MeshLayer(mesh)], stereo="sequential") as renderer:
        seen, _ = drawn(renderer, frame_of(renderer, replace(VIEWER, eye_separation_m=0.0)))
    for panel in wall.panels:
        assert_same(seen[f"{panel.name}@left"], seen[f"{panel.name}@right"], 0.004)


@pytest.mark.parametrize("stereo", ["side-by-side", "sequential"])
def test_no_camera_sees_two_pictures_at_once(device: Any, mesh: Mesh, wall: Display, stereo: Any) -> None:
    with Renderer(device, wall, [MeshLayer(mesh)], stereo=stereo) as renderer:
        frame = frame_of(renderer, VIEWER)
        with pytest.raises(InputError, match=f"'{stereo}' shows two pictures at once"):
            renderer.seen(frame, [])
        with pytest.raises(InputError, match=f"'{stereo}' shows two pictures at once"):
            renderer.textures(frame)


def test_wherever_a_viewer_stands_there_are_pictures(device: Any, mesh: Mesh, wall: Display) -> None:
    """In the plane of all panels, behind them, inside the mesh and very far away."""
    with Renderer(device, wall, [MeshLayer(mesh)], background=(0, 0, 0)) as renderer:
        for place, lit in (((0, 1.5, -1.5), False), ((0, 1.5, -9), False), ((0, 1.5, -1.4), True), ((0, 1, 1e5), True)):
            seen, _ = drawn(renderer, frame_of(renderer, Viewer(place)))
            assert len(seen) == 24
            assert any(picture.any() for picture in seen.values()) == lit, place


def test_a_cut_is_chosen_anew_only_when_something_moves(device: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    knot = torus_knot(3000)
    chosen: list[int] = []

    def counted(*args: Any, **kwargs: Any) -> Any:
        chosen.append(1)
        return select_mesh(*args, **kwargs)

    monkeypatch.setattr(mesh_layer, "select_mesh", counted)
    layer = MeshLayer(knot, policy=Policy.parse("contrast+gaze"), tree=FoldTree(build_vertex_tree(knot)))
    with Renderer(device, Display.window((160, 120)), [layer]) as renderer:
        viewer = Viewer((0.0, 0.0, 3.0), gaze=(0.0, 0.0, -1.0))
        first, _ = drawn(renderer, frame_of(renderer, viewer))
        again, _ = drawn(renderer, frame_of(renderer, replace(viewer, time_s=1.0)))
        assert len(chosen) == 1
        assert first.keys() == again.keys()
        for name, picture in first.items():
            np.testing.assert_array_equal(picture, again[name])
        looks = [replace(viewer, gaze=(0.6, 0.0, -0.8)), replace(viewer, position_m=(0.0, 0.1, 3.0)), viewer]
        counts = [row_of(drawn(renderer, frame_of(renderer, look))[1]).items for look in looks]
        assert len(chosen) == 4
        assert counts[2] > counts[0]
        stands = renderer.state(0.0).layers[0].placement
        assert isinstance(stands, InRoom)
        half = InRoom.of(stands.matrix @ np.diag([0.5, 0.5, 0.5, 1.0]))
        assert row_of(drawn(renderer, frame_of(renderer, viewer, placement=half))[1]).items < counts[2]
        assert len(chosen) == 5


def test_a_mesh_that_was_dragged_stays_where_its_middle_is(mesh: Mesh, wall: Display) -> None:
    layer = MeshLayer(mesh)
    state = layer.state(0.0, wall)
    assert layer.turned(state, Turn(), wall) is state
    turned = layer.turned(state, Turn(30.0, 10.0, 2.0), wall)
    assert turned == msgspec.structs.replace(state, placement=turned.placement)
    assert isinstance(state.placement, InRoom)
    assert isinstance(turned.placement, InRoom)
    before, after = state.placement.matrix, turned.placement.matrix
    middle = np.append(mesh.bounds.mean(axis=0), 1.0)
    np.testing.assert_allclose(after @ middle, before @ middle, atol=1e-9)
    sizes = [np.linalg.norm(each[:3, :3], axis=0) for each in (before, after)]
    np.testing.assert_allclose(sizes[1], sizes[0] / 2)
    assert not np.allclose(after[:3, :3] * 2, before[:3, :3])


# ---------------------------------------------------------------------------- in one call


def test_a_mesh_is_rendered_as_an_image_is(knot: Path, device: Any) -> None:
    """From a path or opened, of all panels or of some: a panel shows one picture."""
    wall = limen.Display.preset("rostock")
    viewer = limen.Viewer((0.1, 1.7, 0.0))
    every = limen.render(knot, wall, [viewer], scale=0.05, device=device)
    assert list(every) == [panel.name for panel in wall.panels]
    assert {(picture.shape, picture.dtype) for picture in every.values()} == {((60, 96, 4), np.dtype(np.uint8))}
    assert every["wall/2,1"][..., :3].max() > 100
    some = limen.render(limen.open(knot), wall, [viewer, limen.Viewer((1, 1, 1))], panels="wall/2,*", scale=0.05,
                        device=device)  # fmt: skip
    assert list(some) == [f"wall/2,{row}" for row in range(4)]
    for name, picture in some.items():
        assert_same(picture, every[name], 0.004)


def test_a_mesh_takes_its_place_and_two_eyes(knot: Path, device: Any) -> None:
    display = limen.Display.window((160, 120))
    viewer = limen.Viewer((0, 0, 0))
    behind = np.diag([0.01, 0.01, 0.01, 1.0])
    columns = []
    for x_m in (0.0, 0.005):
        behind[:3, 3] = (x_m, 0, -0.6)
        picture = limen.render(knot, display, [viewer], placement=behind, device=device)["window"]
        columns.append(np.nonzero(picture[..., :3].max(axis=(0, 2)) > 40)[0].mean())
    assert columns[1] - columns[0] == pytest.approx(0.005 / display.pitch_m, abs=1)
    both = limen.render(knot, display, [viewer], stereo="sequential", device=device)
    assert list(both) == ["window@left", "window@right"]
    wide = limen.render(knot, display, [viewer], stereo="side-by-side", device=device)["window"]
    np.testing.assert_array_equal(np.concatenate(list(both.values()), axis=1), wide)
    tinted = limen.render(knot, display, [viewer], placement=behind, overlay="panels", device=device)["window"]
    assert (tinted != picture).any()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"viewers": []}, "give a viewer"),
        ({"overlay": "levels"}, "'levels' is not for a mesh: give 'panels' or 'simplified'"),
        ({"overlay": "simplified"}, "'simplified' shows what a policy leaves out"),
        ({"acuity_arcmin": 1.0}, "acuity_arcmin changes nothing"),
        ({"acuity_arcmin": 1.0, "policy": Policy()}, "a Policy has its own"),
        ({"panels": ["window", "wimdow"]}, "matches wimdow"),
        ({"placement": OnSurface("cover")}, "are for images"),
        ({"policy": "everything"}, "no policy"),
        ({"stereo": "polarised"}, "no stereo is named"),
        ({"placement": np.eye(3)}, r"shape \(4, 4\)"),
        ({"placement": np.full((4, 4), np.nan)}, "finite"),
    ],
)
def test_what_a_mesh_cannot_be_is_said(knot: Path, device: Any, options: dict[str, Any], says: str) -> None:
    asked: dict[str, Any] = {"viewers": [limen.Viewer((0, 0, 0))]} | options
    with pytest.raises(InputError, match=says):
        limen.render(knot, limen.Display.window((64, 64)), device=device, **asked)


def test_a_tree_is_for_meshes_that_keep_their_shape_and_policies_that_leave_something_out(mesh: Mesh) -> None:
    tree = FoldTree(build_vertex_tree(mesh))
    with pytest.raises(InputError, match="deformed is drawn in full: leave out its tree"):
        MeshLayer(mesh, tree=tree, deformed=lambda _time_s: mesh)
    with pytest.raises(InputError, match="give MeshLayer its tree"):
        MeshLayer(mesh, policy=Policy())
    with pytest.raises(InputError, match="deformed is drawn in full: give the policy full"):
        MeshLayer(mesh, policy=Policy(), deformed=lambda _time_s: mesh)
