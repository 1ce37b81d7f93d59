"""From codes to light: sRGB, and photometers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from limen.errors import FormatError, InputError, MissingFileError
from limen.vision.luminance import Photometry

CODES = [0, 32, 64, 96, 128, 160, 192, 224, 255]
MOST = {"red": 42.0, "green": 143.0, "blue": 15.0}


def true_light(channel, code, gain=1.06, gamma=2.25):
    """A display of this form, with 0.2 cd/m2 of black."""
    bracket = max(gain * code / 255 + 1 - gain, 0.0)
    return 0.2 + MOST[channel] * bracket**gamma


def written(tmp_path, codes=CODES, change=None, light=true_light):
    rows = [(name, code, light(name, code)) for name in MOST for code in codes]
    lines = [",".join(map(str, row)) for row in rows]
    text = "# spot meter, 3 July\nchannel,code,cd_m2\n" + "\n".join(lines) + "\n"
    for old, new in change or ():
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "panel.csv"
    path.write_text(text)
    return path


def test_srgb_at_its_ends_and_in_the_room():
    screen = Photometry.srgb(peak_cd_m2=250, black_cd_m2=0.25, ambient_cd_m2=2)
    assert screen.luminance_cd_m2(np.array([[0, 0, 0], [255, 255, 255]], np.uint8)).tolist() == [
        2.25,
        pytest.approx(252),
    ]
    assert screen.white_cd_m2 == pytest.approx(252)
    green = screen.luminance_cd_m2(np.array([0, 255, 0], np.uint8))
    assert green == pytest.approx(2.25 + 249.75 * 0.7152)
    assert Photometry.srgb().luminance_cd_m2(np.zeros((5, 4, 3), np.uint8)).shape == (5, 4)
    middle = float(Photometry.srgb(100).luminance_cd_m2([188, 188, 188]))
    assert middle == pytest.approx(50.3, abs=0.1), "code 188 is half the light"


@given(st.lists(st.integers(0, 255), min_size=3, max_size=3), st.integers(0, 2), st.integers(1, 255))
def test_a_brighter_code_is_brighter_light(rgb, channel, more):
    screen = Photometry.srgb(80, 0.1, 1)
    brighter = list(rgb)
    brighter[channel] = min(255, rgb[channel] + more)
    assert screen.luminance_cd_m2(brighter) >= screen.luminance_cd_m2(rgb)


@pytest.mark.parametrize("fit", ["spline", "gain-offset-gamma"])
def test_readings_give_back_the_display(tmp_path, fit):
    screen = Photometry.load(written(tmp_path), fit, ambient_cd_m2=1.5)
    assert screen.dark_cd_m2 == pytest.approx(1.7)
    assert screen.white_cd_m2 == pytest.approx(1.7 + sum(MOST.values()), rel=1e-3)
    every = np.arange(256)
    truth = np.array([true_light("green", code) - 0.2 for code in every])
    found = screen.luminance_cd_m2(np.stack([0 * every, every, 0 * every], axis=-1)) - 1.7
    error = abs(found - truth).max() / 143
    assert error < (1e-5 if fit == "gain-offset-gamma" else 0.006), "of the channel's largest"


def test_noise_is_smoothed_and_never_falls(tmp_path):
    rng = np.random.default_rng(5)
    codes = np.unique(np.r_[np.arange(0, 256, 5), 255])

    def noisy(channel, code):
        return max(0.0, true_light(channel, code) + rng.normal(0, 0.001 * MOST[channel]))

    path = written(tmp_path, codes, light=noisy)
    for fit in ("spline", "gain-offset-gamma"):
        screen = Photometry.load(path, fit)
        assert (np.diff(screen.channels_cd_m2, axis=1) >= 0).all()
        truth = np.array([true_light("red", code) - 0.2 for code in range(256)])
        assert abs(screen.channels_cd_m2[0] - truth).max() < 0.006 * 42


BROKEN = [
    ([("green,128,", "green,128,nan #")], r"panel\.csv:16: cd_m2 is 'nan"),
    ([("green,128,", "green,128,-")], r"panel\.csv:16: cd_m2 is '-.*measure it again"),
    ([("green,128,", "green,128.5,")], r"panel\.csv:16: code is '128\.5'"),
    ([("green,128,", "green,300,")], r"panel\.csv:16: code is '300'"),
    ([("green,128,", "grey,128,")], r"panel\.csv:16: channel is 'grey'; there are red, green, blue"),
    ([("green,128,", "green,128,,")], r"panel\.csv:16: 4 cells for 3 columns"),
    ([("green,128,", "green,96,")], r"panel\.csv:1[56]: channel green has two readings of one code"),
    ([("green,128,", "green,128,0.5 #")], r"panel\.csv:16: cd_m2 is '0\.5 #"),
    ([("green,255,", "green,254,")], "channel green has 9 readings; measure at least 5, codes 0 and 255 among them"),
    ([("blue,0,0.2", "blue,0,5.2")], "channel blue falls to"),
    ([("cd_m2", "luminance")], r"panel\.csv:2: not a table of readings"),
]


@pytest.mark.parametrize(("change", "words"), BROKEN)
def test_a_broken_table_is_named_with_line_and_cure(tmp_path, change, words):
    with pytest.raises(FormatError, match=words):
        Photometry.load(written(tmp_path, change=change))


def test_holes_falls_and_odd_blacks(tmp_path):
    sparse = written(tmp_path, [0, 32, 64, 160, 255])
    with pytest.raises(FormatError, match=r":5: channel red has no reading between the codes 64 and 160; measure one"):
        Photometry.load(sparse)
    assert Photometry.load(sparse, "gain-offset-gamma").white_cd_m2 == pytest.approx(200.2, rel=1e-3)
    fallen = written(tmp_path, light=lambda c, k: true_light(c, k) if (c, k) != ("red", 192) else 5.0)
    with pytest.raises(FormatError, match=r":9: channel red falls to 5 cd/m2 at code 192; let the display warm up"):
        Photometry.load(fallen)
    dark = written(tmp_path, light=lambda c, k: 1.0)
    with pytest.raises(FormatError, match="channel red falls to 1"):
        Photometry.load(dark)
    bright = written(tmp_path, light=lambda c, k: true_light(c, k) + (4 if c == "green" else 0))
    with pytest.raises(FormatError, match=r"black \(code 0\) is 0\.2 to 4\.2 cd/m2"):
        Photometry.load(bright)
    with pytest.raises(MissingFileError):
        Photometry.load(tmp_path / "none.csv")
    with pytest.raises(InputError, match="spline or gain-offset-gamma"):
        Photometry.load(sparse, "line")


def test_nonsense_is_refused():
    for bad in ({"peak_cd_m2": np.nan}, {"black_cd_m2": -1}, {"ambient_cd_m2": np.inf}, {"black_cd_m2": 100}):
        with pytest.raises(InputError):
            Photometry.srgb(**bad)
    screen = Photometry.srgb()
    for rgb in ([0, 0], [0, 0, 256], [-1, 0, 0], [0.5, 0, 0]):
        with pytest.raises(InputError, match="rgb"):
            screen.luminance_cd_m2(rgb)
    with pytest.raises(InputError, match="shape"):
        Photometry(np.zeros((3, 4)))
    with pytest.raises(InputError, match="fall"):
        Photometry(np.r_[np.zeros((2, 256)), -np.arange(256.0)[None]])
