"""Clouds on displays: complete pictures wait for chunks, live ones do not; what cannot be is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.clouds import ball

import limen
from limen.data.points.nodes import CHUNK_NODES, NODE
from limen.display.display import Display
from limen.errors import InputError, PageError
from limen.layers.points.renderer import PointsRenderer
from limen.layers.points.stream import CHUNK_BYTES, PointStream
from limen.show.points_stage import PointsExhibit
from limen.show.stage import SceneSettings
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

pytestmark = pytest.mark.drawing

CLOUD = ball(20_000)
VIEWER = Viewer((0.0, 0.0, 0.0), eye_separation_m=0.0)
DISPLAY = Display.window((320, 240))
AT = np.array([[0.3, 0, 0, 0], [0, 0.3, 0, 0], [0, 0, 0.3, -1.5], [0, 0, 0, 1.0]])


@pytest.mark.gpu
def test_complete_pictures_have_all_and_live_ones_begin_with_tops(device: Any) -> None:
    with PointsRenderer(device, DISPLAY, CLOUD, room_from_file=AT) as renderer:
        live = renderer.frame([VIEWER], Policy("full"))
        assert live.missing > 0
        assert live.splats < 200
        ((_, picture, report),) = renderer.pictures([VIEWER], Policy("full"))
        assert report.missing == 0
        assert report.distance_factor <= 1
        assert report.splats > 3 * live.splats
        assert (picture[..., 2] > 30).mean() > 0.2


@pytest.mark.gpu
def test_a_budget_of_time_buys_what_fits(device: Any) -> None:
    with PointsRenderer(device, DISPLAY, CLOUD, room_from_file=AT) as renderer:
        list(renderer.pictures([VIEWER], Policy("full")))  # all chunks are there then
        splats = {}
        for max_ms in (0.01, 1e6):
            policy = Policy("budget", max_ms=max_ms)
            splats[max_ms] = [renderer.frame([VIEWER], policy).splats for _ in range(9)][-1]
            assert renderer.frame([VIEWER], policy).policy.startswith(f"budget:{max_ms:g}ms")
    assert splats[0.01] <= 500 < splats[1e6]


@pytest.mark.gpu
def test_with_room_for_one_chunk_the_rest_is_drawn_as_tops(device: Any) -> None:
    with PointsRenderer(device, DISPLAY, CLOUD, room_from_file=AT, gpu_bytes=CHUNK_BYTES) as renderer:
        ((_, picture, report),) = renderer.pictures([VIEWER], Policy("full"))
        assert report.missing == report.chunks - 1
        assert report.distance_factor > 1
        assert (picture[..., 2] > 30).mean() > 0.2


@pytest.mark.gpu
def test_simplified_looks_the_same_from_afar(device: Any) -> None:
    far = AT.copy()
    far[2, 3] = -12.0
    with PointsRenderer(device, DISPLAY, CLOUD, room_from_file=far) as renderer:
        found = {}
        for policy in ("full", "contrast", "budget:300"):
            ((_, picture, report),) = renderer.pictures([VIEWER], Policy.parse(policy))
            found[policy] = (picture.astype(int), report.splats)
    assert found["budget:300"][1] <= 300
    assert found["contrast"][1] <= found["full"][1]
    assert np.abs(found["contrast"][0] - found["full"][0]).mean() < 1.0


@pytest.mark.gpu
def test_render_and_exhibits_draw_clouds(device: Any) -> None:
    pictures = limen.render(CLOUD, DISPLAY, [VIEWER], "acuity", placement=AT, device=device, overlay="simplified")
    (picture,) = pictures.values()
    assert picture.shape == (240, 320, 4)
    with pytest.raises(InputError, match="give a viewer"):
        limen.render(CLOUD, DISPLAY, device=device)
    with pytest.raises(InputError, match="sheared or stretched"):
        limen.render(CLOUD, DISPLAY, [VIEWER], placement=np.diag([1.0, 2, 1, 1]), device=device)
    stage = PointsExhibit(CLOUD).on(device, DISPLAY)
    try:
        stage.pose(1.0)
        _, report = stage.textures([VIEWER], overlay=True)
        assert report.panels_active == 1
        assert "splats" in report.drawn
    finally:
        stage.close()


def test_what_is_for_meshes_is_refused() -> None:
    with pytest.raises(InputError, match="one eye"):
        PointsExhibit(CLOUD, SceneSettings(stereo="anaglyph"))
    with pytest.raises(InputError, match="ripple"):
        PointsExhibit(CLOUD, SceneSettings(animate="ripple"))


# ---------------------------------------------------------------------- the stream


class Broken:
    """A cloud of which one chunk cannot be read."""

    def __init__(self, bad: int) -> None:
        self._bad, self.chunks = bad, CLOUD.chunks

    def read_chunk(self, chunk: int) -> Any:
        if chunk == self._bad:
            raise PageError(f"chunk {chunk} is damaged")
        return CLOUD.read_chunk(chunk)


def settled(stream: PointStream, wanted: Any) -> Any:
    update = stream.update(wanted)
    while not stream.settled:
        stream.wait(0.1)
        update = stream.update(wanted)
    return update


def test_a_chunk_that_cannot_be_read_is_given_up_and_the_others_come() -> None:
    wanted = np.arange(CLOUD.chunks)
    with PointStream(Broken(2), slots=99) as stream:  # type: ignore[arg-type]
        update = settled(stream, wanted)
        assert update.statistics.missing == 1
        assert update.statistics.failed == 1
        assert stream.resident.mask.sum() == CLOUD.chunks - 1


def test_slots_hold_what_was_wanted_last_and_the_nodes_are_the_chunks() -> None:
    with PointStream(CLOUD, slots=2) as stream:
        settled(stream, np.array([0, 1]))
        update = settled(stream, np.array([3, 1, 4]))
        assert update.statistics.denied == 1
        slots = stream.nodes.slots
        assert sorted(np.flatnonzero(slots >= 0)) == [1, 3]
        words = stream.nodes.words[slots[3]]
        assert np.array_equal(words.reshape(-1), CLOUD.read_chunk(3).view(np.uint32))
        assert words.shape == (CHUNK_NODES, NODE.itemsize // 4)


def test_no_room_is_refused() -> None:
    with pytest.raises(InputError, match="room for at least one"):
        PointStream(CLOUD, slots=0)
