"""Clouds of points: tops stand in for chunks that are not there, budgets are kept; what cannot be is refused."""

from __future__ import annotations

from functools import cache
from typing import Any

import msgspec
import numpy as np
import pytest

import limen
from limen.data.points.file import Points
from limen.data.points.nodes import CHUNK_NODES, NODE
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.errors import InputError, PageError
from limen.frame.renderer import Renderer
from limen.layers.base import Turn
from limen.layers.common.room_placement import RoomPlacement
from limen.layers.points.draw.drawer import CHUNK_BYTES
from limen.layers.points.layer import PointsLayer, PointsSelector
from limen.layers.registry import KINDS
from limen.stream.allocators import Slots
from limen.stream.chunks import ChunkStream
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels, QuiltView
from limen.viewing.state import FrameState
from limen.viewing.viewer import Viewer
from support.clouds import ball
from support.frames import FULL, drawn, frame_of, row_of

pytestmark = pytest.mark.drawing


@cache
def a_ball() -> Points:
    return ball(20_000)


VIEWER = Viewer((0.0, 0.0, 0.0), eye_separation_m=0.0)
DISPLAY = Display.window((320, 240))
AT = np.array([[0.3, 0, 0, 0], [0, 0.3, 0, 0], [0, 0, 0.3, -1.5], [0, 0, 0, 1.0]])
STANDS = RoomPlacement(matrix=AT)
ONE_CHUNK = round(CHUNK_BYTES / KINDS["points"].memory_share)
"""Memory of a frame of which the cloud's share holds one chunk."""


@pytest.mark.gpu
def test_complete_pictures_have_all_and_live_ones_begin_with_tops(device: Any) -> None:
    with Renderer(device, DISPLAY, [PointsLayer(a_ball(), STANDS, FULL)]) as renderer:
        frame = frame_of(renderer, VIEWER)
        live = row_of(renderer.frame(frame))
        assert live.missing > 0
        assert live.drawn < 200
        pictures, report = drawn(renderer, frame)
        (picture,) = pictures.values()
        row = row_of(report)
        assert row.missing == 0
        assert row.distance_factor is not None
        assert row.distance_factor <= 1
        assert row.drawn > 3 * live.drawn
        assert (picture[..., 2] > 30).mean() > 0.2


@pytest.mark.gpu
def test_a_budget_of_time_buys_what_fits(device: Any) -> None:
    with Renderer(device, DISPLAY, [PointsLayer(a_ball(), STANDS)]) as renderer:
        list(renderer.pictures(frame_of(renderer, VIEWER, policy=FULL)))  # all chunks are there then
        splats = {}
        for max_ms in (0.01, 1e6):
            frame = frame_of(renderer, VIEWER, policy=Policy("budget", max_ms=max_ms))
            splats[max_ms] = [row_of(renderer.frame(frame)).drawn for _ in range(9)][-1]
            assert row_of(renderer.frame(frame)).policy.startswith(f"budget:{max_ms:g}ms")
    assert splats[0.01] <= 500 < splats[1e6]


@pytest.mark.gpu
def test_with_room_for_one_chunk_the_rest_is_drawn_as_tops(device: Any) -> None:
    with Renderer(device, DISPLAY, [PointsLayer(a_ball(), STANDS, FULL)], gpu_bytes=ONE_CHUNK) as renderer:
        pictures, report = drawn(renderer, frame_of(renderer, VIEWER))
        (picture,) = pictures.values()
        row = row_of(report)
        assert row.missing == row.chunks - 1
        assert row.distance_factor is not None
        assert row.distance_factor > 1
        assert (picture[..., 2] > 30).mean() > 0.2


@pytest.mark.gpu
def test_simplified_looks_the_same_from_afar(device: Any) -> None:
    far = AT.copy()
    far[2, 3] = -12.0
    with Renderer(device, DISPLAY, [PointsLayer(a_ball(), RoomPlacement(matrix=far))]) as renderer:
        found = {}
        for policy in ("full", "contrast", "budget:300"):
            pictures, report = drawn(renderer, frame_of(renderer, VIEWER, policy=Policy.parse(policy)))
            (picture,) = pictures.values()
            found[policy] = (picture.astype(int), row_of(report).drawn)
    assert found["budget:300"][1] <= 300
    assert found["contrast"][1] <= found["full"][1]
    assert np.abs(found["contrast"][0] - found["full"][0]).mean() < 1.0


@pytest.mark.gpu
def test_render_draws_clouds(device: Any) -> None:
    pictures = limen.render(a_ball(), DISPLAY, [VIEWER], "acuity", placement=AT, device=device, overlay="simplified")
    (picture,) = pictures.values()
    assert picture.shape == (240, 320, 4)
    with pytest.raises(InputError, match="give a viewer"):
        limen.render(a_ball(), DISPLAY, device=device)
    with pytest.raises(InputError, match="sheared or stretched"):
        limen.render(a_ball(), DISPLAY, [VIEWER], placement=np.diag([1.0, 2, 1, 1]), device=device)


@pytest.mark.gpu
def test_a_cloud_that_turns_is_drawn_live_with_what_is_shown_over_it(device: Any) -> None:
    layer = PointsLayer(a_ball(), RoomPlacement(turning=True))
    assert layer.overlay_word == "simplified"
    with Renderer(device, DISPLAY, [layer]) as renderer:
        _, report = renderer.textures(frame_of(renderer, VIEWER, time_s=1.0, overlay=layer.overlay_word))
        row = row_of(report)
        assert (row.kind, row.panels_active) == ("points", 1)
        assert row.drawn > 0
    states = [layer.state(time_s, DISPLAY) for time_s in (0.0, 1.0)]
    assert states[0].placement != states[1].placement
    assert all(state.motion_matrix.any() for state in states)
    assert PointsLayer(a_ball()).state(1.0, DISPLAY).motion is None


def test_a_cloud_that_was_dragged_stays_where_its_middle_is() -> None:
    layer = PointsLayer(a_ball(), STANDS)
    state = layer.state(0.0, DISPLAY)
    assert layer.turned(state, Turn(), DISPLAY) is state
    turned = layer.turned(state, Turn(30.0, 10.0, 2.0), DISPLAY)
    assert turned == msgspec.structs.replace(state, placement=turned.placement)
    assert isinstance(turned.placement, InRoom)
    middle = np.append(a_ball().bounds.mean(axis=0), 1.0)
    np.testing.assert_allclose(turned.placement.matrix @ middle, AT @ middle, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(turned.placement.matrix[:3, :3], axis=0), 0.15)


# ---------------------------------------------------------------------- the stream


class Broken:
    """A cloud of which one chunk cannot be read."""

    def __init__(self, bad: int) -> None:
        self._bad = bad

    def __getattr__(self, name: str) -> Any:
        return getattr(a_ball(), name)

    def read_chunk(self, chunk: int) -> Any:
        if chunk == self._bad:
            raise PageError(f"chunk {chunk} is damaged")
        return a_ball().read_chunk(chunk)


def selector_of(points: Points) -> PointsSelector:
    return PointsLayer(points, STANDS).selector(DISPLAY, DISPLAY)


def settled(selector: PointsSelector, stream: ChunkStream[Any], wanted: Any) -> Any:
    """The last update with which nothing more is to come; all that came was taken, as in the frames after a first."""
    (quilt,) = pack_outlines(DISPLAY)
    frame = FrameState(viewers=(VIEWER,), layers=(PointsLayer(a_ball(), STANDS).state(0.0, DISPLAY),))
    view = QuiltView.of(QuiltPanels(DISPLAY, quilt), [VIEWER.position_m])
    selector.select([view], frame.layers[0], frame, [stream.resident], live=True)
    while True:
        update = stream.update(wanted)
        selector.take(0, update)
        if stream.settled:
            return update
        stream.wait(0.1)


def test_a_chunk_that_cannot_be_read_is_given_up_and_the_others_come() -> None:
    selector = selector_of(Broken(2))  # type: ignore[arg-type]
    with selector.sources[0].stream(Slots(99), 2) as stream:
        update = settled(selector, stream, np.arange(a_ball().chunks))
        assert update.statistics.missing == 1
        assert update.statistics.failed == 1
        assert stream.resident.mask.sum() == a_ball().chunks - 1


def test_slots_hold_what_was_wanted_last_and_the_nodes_are_the_chunks() -> None:
    selector = selector_of(a_ball())
    with selector.sources[0].stream(Slots(2), 2) as stream:
        settled(selector, stream, np.array([0, 1]))
        update = settled(selector, stream, np.array([3, 1, 4]))
        assert update.statistics.denied == 1
        slots = stream.resident.place[:, 0]
        assert sorted(np.flatnonzero(slots >= 0)) == [1, 3]
        words = selector._nodes.view(np.uint32).reshape(-1, CHUNK_NODES, NODE.itemsize // 4)[slots[3]]
        assert np.array_equal(words.reshape(-1), a_ball().read_chunk(3).view(np.uint32))
        assert words.shape == (CHUNK_NODES, NODE.itemsize // 4)


@pytest.mark.gpu
def test_no_room_is_refused(device: Any) -> None:
    with pytest.raises(InputError, match="room for at least one"):
        Renderer(device, DISPLAY, [PointsLayer(a_ball(), STANDS)], gpu_bytes=ONE_CHUNK - 4)
