"""Contrasts of nodes against brute force: every point of the cloud is asked whether a sphere meets it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from limen.data import build_points
from limen.data.points import contrast as point_contrast
from limen.data.points.light_kernels import BRIGHTER, DARKER, code_of
from limen.vision.contrast_codes import code_of_luminances
from limen.vision.luminance import Photometry
from support.point_reference import levels_of


def over_brute_force(points, photometry):
    """How many codes each level's contrasts lie above those of all points that meet the spheres."""
    levels = levels_of(points)
    light = photometry.luminance_cd_m2(levels[0].rgb)
    found = []
    for level in levels[1:]:
        apart = np.linalg.norm(level.place[:, None] - levels[0].place[None], axis=2)
        meets = apart <= level.radius[:, None] + levels[0].radius[None]
        low = np.where(meets, light, np.inf).min(axis=1)
        high = np.where(meets, light, -np.inf).max(axis=1)
        expected = code_of_luminances(photometry.luminance_cd_m2(level.rgb), low, high)
        found.append(level.contrast.astype(int) - expected)
    return found


@settings(max_examples=12, deadline=None)
@given(st.integers(1, 6000), st.integers(0, 2**32 - 1), st.floats(0, 30), st.integers(0, 2))
def test_no_contrast_is_less_than_that_of_all_points_met(count, seed, noise, power):
    chance = np.random.default_rng(seed)
    places = chance.random((count, 3)) ** (2**power) * [10.0, 8.0, 0.5] + 1000.0
    grey = 120 + 80 * np.sin(places[:, 0]) * np.cos(places[:, 1]) + noise * chance.normal(size=count)
    rgb = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[:, None], 3, axis=1)
    for over in over_brute_force(build_points(rgb=rgb, positions=places), Photometry.srgb()):
        assert over.min() >= 0


def test_of_groups_of_8_64_and_512_it_is_that_of_the_very_points():
    """Three chunks, so that groups at borders meet points of others."""
    chance = np.random.default_rng(3)
    places = np.concatenate([chance.random((9000, 2)) * 40, np.zeros((9000, 1))], axis=1)
    rgb = np.repeat((60 + 4 * places[:, :1]).astype(np.uint8), 3, axis=1)
    over = over_brute_force(build_points(places, rgb), Photometry.srgb())
    for exact in over[:3]:
        assert np.all(exact >= 0)
        assert np.mean(exact > 0) < 0.01
    # Nodes above look at nodes, which hold a little more: here less than twice the contrast, which is 25 codes.
    assert max(np.mean(each) for each in over[1:]) < 25


def test_chunks_that_were_forgotten_are_decoded_again(monkeypatch):
    """A long strip of 30 chunks, up to 14 of them near one: with room for 16, some have to go and are wanted again."""
    chance = np.random.default_rng(6)
    places = chance.random((120_000, 3)) * [1000.0, 1.0, 0.1]
    rgb = np.repeat(chance.integers(40, 200, (120_000, 1)), 3, axis=1)
    kept = [level.contrast for level in levels_of(build_points(places, rgb))[1:]]
    monkeypatch.setattr(point_contrast, "_SLOTS", 16)
    for ours, theirs in zip(levels_of(build_points(places, rgb))[1:], kept, strict=True):
        assert np.array_equal(ours.contrast, theirs)


LIGHT = st.floats(0, 1000, width=32)


@given(LIGHT, LIGHT, LIGHT)
def test_codes_are_the_smallest_that_are_enough(shown, one, other):
    low, high = min(one, other), max(one, other)
    code, plain = code_of(shown, low, high), int(code_of_luminances(shown, low, high))
    assert plain <= code <= plain + 1  # luminances may be off by a millionth: then a code more


@given(LIGHT, LIGHT, st.integers(0, 255))
def test_what_raises_no_code_is_between_its_darker_and_its_brighter(shown, other, code):
    if shown > 0 and shown * DARKER[code] <= other <= shown * BRIGHTER[code]:
        assert int(code_of_luminances(shown, other, other)) <= code


def test_a_dark_room_is_not_a_bright_one():
    """The display's own black and what it reflects take contrast away."""
    chance = np.random.default_rng(4)
    places, rgb = chance.random((5000, 3)), chance.integers(0, 30, (5000, 3))
    dark, bright = (Photometry.srgb(100.0, ambient_cd_m2=each) for each in (0.0, 5.0))
    in_dark, in_light = (levels_of(build_points(places, rgb, photometry=each))[1] for each in (dark, bright))
    assert np.median(in_light.contrast) < np.median(in_dark.contrast) - 20
    for over in over_brute_force(build_points(places, rgb, photometry=bright), bright):
        assert over.min() >= 0


@pytest.mark.parametrize("count", [3000, 300_000])
def test_a_cloud_in_one_place_takes_no_longer(count):
    """Every sphere meets every other: lists of neighbours stay short, and what is found stays right."""
    grey = np.full((count, 3), 90, np.uint8)
    grey[count // 3] = 200
    points = build_points(np.zeros((count, 3)), grey, estimate_normals=False)
    dark, bright = Photometry.srgb().luminance_cd_m2([[90] * 3, [200] * 3])
    plain = int(code_of_luminances(dark, dark, bright))
    for level in levels_of(points)[1:]:
        assert np.all(np.abs(level.contrast.astype(int) - plain) <= 40)
        assert level.contrast.min() > 150
