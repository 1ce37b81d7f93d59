"""Frames of every kind of content: live ones never wait, finished ones are the same again, and all is given back."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import pytest

from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.gpu.buffers import TextureReader
from limen.layers.base import Layer
from limen.stream.chunks import Allocator, ChunkStream, Streaming
from limen.stream.pages import FADE_S
from limen.viewing.camera import Camera
from limen.viewing.state import decode, encode
from limen.viewing.viewer import Viewer
from support.frames import (
    ELSEWHERE,
    EYE,
    MEMORY,
    SMALL_PX,
    VIEWER,
    WALL,
    Make,
    assert_equal,
    assert_same,
    drawn,
    frame_of,
    lit,
    living,
    row_of,
)

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]


# ---------------------------------------------------------------------------- what it holds


def test_what_is_closed_leaves_nothing_behind(device: Any, layer: Layer) -> None:
    camera = Camera(EYE, (0.0, 1.5, -1.5), (40, 30), 60.0)

    def use() -> None:
        with Renderer(device, WALL, [layer], gpu_bytes=MEMORY, max_quilt_px=SMALL_PX) as renderer:
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
        with Renderer(device, WALL, [layer], gpu_bytes=MEMORY) as renderer:
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
    one = make()
    every, _ = drawn(one, frame_of(one, VIEWER))
    part = WALL.select("wall/2,*")
    with Renderer(device, part, [layer], gpu_bytes=MEMORY, whole=WALL) as renderer:
        some, _ = drawn(renderer, frame_of(renderer, VIEWER))
    assert list(some) == [f"wall/2,{row}" for row in range(4)]
    if kind == "image":  # lies on what it is shown on
        return
    for name, picture in some.items():
        assert_same(picture, every[name], 0.004)


# ---------------------------------------------------------------------------- what cannot be


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
