"""Packing outlines: apart by the gap, inside the quilt, every panel once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import limen
from limen.display.display import Display
from limen.display.mapping import quilt_outlines
from limen.display.packing import lit_fill, pack_outlines
from limen.display.panel import Panel
from limen.errors import DisplayError
from limen.geometry import signed_area


def _panel(number: int, corners: int, wide: float, high: float, turn: float, margin: float) -> Panel:
    angle = turn + 2 * math.pi * np.arange(corners) / corners
    outline = np.stack([wide * np.cos(angle), high * np.sin(angle)], axis=1)
    outline += margin - outline.min(axis=0)
    size = np.maximum(np.ceil(outline.max(axis=0) + margin), 1).astype(int).tolist()
    return Panel(
        f"p{number}", (size[0], size[1]), (0, 0, 0), (1, 0, 0), (0, -1, 0), (0.001, 0.001),
        outline_px=tuple(map(tuple, outline.tolist())),
    )  # fmt: skip


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Between two convex polygons, 0 if they overlap: plainly, every corner against every edge of the other."""
    if _contains(a, b[0]) or _contains(b, a[0]) or _cross(a, b):
        return 0.0
    return min(
        _to_segment(point, one[k - 1], one[k])
        for one, other in ((a, b), (b, a)) for point in other for k in range(len(one))
    )  # fmt: skip


def _contains(polygon: np.ndarray, point: np.ndarray) -> bool:
    sides = [
        float((e[0] - s[0]) * (point[1] - s[1]) - (e[1] - s[1]) * (point[0] - s[0]))
        for s, e in zip(polygon, np.roll(polygon, -1, axis=0), strict=True)
    ]
    return min(sides) >= 0 or max(sides) <= 0


def _cross(a: np.ndarray, b: np.ndarray) -> bool:
    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    return any(
        side(a[i - 1], a[i], b[j - 1]) * side(a[i - 1], a[i], b[j]) < 0
        and side(b[j - 1], b[j], a[i - 1]) * side(b[j - 1], b[j], a[i]) < 0
        for i in range(len(a)) for j in range(len(b))
    )  # fmt: skip


def _to_segment(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    along = np.clip((point - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
    return float(np.linalg.norm(point - start - along * (end - start)))


size = st.floats(1.5, 40)
panels = st.tuples(st.integers(3, 8), size, size, st.floats(0, 6.3), st.floats(0, 7))


@given(st.lists(panels, min_size=1, max_size=12), st.floats(3, 9), st.integers(110, 300))
@settings(max_examples=40, deadline=None)
def test_outlines_keep_their_distance_and_every_panel_is_there_once(
    shapes: list[tuple[int, float, float, float, float]], gap_px: float, max_size_px: int
) -> None:
    display = Display("d", tuple(_panel(number, *each) for number, each in enumerate(shapes)))
    quilts = pack_outlines(display, gap_px=gap_px, max_size_px=max_size_px)
    assert sorted(index for quilt in quilts for index in quilt.panels) == list(range(len(shapes)))
    for quilt in quilts:
        assert max(quilt.size_px) <= max_size_px
        assert set(quilt.turns) <= {0, 2}
        maps = quilt.quilt_from_panel(display)
        outlines = [
            display.panels[index].lit_outline_px @ maps[row, :, :2].T + maps[row, :, 2]
            for row, index in enumerate(quilt.panels)
        ]
        for row, outline in enumerate(outlines):
            assert outline.min() >= gap_px / 2 - 1e-9
            assert (outline <= np.array(quilt.size_px) - gap_px / 2 + 1e-9).all()
            for other in outlines[:row]:
                assert _distance(outline, other) >= gap_px - 1e-6
        filled = sum(abs(signed_area(outline)) for outline in outlines) / math.prod(quilt.size_px)
        assert lit_fill(display, quilt) == pytest.approx(filled)
        padded = quilt_outlines(display, quilt)
        for outline, same in zip(outlines, padded, strict=True):
            np.testing.assert_allclose(same[: len(outline)], outline)
            assert (same[len(outline) :] == same[len(outline) - 1]).all()


def test_what_does_not_fit_one_quilt_goes_into_more_and_a_panel_too_large_is_named() -> None:
    display = limen.Display.preset("icosahedron")
    quilts = pack_outlines(display, max_size_px=4096)
    assert len(quilts) > 1
    assert sorted(index for quilt in quilts for index in quilt.panels) == list(range(20))
    small = pack_outlines(display, max_px=1 << 22)
    assert all(math.prod(quilt.size_px) <= 1 << 22 for quilt in small)
    with pytest.raises(DisplayError, match=r"panel 'icosahedron/0' has 16\d\d x 14\d\d pixels; .* at most 1500 a side"):
        pack_outlines(display, max_size_px=1500)
    with pytest.raises(DisplayError, match="gap_px must be at least 3"):
        pack_outlines(display, gap_px=2)
    (some,) = pack_outlines(display, panels=[3, 7])
    assert some.panels == (3, 7)


@pytest.mark.parametrize(("name", "least"), [("cylinder", 0.92), ("sphere", 0.90), ("120", 0.83), ("teapot", 0.81)])
def test_quilts_are_filled_well(name: str, least: float) -> None:
    display = limen.Display.preset(name)
    (quilt,) = pack_outlines(display)
    assert lit_fill(display, quilt) > least
