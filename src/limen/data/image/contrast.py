"""The contrast of what every page's next finer level adds to it: what nobody could see need not be fetched.

F is the finer level in linear light, U the page itself upsampled to F's texels with the kernel that drawing uses
(Catmull-Rom, a = -1/2, texel centres on texel centres) and held to 0 .. 1 as drawing holds it; opacity is composed on
black. A texel counts as equal where all three of its U lie within 1.21 codes of F: that much the rounding of both
pictures to 8 bits can do alone. Any other counts in full, D = F - U against the background U, in three mechanisms:

* achromatic: ``|Y(D)| / (Y(U) + Y0)``, Y0 = 0.001 being the black of a display of 1000:1;
* red-green and yellow-violet: the opponent signals of castleCSF, L - (Lw / Mw) M and (Lw + Mw) / Sw S - (L + M) for the
  white w, over the background's L + M. On grey they are cone contrasts along DKL's isoluminant directions; their norm
  over the root of 3 is the contrast of the human fits, which turn it into the achromatic contrast whose highest
  visible frequency is the same.

All three are discounted for darkness: the eye's sensitivity at the background's luminance over that at white, on a
display of 300 cd/m2, at whichever of 2 .. 60 cycles a degree it lost least. Dimmer displays only discount more.

An eye does not see a lone texel as it sees a grating: it sums the energy of contrast over an area. In castleCSF the
sensitivity to a patch of area A goes as ``sqrt(Ac / (1 + Ac / A))``, so with the root of A up to the critical area
``Ac = A0 / (1 + (rho / f0)**2)``, A0 = 157.103 deg2, f0 = 0.702338 cycles a degree. Above some 2 cycles a degree ``Ac
rho**2`` is A0 f0**2 = 77.5 cycles2, a square of 8.8 cycles. The coarsest pattern that only the finer level can show,
and the best visible, has four fine texels a cycle: its square is 35 texels wide, and those of the colours 15 and 13.5
(A0 f0**2 is 14.2 and 11.4 cycles2). So the squares of the contrasts, each no more than 2, are averaged over windows of
32 x 32 fine texels, for the colours 16 x 16, one every 8 texels each way, and a window's contrast is the root of twice
the mean: that of a grating of the same energy. A page has the contrast of its strongest window. In finer patterns Ac is
less, but the eye's sensitivity to them is, too.

Every finer page is measured by itself. At its borders windows are cut to no less than half, and averaged over what is
left: a pattern that lies across a border counts as much as inside, one that ends at a border more. Windows at the
image's edge average over the texels inside the image, or over a quarter of the window where there are fewer.

References
----------
Ashraf, Mantiuk, Chapiro, Wuerger 2024, *castleCSF*, Journal of Vision 24(4): mechanisms, cone matrix, cone contrast.
Ashraf, Chapiro, Mantiuk 2025, *Resolution limit of the eye*, Nature Communications: the three fits.
Derrington, Krauskopf, Lennie 1984, J. Physiol. 357: the isoluminant directions.
"""

from __future__ import annotations

import functools
import logging
import math
import threading
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.data.image.contrast_file import (
    CONTRAST_OF_BYTE,
    UNKNOWN,
    PageBytes,
    byte_of_contrast,
    read_contrast,
    write_contrast,
)
from limen.data.image.contrast_kernels import largest_contrasts
from limen.data.image.file import Image
from limen.data.pages import GUTTER, PAGE
from limen.data.store.resample import LINEAR_OF_SRGB, SRGB_OF_LINEAR, linear_of_srgb
from limen.errors import PageError
from limen.system import worker_count
from limen.vision.contrast import sensitivity

__all__ = ["CONTRAST_OF_BYTE", "UNKNOWN", "ContrastSurvey", "contrast_of_quarter", "page_contrast"]

_log = logging.getLogger(__name__)

Texels = NDArray[np.uint8]
Floats = NDArray[np.float32]

_BLACK = 0.001
_WHITE_CD_M2 = 300.0

_ROUNDING_CODES = 1.21
"""Half a code of F, and half a code of every texel of U by the kernel's absolute weights: 0.5 + 0.5 * 1.1875**2."""

_XYZ_OF_RGB = np.array(
    [[0.41239080, 0.35758434, 0.18048079], [0.21263901, 0.71516868, 0.07219232], [0.01933082, 0.11919478, 0.95053215]]
)
"""Linear sRGB (IEC 61966-2-1) to CIE 1931 XYZ."""

_XYZ_OF_LMS = np.array(
    [
        [2.629129278399650, -3.780202391780134, 10.294956387893450],
        [0.865649062438827, 1.215555811642301, -0.984175688105352],
        [-0.008886561474676, 0.081612628990755, 51.371024830897888],
    ]
)
"""CIE 2006 2-degree cones to XYZ for an LED-lit LCD, as published with castleCSF."""

# Highest visible frequency, log10 S = c + cF rho, of Ashraf, Chapiro, Mantiuk 2025: (c, -cF).
_ACHROMATIC, _RED_GREEN, _YELLOW_VIOLET = (2.13475, 0.043936), (2.17939, 0.029965), (1.77669, 0.055037)


class _Model(NamedTuple):
    """Tables of the kernel, see :func:`limen.data.image.contrast_kernels.largest_contrasts`."""

    low: Floats
    high: Floats
    mechanisms: Floats
    discount: Floats


@functools.cache
def _model() -> _Model:
    codes = np.arange(256.0)
    low = linear_of_srgb(np.maximum(codes - _ROUNDING_CODES, 0.0) / 255.0)
    high = linear_of_srgb(np.minimum(codes + _ROUNDING_CODES, 255.0) / 255.0)
    powers = [1.0, *(_ACHROMATIC[1] / fit[1] for fit in (_RED_GREEN, _YELLOW_VIOLET))]
    dark = _darkness()
    # An equivalent contrast is a power of a chromatic one: so is its discount, and the kernel takes no powers.
    discount = np.stack([dark ** (2.0 / power) for power in powers])  # of energy, the square of contrast
    tables = (low, high, mechanisms(), discount)
    return _Model(*(np.ascontiguousarray(table, dtype=np.float32) for table in tables))


def mechanisms() -> NDArray[np.float64]:
    """(4, 3) weights of linear sRGB: luminance Y, cone luminance L + M, red-green and yellow-violet contrast.

    The first two are 1 for white. The others, over the cone luminance of a background, are contrasts as the human fits
    count them (norm of cone contrast over the root of 3, on grey); greys excite neither.
    """
    cones = np.linalg.inv(_XYZ_OF_LMS) @ _XYZ_OF_RGB
    long, medium, short = cones / cones.sum(axis=1, keepdims=True)  # each is 1 for white
    share_l, share_m, _ = cones.sum(axis=1) / cones[:2].sum()  # of L + M in white
    # Along the red-green direction the luminances of L and M are opposite: a of L + M is a / share of each cone.
    red_green = (long - medium) * share_l * share_m * math.hypot(1 / share_l, 1 / share_m)
    both = share_l * long + share_m * medium
    return np.stack([_XYZ_OF_RGB[1], both, red_green / math.sqrt(3), (short - both) / math.sqrt(3)])


def _darkness() -> NDArray[np.float64]:
    """(256,) what darkness leaves of contrast where the root of luminance is up to k / 255."""
    frequency = np.geomspace(2.0, 60.0, 32)[:, None]
    luminance = (np.arange(256) / 255.0) ** 2 + _BLACK
    left = sensitivity(frequency, luminance_cd_m2=_WHITE_CD_M2 * luminance)
    return np.asarray(np.minimum((left / sensitivity(frequency, luminance_cd_m2=_WHITE_CD_M2)).max(axis=0), 1.0))


def _equivalent(contrast: float, fit: tuple[float, float]) -> float:
    """The achromatic contrast whose highest visible frequency is that of a chromatic one."""
    if contrast <= 0.0:
        return 0.0
    c, slope = fit
    return float(10.0 ** (_ACHROMATIC[1] / slope * (c + math.log10(contrast)) - _ACHROMATIC[0]))


def contrast_of_quarter(coarse: Texels, fine: Texels, quarter: tuple[int, int], size_px: tuple[int, int]) -> float:
    """Contrast that one finer page adds to the quarter of a coarser page that it covers, 0 .. 1.

    ``coarse`` (264, 264, 4) with its gutter and ``fine`` (256, 256, 4) without are RGBA; ``quarter`` is the finer
    page's (column, row) in the coarser, 0 or 1 each, and ``size_px`` the (width, height) of it that lies in the image.
    """
    model = _model()
    found = np.zeros(3, dtype=np.float32)
    left, top = (GUTTER + PAGE // 2 * half for half in quarter)
    largest_contrasts(
        _on_black(coarse),
        _on_black(fine),
        left,
        top,
        size_px[1],
        size_px[0],
        LINEAR_OF_SRGB,
        model.low,
        model.high,
        model.mechanisms,
        model.discount,
        np.float32(_BLACK),
        found,
    )
    achromatic, red_green, yellow_violet = (float(value) for value in found)
    coloured = (_equivalent(red_green, _RED_GREEN), _equivalent(yellow_violet, _YELLOW_VIOLET))
    return min(max(achromatic, *coloured), 1.0)


def _on_black(page: Texels) -> Texels:
    """Codes of a page's colours times their opacity."""
    if page.view("<u4").min() >= 0xFF000000:  # the fourth byte: several times as fast as by itself
        return page
    light = LINEAR_OF_SRGB[page[..., :3]] * (page[..., 3:].astype(np.float32) / np.float32(255.0))
    return SRGB_OF_LINEAR[(light * np.float32(65535.0) + np.float32(0.5)).astype(np.uint16)]


def page_contrast(image: Image, *, progress: Callable[[float], None] | None = None) -> NDArray[np.uint8]:
    """The contrast byte of every page, (page_count,) uint8: from the file beside the image, else found now and kept.

    See :data:`CONTRAST_OF_BYTE` for what a byte means. Pages that cannot be read, and those just above them, are
    :data:`UNKNOWN`. ``progress`` is called with the fraction done; what it raises ends the work, and what was found
    until then is kept.
    """
    with ContrastSurvey(image, workers=worker_count()) as survey:
        survey.run(progress)
        return survey.bytes


class ContrastSurvey:
    """The contrast bytes of an image's pages while they are being found; a context manager.

    ``bytes`` is (page_count,) uint8, :data:`UNKNOWN` where not known yet: it may be read at any time while threads
    fill it, coarse levels first. What is kept beside the image is taken from there and added there, also where only
    part was found; pages that could not be read are tried again by the next survey. With ``keep=False`` no file is
    read or written. Close it before the image.
    """

    def __init__(self, image: Image, *, workers: int = 1, keep: bool = True) -> None:
        self._image, self._workers, self._keep = image, workers, keep
        stored = read_contrast(image.path, image.pyramid) if keep else None
        self._pages = stored or PageBytes(image.pyramid)
        self.bytes = self._pages.bytes
        self._wanted = int(np.count_nonzero(~self._pages.known))
        self._coming = iter(_in_order(image, self._pages.known))
        self._lock = threading.Lock()
        self._stop, self._ended = threading.Event(), threading.Event()
        self._threads: list[threading.Thread] = []
        self._working = 0
        self._unreadable: list[PageError] = []
        self._done = 0
        self._problem: BaseException | None = None

    @property
    def pages(self) -> PageBytes:
        """The bytes and which of them are known."""
        return self._pages

    @property
    def complete(self) -> bool:
        """Whether every page was looked at: all are known but those that cannot be read."""
        return self._done == self._wanted

    def start(self) -> None:
        """Begin in background threads. A second call does nothing."""
        if self._threads or self._ended.is_set():
            return
        self._working = min(self._workers, self._wanted)
        if not self._working:
            self._ended.set()
        self._threads = [
            threading.Thread(target=self._work, name=f"limen-contrast-{k}", daemon=True) for k in range(self._working)
        ]
        for thread in self._threads:
            thread.start()

    def run(self, progress: Callable[[float], None] | None = None) -> None:
        """Find all that is missing, and return when done."""
        try:
            self.start()
            while not self._ended.wait(0.1):
                if progress is not None:
                    progress(self._done / self._wanted)
        finally:
            self.close()
        if progress is not None:
            progress(1.0)

    def close(self) -> None:
        """Stop, and keep what was found. May be called twice; raises what went wrong in a thread, if anything did."""
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._ended.set()
        problem, self._problem = self._problem, None
        if problem is not None:
            raise problem

    def __enter__(self) -> ContrastSurvey:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _work(self) -> None:
        try:
            while not self._stop.is_set():
                with self._lock:
                    page = next(self._coming, None)
                if page is None:
                    break
                self._look_at(page)
        except BaseException as error:
            self._problem = error
            self._stop.set()
        with self._lock:
            self._working -= 1
            last = self._working == 0
        if last:
            self._end()

    def _look_at(self, page: int) -> None:
        try:
            self.bytes[page] = byte_of_contrast(_contrast_of_page(self._image, page))
            self._pages.known[page] = True
        except PageError as error:
            with self._lock:
                self._unreadable.append(error)
        with self._lock:
            self._done += 1

    def _end(self) -> None:
        if self._unreadable:
            count, first = len(self._unreadable), self._unreadable[0]
            _log.warning("the contrast of %d pages is not known, since they cannot be read: %s", count, first)
        if self._keep and len(self._unreadable) < self._done:
            write_contrast(self._image.path, self._image.pyramid, self._pages)
        self._ended.set()


_STRIP = 16
"""Columns of pages that are gone down together, so that neighbours are still decoded when they are needed again."""


def _in_order(image: Image, known: NDArray[np.bool_]) -> Iterator[int]:
    """Pages whose byte is missing: coarse to fine, in strips."""
    for level in reversed(image.pyramid.levels):
        for left in range(0, level.columns, _STRIP):
            for row in range(level.rows):
                for column in range(left, min(left + _STRIP, level.columns)):
                    page = level.first_page + row * level.columns + column
                    if not known[page]:
                        yield page


def _contrast_of_page(image: Image, page: int) -> float:
    """The largest contrast that the (up to four) finer pages add to a page; each is read once."""
    level, column, row = image.pyramid.page_of(page)
    coarse = image.read_page(page)
    finer = image.pyramid.levels[level - 1]
    most = 0.0
    for quarter in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = 2 * column + quarter[0], 2 * row + quarter[1]
        if x < finer.columns and y < finer.rows and most <= CONTRAST_OF_BYTE[UNKNOWN - 1]:
            size_px = (min(PAGE, finer.size_px[0] - x * PAGE), min(PAGE, finer.size_px[1] - y * PAGE))
            fine = image.read_page((level - 1, x, y), gutter=0)
            most = max(most, contrast_of_quarter(coarse, fine, quarter, size_px))
    return most
