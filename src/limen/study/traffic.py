"""What would have to move: pages per frame of a session, policy by policy, with nothing kept between frames.

References
----------
Papadopoulos, Kaufman 2013, *Acuity-Driven Gigapixel Visualization*, section 6.3: invalidating the page cache every
frame stands for images that change all the time; 9 kB a page and 30 frames a second turn pages into bytes.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import msgspec
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from limen.data.image.contrast import CONTRAST_OF_BYTE, page_contrast
from limen.data.image.file import Image
from limen.data.pages import PAGE, Pyramid
from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats, Vec3
from limen.layers.common.page_detail import Detail, contrast_detail
from limen.layers.image.select import ImageOnDisplay, flat_pairs, select, view_of
from limen.study.resolvable import places_of, resolvable_samples
from limen.track.session import Frame, Session
from limen.viewing.placement import OnShape, OnSurface, one_to_one_size_px
from limen.viewing.policy import Policy, ignores_acuity
from limen.viewing.tolerance import Tolerance, tolerance_of
from limen.vision.acuity import acuity_from

__all__ = [
    "FRAMES_PER_S",
    "PAPER_PAGE_BYTES",
    "Counts",
    "Report",
    "Row",
    "SessionTraffic",
    "Traffic",
    "count_traffic",
    "detail_of",
    "frames_of",
    "one_to_one_view",
    "page_bytes_of",
    "policies_of",
]

PAPER_PAGE_BYTES = 9_000.0
FRAMES_PER_S = 30.0
"""The display's rate that bytes per second are stated at, as in the paper."""

_FULL = Policy.parse("full")


class Row(msgspec.Struct, frozen=True):
    """One policy in one session."""

    policy: str
    acuity_arcmin: float | None
    """``None`` for ``full``, which asks nobody's eyes."""
    pages_mean: float
    pages_p99: float
    pages_max: int
    bytes_mean: float
    bytes_per_s: float
    """At 30 frames a second, whatever rate was sampled."""
    saving: float
    """Share of the pages of ``full`` that need not move, 0 to 1."""
    texels_over_floor: float
    """Texels moved over the samples that an eye of this acuity (``full``: the human one) could resolve."""


class SessionTraffic(msgspec.Struct, frozen=True):
    """One session: all its policies."""

    name: str
    frames: int
    duration_s: float
    viewers: int
    rows: list[Row]
    floor_samples_mean: float
    """Samples a frame that human eyes could resolve (0.64 arcmin, or a viewer's own acuity)."""


class Traffic(msgspec.Struct, frozen=True):
    """What ``limen traffic --json`` prints."""

    content: str
    display: str
    panels: int
    total_px: int
    image_px: tuple[int, int]
    rate_hz: float
    page_bytes: float
    per_node: bool
    sessions: list[SessionTraffic]


@dataclass(frozen=True, slots=True, eq=False)
class Counts:
    """One session, frame by frame.

    Parameters
    ----------
    pages
        Distinct pages, a row for each policy: shape (K, F).
    full_pages
        Those of the policy ``full``, shape (F,), for the saving.
    floor_samples
        Resolvable samples for each policy's own acuity, shape (K, F).
    human_samples
        Resolvable samples for human eyes, shape (F,).
    """

    session: str
    duration_s: float
    viewers: int
    time_s: Floats
    policies: tuple[Policy, ...]
    pages: NDArray[np.int64]
    full_pages: NDArray[np.int64]
    floor_samples: Floats
    human_samples: Floats

    def summary(self, page_bytes: float) -> SessionTraffic:
        rows = [self._row(number, page_bytes) for number in range(len(self.policies))]
        floor = float(self.human_samples.mean())
        return SessionTraffic(self.session, len(self.time_s), self.duration_s, self.viewers, rows, floor)

    def _row(self, number: int, page_bytes: float) -> Row:
        policy, pages = self.policies[number], self.pages[number]
        mean = float(pages.mean())
        full, floor = float(self.full_pages.mean()), float(self.floor_samples[number].mean())
        return Row(
            policy=policy.title,
            acuity_arcmin=None if policy.name == "full" else policy.acuity_arcmin,
            pages_mean=mean,
            pages_p99=float(np.percentile(pages, 99)),
            pages_max=int(pages.max()),
            bytes_mean=mean * page_bytes,
            bytes_per_s=mean * page_bytes * FRAMES_PER_S,
            saving=1 - mean / full if full else 0.0,
            texels_over_floor=mean * PAGE**2 / floor if floor else 0.0,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """The counts of several sessions over one view, for the table, the JSON and the plot."""

    content: str
    view: ImageOnDisplay
    rate_hz: float
    page_bytes: float
    per_node: bool
    counts: tuple[Counts, ...]

    def summary(self) -> Traffic:
        display = self.view.display
        sessions = [counts.summary(self.page_bytes) for counts in self.counts]
        return Traffic(
            self.content,
            display.name,
            len(display.panels),
            display.total_px,
            self.view.pyramid.size_px,
            self.rate_hz,
            self.page_bytes,
            self.per_node,
            sessions,
        )


def page_bytes_of(image: Image) -> float:
    """Mean bytes of a stored page; of up to 64 pages as JPEG (quality 90), where the image is not stored as pages."""
    if image.mean_page_bytes is not None:
        return image.mean_page_bytes
    base = image.pyramid.levels[0]
    pages = np.unique(np.linspace(0, base.columns * base.rows - 1, 64).astype(int))
    sizes = [
        len(simplejpeg.encode_jpeg(image.read_page(int(page), 0)[..., :3].copy(), quality=90, colorspace="RGB"))
        for page in pages
    ]
    return float(np.mean(sizes))


def one_to_one_view(display: Display) -> ImageOnDisplay:
    """A virtual image with a texel on every pixel of a display's whole unrolled surface."""
    return view_of(display, Pyramid.of(one_to_one_size_px(display)), OnSurface("one-to-one"))


def detail_of(image: Image, display: Display, *, progress: Callable[[float], None] | None = None) -> Detail:
    """What is too faint to be seen on a display: for the policy ``contrast``.

    Quick where the contrast of the image's pages lies beside it already; ``progress`` is told the fraction done.
    """
    contrast = page_contrast(image, progress=progress)
    luminance = np.array([panel.luminance_cd_m2 for panel in display.panels])
    return contrast_detail(image.pyramid, CONTRAST_OF_BYTE[contrast], luminance)


def policies_of(names: Iterable[str], acuities: Iterable[str | float]) -> tuple[Policy, ...]:
    """Policies by name; one that depends on the viewers' acuity appears once for each acuity.

    Raises
    ------
    InputError
        If a policy or an acuity is unknown or impossible, or there is none.
    """
    values = [acuity_from(acuity) for acuity in acuities]
    found: list[Policy] = []
    for name in names:
        if ignores_acuity(name):
            found.append(Policy.parse(name))
        else:
            found += [Policy.parse(name, value).timeless for value in values]
    if not found:
        raise InputError("no policy to count: give --policy, and --acuity-arcmin for those that need it")
    return tuple(dict.fromkeys(found))


def frames_of(sessions: Iterable[Session], rate_hz: float) -> int:
    """How many frames `count_traffic` will go through."""
    return sum(len(session.times_s(rate_hz)) for session in sessions)


def count_traffic(
    view: ImageOnDisplay,
    session: Session,
    policies: Sequence[Policy],
    *,
    rate_hz: float = FRAMES_PER_S,
    per_node: bool = False,
    detail: Detail | None = None,
    advance: Callable[[], None] | None = None,
) -> Counts:
    """Distinct pages that every frame of a session needs, as if no page were left from the frame before.

    Parameters
    ----------
    view
        The image on the panels that count.
    session
        Who walks where.
    policies
        Each gets a row.
    rate_hz
        Frames a second to look at.
    per_node
        A page that several nodes show counts once for each, as it does when every node fetches for itself.
    detail
        What the policy ``contrast`` goes by; see `limen.layers.common.page_detail.contrast_detail`.
    advance
        Called after every frame.

    Raises
    ------
    InputError
        If pages are to be counted per node for an image on a shape, or by contrast without a ``detail``.
    """
    if detail is None and any(policy.name == "contrast" for policy in policies):
        raise InputError("the policy contrast needs an image whose contrast is known; one-to-one is made up")
    if per_node and view.placement.bends:
        raise InputError("pages can be counted per node for an image on the display's surface only, without lenses")
    look = _Look(view, policies, per_node, detail)
    seen: list[tuple[list[int], int, Floats]] = []
    for counted in _in_threads(look, list(session.frames(rate_hz))):
        seen.append(counted)
        if advance is not None:
            advance()
    floor = np.stack([samples for _, _, samples in seen], axis=1)
    return Counts(
        session=session.name,
        duration_s=session.duration_s,
        viewers=len(session.tracks),
        time_s=session.times_s(rate_hz),
        policies=tuple(policies),
        pages=np.array([pages for pages, _, _ in seen], dtype=np.int64).T,
        full_pages=np.array([full for _, full, _ in seen], dtype=np.int64),
        floor_samples=floor[:-1],
        human_samples=floor[-1],
    )


def _in_threads(look: _Look, frames: list[Frame]) -> Iterator[tuple[list[int], int, Floats]]:
    """The frames' counts in their order; the kernels and NumPy's sorting let other threads run meanwhile."""
    pool = ThreadPoolExecutor(max_workers=min(8, os.cpu_count() or 1))
    try:
        yield from pool.map(look, frames)
    finally:
        pool.shutdown(cancel_futures=True)  # after Ctrl-C nobody waits for the rest


def _floor_policy(policy: Policy) -> Policy:
    """The eyes that a policy serves, without regard to what the picture shows."""
    return Policy() if policy.name == "full" else replace(policy.eyesight, name="acuity")


class _Look:
    """Counts one frame: pages of every policy, pages of ``full``, and the floor for every acuity and human eyes."""

    def __init__(self, view: ImageOnDisplay, policies: Sequence[Policy], per_node: bool, detail: Detail | None) -> None:
        self._view, self._policies = view, policies
        self._faint = view._replace(detail=detail) if detail is not None else view
        self._places = places_of(view)
        self._eyesight = [*map(_floor_policy, policies), Policy()]
        self._distinct = tuple(
            dict.fromkeys(policy for policy in (*policies, *self._eyesight) if policy.name != "full")
        )
        names = {name: number for number, name in enumerate(view.display.nodes)}
        nodes = np.array([names[panel.node] for panel in view.display.panels])
        self._nodes = nodes if per_node else None
        # Only an image seen through the panels from the viewer's place changes under `full`.
        follows = isinstance(view.placement, OnShape) and view.placement.eye_m is None
        self._full = None if follows else self._pages(_FULL, tolerance_of((), _FULL), None)

    def __call__(self, frame: Frame) -> tuple[list[int], int, Floats]:
        eye = frame.viewers[0].position_m
        full = self._pages(_FULL, tolerance_of((), _FULL), eye) if self._full is None else self._full
        allows = {policy: tolerance_of(frame.viewers, policy) for policy in self._distinct}
        pages = [
            full if policy.name == "full" else self._pages(policy, allows[policy], eye) for policy in self._policies
        ]
        samples = resolvable_samples(self._places, list(allows.values()))
        floor = dict(zip(self._distinct, samples, strict=True))
        return pages, full, np.array([floor[policy] for policy in self._eyesight])

    def _pages(self, policy: Policy, tolerance: Tolerance, eye_m: Vec3 | None) -> int:
        """As many as ``len(select(...))``; on the surface without sorting them by importance, in half the time."""
        view = self._faint if policy.name == "contrast" else self._view
        if view.placement.bends:
            return len(select(view, tolerance, eye_m=eye_m))
        pairs = flat_pairs(view, tolerance)
        if self._nodes is not None:
            return len(np.unique(self._nodes[pairs.panel] * self._view.pyramid.page_count + pairs.page))
        needed = np.zeros(self._view.pyramid.page_count, dtype=bool)
        needed[pairs.page] = True
        return int(np.count_nonzero(needed))
