"""Lenses over time, from files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.errors import FormatError, MissingFileError
from limen.track.lens_track import LensTrack, lenses_at, read_lens_tracks
from limen.viewing.lens import Lens

STYLE = Lens((0.0, 0.0), 1.0, 1.0, 0.3, "quadratic")
HEAD = "time_s,x_px,y_px,radius_px,magnification"


def written(folder: Path, text: str) -> Path:
    path = folder / "lenses.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_lenses_move_evenly_and_grow_by_even_factors(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        f"# a tour\nlens,{HEAD}\na,0,100,200,50,1\nb,1,0,0,10,2\na,4,300,0,200,16\nb,3,0,0,10,2\n",
    )
    one, other = read_lens_tracks(path, STYLE)
    half = one.at(2.0)
    assert half.centre_px == pytest.approx((200, 100))
    assert half.radius_px == pytest.approx(100)
    assert half.magnification == pytest.approx(4)
    assert (half.focus, half.drop_off) == (0.3, "quadratic")
    assert one.at(99.0).magnification == pytest.approx(16)
    assert len(lenses_at([one, other], 0.0)) == 1, "a magnification of 1 is no lens"
    assert len(lenses_at([one, other], 2.0)) == 2
    (alone,) = read_lens_tracks(written(tmp_path, f"{HEAD}\n5,1,2,3,4\n"), STYLE)
    assert alone.at(-1.0).centre_px == (1.0, 2.0)


@given(st.lists(st.tuples(st.floats(1, 1e4), st.floats(1, 64)), min_size=1, max_size=5), st.floats(-2, 12))
def test_a_lens_between_samples_lies_between_them(samples: list[tuple[float, float]], time_s: float) -> None:
    radius, magnification = np.array(samples).T
    times = np.arange(len(samples)) * 2.0
    lens = LensTrack(STYLE, times, np.zeros((len(samples), 2)), radius, magnification).at(time_s)
    assert radius.min() * 0.999 <= lens.radii_px[0] <= radius.max() * 1.001
    assert magnification.min() * 0.999 <= lens.magnification <= magnification.max() * 1.001


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "no column time_s"),
        ("time_s,x_px\n1,2\n", "no column y_px, radius_px, magnification"),
        (f"{HEAD}\n", "no lens in it"),
        (f"{HEAD}\n1,2,3,0,4\n", "sample 1: lens: radius_px must be above 0"),
        (f"{HEAD}\n1,2,3,9,0.5\n", "magnification must be 1 or more"),
        (f"{HEAD}\n1,nan,3,9,4\n", "centre_px must be two finite numbers"),
        (f"{HEAD}\n1,2,3,x,4\n", "radius_px is no number: 'x'"),
        (f"{HEAD}\n1,2,3\n", "radius_px is no number"),
        (f"{HEAD}\ninf,2,3,9,4\n", "time_s is not finite"),
        (f"{HEAD}\n1,2,3,9,4\n1,2,3,9,4\n", "sample 2: time_s does not grow"),
    ],
)
def test_what_is_no_lens_is_refused_with_its_place(text: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=says):
        read_lens_tracks(written(tmp_path, text), STYLE)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(MissingFileError, match=r"none\.csv"):
        read_lens_tracks(tmp_path / "none.csv", STYLE)
    broken = tmp_path / "broken.csv"
    broken.write_bytes(b"time_s,x_px,\xff\xfe\n")
    with pytest.raises(FormatError, match="UTF-8"):
        read_lens_tracks(broken, STYLE)
