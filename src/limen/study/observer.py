"""The independent observer: ColorVideoVDP, a published model of what people see, judges pairs of windows.

Nothing that decides what limen draws knows of it. It is an extra (`INSTALL`), imported when first used.

References
----------
Mantiuk, Hanji, Ashraf, Asano, Chapiro 2024, *ColorVideoVDP*, ACM Trans. Graphics 43(4), and its package ``cvvdp``.
Ashraf, Chapiro, Mantiuk 2025, *Resolution limit of the eye*, Nature Communications (the fall-off with gaze).
Andersson, Nilsson, Akenine-Möller et al. 2020, *FLIP*, Proc. ACM Computer Graphics 3(2), and ``flip-evaluator``.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import logging
import math
import os
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from limen.data.store.resample import LINEAR_OF_SRGB, srgb_of_linear
from limen.errors import InputError
from limen.geometry import Floats
from limen.study.filters import resampled
from limen.study.retinal_motion import gliding

__all__ = [
    "INSTALL",
    "LEAST_WINDOW_PX",
    "SAMPLES_PER_DEGREE",
    "WINDOW_PX",
    "Observer",
    "Verdict",
    "light_of",
    "missing_packages",
    "sampled",
]

INSTALL = (
    "pip install --no-deps torch==2.13.0 cvvdp==0.5.7 --extra-index-url https://download.pytorch.org/whl/cpu",
    'pip install "limen[verify]"',
)
"""The two commands that install the observer: without CUDA, and without torchvision that would bring it."""

WINDOW_PX = 256
"""Side of the windows that are judged: over a whole frame, what is right hides what is wrong."""

LEAST_WINDOW_PX = 32
"""Smaller windows have too few bands of frequencies to be judged."""

SAMPLES_PER_DEGREE = 96.0
"""Finer windows are resampled to this first: nobody sees what is lost, and the observer's table ends at 64 cpd."""

STRICT_JOD, STRICT_DROP = 9.95, 0.10
"""At the threshold of visibility: a grating at its threshold contrast scores 9.953 ... 9.976."""

PRACTICAL_JOD, PRACTICAL_DROP = 9.80, 0.35
"""Within twice the threshold: a grating at twice its threshold contrast scores 9.80 ... 9.89."""

FAILED_JOD = 9.5
"""Clearly visible: about four times the threshold."""

GAZE_FALLOFF = (0.00703, 0.01359, 0.02548)
"""``k`` of ``10^(-k rho e)``, rho in cycles a degree, e in degrees: achromatic, red-green, yellow-violet.

These are ``-cF cR`` of Ashraf et al. 2025.
"""

_RIM_PX = 4

_CHANGE_HZ, _CHANGE_FRAMES = 60.0, 30
"""Of the film in which one picture becomes another at once, in the middle: half a second, as long as the observer's
model of time looks back twice."""

Window = NDArray[np.uint8]

_LIGHT: Floats = LINEAR_OF_SRGB.astype(float)


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an observer says of a pair of windows.

    Attributes
    ----------
    jod
        Just-objectionable differences: 10 where both look alike, one less where 75 % of people prefer the reference.
    drop_p99
        99th percentile, over the window, of how much a pixel's neighbourhood alone lowers the JOD.
    flip_p99
        99th percentile of FLIP's error, 0 ... 1, by the second observer; None off the gaze or where not installed.
    """

    jod: float
    drop_p99: float
    flip_p99: float | None = None

    @property
    def strict(self) -> bool:
        """Whether nobody should see a difference."""
        return self.jod >= STRICT_JOD and self.drop_p99 <= STRICT_DROP

    @property
    def practical(self) -> bool:
        """Whether the difference stays within twice the threshold."""
        return self.jod >= PRACTICAL_JOD and self.drop_p99 <= PRACTICAL_DROP

    @property
    def failed(self) -> bool:
        """Whether the difference is plain to see."""
        return self.jod < FAILED_JOD


def missing_packages() -> tuple[str, ...]:
    """Packages that the observer needs and this Python lacks; empty where it can judge."""
    names = ("torch", "pycvvdp", "einops", "ffmpeg", "huggingface_hub", "imageio", "tqdm")
    return tuple(name for name in names if not _is_installed(name))


def _is_installed(name: str) -> bool:
    return name in sys.modules or importlib.util.find_spec(name) is not None


class Observer:
    """ColorVideoVDP in front of a display, looking at one window at a time.

    Parameters
    ----------
    peak_cd_m2, contrast, ambient_lux
        The display: luminance of white, white over black, and light falling on it.

    Raises
    ------
    InputError
        If the observer's packages are not installed, or the display is impossible.
    """

    def __init__(self, peak_cd_m2: float = 300.0, contrast: float = 1000.0, ambient_lux: float = 10.0) -> None:
        if not (0 < peak_cd_m2 <= 10_000 and contrast > 1 and ambient_lux >= 0):
            raise InputError(
                f"a display has a peak above 0 and at most 10,000 cd/m2, a contrast above 1 and no negative ambient "
                f"light; got {peak_cd_m2:g} cd/m2, {contrast:g}, {ambient_lux:g} lux"
            )
        self.peak_cd_m2 = peak_cd_m2
        self.black_cd_m2 = peak_cd_m2 / contrast
        self._torch, self._vdp = _packages()
        self._flip = _second_observer()
        with _silence():
            # Emitted light goes in as it is: windows are resampled in linear light and never rounded to 8 bits again.
            self._photometry = self._vdp.vvdp_display_photo_eotf(
                peak_cd_m2, contrast=contrast, EOTF="linear", E_ambient=ambient_lux
            )
            colour = importlib.import_module("pycvvdp.display_model")
            self._opponent_of_rgb = (
                np.array(colour.LMS2006_to_DKLd65) @ colour.XYZ_to_LMS2006 @ self._photometry.rgb2xyz_list
            )
            self._metric = self._vdp.cvvdp(
                display_photometry=self._photometry,
                display_geometry=self._geometry(SAMPLES_PER_DEGREE),
                heatmap="raw",
                device=self._torch.device("cpu"),
                quiet=True,
            )

    def judge(
        self, test: Window, reference: Window, pixels_per_degree: float, eccentricity_deg: float | Floats = 0.0
    ) -> Verdict:
        """How visible the difference of two windows is.

        Parameters
        ----------
        test, reference
            sRGB, shape (H, W, 3), uint8, the same shape.
        pixels_per_degree
            Of the windows, as the viewer sees them. Above `SAMPLES_PER_DEGREE` both are resampled to it.
        eccentricity_deg
            Angle from the viewer's gaze: one for all of the window, or those of an even grid of points from corner to
            corner, shape (n, m).

        Raises
        ------
        InputError
            If the windows differ in shape, are not uint8 sRGB, or are too small or too large to be judged.
        """
        for name, window in (("test", test), ("reference", reference)):
            if window.dtype != np.uint8:
                raise InputError(f"{name} must be uint8 sRGB, got {window.dtype}")
        return self.judge_light(light_of(test), light_of(reference), pixels_per_degree, eccentricity_deg)

    def judge_light(
        self,
        test: Floats,
        reference: Floats,
        samples_per_degree: float,
        eccentricity_deg: float | Floats = 0.0,
        *,
        second_opinion: bool = True,
        change: bool = False,
        velocity_deg_s: tuple[float, float] = (0.0, 0.0),
    ) -> Verdict:
        """`judge` of windows in linear light, 0 ... 1 of what the display emits beyond its black.

        The second observer takes three times as long as the first; without ``second_opinion`` it is not asked. With
        ``change``, it is the moment that is judged in which the reference becomes the test from one frame to the next,
        beside a reference that stays; the second observer knows no time, and takes no part. ``velocity_deg_s`` is how
        fast the windows glide over the retina, to the right and down.
        """
        away = np.asarray(eccentricity_deg, dtype=float)
        _check(test, reference, samples_per_degree, away)
        (test, rate), (reference, _) = (sampled(light, samples_per_degree) for light in (test, reference))
        height, width = test.shape[:2]
        if min(height, width) < LEAST_WINDOW_PX or max(height, width) > WINDOW_PX:
            raise InputError(
                f"a window of {width} x {height} samples cannot be judged: sides go from {LEAST_WINDOW_PX} to "
                f"{WINDOW_PX} at not more than {SAMPLES_PER_DEGREE:g} samples a degree"
            )
        ground = reference.mean(axis=(0, 1))
        if any(velocity_deg_s):
            mean_cd_m2 = self.black_cd_m2 + (self.peak_cd_m2 - self.black_cd_m2) * float(reference.mean())
            test, reference = gliding(test, reference, rate, velocity_deg_s, mean_cd_m2, self._opponent_of_rgb)
        # Clipped at the very end: what resampling overshoots is mostly lost on the periphery.
        seen = [np.clip(self._peripheral(_faded(light, ground), rate, away), 0.0, 1.0) for light in (test, reference)]
        jod, drop = self._changes(seen[0], seen[1], rate) if change else self._differences(seen[0], seen[1], rate)
        asked = second_opinion and not (change or any(velocity_deg_s)) and self._flip is not None and not away.any()
        flip = self._flip_p99(seen[0], seen[1], rate) if asked else None
        return Verdict(jod, float(np.percentile(drop, 99)), flip)

    def _peripheral(self, light: Floats, samples_per_degree: float, eccentricity_deg: Floats) -> Floats:
        """The window less what an eye loses of it that far from its gaze, place by place.

        Dividing every frequency's contrast by what sensitivity loses there is the same as dividing the sensitivity,
        and holds at every frequency. The observer itself knows sensitivity only at the middle of bands an octave and
        more wide, within which it falls up to tenfold off the gaze: gratings at their threshold then scored 9.50
        ... 9.98 at 10 degrees.

        Where the angle differs from place to place, windows for angles two degrees apart are mixed, which leaves a
        little more than the angle between would.
        """
        if not eccentricity_deg.any():
            return light
        height, width = light.shape[:2]
        steps = np.linspace(eccentricity_deg.min(), eccentricity_deg.max(), 1 + math.ceil(np.ptp(eccentricity_deg) / 2))
        place = (_spread(eccentricity_deg, height, width) - steps[0]) / max(np.ptp(steps), 1e-9) * (len(steps) - 1)
        down, across = np.fft.fftfreq(height), np.fft.rfftfreq(width)
        frequency_cpd = np.hypot(down[:, None], across) * samples_per_degree
        opponent = light @ self._opponent_of_rgb.T
        for channel, falloff in enumerate(GAZE_FALLOFF):
            spectrum = np.fft.rfft2(opponent[..., channel])
            opponent[..., channel] = 0.0
            for number, angle_deg in enumerate(steps):
                seen = np.fft.irfft2(spectrum * 10.0 ** (-falloff * frequency_cpd * angle_deg), s=(height, width))
                opponent[..., channel] += np.maximum(1 - np.abs(place - number), 0.0) * seen
        return np.asarray(opponent @ np.linalg.inv(self._opponent_of_rgb).T)

    def _differences(self, test: Floats, reference: Floats, samples_per_degree: float) -> tuple[float, Floats]:
        """The JOD, and what each place alone lowers it by, (H, W)."""
        jod, heat = self._predicted(test, reference, samples_per_degree, "HWC", {})
        return jod, heat[0]

    def _changes(self, test: Floats, reference: Floats, samples_per_degree: float) -> tuple[float, Floats]:
        """`_differences` of a film in which the reference becomes the test; of each place, the mean over the film."""
        stays = np.repeat(reference[None], _CHANGE_FRAMES, axis=0)
        changes = stays.copy()
        changes[_CHANGE_FRAMES // 2 :] = test
        told = {"frames_per_second": _CHANGE_HZ}
        jod, heat = self._predicted(changes, stays, samples_per_degree, "FHWC", told)
        return jod, heat.mean(axis=0)

    def _predicted(
        self, test: Floats, reference: Floats, samples_per_degree: float, order: str, told: dict[str, float]
    ) -> tuple[float, Floats]:
        """The JOD, and what each place alone lowers it by in each frame, (F, H, W)."""
        emitted = [self.black_cd_m2 + (self.peak_cd_m2 - self.black_cd_m2) * light for light in (test, reference)]
        with _silence(), self._torch.no_grad():
            self._metric.set_display_model(
                display_photometry=self._photometry, display_geometry=self._geometry(samples_per_degree)
            )
            self._metric.csf.logS_rho.clear()  # a cache by frequency, which would grow with every distance
            jod, stats = self._metric.predict(*(light.astype(np.float32) for light in emitted), dim_order=order, **told)
        # The map holds the share of 10 JOD that is lost.
        return float(jod), np.asarray(stats["heatmap"][0, 0].numpy(), dtype=float) * 10

    def _geometry(self, samples_per_degree: float) -> Any:
        return self._vdp.vvdp_display_geometry([WINDOW_PX, WINDOW_PX], ppd=samples_per_degree)

    def _flip_p99(self, test: Floats, reference: Floats, samples_per_degree: float) -> float:
        coded = [np.ascontiguousarray(srgb_of_linear(light), dtype=np.float32) for light in (reference, test)]
        errors, _, _ = self._flip.evaluate(*coded, "LDR", True, False, False, {"ppd": samples_per_degree})
        return float(np.percentile(errors, 99))


def light_of(window: Window) -> Floats:
    """Linear light, 0 ... 1, of sRGB codes, uint8 of any shape."""
    return _LIGHT[window]


def sampled(light: Floats, samples_per_degree: float) -> tuple[Floats, float]:
    """A window in linear light (H, W, 3) at no more than `SAMPLES_PER_DEGREE`, and how many it has then."""
    ratio = samples_per_degree / SAMPLES_PER_DEGREE
    return (light, samples_per_degree) if ratio <= 1 else (resampled(light, ratio, "kaiser-4"), SAMPLES_PER_DEGREE)


def _spread(grid: Floats, height: int, width: int) -> Floats:
    """Values at every sample of a window, from one for all or from an even grid of points from corner to corner."""
    if grid.ndim == 0:
        return np.full((height, width), float(grid))
    down, across = (
        (np.arange(side) + 0.5) / side * (count - 1) for side, count in zip((height, width), grid.shape, strict=True)
    )
    return np.asarray(ndimage.map_coordinates(grid, np.meshgrid(down, across, indexing="ij"), order=1))


def _check(test: Floats, reference: Floats, samples_per_degree: float, eccentricity_deg: Floats) -> None:
    for name, window in (("test", test), ("reference", reference)):
        if window.ndim != 3 or window.shape[2] != 3:
            raise InputError(f"{name} must have shape (H, W, 3), got {window.shape}")
    if test.shape != reference.shape:
        raise InputError(f"test and reference must have one shape, got {test.shape} and {reference.shape}")
    if not (math.isfinite(samples_per_degree) and samples_per_degree > 0):
        raise InputError(f"pixels_per_degree must be above 0, got {samples_per_degree}")
    if eccentricity_deg.ndim not in (0, 2) or not ((eccentricity_deg >= 0) & (eccentricity_deg <= 180)).all():
        raise InputError(f"eccentricity_deg must lie between 0 and 180, one or a grid of them, got {eccentricity_deg}")


def _packages() -> tuple[Any, Any]:
    """torch and pycvvdp, imported quietly, and without what pycvvdp leaves behind."""
    path = list(sys.path)
    try:
        with _silence():
            import torch

            from limen.study.torchvision_shim import torchvision_stood_in_for

            with torchvision_stood_in_for():
                import pycvvdp
    except ImportError as error:
        missing = ", ".join(missing_packages()) or str(error)
        raise InputError(
            f"the independent observer is not installed ({missing}): run `{INSTALL[0]}`, then `{INSTALL[1]}`"
        ) from error
    finally:
        # It appends its own folder, whose `utils` and `interp` would shadow anybody's.
        sys.path[:] = path
    # A window takes one thread 0.08 s; two, waiting for each other on a busy machine, took 3 s.
    torch.set_num_threads(1)
    return torch, pycvvdp


def _second_observer() -> Any:
    try:
        return importlib.import_module("flip_evaluator")
    except ImportError:
        return None


def _faded(light: Floats, ground: Floats) -> Floats:
    """The window with its rim faded into a plain ground, as gratings are shown to people.

    At an edge the observer's pyramid repeats the last samples, so that a fine regular pattern ends in a coarse, visible
    one: binary noise lost 0.1 JOD and a one-pixel grating 0.5 to it alone.
    """
    down, across = (_rise(side) for side in light.shape[:2])
    return np.asarray(ground + (light - ground) * (down[:, None] * across)[..., None])


def _rise(side: int) -> Floats:
    from_edge = np.minimum(np.arange(side), np.arange(side)[::-1]) + 0.5
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.minimum(from_edge / _RIM_PX, 1.0)))


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """No warnings, no messages and no progress bars of packages that are not ours."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with (
            warnings.catch_warnings(),
            Path(os.devnull).open("w") as nowhere,
            contextlib.redirect_stdout(nowhere),
            contextlib.redirect_stderr(nowhere),
        ):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
