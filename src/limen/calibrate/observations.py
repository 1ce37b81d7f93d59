"""What the photographs saw, as arrays: one row for each corner of a marker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from limen.calibrate.boards import Board
from limen.calibrate.camera import Intrinsics
from limen.calibrate.detect import Sighting
from limen.display.display import Display
from limen.geometry import Floats

__all__ = ["Observations", "observe"]


@dataclass(frozen=True)
class Observations:
    """Corners of markers.

    Parameters
    ----------
    photo, panel
        Index of the photograph and of the panel, (N,).
    place_m
        Where the corner lies in the panel's own frame, (N, 3); z is 0.
    seen_px
        Where the photograph shows it, (N, 2).
    """

    photo: NDArray[np.int64]
    panel: NDArray[np.int64]
    place_m: Floats
    seen_px: Floats

    def __len__(self) -> int:
        return len(self.photo)

    def where(self, chosen: NDArray[np.bool_]) -> Observations:
        return Observations(self.photo[chosen], self.panel[chosen], self.place_m[chosen], self.seen_px[chosen])

    def errors_px(self, camera: Intrinsics, photo_poses: Floats, panel_poses: Floats) -> Floats:
        """Seen less predicted, (N, 2), given poses (F, 6) of photographs and (P, 6) of panels."""
        room = _moved(panel_poses, self.panel, self.place_m)
        return np.asarray(self.seen_px - camera.project(_moved(photo_poses, self.photo, room)))

    def islands(self, photos: int, panels: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Labels of photographs (F,) and of panels (P,): those with one label are linked by what was seen.

        What was never seen is an island of its own.
        """
        links = coo_array(
            (np.ones(len(self)), (self.photo, photos + self.panel)), shape=(photos + panels, photos + panels)
        )
        _, labels = connected_components(links, directed=False)
        return labels[:photos].astype(np.int64), labels[photos:].astype(np.int64)


def _moved(poses: Floats, which: NDArray[np.int64], points_m: Floats) -> Floats:
    """Points (N, 3), each by one of the poses: `poses.apply` with as few rotations as there are poses."""
    known = np.isfinite(poses[:, 0])
    turns = np.full((len(poses), 3, 3), np.nan)
    turns[known] = Rotation.from_rotvec(poses[known, :3]).as_matrix()
    return np.asarray(np.einsum("nij,nj->ni", turns[which], points_m) + poses[which, 3:])


def observe(display: Display, boards: Sequence[Board], sightings: Sequence[Sighting]) -> Observations:
    """Match the markers in photographs with those of the boards; others are left out."""
    ids = np.concatenate([np.array(board.ids) for board in boards])
    owner = np.concatenate([np.full(len(board.ids), number) for number, board in enumerate(boards)])
    places = np.concatenate(
        [board.corners_px * np.array(panel.pitch_m) for board, panel in zip(boards, display.panels, strict=True)]
    )
    table = np.full(max(int(ids.max()), max((int(s.ids.max(initial=0)) for s in sightings), default=0)) + 1, -1)
    table[ids] = np.arange(len(ids))
    photo, panel, place, seen = [], [], [], []
    for number, sighting in enumerate(sightings):
        row = table[sighting.ids]
        known = row >= 0
        photo.append(np.full(4 * int(known.sum()), number))
        panel.append(np.repeat(owner[row[known]], 4))
        place.append(places[row[known]].reshape(-1, 2))
        seen.append(sighting.corners_px[known].reshape(-1, 2))
    flat = np.concatenate([np.empty((0, 2)), *place])
    return Observations(
        np.concatenate([np.empty(0, dtype=np.int64), *photo]).astype(np.int64),
        np.concatenate([np.empty(0, dtype=np.int64), *panel]).astype(np.int64),
        np.column_stack([flat, np.zeros(len(flat))]),
        np.concatenate([np.empty((0, 2)), *seen]),
    )
