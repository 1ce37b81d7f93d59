"""Frames of every kind of content: live ones never wait, finished ones are the same again, what cannot be is said."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from clouds import ball
from frames import FULL, Rgb, assert_same, changed, drawn, frame_of, living, row_of
from limen.data.image.file import open_image
from limen.data.samples.mesh import torus_knot
from limen.data.terrain.file import Terrain
from limen.display.display import Display
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.gpu.buffers import TextureReader
from limen.layers.base import Layer
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.image.layer import ImageLayer
from limen.layers.mesh.layer import MeshLayer
from limen.layers.points.layer import PointsLayer
from limen.layers.registry import KINDS
from limen.layers.terrain.layer import TerrainLayer
from limen.layers.terrain.selector import TerrainSettings
from limen.stream.chunks import Allocator, ChunkStream, Streaming
from limen.stream.pages import FADE_S
from limen.viewing.camera import Camera
from limen.viewing.placement import InRoom, LookAt, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import AnyPlacement, decode, encode
from limen.viewing.viewer import Viewer

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

WALL = Display.preset("rostock").scaled(0.05)  # 24 panels of 96 x 60 pixels
EYE = (0.2, 1.7, 0.3)
VIEWER = Viewer(EYE, time_s=2.5)
SMALL_PX = 30_000  # of a quilt: four of the panels and more
STANDS = np.array([[0.7, 0, 0, 0], [0, 0.7, 0, 1.5], [0, 0, 0.7, -3.0], [0, 0, 0, 1.0]])
CLOSE = LookAt((0.55, 0.5), 30, 35, 5_000)
ELSEWHERE: dict[str, AnyPlacement] = {
    "image": OnSurface(zoom=2.0, centre=(0.3, 0.6)),
    "mesh": InRoom.of(STANDS @ np.diag([0.5, 0.5, 0.5, 1.0])),
    "terrain": msgspec.structs.replace(CLOSE, heading_deg=120.0),
    "points": InRoom.of(STANDS @ np.diag([0.5, 0.5, 0.5, 1.0])),
}
FOREIGN: dict[str, AnyPlacement] = {
    "image": InRoom.of(STANDS), "mesh": OnSurface(), "terrain": InRoom.of(STANDS), "points": LookAt(),
}  # fmt: skip
IN_ROOM = [kind for kind in KINDS if kind != "image"]

Make = Callable[..., Renderer]


@pytest.fixture(scope="module")
def layers(world: Path, terrain: Terrain) -> Iterator[dict[str, Layer]]:
    """One of every kind, of which all detail is drawn."""
    with open_image(world) as image:
        yield {
            "image": ImageLayer(image, policy=FULL),
            "mesh": MeshLayer(torus_knot(3000), RoomPlacement()),
            "terrain": TerrainLayer(terrain, settings=TerrainSettings(CLOSE), policy=FULL, reference_m=EYE),
            "points": PointsLayer(ball(20_000), RoomPlacement(matrix=STANDS), FULL),
        }


@pytest.fixture(params=list(KINDS))
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def layer(kind: str, layers: dict[str, Layer]) -> Layer:
    return layers[kind]


@pytest.fixture
def make(device: Any, layer: Layer) -> Iterator[Make]:
    """Makes renderers of the layer."""
    made: list[Renderer] = []

    def renderer(**options: Any) -> Renderer:
        made.append(Renderer(device, WALL, [layer], **options))
        return made[-1]

    yield renderer
    for each in made:
        each.close()


def assert_equal(one: dict[str, Rgb], other: dict[str, Rgb]) -> None:
    assert list(one) == list(other)
    for name, picture in one.items():
        np.testing.assert_array_equal(picture, other[name], name)


def lit(pictures: dict[str, Rgb]) -> int:
    """How many pixels show more than what lies behind everything."""
    return sum(int((picture.max(axis=-1) > 40).sum()) for picture in pictures.values())


def off(one: dict[str, Rgb], other: dict[str, Rgb]) -> int:
    """How many pixels clearly differ."""
    assert list(one) == list(other)
    return sum(int((np.abs(one[name].astype(int) - other[name]).max(axis=-1) > 8).sum()) for name in one)


# ---------------------------------------------------------------------------- what it holds


def test_what_is_closed_leaves_nothing_behind(device: Any, layer: Layer) -> None:
    camera = Camera(EYE, (0.0, 1.5, -1.5), (40, 30), 60.0)

    def use() -> None:
        with Renderer(device, WALL, [layer], max_quilt_px=SMALL_PX) as renderer:
            frame = frame_of(renderer, VIEWER)
            renderer.frame(frame)
            assert len(drawn(renderer, frame)[0]) == 24
            renderer.seen(frame, [camera])

    use()
    before, threads = living(), threading.active_count()
    use()
    assert living() == before
    assert threading.active_count() == threads


def test_the_device_and_the_content_stay_open(device: Any, layer: Layer) -> None:
    seen = []
    for _ in range(2):
        with Renderer(device, WALL, [layer]) as renderer:
            seen.append(drawn(renderer, frame_of(renderer, VIEWER))[0])
    assert_equal(*seen)


# ---------------------------------------------------------------------------- live


@dataclass(frozen=True)
class Gated:
    """A source of which nothing can be read while the gate is shut."""

    source: Any
    gate: threading.Event

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    def read(self, chunk: int) -> Any:
        self.gate.wait()
        return self.source.read(chunk)


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Through which all chunks come; opened in the end, for whoever waits there."""
    gate, stream = threading.Event(), Streaming.stream
    gate.set()

    def gated(self: Streaming, allocator: Allocator, threads: int) -> ChunkStream[Any]:
        return stream(replace(self, source=Gated(self.source, gate)), allocator, threads)

    monkeypatch.setattr(Streaming, "stream", gated)
    yield gate
    gate.set()


def test_live_frames_never_wait_and_end_with_the_finished_picture(
    device: Any, gate: threading.Event, make: Make, kind: str
) -> None:
    renderer = make()
    frame, streamed = frame_of(renderer, VIEWER), kind != "mesh"
    gate.clear()
    try:
        for _ in range(3):
            row = row_of(renderer.frame(frame, now_s=0.0))
            assert (row.missing > 0) == (row.chunks > 0) == streamed
            assert row.uploads == 0
    finally:
        gate.set()
    reader, uploads = TextureReader(device), 0
    for _ in range(1000):
        (texture,), report = renderer.textures(frame, now_s=0.0)
        reader.read(texture)  # or frames are submitted faster than drawn
        uploads += row_of(report).uploads
        if not report.missing:
            break
    (texture,), report = renderer.textures(frame, now_s=2 * FADE_S)
    assert report.missing == 0
    assert (uploads > 0) == streamed
    live = reader.read(texture)[..., :3].copy()
    reader.destroy()
    finished, _ = drawn(renderer, frame, by="quilts")
    assert_same(live, finished["quilt-0"], 0.002)


def test_a_report_tells_of_the_frame_and_of_its_layer(make: Make, layer: Layer, kind: str) -> None:
    renderer = make()
    frame = msgspec.structs.replace(frame_of(renderer, VIEWER), number=7)
    for report in (drawn(renderer, frame)[1], renderer.frame(frame)):
        row = row_of(report)
        assert (report.number, report.time_s, report.scale) == (7, 2.5, WALL.scale)
        assert (row.kind, row.name, row.policy) == (kind, layer.name, "full")
        assert 0 < row.panels_active <= 24
        assert row.items > 0
        assert row.drawn > 0 or kind == "image"
        assert min(row.select_ms, row.stream_ms, row.draw_ms) >= 0


# ---------------------------------------------------------------------------- finished


def test_finished_pictures_wait_and_are_the_same_whatever_was_drawn_before(make: Make, kind: str) -> None:
    renderer = make()
    frame = frame_of(renderer, VIEWER)
    first, report = drawn(renderer, frame)
    assert lit(first) > 1000
    assert report.missing == 0
    assert (row_of(report).uploads > 0) == (kind != "mesh")
    renderer.frame(frame_of(renderer, Viewer((0.9, 1.2, 1.0)), placement=ELSEWHERE[kind]))
    again, report = drawn(renderer, frame)
    assert_equal(first, again)
    assert report.missing == 0
    assert_equal(first, drawn(make(), frame)[0])


def test_the_message_says_all(make: Make) -> None:
    renderer = make()
    frame = frame_of(renderer, VIEWER)
    sent = decode(encode(frame))
    assert sent == frame
    assert_equal(drawn(renderer, frame)[0], drawn(make(), sent)[0])


def test_many_quilts_show_what_one_shows(make: Make) -> None:
    one, many = make(), make(max_quilt_px=SMALL_PX)
    assert len(one.quilts) == 1
    assert len(many.quilts) > 3
    assert sum(len(quilt.panels) for quilt in many.quilts) == 24
    frame = frame_of(one, VIEWER)
    (together, told), (apart, others) = (drawn(each, frame) for each in (one, many))
    assert set(together) == set(apart)
    for name, picture in together.items():
        assert_same(picture, apart[name], 0.004)
    assert lit(together) > 1000
    assert row_of(told).panels_active == row_of(others).panels_active
    assert row_of(told).drawn == pytest.approx(row_of(others).drawn, rel=0.01)
    rows = [row_of(each.frame(frame)) for each in (one, many)]
    assert rows[0].panels_active == rows[1].panels_active
    assert rows[0].drawn == pytest.approx(rows[1].drawn, rel=0.01)


def test_a_camera_sees_the_same_of_many_quilts(make: Make) -> None:
    """Quilts of one size keep their own pixels while the display is looked at."""
    cameras = [Camera(EYE, (0.0, 1.5, -1.5), size_px, 60.0) for size_px in ((160, 120), (80, 60))]
    seen = []
    for max_quilt_px in (1 << 26, SMALL_PX):
        renderer = make(max_quilt_px=max_quilt_px)
        seen.append([picture[..., :3] for picture in renderer.seen(frame_of(renderer, VIEWER), cameras)])
    assert [picture.shape for picture in seen[0]] == [(120, 160, 3), (60, 80, 3)]
    for one, many in zip(*seen, strict=True):
        assert (one.max(axis=-1) > 40).mean() > 0.05
        assert_same(one, many, 0.01)


def test_quilts_come_whole_and_by_name(make: Make) -> None:
    renderer = make(max_quilt_px=60_000)
    whole = [
        (name, picture.shape[:2]) for name, picture, _ in renderer.pictures(frame_of(renderer, VIEWER), by="quilts")
    ]
    assert whole == [(f"quilt-{number}", quilt.size_px[::-1]) for number, quilt in enumerate(renderer.quilts)]
    assert len(whole) > 1


def test_some_panels_are_drawn_alone(make: Make) -> None:
    renderer = make()
    frame = frame_of(renderer, VIEWER)
    every, _ = drawn(renderer, frame)
    asked = [7, 2, 14]
    some, report = drawn(renderer, frame, panels=asked)
    assert set(some) == {WALL.panels[panel].name for panel in asked}
    for name, picture in some.items():
        assert_same(picture, every[name], 0.004)
    assert 0 < row_of(report).panels_active <= 3
    assert_equal(every, drawn(renderer, frame)[0])


def test_panels_of_a_part_show_what_they_show_of_the_whole(device: Any, layer: Layer, make: Make, kind: str) -> None:
    every, _ = drawn(make(), frame_of(make(), VIEWER))
    part = WALL.select("wall/2,*")
    with Renderer(device, part, [layer], whole=WALL) as renderer:
        some, _ = drawn(renderer, frame_of(renderer, VIEWER))
    assert list(some) == [f"wall/2,{row}" for row in range(4)]
    if kind == "image":  # lies on what it is shown on
        return
    for name, picture in some.items():
        assert_same(picture, every[name], 0.004)


# ---------------------------------------------------------------------------- what a state says


def test_a_thing_moves_with_its_state_alone(make: Make, kind: str) -> None:
    renderer = make()
    here = frame_of(renderer, VIEWER)
    there = changed(here, placement=ELSEWHERE[kind])
    before, moved, after = (drawn(renderer, frame)[0] for frame in (here, there, here))
    assert off(before, moved) > 1000
    assert_equal(before, after)
    live = renderer.frame(there)
    assert live.layers[0].panels_active > 0


def test_what_is_invisible_leaves_the_background(make: Make) -> None:
    renderer = make(background=(0.5, 0.2, 0.05))
    hidden = frame_of(renderer, VIEWER, visible=False)
    for frame in (hidden, msgspec.structs.replace(hidden, viewers=())):
        pictures, report = drawn(renderer, frame)
        assert len(pictures) == 24
        for picture in pictures.values():
            assert np.abs(picture.astype(int) - (188, 124, 63)).max() <= 1
        assert (report.layers, report.missing) == ((), 0)
        assert renderer.frame(frame).layers == ()
    assert off(pictures, drawn(renderer, frame_of(renderer, VIEWER))[0]) > 1000


def test_what_is_shown_over_it_is_seen(make: Make, kind: str) -> None:
    renderer = make()
    # Something has to stand for more, to be shown as such; a mesh without a tree leaves nothing out.
    policy = Policy("budget", max_items=300) if kind == "points" else FULL
    bare = frame_of(renderer, VIEWER, policy=policy)
    plain, _ = drawn(renderer, bare)
    for overlay in set(KINDS[kind].overlays) - {"error"}:  # of what lenses bend
        shown = changed(bare, overlay=overlay)
        if (kind, overlay) == ("mesh", "simplified"):
            with pytest.raises(InputError, match="shows what a policy leaves out"):
                renderer.frame(shown)
            continue
        assert off(plain, drawn(renderer, shown)[0]) > 500, overlay
    assert_equal(plain, drawn(renderer, bare)[0])


def test_the_first_viewer_is_drawn_for_or_an_eye_of_the_renderers_own(make: Make, kind: str) -> None:
    aside = Viewer((-0.5, 1.3, 0.8))
    renderer, own = make(), make(eye_m=EYE)
    seen, _ = drawn(renderer, frame_of(renderer, VIEWER, aside))
    turned, _ = drawn(renderer, frame_of(renderer, aside, VIEWER))
    assert (off(seen, turned) > 1000) == (kind != "image")
    for viewers in ((), (aside,)):
        assert_equal(seen, drawn(own, frame_of(own, *viewers))[0])


# ---------------------------------------------------------------------------- two eyes


@pytest.mark.parametrize("kind", IN_ROOM, indirect=True)
def test_two_pictures_lie_side_by_side_or_come_after_each_other(make: Make) -> None:
    beside, after = make(stereo="side-by-side"), make(stereo="sequential")
    both, apart = (drawn(each, frame_of(each, VIEWER))[0] for each in (beside, after))
    assert list(both) == [panel.name for panel in WALL.panels]
    assert list(apart) == [f"{name}@{eye}" for name in both for eye in ("left", "right")]
    for name, picture in both.items():
        np.testing.assert_array_equal(picture, np.hstack([apart[f"{name}@left"], apart[f"{name}@right"]]))
    for eye, position_m in zip(("left", "right"), VIEWER.eyes_m, strict=True):
        one = make()
        alone, _ = drawn(one, frame_of(one, Viewer(tuple(position_m))))
        for name, picture in alone.items():
            assert_same(picture, apart[f"{name}@{eye}"], 0.01)


@pytest.mark.parametrize("kind", IN_ROOM, indirect=True)
def test_an_anaglyph_is_one_picture_that_cameras_see(make: Make) -> None:
    one, two = make(), make(stereo="anaglyph")
    plain, mixed = (drawn(each, frame_of(each, VIEWER))[0] for each in (one, two))
    assert off(plain, mixed) > 500
    camera = Camera(EYE, (0.0, 1.5, -1.5), (80, 60), 60.0)
    (seen,) = two.seen(frame_of(two, VIEWER), [camera])
    assert (seen[..., :3].max(axis=-1) > 40).mean() > 0.05
    assert len(two.textures(frame_of(two, VIEWER))[0]) == len(two.quilts)


@pytest.mark.parametrize("kind", IN_ROOM, indirect=True)
@pytest.mark.parametrize("stereo", ["side-by-side", "sequential"])
def test_no_camera_sees_two_pictures_at_once(make: Make, stereo: str) -> None:
    renderer = make(stereo=stereo)
    frame = frame_of(renderer, VIEWER)
    with pytest.raises(InputError, match=f"'{stereo}' shows two pictures at once"):
        renderer.seen(frame, [])
    with pytest.raises(InputError, match=f"'{stereo}' shows two pictures at once"):
        renderer.textures(frame)


# ---------------------------------------------------------------------------- what cannot be


def test_a_state_that_is_not_of_its_kind_is_refused_by_name(make: Make, kind: str) -> None:
    renderer = make()
    noun = KINDS[kind].noun
    wrongs: list[tuple[dict[str, Any], str]] = [
        ({"overlay": "sparkles"}, f"'sparkles' is not for {noun}: give '"),
        ({"placement": FOREIGN[kind]}, f"^{noun} is not placed by {type(FOREIGN[kind]).__name__}: give "),
    ]
    wrongs += [
        ({"policy": policy}, f"{policy.name}.* is not for {noun}: give full, acuity")
        for policy in (Policy("scheel"), Policy("budget", max_items=1000), Policy("size", max_items=1000))
        if policy.name not in KINDS[kind].policies
    ]
    assert len(wrongs) > 2
    for wrong, says in wrongs:
        frame = frame_of(renderer, VIEWER, **wrong)
        with pytest.raises(InputError, match=says):
            renderer.frame(frame)
        with pytest.raises(InputError, match=says):
            next(renderer.pictures(frame))
        renderer.frame(changed(frame, visible=False))
    assert lit(drawn(renderer, frame_of(renderer, VIEWER))[0]) > 1000, "it goes on"


def test_a_frame_has_a_state_for_every_layer(make: Make) -> None:
    renderer = make()
    frame = frame_of(renderer, VIEWER)
    for count in (0, 2):
        wrong = msgspec.structs.replace(frame, layers=frame.layers * count)
        with pytest.raises(InputError, match=f"a frame of {count} layers is drawn by a renderer of 1"):
            renderer.frame(wrong)
        with pytest.raises(InputError, match=f"a frame of {count} layers is drawn by a renderer of 1"):
            next(renderer.pictures(wrong))


def test_all_but_images_are_drawn_for_somebody(make: Make, kind: str) -> None:
    renderer = make()
    frame = frame_of(renderer)
    if kind == "image":
        assert lit(drawn(renderer, frame)[0]) > 1000
        assert renderer.frame(frame).layers[0].panels_active > 0
        return
    says = f"^{KINDS[kind].noun} is drawn for somebody's eyes: give a viewer"
    with pytest.raises(InputError, match=says):
        renderer.frame(frame)
    with pytest.raises(InputError, match=says):
        renderer.textures(frame)
    with pytest.raises(InputError, match=says):
        next(renderer.pictures(frame))
    with pytest.raises(InputError, match=says):
        renderer.seen(frame, [])


def test_a_stereo_that_does_not_exist_is_refused(make: Make) -> None:
    with pytest.raises(InputError, match="no stereo is named 'polarised': there are none, "):
        make(stereo="polarised")


@pytest.mark.parametrize("kind", ["image"], indirect=True)
def test_an_image_on_panels_is_alike_for_both_eyes(make: Make) -> None:
    for stereo in ("anaglyph", "side-by-side", "sequential"):
        with pytest.raises(InputError, match=f"alike for both eyes: leave out the stereo '{stereo}'"):
            make(stereo=stereo)


def test_nothing_is_not_shown(device: Any) -> None:
    with pytest.raises(InputError, match="give a layer"):
        Renderer(device, WALL, [])
