"""Levels change without a pop: blended in space while viewers walk, faded in time where a page came late."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import pack
from limen.layers.common.page_detail import KEPT
from limen.layers.image import select as selector
from limen.layers.image.draw import uniforms as records
from limen.layers.image.select import select, view_of
from limen.viewing.placement import OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer
from limen.vision.acuity import optimal_distance_m
from limen.vision.contrast import sensitivity
from support.studio import linear

pytestmark = pytest.mark.drawing

_PITCH_M = 0.000_233_47
_SPEED_M_S = 1.252
_RATE_HZ = 60
_SIDE = 64


def _sequence(studio: Any, image: Any, distances_m: Any) -> Any:
    """Linear light of every pixel's green, frame by frame."""
    return linear(_pictures(studio, image, distances_m)[..., 1])


def _pictures(studio: Any, image: Any, distances_m: Any) -> Any:
    """Frame by frame what is drawn as a viewer walks straight at the middle of a small panel, (frames, H, W, 3)."""
    panel = Panel("p", (_SIDE, _SIDE), (-_SIDE / 2 * _PITCH_M, _SIDE / 2 * _PITCH_M, 0.0), (1, 0, 0), (0, -1, 0),
                  (_PITCH_M, _PITCH_M))  # fmt: skip
    display = Display("small", (panel,))
    view = view_of(display, image.pyramid, OnSurface("one-to-one"))
    quilt = pack(display)[0]
    frames = []
    with studio.exhibit(image) as shown:
        for distance_m in distances_m:
            tolerance = tolerance_of([Viewer((0.0, 0.0, distance_m), eye_separation_m=0.0)], Policy())
            cut = select(view, tolerance)
            shown.settle(cut.pages)
            frames.append(shown.draw(quilt, shown.part(view, cut, tolerance))[..., :3])
    return np.array(frames)


def test_a_plain_picture_stays_plain_where_levels_blend(studio: Any, memory_image: Any) -> None:
    """Two parts of a colour, rounded one by one, add up to another: bands of a code, as wide as a blend."""
    code = (13, 38, 71)
    sea = memory_image(np.full((600, 600, 3), code, np.uint8))
    edge_m = 2 * optimal_distance_m(_PITCH_M, 0.64) / KEPT
    pictures = _pictures(studio, sea, edge_m * np.exp2(np.linspace(-0.2, 0.05, 26)))
    np.testing.assert_array_equal(pictures, np.broadcast_to(code, pictures.shape))


def _flicker(frames: Any) -> Any:
    """The contrast that flickers at each temporal frequency, over half a second: (Hz, Michelson of a sinusoid)."""
    contrast = (frames - frames.mean(axis=0)) / frames.mean()
    window = np.hanning(_RATE_HZ // 2)
    found = []
    for start in range(0, len(frames) - len(window) + 1, 3):
        spectrum = np.fft.rfft(contrast[start : start + len(window)] * window[:, None, None], axis=0)
        amplitude = 2 * np.abs(spectrum) / window.sum()
        found.append(np.sqrt(2 * (amplitude**2).mean(axis=(1, 2))))
    return np.fft.rfftfreq(len(window), 1 / _RATE_HZ), np.max(found, axis=0)


def test_walking_past_a_level_flickers_less_than_eyes_can_see(
    studio: Any, memory_image: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    noise = memory_image(np.random.default_rng(3).choice(np.array([0, 255], np.uint8), (600, 600, 1)).repeat(3, axis=2))
    edge_m = 2 * optimal_distance_m(_PITCH_M, 0.64) / KEPT
    distances_m = edge_m - 0.45 + np.arange(48) / _RATE_HZ * _SPEED_M_S
    blended = _sequence(studio, noise, distances_m)
    for module in (records, selector):
        monkeypatch.setattr(module, "BLEND_LEVELS", 1e-6)
    hard = _sequence(studio, noise, distances_m)

    # Both begin with one level and end with the other, to the last bit of a sample's place; only the way differs.
    assert np.abs(blended[0] - hard[0]).max() < 0.01
    assert np.abs(blended[-1] - hard[-1]).max() < 0.01
    change = np.abs(hard[-1] - hard[0])
    assert change.mean() > 0.1
    popped, stepped = (
        np.abs(np.diff(frames, axis=0)).max(axis=0)[change > 0.1] / change[change > 0.1] for frames in (hard, blended)
    )
    assert np.median(popped) > 0.99, "the control pops in one frame"
    assert np.percentile(stepped, 99) < 0.2

    # What a page of level 1 lacks begins at its own highest frequency.
    lost_cpd = 1 / (2 * 2 * np.degrees(np.arctan(_PITCH_M / edge_m)))
    hertz, flicker = _flicker(blended)
    _, popping = _flicker(hard)
    felt = hertz >= 4
    seen = flicker[felt] * sensitivity(lost_cpd, 0, 100, hertz[felt])
    assert seen.max() < 1, "castleCSF at the change's own frequencies"
    control = popping[felt] * sensitivity(lost_cpd, 0, 100, hertz[felt])
    assert control.max() > 1.5 * seen.max(), (control, seen)


@pytest.mark.parametrize("shape", ["flat", "plane"])
def test_a_page_that_fades_in_is_mixed_with_the_one_it_replaces(shape: str, studio: Any, memory_image: Any) -> None:
    image = memory_image(np.random.default_rng(4).integers(0, 256, (700, 900, 3), dtype=np.uint8))
    display = Display.window((300, 200))
    eye_m = (0.0, 0.0, 1.0)
    width, height = display.surface.width, display.surface.height
    flat = shape == "flat"
    placement = OnSurface("contain") if flat else OnShape(
        "plane", (-width, height, -1.0), (2 * width, 0, 0), (0, -2 * height, 0), eye_m=eye_m
    )  # fmt: skip
    view = view_of(display, image.pyramid, placement)
    nobody = tolerance_of([], Policy("full"))
    cut, quilt = select(view, nobody, eye_m=eye_m), pack(display)[0]
    pictures = {}
    with studio.exhibit(image) as exhibit:
        stream = exhibit.stream

        def shown(now_s: float) -> Any:
            update = stream.update(cut.pages, now_s=now_s)
            exhibit.drawer.upload(0, update)
            part = exhibit.part(view, cut, nobody, eye_m)
            assert flat == (part.pages.table is None)
            return exhibit.draw(quilt, part)[..., :3], update.statistics.missing

        exhibit.settle(image.coarsest)
        while shown(5.0)[1] or not stream.settled:
            stream.wait()
        for name, now_s in (("before", 5.0), ("halfway", 5.1), ("after", 5.3)):
            pictures[name], _ = shown(now_s)
    light = {name: linear(picture) for name, picture in pictures.items()}
    assert np.abs(light["after"] - light["before"]).mean() > 0.02
    np.testing.assert_allclose(light["halfway"], (light["before"] + light["after"]) / 2, atol=0.02)
