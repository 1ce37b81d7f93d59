"""Faces become flat, convex outlines of at most eight corners, or are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.display.polygons import FLAT, are_outlines, convex_parts, flattened
from limen.errors import DisplayError
from limen.geometry import signed_area


def _star(radii: list[float]) -> np.ndarray:
    """A polygon around the origin: simple whatever the radii, and rarely convex."""
    angle = 2 * math.pi * np.arange(len(radii)) / len(radii)
    return np.array(radii)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@given(st.lists(st.floats(0.2, 2.0), min_size=3, max_size=24), st.booleans())
def test_parts_are_convex_small_and_make_up_the_polygon(radii: list[float], backward: bool) -> None:
    polygon = _star(radii)[:: -1 if backward else 1]
    parts = [polygon[part] for part in convex_parts(polygon, "p")]
    for part in parts:
        assert 3 <= len(part) <= 8
        assert are_outlines(part[None]).all() or abs(signed_area(part)) < 1e-5
    assert sum(signed_area(part) for part in parts) == pytest.approx(signed_area(polygon), rel=1e-5)
    assert len({math.copysign(1, signed_area(part)) for part in parts}) == 1, "none overlaps another, none is mirrored"


@pytest.mark.parametrize(("corners", "parts"), [(4, 1), (8, 1), (9, 2), (14, 2), (15, 3), (26, 4)])
def test_a_regular_polygon_is_cut_into_few_parts(corners: int, parts: int) -> None:
    assert len(convex_parts(_star([1.0] * corners), "p")) <= parts


def test_corners_in_the_middle_of_an_edge_are_dropped() -> None:
    (part,) = convex_parts(np.array([[0, 0], [1, 0], [2, 0], [3, 0], [3, 1], [0, 1], [0, 0.5]]), "p")
    assert sorted(part.tolist()) == [0, 3, 4, 5]


@pytest.mark.parametrize(
    "polygon",
    [
        [[0, 0], [2, 2], [2, 0], [0, 1]],  # a bow tie
        [[math.cos(4 * math.pi * k / 5), math.sin(4 * math.pi * k / 5)] for k in range(5)],  # a pentagram
        [[0, 0], [4, 0], [4, 3], [2, 0], [0, 3]],  # touches itself
    ],
)
def test_a_polygon_that_meets_itself_is_refused_by_name(polygon: list[list[float]]) -> None:
    assert not are_outlines(np.array([polygon])).any()
    with pytest.raises(DisplayError, match="face 7 crosses or touches itself"):
        convex_parts(np.array(polygon), "face 7")


@given(
    st.lists(st.floats(0.5, 2.0), min_size=3, max_size=9), st.floats(-0.9, 0.9), st.floats(0, 6.28), st.floats(-5, 5)
)
def test_a_flat_face_stays_where_it_is(radii: list[float], tilt: float, turn: float, away: float) -> None:
    normal = np.array([math.sin(turn) * math.cos(tilt), math.sin(tilt), math.cos(turn) * math.cos(tilt)])
    across = np.array([math.cos(turn), 0, -math.sin(turn)])
    face = _star(radii) @ np.stack([across, np.cross(normal, across)]) + away * normal
    corners, found = flattened(face[None], str)
    np.testing.assert_allclose(corners[0], face, atol=1e-9)
    np.testing.assert_allclose(found[0], normal, atol=1e-9)


@pytest.mark.parametrize(("lift", "refused"), [(0.9, False), (1.1, True)])
def test_the_tolerance_of_flatness_is_the_stated_share_of_the_extent(lift: float, refused: bool) -> None:
    """Of a square with one corner lifted, corners lie half as far above and below the best plane, in all."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 2 * lift * FLAT * math.sqrt(2)], [0, 1, 0]], dtype=float)
    if refused:
        with pytest.raises(DisplayError, match=r"a\.obj: face 3 is not flat.*0\.1%"):
            flattened(square[None], lambda row: f"a.obj: face {row + 3}")
    else:
        corners, normal = flattened(square[None], str)
        np.testing.assert_allclose((corners[0] - corners[0, 0]) @ normal[0], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("face", "words"),
    [
        ([[0, 0, 0], [1, 0, 0], [1, 0, 0]], "two corners in one place"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], "no area"),
        ([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]], "no area"),
    ],
)
def test_a_degenerate_face_is_refused_by_name_and_others_counted(face: list[list[float]], words: str) -> None:
    good = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]][: len(face)]
    with pytest.raises(DisplayError, match=rf"face 1 has {words}.*\(and 1 more faces\)"):
        flattened(np.array([good, face, face], dtype=float), lambda row: f"face {row}")
