"""Who sees which panel, and how large an error may be there: what a terrain's detail is chosen by.

Every panel has one class and one allowed error for all viewers together: the finest demand wins. A viewer demands
something of the panels that they are in front of and that lie within a limit of their line of sight (gaze, or head
where no eye tracker tells), whether that meets the display or not. The angle of a panel is that of its middle, as
Scheel and others have it, or the smallest of any of its places: then no panel is dropped that reaches within the limit.

References
----------
Scheel, Löffler, Lehmann, Schumann, Staadt, *Dynamic Level of Detail for Tiled Large High-Resolution Displays*, sections
2.1, 2.2 and 3.1.
Rönne 1915, *Zur Theorie und Technik der Bjerrumschen Gesichtsfelduntersuchung*, Archiv für Augenheilkunde 78, 284-301
(how far the visual field of an eye reaches).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.display.display import Display
from limen.errors import InputError
from limen.geometry import Floats
from limen.viewing.panel_distance import angle_deg, least_tolerance_m, nearest_m, smallest_angle_deg
from limen.viewing.policy import Policy
from limen.viewing.tolerance import scheel_px, tolerance_of
from limen.viewing.viewer import Pointer, Viewer

__all__ = [
    "CLASSES", "FIELD_DEG", "FOCUS", "FULL_ERROR_PX", "HOLD_DEG", "HOLD_NEAR_DEG", "HOLD_OCTAVES", "MACULA_DEG",
    "OUTSIDE", "PERIPHERY", "POINTER_CONE_DEG", "SCHEEL_FIELD_DEG", "SELECTED", "PanelDemands", "Rule", "panel_demands",
]  # fmt: skip

Rule: TypeAlias = Literal["exact", "middle"]

CLASSES = ("outside", "periphery", "focus", "selected")
"""What `PanelDemands.seen` counts through."""
OUTSIDE, PERIPHERY, FOCUS, SELECTED = range(4)

FULL_ERROR_PX = 0.5
"""Half a pixel: the pixels of a panel can show no smaller error. ``full`` and pointers allow it, and nothing less."""

SCHEEL_FIELD_DEG = 60.0
"""The limit of the policy ``scheel``: 90 degrees less what a panel's middle leaves open (section 2.1)."""

FIELD_DEG = 107.0
"""How far from where it looks an eye still sees, toward the temple (Rönne 1915); less to all other sides.

The limit of limen's own policies, to all sides and for each eye, and where only the head is known by the policy's
``head_slack_deg`` more. So nothing is switched off that anybody could see."""

MACULA_DEG = 8.5
"""By the rule of middles a panel is in focus that lies as near as this to the line of sight: the macula's radius. By
the exact rule, it is the panel that the line of sight meets."""

POINTER_CONE_DEG = 20.0
"""Opening angle of the cone in which a pointer selects panels (section 3.1)."""

HOLD_DEG = 5.0
"""How far beyond the limit a panel that was seen stays seen."""

HOLD_NEAR_DEG = 1.0
"""How far beyond what made it so a panel stays in focus or selected."""

HOLD_OCTAVES = 0.25
"""The allowed error grows when it would by more than this; it shrinks at once."""

_IN_PLANE_M = 1e-6  # an eye this near to a panel's plane, or behind it, sees no pixel of it
_NOBODY = -1


class PanelDemands(NamedTuple):
    """What is demanded of every panel of a display, one entry a panel; the next frame goes on from it."""

    seen: NDArray[np.int8]  # (P,): an index into `CLASSES`, the highest of any viewer
    angle_deg: Floats  # (P,): the smallest to any viewer in front, inf where there is none
    allowed_px: Floats  # (P,): the smallest of anybody who sees it, inf where nobody does
    decided_by: NDArray[np.int16]  # (P,): the viewer whose demand is the finest; -1: nobody, or what holds anyway
    hides_faint: NDArray[np.bool_]  # (P,): what is too faint to be seen may be left out of pages


class _Sights(NamedTuple):
    """Lines of sight, one row an eye (or one a viewer, where a policy knows no eyes)."""

    eye_m: Floats  # (E, 3)
    line: Floats  # (E, 3) unit
    limit_deg: Floats  # (E,)
    viewer: NDArray[np.int16]  # (E,)


class _Panels(NamedTuple):
    """The panels from every eye."""

    corners_m: Floats  # (E, P, K, 3)
    middle_m: Floats  # (E, P, 3)
    normal: Floats  # (P, 3)
    in_front: NDArray[np.bool_]  # (E, P)


def panel_demands(
    display: Display,
    viewers: Sequence[Viewer],
    policy: Policy,
    *,
    rule: Rule = "exact",
    field_deg: float | None = None,
    pointers: Sequence[Pointer] = (),
    earlier: PanelDemands | None = None,
) -> PanelDemands:
    """What all viewers and pointers together demand of every panel.

    Parameters
    ----------
    policy
        ``scheel``: its formula, from distance and angle by the rule. ``acuity`` and ``contrast``: never more than
        `limen.Tolerance.allowed_px` anywhere on the panel. ``contrast`` also lets pages hide what is too faint on
        panels that no pointer selects. ``full``: half a pixel on all panels, whoever looks. No policy allows less than
        half a pixel.
    rule
        ``middle``: angles of panels' middles, and with ``scheel`` distances too. ``exact``: the smallest of all places.
    field_deg
        The largest angle at which a panel is seen. By default the policy's: 60 degrees for ``scheel``, for ``full``
        all panels whoever looks, else what eyes can see; see `FIELD_DEG`.
    pointers
        Panels that the cone of one touches are selected, and allowed half a pixel at most, whoever sees them.
    earlier
        The demands of the frame before. With them classes and errors keep still while trackers jitter: a panel stays
        seen up to `HOLD_DEG` beyond the limit, and its error grows only by more than `HOLD_OCTAVES`. What is allowed is
        never more than it would be without.

    Raises
    ------
    InputError
        If ``field_deg`` is no angle, or ``earlier`` is of another display.
    """
    _check(display, field_deg, earlier)
    before = np.zeros(len(display.panels), dtype=np.int8) if earlier is None else earlier.seen
    sights = _sights(viewers, policy, field_deg)
    panels = _seen_from(display, sights.eye_m)
    angle = _angles_deg(panels, sights.line, rule)
    within = panels.in_front & (angle <= sights.limit_deg[:, None] + HOLD_DEG * (before > OUTSIDE))
    focus_deg = (0.0 if rule == "exact" else MACULA_DEG) + HOLD_NEAR_DEG * (before == FOCUS)
    in_focus = (within & (angle <= focus_deg)).any(axis=0)
    whoever = policy.name == "full" and field_deg is None
    selected = _selected(display, pointers, before)
    anyway = np.where(selected | whoever, FULL_ERROR_PX, np.inf)
    errors = np.vstack([anyway, _allowed_px(display, panels, within, angle, viewers, policy, rule)])
    now = PanelDemands(
        np.max([PERIPHERY * (within.any(axis=0) | whoever), FOCUS * in_focus, SELECTED * selected], axis=0).astype(
            np.int8
        ),
        np.where(panels.in_front, angle, np.inf).min(axis=0, initial=np.inf),
        errors.min(axis=0),
        np.append(np.int16(_NOBODY), sights.viewer)[errors.argmin(axis=0)],
        ~selected & (policy.name == "contrast"),
    )
    return now if earlier is None else _held(now, earlier)


def _check(display: Display, field_deg: float | None, earlier: PanelDemands | None) -> None:
    count = len(display.panels)
    if field_deg is not None and not 0 < field_deg <= 180:
        raise InputError(f"field_deg must lie above 0 and at most at 180 degrees, got {field_deg}")
    if earlier is not None and len(earlier.seen) != count:
        raise InputError(f"earlier demands are of {len(earlier.seen)} panels, '{display.name}' has {count}: start anew")


def _held(now: PanelDemands, earlier: PanelDemands) -> PanelDemands:
    """The allowed error follows finer demands at once, and coarser ones by whole steps: a change is what is seen."""
    coarser = now.allowed_px > earlier.allowed_px * 2**HOLD_OCTAVES
    return now._replace(allowed_px=np.where(coarser, now.allowed_px, np.minimum(now.allowed_px, earlier.allowed_px)))


def _sights(viewers: Sequence[Viewer], policy: Policy, field_deg: float | None) -> _Sights:
    """Eyes in the order of `tolerance_of`; for ``scheel`` the head, which is all that the paper knows of a viewer."""
    rows: list[tuple[Floats, Floats, float, int]] = []
    for number, viewer in enumerate(viewers):
        line = np.array(viewer.direction if viewer.gaze is None else viewer.gaze)
        slack = policy.head_slack_deg if viewer.gaze is None else 0.0
        own = SCHEEL_FIELD_DEG if policy.name == "scheel" else FIELD_DEG + slack
        eyes = np.array([viewer.position_m]) if policy.name == "scheel" else viewer.eyes_m
        rows += [(eye, line, own if field_deg is None else field_deg, number) for eye in eyes]
    return _Sights(
        np.array([eye for eye, _, _, _ in rows]).reshape(-1, 3),
        np.array([line for _, line, _, _ in rows]).reshape(-1, 3),
        np.array([limit for _, _, limit, _ in rows], dtype=float),
        np.array([number for _, _, _, number in rows], dtype=np.int16),
    )


def _seen_from(display: Display, eye_m: Floats) -> _Panels:
    corners = display.outlines_m - eye_m[:, None, None]
    normal = display.normals
    in_front = -(corners[:, :, 0] * normal).sum(axis=-1) > _IN_PLANE_M
    return _Panels(corners, display.middles_m - eye_m[:, None], normal, np.asarray(in_front))


def _angles_deg(panels: _Panels, line: Floats, rule: Rule) -> Floats:
    if rule == "middle":
        return angle_deg(panels.middle_m, line[:, None])
    return smallest_angle_deg(panels.corners_m, panels.normal, line[:, None])


def _allowed_px(
    display: Display, panels: _Panels, within: NDArray[np.bool_], angle: Floats, viewers: Sequence[Viewer],
    policy: Policy, rule: Rule,
) -> Floats:  # fmt: skip
    """What every eye allows every panel, shape (E, P): inf where it sees none, and no less than pixels can show."""
    allowed = np.full(within.shape, np.inf)
    eye, panel = np.nonzero(within)
    corners, normal, pitch_m = panels.corners_m[within], panels.normal[panel], display.arrays.pitch_m[panel]
    if policy.name == "full":
        allowed[within] = FULL_ERROR_PX
    elif policy.name == "scheel":
        middle = np.linalg.norm(panels.middle_m[within], axis=-1)
        distance = middle if rule == "middle" else nearest_m(corners, normal)
        allowed[within] = scheel_px(distance * policy.distance_factor, angle[within], pitch_m[:, 1])
    else:
        eyes = tolerance_of(viewers, policy)
        gazes = eyes.gaze[eye], eyes.slack_deg[eye]
        least = least_tolerance_m(corners, normal, *gazes) if policy.gaze else nearest_m(corners, normal)
        allowed[within] = least * eyes.tan_angle[eye] / pitch_m.max(axis=1)
    return np.asarray(np.maximum(allowed, FULL_ERROR_PX))


def _selected(display: Display, pointers: Sequence[Pointer], before: NDArray[np.int8]) -> NDArray[np.bool_]:
    """The panels that the cone of a pointer touches from in front, shape (P,)."""
    hands = np.array([pointer.position_m for pointer in pointers]).reshape(-1, 3)
    lines = np.array([pointer.direction for pointer in pointers]).reshape(-1, 3)
    panels = _seen_from(display, hands)
    limit = POINTER_CONE_DEG / 2 + HOLD_NEAR_DEG * (before == SELECTED)
    return np.asarray((panels.in_front & (_angles_deg(panels, lines, "exact") <= limit)).any(axis=0))
