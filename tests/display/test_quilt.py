"""Packing panels into quilts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.display.display import Display
from limen.display.panel import Panel
from limen.display.quilt import Quilt, pack, pieces
from limen.errors import DisplayError


def _display(sizes: list[tuple[int, int]]) -> Display:
    panels = [
        Panel(f"p{n}", size, (float(n), 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.001, 0.001))
        for n, size in enumerate(sizes)
    ]
    return Display("test", tuple(panels))


sides = st.integers(1, 60)


@given(st.lists(st.tuples(sides, sides), min_size=1, max_size=30), st.integers(60, 200), st.integers(3600, 20_000))
def test_every_panel_once_inside_its_quilt_and_over_no_other(
    sizes: list[tuple[int, int]], max_size_px: int, max_px: int
) -> None:
    display = _display(sizes)
    quilts = pack(display, max_size_px=max_size_px, max_px=max_px)
    assert sorted(index for quilt in quilts for index in quilt.panels) == list(range(len(sizes)))
    for quilt in quilts:
        width, height = quilt.size_px
        assert max(width, height) <= max_size_px
        assert width * height <= max_px
        taken = np.zeros((height, width), int)
        for index, (x, y) in zip(quilt.panels, quilt.offsets_px, strict=True):
            w, h = sizes[index]
            assert x + w <= width
            assert y + h <= height
            taken[y : y + h, x : x + w] += 1
        assert taken.max() == 1


def test_equal_panels_waste_less_than_a_shelf() -> None:
    (quilt,) = pack(_display([(256, 144)] * 24))
    assert quilt.size_px == (4 * 256, 6 * 144)
    (quilt,) = pack(_display([(256, 144)] * 16))
    assert quilt.size_px[0] * quilt.size_px[1] - 16 * 256 * 144 < quilt.size_px[0] * 144


def test_chosen_panels_only() -> None:
    (quilt,) = pack(_display([(10, 10)] * 5), panels=[1, 3])
    assert quilt.panels == (1, 3)


def test_a_panel_that_no_quilt_can_hold_is_named() -> None:
    with pytest.raises(DisplayError, match="panel 'p1' has 9000 x 20 pixels; this adapter draws at most 8192 a side"):
        pack(_display([(10, 10), (9000, 20)]))


def test_pieces_are_the_panels_pictures() -> None:
    display = _display([(3, 2), (2, 2)])
    image = np.arange(2 * 5 * 4, dtype=np.uint8).reshape(2, 5, 4)
    cut = pieces(display, Quilt((5, 2), (0, 1), ((0, 0), (3, 0))), image)
    assert (cut["p0"] == image[:, :3]).all()
    assert (cut["p1"] == image[:, 3:]).all()


@given(st.lists(st.tuples(sides, sides, st.integers(0, 3)), min_size=1, max_size=6))
def test_turned_panels_lie_where_their_map_says(panels: list[tuple[int, int, int]]) -> None:
    """A picture of its own coordinates, turned into the quilt by NumPy, is where the affine map sends them."""
    display = _display([(width, height) for width, height, _ in panels])
    offsets, turns = [(3, 60 * n) for n in range(len(panels))], tuple(turn for _, _, turn in panels)
    quilt = Quilt((64, 60 * len(panels)), tuple(range(len(panels))), tuple(offsets), turns)
    image = np.full((quilt.size_px[1], quilt.size_px[0], 3), -1)
    for index, (width, height, turn) in enumerate(panels):
        rows, columns = np.mgrid[:height, :width]
        picture = np.rot90(np.stack([columns, rows, np.full_like(rows, index)], axis=-1), -turn)
        x, y = offsets[index]
        image[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
    maps = quilt.quilt_from_panel(display)
    cut = pieces(display, quilt, image)
    for index, (width, height, _) in enumerate(panels):
        rows, columns = np.mgrid[:height, :width]
        centres = np.stack([columns, rows], axis=-1) + 0.5
        places = np.floor(centres @ maps[index, :, :2].T + maps[index, :, 2]).astype(int)
        expected = np.stack([columns, rows, np.full_like(rows, index)], axis=-1)
        assert (image[places[..., 1], places[..., 0]] == expected).all()
        assert (cut[f"p{index}"] == expected).all()
        assert np.linalg.det(maps[index, :, :2]) == pytest.approx(1), "turned, never mirrored"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"size_px": (0, 4)}, "at least one pixel"),
        ({"offsets_px": ((0, 0),)}, "as many offsets"),
        ({"turns": (1,)}, "as many turns or none"),
        ({"turns": (0, 4)}, "0 to 3 quarter turns"),
        ({"panels": (1, 1)}, "no panel twice"),
    ],
)
def test_quilts_refuse_nonsense(fields: dict[str, object], words: str) -> None:
    good = {"size_px": (4, 4), "panels": (0, 1), "offsets_px": ((0, 0), (2, 0)), "turns": (0, 3)}
    assert Quilt(**good).turns == (0, 3)  # type: ignore[arg-type]
    with pytest.raises(DisplayError, match=words):
        Quilt(**{**good, **fields})  # type: ignore[arg-type]


def test_a_piece_has_no_pixel_of_its_neighbours() -> None:
    """A triangle whose grid reaches beyond the quilt, over a quilt that is all lit: only the triangle is taken out."""
    panel = Panel(
        "only", (40, 30), (0, 0, 0), (1, 0, 0), (0, -1, 0), (0.001, 0.001), outline_px=((0, 30), (20, 0), (40, 30))
    )
    display = Display("one", (panel,))
    for turn in range(4):
        offset = (-3, -2)
        quilt = Quilt((60, 60), (0,), (offset,), (turn,))
        picture = pieces(display, quilt, np.full((60, 60, 4), 255, np.uint8))["only"]
        assert picture.shape == (30, 40, 4)
        assert picture[25, 20].tolist() == [255] * 4, "inside"
        assert picture[2, 2].tolist() == picture[2, 37].tolist() == [0] * 4, "outside"
        assert 550 < (picture[..., 0] > 0).sum() < 750
