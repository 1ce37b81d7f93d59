"""All panels of an installation, in one room frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from limen.display import files
from limen.display.entries import MeshEntry
from limen.display.mapping import check_quilts, part_of_quilts
from limen.display.meshfile import MESH_SUFFIXES
from limen.display.panel import Panel
from limen.display.quilt import Quilt
from limen.errors import DisplayError, InputError
from limen.geometry import Floats, Vec3

__all__ = ["Display", "PanelArrays", "Rect"]


class PanelArrays(NamedTuple):
    """The panels as arrays, one row a panel: what the kernels and the GPU read."""

    origin_m: Floats  # (P, 3)
    right: Floats  # (P, 3)
    down: Floats  # (P, 3)
    pitch_m: Floats  # (P, 2)
    surface_m: Floats  # (P, 2)
    nudge_px: Floats  # (P, 2)
    size_px: NDArray[np.int64]  # (P, 2)
    luminance_cd_m2: Floats  # (P,), of white


class Rect(NamedTuple):
    """A rectangle on the unrolled surface, metres, or on a panel, pixels; y points down."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def width(self) -> float:
        return self.right - self.left

    @property
    def height(self) -> float:
        return self.bottom - self.top


@dataclass(frozen=True)
class Display:
    """All panels of an installation.

    Parameters
    ----------
    quilts
        How the hardware wants the panels' pictures in images, where its owner says; empty if limen may pack them.

    Raises
    ------
    DisplayError
        If there is no panel, two panels share a name, or the quilts cannot be (a panel is missing, reaches out of its
        quilt, or lies over another).
    """

    name: str
    panels: tuple[Panel, ...]
    description: str = ""
    quilts: tuple[Quilt, ...] = ()

    def __post_init__(self) -> None:
        if not self.panels:
            raise DisplayError(f"display '{self.name}' has no panels: add a [[grid]], a [[panel]] or a [[mesh]]")
        names = [panel.name for panel in self.panels]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise DisplayError(f"display '{self.name}': two panels are named '{twice}'")
        if self.quilts:
            try:
                check_quilts(self, self.quilts)
            except DisplayError as error:
                raise DisplayError(f"display '{self.name}': {error}") from None

    @classmethod
    def preset(cls, name: str) -> Display:
        """One of the displays that limen brings along; see `limen.display.files.preset_names`.

        Raises
        ------
        InputError
            If there is no preset of that name; the message lists those there are.
        """
        if name not in files.preset_names():
            raise InputError(
                f"no display is named '{name}': there are {', '.join(files.preset_names())}; or give a .toml file"
            )
        return cls(*files.read(files.preset_path(name)))

    @classmethod
    def load(cls, path: str | Path) -> Display:
        """Read a display file (TOML).

        Raises
        ------
        MissingFileError
            If the file does not exist.
        FormatError
            If the file is not TOML or a field is wrong; the message names line and field.
        DisplayError
            If the panels it describes are impossible.
        """
        return cls(*files.read(Path(path)))

    @classmethod
    def from_mesh(
        cls, path: str | Path, ppi: float, *, scale: float = 1.0, up: Vec3 = (0.0, 1.0, 0.0), inward: bool = False
    ) -> Display:
        """A panel for every face of a mesh file (OBJ, PLY, OFF, STL ...); a display file's ``[[mesh]]`` says more.

        Parameters
        ----------
        ppi
            Pixels per inch.
        scale
            Metres per unit of the mesh.
        up
            The mesh's upward direction; (0, 0, 1) where z points up.
        inward
            Panels are seen from where their corners run clockwise.

        Raises
        ------
        InputError
            If the resolution or the scale is not above 0.
        MissingFileError, FormatError, DisplayError
            If the file is not there, cannot be read, or has a face that cannot be a panel; the message names the face.
        """
        for what, value in (("pixels per inch", ppi), ("scale", scale)):
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{path}: {what} must be above 0, got {value}")
        path = Path(path)
        entry = MeshEntry(name=path.stem, file=path.name, ppi=ppi, scale=scale, up=up, facing="in" if inward else "out")
        return cls(path.stem, tuple(files.mesh_panels(entry, path.parent)))

    @classmethod
    def named(
        cls, name_or_path: str, *, ppi: float | None = None, scale: float | None = None, inward: bool = False
    ) -> Display:
        """A preset by its name, or a file by its path: what the command line takes.

        ``ppi``, ``scale`` and ``inward`` are for mesh files, see `from_mesh`; these need the first.
        """
        if name_or_path.lower().endswith(MESH_SUFFIXES):
            if ppi is None:
                raise InputError(
                    f"{name_or_path}: a mesh says nothing of pixels: give --ppi, or a display file with a [[mesh]] "
                    f"(limen display {name_or_path} --ppi 100 --to-toml {Path(name_or_path).stem}.toml)"
                )
            return cls.from_mesh(name_or_path, ppi, scale=1.0 if scale is None else scale, inward=inward)
        of_meshes = {"--ppi": ppi is not None, "--scale": scale is not None, "--inside": inward}
        for option, given in of_meshes.items():
            if given:
                raise InputError(f"{name_or_path}: {option} is for mesh files; a display has its own: leave it out")
        if name_or_path in files.preset_names():
            return cls.preset(name_or_path)
        if name_or_path.endswith(".toml") or "/" in name_or_path or Path(name_or_path).exists():
            return cls.load(name_or_path)
        return cls.preset(name_or_path)

    @classmethod
    def window(cls, size_px: tuple[int, int], pitch_m: float = 0.000_265, distance_m: float = 0.6) -> Display:
        """A plain window: one panel, ``distance_m`` in front of a viewer at the room's origin."""
        width, height = size_px[0] * pitch_m, size_px[1] * pitch_m
        panel = Panel(
            name="window",
            size_px=size_px,
            origin_m=(-width / 2, height / 2, -distance_m),
            right=(1.0, 0.0, 0.0),
            down=(0.0, -1.0, 0.0),
            pitch_m=(pitch_m, pitch_m),
        )
        return cls("window", (panel,))

    def to_toml(self, quilts: Sequence[Quilt] | None = None) -> str:
        """The display as a file that `load` reads back, every panel written out.

        ``quilts`` are written with it: by default its own, or such as `limen.display.packing.pack_outlines` made.
        """
        return files.write(self.name, self.panels, self.description, self.quilts if quilts is None else quilts)

    def select(self, globs: str | Iterable[str]) -> Display:
        """The panels whose names match any of the shell-style patterns, on the same surface.

        Raises
        ------
        InputError
            If one of them matches no panel.
        """
        patterns = [globs] if isinstance(globs, str) else list(globs)
        names = [panel.name for panel in self.panels]
        chosen = [row for row, name in enumerate(names) if any(fnmatchcase(name, pattern) for pattern in patterns)]
        idle = [pattern for pattern in patterns if not any(fnmatchcase(name, pattern) for name in names)]
        if idle or not chosen:
            raise InputError(
                f"no panel of '{self.name}' matches {' '.join(idle)}; a name looks like '{self.panels[0].name}'"
            )
        return self.part(chosen)

    def part(self, indices: Sequence[int]) -> Display:
        """Some of the panels, in the order given, on the same surface."""
        quilts = part_of_quilts(self.quilts, indices)
        return self._part(tuple(self.panels[index] for index in indices), quilts)

    def cut_outs(self, cuts: Sequence[tuple[str, int, Rect]]) -> Display:
        """Rectangles of panels as panels of their own, hanging where they hang and showing what they show.

        Parameters
        ----------
        cuts
            The new panel's name, the index of the panel that it is cut from, and its whole pixels.

        Raises
        ------
        InputError
            If a rectangle is empty or sticks out of its panel.
        """
        return self._part(tuple(_cut_out(self.panels[index], name, rect) for name, index, rect in cuts))

    def scaled(self, factor: float) -> Display:
        """The same panels with ``factor`` times as many pixels along each side: for previews of a whole room."""
        if not 0 < factor <= 1:
            raise InputError(f"a preview's scale must lie above 0 and at most at 1, got {factor}")
        if factor == 1:
            return self  # with its quilts
        return self._part(tuple(_scaled(panel, factor) for panel in self.panels))

    def _part(self, panels: tuple[Panel, ...], quilts: tuple[Quilt, ...] = ()) -> Display:
        """Other panels on the same surface. Previews and cut-outs are shown by no hardware, so they have no quilts."""
        return _Part(self.name, panels, self.description, quilts, part_of=self.whole)

    @property
    def whole(self) -> Display:
        """The display that this is a part or a preview of; itself where it is neither."""
        return self

    @cached_property
    def arrays(self) -> PanelArrays:
        panels = self.panels
        return PanelArrays(
            np.array([panel.origin_m for panel in panels]),
            np.array([panel.right for panel in panels]),
            np.array([panel.down for panel in panels]),
            np.array([panel.pitch_m for panel in panels]),
            np.array([panel.surface_m for panel in panels]),
            np.array([panel.nudge_px for panel in panels], dtype=float),
            np.array([panel.size_px for panel in panels], dtype=np.int64),
            np.array([panel.luminance_cd_m2 for panel in panels], dtype=float),
        )

    @cached_property
    def nudged_origin_m(self) -> Floats:
        """Where each panel's corner would be if the panel hung where its picture is nudged to, shape (P, 3)."""
        arrays = self.arrays
        step = arrays.nudge_px * arrays.pitch_m
        return arrays.origin_m - arrays.right * step[:, :1] - arrays.down * step[:, 1:]

    @cached_property
    def outlines_m(self) -> Floats:
        """Corners of the lit outlines in the room, clockwise as viewers see them: shape (P, K, 3).

        Rows beyond an outline's number of corners repeat its last; K is the largest number.
        """
        outlines = [panel.outline_m for panel in self.panels]
        most = max(map(len, outlines))
        return np.array([outline[np.minimum(np.arange(most), len(outline) - 1)] for outline in outlines])

    @cached_property
    def middles_m(self) -> Floats:
        """The mean of each lit outline's corners, a place inside of it: shape (P, 3)."""
        return np.array([panel.outline_m.mean(axis=0) for panel in self.panels])

    @cached_property
    def normals(self) -> Floats:
        """Unit vectors toward the viewers, shape (P, 3)."""
        return np.cross(self.arrays.down, self.arrays.right)

    @cached_property
    def surface(self) -> Rect:
        """The bounding rectangle of all panels on the unrolled surface."""
        arrays = self.arrays
        corner = arrays.surface_m + arrays.size_px * arrays.pitch_m
        left, top = arrays.surface_m.min(axis=0)
        right, bottom = corner.max(axis=0)
        return Rect(float(left), float(top), float(right), float(bottom))

    @cached_property
    def bounds_m(self) -> Floats:
        """Smallest and largest room coordinates of all panels' lit outlines, shape (2, 3)."""
        corners = np.concatenate([panel.outline_m for panel in self.panels])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    @cached_property
    def facing(self) -> Floats:
        """Mean of the panels' normals weighted by area, shape (3,): length 1 for a flat wall, about 0 for a room."""
        areas = np.array([panel.size_m[0] * panel.size_m[1] for panel in self.panels])
        normals = np.array([panel.normal for panel in self.panels])
        return np.asarray((normals * areas[:, None]).sum(axis=0) / areas.sum())

    @property
    def pitch_m(self) -> float:
        """Distance between true pixels of the first panel of the whole display, also in parts and previews of it."""
        return self.panels[0].pitch_m[0] / self.panels[0].true_px

    @property
    def scale(self) -> float:
        """Pixels of the first panel over its true pixels, along a side: below 1 in a preview."""
        return 1 / self.panels[0].true_px

    @property
    def total_px(self) -> int:
        return sum(panel.size_px[0] * panel.size_px[1] for panel in self.panels)

    @property
    def nodes(self) -> dict[str, list[str]]:
        """Names of the panels that each node draws, in the order of the panels."""
        nodes: dict[str, list[str]] = {}
        for panel in self.panels:
            nodes.setdefault(panel.node, []).append(panel.name)
        return nodes

    def grids(self) -> dict[str, Sequence[Panel]]:
        """Panels by the grid (wall) they belong to, in the order of the panels."""
        grids: dict[str, list[Panel]] = {}
        for panel in self.panels:
            grids.setdefault(panel.grid_name, []).append(panel)
        return dict(grids)


def _cut_out(panel: Panel, name: str, rect: Rect) -> Panel:
    left, top, right, bottom = (int(side) for side in rect)
    width, height = panel.size_px
    if not (0 <= left < right <= width and 0 <= top < bottom <= height):
        raise InputError(f"panel '{panel.name}' ({width} x {height} px) holds no {left},{top} to {right},{bottom}")
    x, y, z = panel.position_m(np.array([left, top], dtype=float))
    return replace(
        panel,
        name=name,
        size_px=(right - left, bottom - top),
        origin_m=(float(x), float(y), float(z)),
        surface_m=(panel.surface_m[0] + left * panel.pitch_m[0], panel.surface_m[1] + top * panel.pitch_m[1]),
        outline_px=tuple((x - left, y - top) for x, y in panel.outline_px),
        bezel_m=0.0,  # a cut through the lit area has no frame
    )


def _scaled(panel: Panel, factor: float) -> Panel:
    width, height = (max(1, round(side * factor)) for side in panel.size_px)
    shrink = (width / panel.size_px[0], height / panel.size_px[1])
    return replace(
        panel,
        size_px=(width, height),
        pitch_m=(panel.pitch_m[0] / shrink[0], panel.pitch_m[1] / shrink[1]),
        outline_px=tuple((x * shrink[0], y * shrink[1]) for x, y in panel.outline_px),
        nudge_px=(panel.nudge_px[0] * shrink[0], panel.nudge_px[1] * shrink[1]),
        true_px=panel.true_px / shrink[0],
    )


@dataclass(frozen=True)
class _Part(Display):
    """Some panels of a display, or all with fewer pixels: an image still lies on the whole display's surface."""

    part_of: Display | None = None

    @property
    def whole(self) -> Display:
        return self.part_of or self

    @property
    def surface(self) -> Rect:
        return self.whole.surface

    @property
    def pitch_m(self) -> float:
        return self.whole.pitch_m
