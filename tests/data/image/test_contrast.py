"""The measure of contrast against a plain NumPy reference, known patterns, and its laws."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import pyvips
from hypothesis import given, settings
from hypothesis import strategies as st

import limen.data
from limen.data.image import contrast
from limen.data.image.contrast import CONTRAST_OF_BYTE, contrast_of_quarter, page_contrast
from limen.data.image.contrast_file import byte_of_contrast
from limen.vision.contrast import sensitivity
from support.contrast_reference import reference
from support.pictures import codes_of, light_of, noisy_picture, smooth_picture


def opened(tmp_path, picture):
    path = tmp_path / "picture.png"
    pyvips.Image.new_from_array(picture).pngsave(str(path), compression=1)
    return limen.data.open(path)


def level_contrasts(image):
    """Contrasts of all pages, level by level."""
    found = CONTRAST_OF_BYTE[page_contrast(image)]
    return [found[level.first_page : level.first_page + level.page_count] for level in image.pyramid.levels]


def faint_picture(width, height, bands=3):
    """Slopes with some detail of a few codes, differently coloured from place to place."""
    rng = np.random.default_rng(5)
    picture = smooth_picture(width, height).astype(int)
    for left in range(0, width, 128):
        amount = rng.integers(0, 6, 3)
        picture[:, left : left + 128] += (
            rng.integers(-1, 2, (height, picture[:, left : left + 128].shape[1], 1)) * amount
        )
    picture = np.clip(picture, 0, 255).astype(np.uint8)
    return picture if bands == 3 else np.dstack([picture, smooth_picture(width, height, seed=9)[..., 0]])


@pytest.mark.parametrize("bands", [3, 4], ids=["opaque", "transparent"])
def test_the_kernel_equals_the_plain_reference(tmp_path, bands):
    with opened(tmp_path, faint_picture(1300, 900, bands)) as image:
        found = page_contrast(image)
        pages = range(image.pyramid.levels[1].first_page, image.pyramid.page_count)
        plain = [reference(image, *image.pyramid.page_of(page)) for page in pages]
    assert len(pages) == 9
    assert len(set(plain)) > 5
    # Single precision may put a contrast that lies on a step into the next.
    assert np.abs(np.array([byte_of_contrast(value) for value in plain]) - found[list(pages)].astype(int)).max() <= 1


# ------------------------------------------------------------------------------------------- known patterns


def grating(direction, amount, mean=(0.2, 0.2, 0.2), frequency=0.375):
    """(768, 1024, 3): a sinusoid at 3/4 of Nyquist along a direction of linear RGB."""
    wave = np.cos(2 * np.pi * frequency * np.arange(1024))[None, :, None]
    return codes_of(np.asarray(mean) + amount * wave * np.asarray(direction) * np.ones((768, 1, 1)))


MIDDLE_DARK = float(contrast._darkness()[math.ceil(255 * math.sqrt(0.2))])
"""What darkness leaves of contrast on a grey of 0.2, 60 cd/m2."""


def patch(place, frequency=0.375, angle_deg=0.0):
    """A grey coarse page, and a finer one with a grating of contrast 0.3 in (x, y, width, height), as far as inside."""
    y, x = np.mgrid[0:256, 0:256]
    angle = math.radians(angle_deg)
    wave = np.cos(2 * np.pi * frequency * (math.cos(angle) * x + math.sin(angle) * y) + 0.4)
    left, top, width, height = place
    wave *= (left <= x) & (x < left + width) & (top <= y) & (y < top + height)
    fine = flat((0,) * 3, 256)
    fine[..., :3] = codes_of(0.2 * (1 + 0.3 * wave))[..., None]
    return flat(codes_of(np.array([0.2] * 3)), 264), fine


def single_contrast(back, code):
    """Of one texel of a grey on another."""
    light, step = light_of(np.array(back)), light_of(np.array(code)) - light_of(np.array(back))
    return float(step / (light + 0.001) * contrast._darkness()[math.ceil(255 * math.sqrt(light))])


def flat(codes, edge):
    page = np.full((edge, edge, 4), 255, dtype=np.uint8)
    page[..., :3] = codes
    return page


@pytest.mark.parametrize("wanted", [0.05, 0.1, 0.3, 0.6])
def test_a_grating_has_its_own_contrast(tmp_path, wanted):
    with opened(tmp_path, grating((1, 1, 1), 0.2 * wanted)) as image:
        _, first, *coarser = level_contrasts(image)
    assert 0.9 < MIDDLE_DARK < 1.0
    # Bytes are 2.8 % apart, and halving leaves a little of the grating in the coarser page. Codes are 1.6 % of
    # luminance apart here: where the faintest grating crosses grey, rounding could have made the difference.
    assert first == pytest.approx(wanted * MIDDLE_DARK, rel=0.06)
    assert all((level <= 0.11 * wanted + 0.01).all() for level in coarser)


@pytest.mark.parametrize("frequency", [0.25, 0.375, 0.44])
@pytest.mark.parametrize("angle_deg", [0, 30, 90])
def test_a_grating_over_all_of_a_page_counts_the_same_whatever_its_period_and_angle(frequency, angle_deg):
    found = contrast_of_quarter(*patch((0, 0, 256, 256), frequency, angle_deg), (0, 0), (256, 256))
    assert found == pytest.approx(0.3 * MIDDLE_DARK, rel=0.04)


@given(st.integers(24, 231), st.integers(24, 231))  # beyond windows that are cut
@settings(deadline=None, max_examples=30)
def test_a_lone_texel_counts_as_little_as_it_is_seen(x, y):
    for code, wanted in ((150, single_contrast(120, 150)), (255, 2.0)):
        fine = flat((120,) * 3, 256) if code == 150 else flat((0,) * 3, 256)
        coarse = flat(fine[0, 0, :3], 264)
        fine[y, x, :3] = code
        found = contrast_of_quarter(coarse, fine, (0, 0), (256, 256))
        assert found == pytest.approx(wanted * math.sqrt(2) / 32, rel=1e-4)


@given(st.integers(16, 224), st.integers(16, 224))
@settings(deadline=None, max_examples=30)
def test_a_small_patch_of_a_grating_counts_half(x, y):
    found = contrast_of_quarter(*patch((x, y, 16, 16)), (0, 0), (256, 256))
    assert found == pytest.approx(0.3 * MIDDLE_DARK / 2, rel=0.05)


@given(st.integers(0, 16), st.integers(0, 16), st.sampled_from([16, 24, 32]))
@settings(deadline=None, max_examples=40)
def test_a_patch_that_borders_of_pages_cut_counts_no_less_than_inside(right, below, edge):
    """Of a patch that lies over the corner of four pages, the strongest part; ``right`` and ``below`` of it are cut."""
    inside = contrast_of_quarter(*patch((96, 96, edge, edge)), (0, 0), (256, 256))
    places = itertools.product((256 - edge + right, right - edge), (256 - edge + below, below - edge))
    parts = [contrast_of_quarter(*patch((*place, edge, edge)), (0, 0), (256, 256)) for place in places]
    assert 0.9 * inside < max(parts) <= min(2.05 * inside, 1.05 * 0.3 * MIDDLE_DARK)
    if right == below == edge / 2:
        assert max(parts) == pytest.approx(inside, rel=0.05)


@pytest.mark.parametrize("place", [(248, 120), (120, 248), (504, 120), (248, 248), (504, 504)])
def test_a_patch_across_a_border_of_an_image_counts_as_inside(tmp_path, place):
    found = []
    for x, y in ((120, 120), place):
        wave = grating((1, 1, 1), 0.06)
        picture = np.full_like(wave, codes_of(np.array([0.2]))[0])
        picture[y : y + 16, x : x + 16] = wave[y : y + 16, x : x + 16]
        folder = tmp_path / f"{x}-{y}"
        folder.mkdir()
        with opened(folder, picture) as image:
            found.append(level_contrasts(image)[1].max())
    assert found[1] == pytest.approx(found[0], rel=0.1)
    assert found[0] == pytest.approx(0.3 * MIDDLE_DARK / 2, rel=0.1)


def test_a_red_green_grating_of_one_luminance_counts_as_its_fit_says(tmp_path):
    red = np.array([0.71516868, -0.21263901, 0.0])  # Y = 0
    lms = np.linalg.inv(contrast._XYZ_OF_LMS) @ contrast._XYZ_OF_RGB
    back = lms @ [0.2, 0.2, 0.2]
    cones = 0.2 * (lms @ red) / back
    with opened(tmp_path, grating(red, 0.2)) as image:
        _, first, *_ = level_contrasts(image)
    norm = math.hypot(*cones[:2]) / math.sqrt(3)
    equal = 10 ** (1.466244 * (2.17939 + math.log10(norm)) - 2.13475)
    assert 0.05 < equal < 0.5
    assert first == pytest.approx(equal * 0.94, rel=0.15)


def test_a_violet_grating_of_one_luminance_is_not_nothing(tmp_path):
    violet = np.array([0.0, -0.07219232, 0.71516868]) * 0.2
    with opened(tmp_path, grating(violet, 1.0)) as image:
        _, first, *_ = level_contrasts(image)
    assert (first > 0.02).all()
    assert (first < 0.2).all()


def test_equal_frequencies_are_what_makes_contrasts_equal():
    for fit in (contrast._RED_GREEN, contrast._YELLOW_VIOLET):
        for value in (0.004, 0.05, 0.3):
            equal = contrast._equivalent(value, fit)
            own_cpd = (fit[0] - math.log10(1 / value)) / fit[1]
            assert (2.13475 - math.log10(1 / equal)) / 0.043936 == pytest.approx(own_cpd)


def test_greys_excite_no_colour_and_white_has_the_luminance_one():
    assert contrast.mechanisms().sum(axis=1) == pytest.approx([1, 1, 0, 0], abs=1e-6)


def test_darkness_only_discounts_and_more_the_darker_it_is():
    dark = contrast._darkness()
    assert dark[255] == 1.0
    assert (np.diff(dark) >= 0).all()
    ratio = sensitivity(2.0, luminance_cd_m2=0.3) / sensitivity(2.0, luminance_cd_m2=300.0)
    assert dark[0] == pytest.approx(float(ratio)) == pytest.approx(0.2134, abs=1e-4)


def test_noise_of_one_code_in_the_dark_is_nothing(tmp_path):
    picture = np.random.default_rng(3).integers(0, 2, (700, 900, 3), dtype=np.uint8)
    with opened(tmp_path, picture) as image:
        assert not page_contrast(image).any()


def test_noise_of_one_code_is_nothing_and_of_three_codes_is_something(tmp_path):
    grain = noisy_picture(700, 900, 1)[..., 0] % 2
    with opened(tmp_path, np.repeat((120 + grain)[..., None], 3, axis=2).astype(np.uint8)) as image:
        assert not page_contrast(image).any()
    with opened(tmp_path, np.repeat((120 + 3 * grain)[..., None], 3, axis=2).astype(np.uint8)) as image:
        assert (level_contrasts(image)[1] > 0.02).all()


def test_transparent_detail_over_black_is_nothing(tmp_path):
    hidden = np.dstack([noisy_picture(600, 600), np.zeros((600, 600), dtype=np.uint8)])
    with opened(tmp_path, hidden) as image:
        assert not page_contrast(image).any()


# ------------------------------------------------------------------------------------------- laws


def quarter_byte(coarse, fine):
    return byte_of_contrast(contrast_of_quarter(coarse, fine, (1, 0), (256, 256)))


CODE = st.integers(0, 255)


@given(st.tuples(CODE, CODE, CODE))
@settings(deadline=None, max_examples=30)
def test_uniform_pages_add_nothing(codes):
    assert quarter_byte(flat(codes, 264), flat(codes, 256)) == 0


@given(st.integers(40, 215), st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 6))
@settings(deadline=None, max_examples=40)
def test_more_grey_detail_never_lowers_the_byte(code, seed, small, more):
    detail = np.random.default_rng(seed).integers(-4, 5, (256, 256, 1))
    bytes_of = []
    for scale in (small, small + more):
        fine = flat((code,) * 3, 256)
        fine[..., :3] = np.clip(code + scale * detail, 0, 255)
        bytes_of.append(quarter_byte(flat((code,) * 3, 264), fine))
    assert bytes_of[0] <= bytes_of[1]


@given(st.tuples(*[st.floats(0.05, 0.4)] * 3), st.integers(0, 2**32 - 1), st.floats(0.01, 0.1))
@settings(deadline=None, max_examples=40)
def test_three_times_the_coloured_detail_never_lowers_the_byte(mean, seed, amount):
    codes = codes_of(np.array(mean))
    detail = np.random.default_rng(seed).uniform(-1, 1, (256, 256, 3)) * amount * np.array(mean)
    bytes_of = []
    for scale in (1, 3):
        fine = flat(codes, 256)
        fine[..., :3] = codes_of(light_of(codes) + scale * detail)
        bytes_of.append(quarter_byte(flat(codes, 264), fine))
    assert bytes_of[0] <= bytes_of[1]


@given(st.integers(0, 2**32 - 1), st.integers(1, 255), st.integers(1, 255), st.integers(1, 40))
@settings(deadline=None, max_examples=40)
def test_more_detail_elsewhere_never_lowers_the_contrast(seed, column, row, amount):
    fine, more = np.random.default_rng(seed).integers(90, 130, (256, 256, 3)), flat((110,) * 3, 256)
    more[:row, :column, :3] = fine[:row, :column]
    contrasts = []
    for _ in range(2):
        contrasts.append(contrast_of_quarter(flat((110,) * 3, 264), more, (1, 0), (256, 256)))
        more[row:, :, :3] = 110 + amount * (fine[row:] % 2)
    assert contrasts[0] <= contrasts[1]


def test_only_texels_inside_the_image_count():
    coarse, fine = flat((90, 90, 90), 264), flat((90, 90, 90), 256)
    fine[200:, :, :3] = 200  # so bright that it counts as a contrast of 2
    assert contrast_of_quarter(coarse, fine, (0, 1), (256, 200)) == 0.0
    # Half a window at least: a row of blocks, and the one row of texels that is inside the image.
    assert contrast_of_quarter(coarse, fine, (0, 1), (256, 201)) == pytest.approx(2 * math.sqrt(2 / 9))
    assert contrast_of_quarter(coarse, np.swapaxes(fine, 0, 1), (0, 1), (200, 256)) == 0.0


@pytest.mark.parametrize(("width", "share"), [(1, 1 / 8), (2, 1 / 4), (8, 1.0), (16, 1.0), (100, 1.0)])
def test_little_that_an_image_reaches_into_a_page_is_no_large_patch(width, share):
    coarse, fine = flat((100,) * 3, 264), flat((108,) * 3, 256)
    found = contrast_of_quarter(coarse, fine, (0, 0), (width, 256))
    assert found == pytest.approx(single_contrast(100, 108) * math.sqrt(2 * share), rel=1e-4)


@given(st.floats(0.0, 2.0))
@settings(max_examples=300)
def test_a_byte_never_understates_and_at_most_by_a_step_overstates(value):
    byte = byte_of_contrast(value)
    if value < 1e-3:
        assert byte == 0
    else:
        assert CONTRAST_OF_BYTE[byte] >= min(value, 1.0)
        assert byte == 1 or CONTRAST_OF_BYTE[byte - 1] < value


def test_bytes_come_back_from_the_contrasts_they_stand_for():
    assert [byte_of_contrast(float(value)) for value in CONTRAST_OF_BYTE] == list(range(256))
