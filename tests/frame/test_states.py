"""What a frame's message says of every kind of content: where it is, for whose eyes it is drawn, and what cannot be."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from limen.errors import InputError
from limen.layers.registry import KINDS
from limen.viewing.camera import Camera
from limen.viewing.placement import InRoom, LookAt, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.state import AnyPlacement
from limen.viewing.viewer import Viewer
from support.frames import (
    ELSEWHERE,
    EYE,
    FULL,
    STANDS,
    VIEWER,
    WALL,
    Make,
    assert_equal,
    assert_same,
    changed,
    drawn,
    frame_of,
    lit,
    off,
)

pytestmark = [pytest.mark.gpu, pytest.mark.drawing]

FOREIGN: dict[str, AnyPlacement] = {
    "image": InRoom.of(STANDS), "mesh": OnSurface(), "terrain": InRoom.of(STANDS), "points": LookAt(),
}  # fmt: skip
IN_ROOM = [kind for kind in KINDS if kind != "image"]


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
