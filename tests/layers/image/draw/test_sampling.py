"""Pictures are sharp, smooth across borders of pages and panels, and the right way round."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from limen.data.store.resample import linear_of_srgb
from limen.display.display import Display
from limen.display.panel import Panel
from limen.study.filters import magnified
from limen.viewing.placement import OnShape, OnSurface
from limen.viewing.policy import Policy
from limen.viewing.tolerance import tolerance_of

pytestmark = pytest.mark.gpu

_FULL = tolerance_of([], Policy("full"))
_PHOTOGRAPHS = ("bluemarble_ng_5400x2700", "wise_allsky_19000x9500", "apollo_moon_pano_16810x1708")
_PITCH_M = 0.0003
_MARGIN_PX = 24  # pyvips and limen repeat the border's texels differently far out


def _window(size_px: tuple[int, int]) -> Display:
    return Display.window(size_px, pitch_m=_PITCH_M)


def _resized(pixels: NDArray[np.uint8], texels_per_px: float) -> NDArray[np.uint8]:
    """Lanczos (three lobes) in linear light by libvips, independent of limen."""
    import pyvips

    image = pyvips.Image.new_from_array(pixels).copy(interpretation="srgb").colourspace("scrgb")
    made = image.resize(1 / texels_per_px, kernel="lanczos3", gap=0).colourspace("srgb")
    return np.asarray(made.numpy()[..., :3])


def _psnr_db(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> float:
    inner = slice(_MARGIN_PX, -_MARGIN_PX)
    error = np.mean((a[inner, inner].astype(float) - b[inner, inner]) ** 2)
    return float(10 * np.log10(255**2 / max(error, 1e-9)))


def _synthetic() -> NDArray[np.uint8]:
    """Rings that get finer outward, text-like bars, and noise softened to what a lens would leave."""
    from scipy.ndimage import gaussian_filter

    y, x = np.mgrid[:510, :620]
    rings = 0.5 + 0.35 * np.cos(0.0021 * ((x - 250.0) ** 2 + (y - 200.0) ** 2) ** 0.9)
    bars = np.where((x // 11) % 2 == 0, 0.85, 0.15) * (y > 350) + rings * (y <= 350)
    noise = np.random.default_rng(0).normal(0, 0.1, (*x.shape, 3))
    picture = gaussian_filter(bars[..., None] + noise, (1.7, 1.7, 0))
    return np.asarray((picture.clip(0, 1) * 255).astype(np.uint8))


@pytest.fixture(scope="module", params=["synthetic", *_PHOTOGRAPHS])
def picture(request: Any) -> NDArray[np.uint8]:
    if request.param == "synthetic":
        return _synthetic()
    folder: Path = request.getfixturevalue("data_dir")
    import pyvips

    image = pyvips.Image.new_from_file(str(folder / "image" / f"{request.param}.jpg"))
    texels = image.crop(image.width // 2, image.height // 3, 620, 510).numpy()[..., :3]
    return np.ascontiguousarray(texels if texels.shape[2] == 3 else np.repeat(texels, 3, 2))


@pytest.mark.parametrize(
    ("texels_per_px", "size_px", "sharp_db", "fast_db"),
    [
        (1.0, (500, 400), 70.0, 70.0),
        (1.3, (585, 455), 40.0, 35.0),
        (1.7, (595, 510), 40.0, 35.0),
        (3.1, (620, 465), 36.0, 33.0),
        (1 / 2.3, (400, 300), 35.0, 34.0),
    ],
)
def test_full_detail_looks_as_libvips_resizes(
    texels_per_px: float,
    size_px: tuple[int, int],
    sharp_db: float,
    fast_db: float,
    picture: NDArray[np.uint8],
    studio: Any,
    memory_image: Any,
) -> None:
    """Sizes are whole multiples of the scale, because libvips shifts a picture whose size it had to round."""
    pixels = np.ascontiguousarray(picture[: size_px[1], : size_px[0]])
    reference = _resized(pixels, texels_per_px)
    height, width = reference.shape[:2]
    image, display = memory_image(pixels), _window((width, height))
    for sampling, least_db in (("sharp", sharp_db), ("fast", fast_db)):
        drawn = studio.draw(image, display, OnSurface("contain"), _FULL, sampling=sampling)["window"]
        reached = _psnr_db(drawn[..., :3], reference)
        assert reached >= least_db, f"{sampling} at 1:{texels_per_px:.2f}: {reached:.1f} dB"


def test_texel_for_pixel_is_the_image_itself(studio: Any, memory_image: Any) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (300, 500, 3), dtype=np.uint8)
    drawn = studio.draw(memory_image(pixels), _window((500, 300)), OnSurface("one-to-one"), _FULL)["window"]
    assert (drawn[..., :3] == pixels).all()


def test_magnified_it_is_drawn_with_catmull_rom_in_linear_light(studio: Any, memory_image: Any) -> None:
    pixels = np.random.default_rng(3).integers(0, 256, (300, 500, 3), dtype=np.uint8)
    drawn = studio.draw(memory_image(pixels), _window((1150, 690)), OnSurface("contain"), _FULL)["window"]
    light = magnified(linear_of_srgb(pixels / 255.0), (690, 1150), "catmull-rom")
    # Half a code is 0.0045 of the light at white; adapters' sRGB is their own by some codes near black.
    away = np.abs(linear_of_srgb(drawn[..., :3] / 255.0) - np.clip(light, 0, 1))
    assert away.max() < 0.006


def test_texel_for_pixel_lies_on_the_pixels_where_sides_differ_by_one(studio: Any, memory_image: Any) -> None:
    pixels = np.random.default_rng(2).integers(0, 256, (301, 501, 3), dtype=np.uint8)
    drawn = studio.draw(memory_image(pixels), _window((500, 300)), OnSurface("one-to-one"), _FULL)["window"]
    left_out = [(pixels[y : 300 + y, x : 500 + x] == drawn[..., :3]).all() for y in (0, 1) for x in (0, 1)]
    assert sum(left_out) == 1


@pytest.mark.parametrize("zoom", [0.31, 0.77, 1.0, 2.3])
@pytest.mark.parametrize("sampling", ["sharp", "fast"])
def test_a_smooth_image_stays_smooth_across_pages(zoom: float, sampling: str, studio: Any, memory_image: Any) -> None:
    """A ramp over 6 x 4 pages: a seam would be a jump of the slope."""
    y, x = np.mgrid[:900, :1400]
    pixels = np.stack([30 + x * 0.14, 40 + y * 0.2, 20 + (x + y) * 0.09], -1).astype(np.uint8)
    drawn = studio.draw(
        memory_image(pixels), _window((700, 500)), OnSurface("one-to-one", zoom=zoom), _FULL, sampling=sampling
    )["window"]
    inside = drawn[..., 3] > 0
    inside[1:-1, 1:-1] &= inside[2:, 1:-1] & inside[:-2, 1:-1] & inside[1:-1, 2:] & inside[1:-1, :-2]
    values = drawn[..., :3].astype(int)
    for axis in (0, 1):
        steps = np.abs(np.diff(values, axis=axis)).max(-1)
        both = np.logical_and(*((inside[1:], inside[:-1]) if axis == 0 else (inside[:, 1:], inside[:, :-1])))
        both[[0, -1]] = both[:, [0, -1]] = False
        slope = 0.2 / zoom
        assert steps[both].max() <= np.ceil(slope) + 1


def _split(display: Display, columns: int, rows: int) -> Display:
    """The same pixels as a grid of smaller panels."""
    whole = display.panels[0]
    width, height = whole.size_px[0] // columns, whole.size_px[1] // rows
    made: list[Panel] = []
    for row in range(rows):
        for column in range(columns):
            corner = np.array([column * width, row * height], dtype=float)
            surface = np.array(whole.surface_m) + corner * np.array(whole.pitch_m)
            made.append(
                replace(
                    whole,
                    name=f"part/{column},{row}",
                    size_px=(width, height),
                    origin_m=tuple(whole.position_m(corner)),
                    surface_m=tuple(surface),
                )
            )
    return Display("split", tuple(made))


def _joined(pictures: dict[str, NDArray[np.uint8]], columns: int, rows: int) -> NDArray[np.uint8]:
    return np.concatenate(
        [np.concatenate([pictures[f"part/{c},{r}"] for c in range(columns)], axis=1) for r in range(rows)]
    )


@pytest.mark.parametrize(
    "placement",
    [
        OnSurface("contain", zoom=1.37),
        OnSurface("cover", zoom=0.61, centre=(0.4, 0.55)),
        OnShape("ellipsoid", (0, 0, 0), (0, 0, -5.0), (0, -4.0, 0)),
        OnShape("cylinder", (0, 0, 0), (0.3, 0, -0.7), (0, -0.6, 0)),
        OnShape("plane", (-0.1, 0.08, -0.8), (0.2, 0.01, 0), (0, -0.1, 0.05)),
    ],
    ids=["contain", "cover", "ellipsoid", "cylinder", "plane"],
)
def test_four_panels_together_show_what_one_would(placement: Any, studio: Any, memory_image: Any) -> None:
    pixels = np.random.default_rng(2).integers(0, 256, (700, 1100, 3), dtype=np.uint8)
    image, one = memory_image(pixels), _window((640, 480))
    whole = studio.draw(image, one, placement, _FULL, eye_m=(0.0, 0.0, 0.0))["window"].astype(int)
    parts = _joined(studio.draw(image, _split(one, 2, 2), placement, _FULL, eye_m=(0.0, 0.0, 0.0)), 2, 2)
    off = np.abs(whole - parts).max(-1) > 1
    assert off.mean() < 1e-4  # single precision moves a sample by a thousandth of a texel; noise shows it


def test_beyond_the_image_it_is_black(studio: Any, memory_image: Any) -> None:
    white = np.full((300, 400, 3), 255, np.uint8)
    drawn = studio.draw(memory_image(white), _window((500, 500)), OnSurface("one-to-one"), _FULL)["window"]
    assert (drawn[100:400, 50:450, :3] == 255).all()
    drawn[100:400, 50:450] = 0
    assert (drawn == 0).all()


def test_outside_a_panels_outline_it_is_black(studio: Any, memory_image: Any) -> None:
    white = memory_image(np.full((300, 400, 3), 255, np.uint8))
    panel = replace(_window((400, 300)).panels[0], outline_px=((200.0, 0.0), (400.0, 300.0), (0.0, 300.0)))
    for outline in (panel.outline_px, panel.outline_px[::-1]):
        display = Display("triangle", (replace(panel, outline_px=outline),))
        drawn = studio.draw(white, display, OnSurface("cover"), _FULL)["window"][..., 0]
        y, x = np.mgrid[:300, :400] + 0.5
        inside = np.abs(x - 200) * 1.5 <= y
        assert ((drawn > 0) == inside).mean() > 0.999


@pytest.mark.parametrize("kind", ["surface", "plane", "cylinder", "ellipsoid"])
def test_the_image_is_the_right_way_round(kind: str, studio: Any, memory_image: Any) -> None:
    """Four colours: left of the viewer is the image's left, up is up, and the middle lies where ``across`` points."""
    pixels = np.zeros((512, 1024, 3), np.uint8)
    pixels[:256, :512], pixels[:256, 512:] = (255, 0, 0), (0, 255, 0)
    pixels[256:, :512], pixels[256:, 512:] = (0, 0, 255), (255, 255, 0)
    placements: dict[str, Any] = {
        "surface": OnSurface("cover"),
        "plane": OnShape("plane", (-1, 0.5, -1), (2, 0, 0), (0, -1, 0)),
        "cylinder": OnShape("cylinder", (0, 0, 0), (0, 0, -3), (0, -3, 0)),
        "ellipsoid": OnShape("ellipsoid", (0, 0, 0), (0, 0, -3), (0, -3, 0)),
    }
    display = Display.window((200, 150), pitch_m=0.003)
    drawn = studio.draw(memory_image(pixels), display, placements[kind], _FULL, eye_m=(0.0, 0.0, 0.0))["window"]
    corners = [tuple(drawn[y, x, :3].tolist()) for y in (50, 100) for x in (60, 140)]
    assert corners == [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0)]
    assert (drawn[75, 97, 0] > drawn[75, 97, 1]) or (drawn[75, 97, 2] > drawn[75, 97, 1])  # still left
