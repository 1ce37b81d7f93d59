"""What limen leaves out, judged by the independent observer in random windows of a walk.

A user study with a model of vision for its subject: pairs of pictures, one with all detail and one that a policy drew,
for the viewers' true distance and for wrong ones; and catch pairs, both with all detail.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Interactive Rendering*, University of Virginia CS-2001-01, section 6.2.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from limen.data.image.file import Image
from limen.display.display import Display
from limen.display.panel import Panel
from limen.errors import PageError
from limen.frame.renderer import Renderer
from limen.geometry import Floats
from limen.gpu.device import Device
from limen.layers.image.layer import ImageLayer
from limen.study.frames import frame_of
from limen.study.observer import Observer, Verdict, light_of, sampled
from limen.study.windows import Window, cut_display
from limen.viewing.placement import OnSurface
from limen.viewing.policy import Policy
from limen.viewing.viewer import Viewer

__all__ = [
    "ALIKE",
    "FACTORS",
    "GAZE_DEG",
    "Judged",
    "Trial",
    "VerifyRow",
    "imperceptible",
    "judge_windows",
    "rows_of",
    "trials_of",
]

FACTORS = (1.0, 2.0, 5.0, 10.0)
"""How many times farther away than they are the viewers are taken to be, unless told otherwise."""

GAZE_DEG = (0.0, 10.0, 20.0)
"""Angles from the gaze at which policies with gaze are tried, unless told otherwise; the others are at 0."""

STRICT_SHARE = 0.95
"""Of the windows, for `imperceptible`: the threshold itself is where half of all people begin to guess right."""

_FULL = Policy("full")
_POOL_BYTES = 128 << 20
"""460 pages; a window of 1,600 px, the largest that the Reality Deck gives, shows 80."""

ALIKE = Verdict(10.0, 0.0)
"""Of a picture and itself, as every run's controls see to."""


@dataclass(frozen=True, slots=True)
class Trial:
    """What every window is judged under; the policy knows its distance factor."""

    policy: Policy
    eccentricity_deg: float


@dataclass(frozen=True, slots=True)
class Judged:
    """One window: a verdict for each trial, and for each trial's catch pair."""

    verdicts: tuple[Verdict, ...]
    catches: tuple[Verdict, ...]


class VerifyRow(msgspec.Struct, frozen=True):
    """One trial over all windows."""

    policy: str
    acuity_arcmin: float | None
    distance_factor: float
    eccentricity_deg: float
    windows: int
    jod_mean: float
    jod_min: float
    drop_p99_max: float
    flip_p99_max: float | None
    """For the true distance in the fovea, where the second observer is installed."""
    strict: float
    """Share of the windows in which nobody should see a difference."""
    practical: float
    """Share in which the difference stays within twice the threshold."""
    detected: float
    """Share in which the observer saw a difference."""
    false_alarms: float
    """Share of the catch pairs, both with all detail, in which it saw one."""
    worst_window: int


def trials_of(
    policies: Iterable[Policy],
    factors: Sequence[float] = FACTORS,
    eccentricities_deg: Sequence[float] | None = None,
    gaze_deg: Sequence[float] = GAZE_DEG,
) -> list[Trial]:
    """Every policy with every factor, at every angle from the gaze (by default only policies with gaze off it: at
    ``gaze_deg``).

    Raises
    ------
    InputError
        If a factor is not a positive number.
    """
    trials = []
    for policy in policies:
        angles = eccentricities_deg or (gaze_deg if policy.gaze else (0.0,))
        told = (replace(policy, distance_factor=factor) for factor in factors)
        trials += [Trial(each, angle) for each in told for angle in angles]
    return trials


def judge_windows(
    device: Device,
    image: Image,
    display: Display,
    placement: OnSurface,
    windows: Sequence[Window],
    trials: Sequence[Trial],
    observers: dict[float, Observer],
) -> Iterator[Judged]:
    """Draw and judge the windows one after the other, exactly as the display would show them.

    Parameters
    ----------
    observers
        By the luminance of panels' white, cd/m2.

    Raises
    ------
    PageError
        If a page of the image could not be read, for what would be judged is the page above it.
    """
    cut = cut_display(display, list(windows))
    with Renderer(device, cut, [ImageLayer(image, placement)], gpu_bytes=_POOL_BYTES) as renderer:
        for number, window in enumerate(windows):
            panel = cut.panels[number]
            observer = observers[panel.luminance_cd_m2]
            judge = _Judge(renderer, number, window, display.panels[window.panel], observer)
            yield judge.all(trials)


class _Judge:
    """One window; pictures that several trials share are drawn, and sampled as finely as eyes can, once."""

    def __init__(self, renderer: Renderer, number: int, window: Window, panel: Panel, observer: Observer) -> None:
        self._renderer, self._number, self._window, self._observer = renderer, number, window, observer
        self._panel = panel
        self._drawn: dict[tuple[Policy, float], Floats] = {}
        self._samples_per_degree = 0.0
        self._reference = self._draw(window.viewers, _FULL)
        self._again = self._draw(window.viewers, _FULL)

    def all(self, trials: Sequence[Trial]) -> Judged:
        verdicts = (self._verdict(self._picture(trial), trial) for trial in trials)
        return Judged(tuple(verdicts), tuple(self._verdict(self._again, trial) for trial in trials))

    def _verdict(self, light: Floats, trial: Trial) -> Verdict:
        if np.array_equal(light, self._reference):
            return ALIKE
        return self._observer.judge_light(
            light,
            self._reference,
            self._samples_per_degree,
            self._away_deg(trial),
            second_opinion=trial.policy.distance_factor == 1,
        )

    def _away_deg(self, trial: Trial) -> float | Floats:
        """How far from the gaze the window lies; where no gaze is asked for, eyes may rest on any place of it."""
        if trial.eccentricity_deg == 0 and not trial.policy.gaze:
            return 0.0
        looker = self._window.gazing(self._panel, trial.eccentricity_deg)[self._window.looker]
        assert looker.gaze is not None
        return self._window.eccentricities_deg(self._panel, looker.gaze)

    def _picture(self, trial: Trial) -> Floats:
        """Where the policy does not ask for the gaze, one picture serves all angles."""
        angle = trial.eccentricity_deg if trial.policy.gaze else 0.0
        if (trial.policy, angle) not in self._drawn:
            viewers = self._window.viewers
            if trial.policy.gaze:
                viewers = self._window.gazing(self._panel, angle)
            self._drawn[trial.policy, angle] = self._draw(viewers, trial.policy)
        return self._drawn[trial.policy, angle]

    def _draw(self, viewers: Sequence[Viewer], policy: Policy) -> Floats:
        frame = frame_of(self._renderer, viewers, policy=policy)
        ((_, picture, report),) = self._renderer.pictures(frame, panels=[self._number])
        if report.missing:
            raise PageError(f"{report.missing} pages of a window could not be read, so it cannot be judged")
        light, self._samples_per_degree = sampled(light_of(picture[..., :3]), self._window.pixels_per_degree)
        return light


def rows_of(trials: Sequence[Trial], judged: Sequence[Judged]) -> list[VerifyRow]:
    """A row for each trial."""
    return [_row(trial, number, judged) for number, trial in enumerate(trials)]


def imperceptible(rows: Iterable[VerifyRow]) -> bool:
    """Whether nothing that was left out is to be seen by viewers whose distance is known.

    At the true distance every window must stay within twice the threshold, and `STRICT_SHARE` of them below it; and of
    the catch pairs none may be taken for a difference.
    """
    true = [row for row in rows if row.distance_factor == 1]
    return all(row.practical == 1 and row.strict >= STRICT_SHARE and row.false_alarms == 0 for row in true)


def _row(trial: Trial, number: int, judged: Sequence[Judged]) -> VerifyRow:
    verdicts = [each.verdicts[number] for each in judged]
    jods = np.array([verdict.jod for verdict in verdicts])
    flips = [verdict.flip_p99 for verdict in verdicts if verdict.flip_p99 is not None]
    return VerifyRow(
        policy=trial.policy.title,
        acuity_arcmin=None if trial.policy.name == "full" else trial.policy.acuity_arcmin,
        distance_factor=trial.policy.distance_factor,
        eccentricity_deg=trial.eccentricity_deg,
        windows=len(verdicts),
        jod_mean=float(jods.mean()),
        jod_min=float(jods.min()),
        drop_p99_max=max(verdict.drop_p99 for verdict in verdicts),
        flip_p99_max=max(flips) if flips else None,
        strict=float(np.mean([verdict.strict for verdict in verdicts])),
        practical=float(np.mean([verdict.practical for verdict in verdicts])),
        detected=_detected(verdicts),
        false_alarms=_detected([each.catches[number] for each in judged]),
        worst_window=int(jods.argmin()),
    )


def _detected(verdicts: Sequence[Verdict]) -> float:
    """Share of pairs in which the observer sees a difference."""
    return float(np.mean([not verdict.practical for verdict in verdicts]))
