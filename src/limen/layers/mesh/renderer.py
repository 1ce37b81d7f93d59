"""One frame of a three-dimensional scene: view -> sort -> draw -> present.

`SceneRenderer` shows one mesh, as through windows, on all panels of a display to one viewer. A plain window is a
display with one panel.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from limen.data.mesh.mesh import Mesh
from limen.display.display import Display
from limen.display.packing import pack_outlines
from limen.display.quilt import Quilt, pieces, quilt_names
from limen.errors import InputError
from limen.geometry import Floats
from limen.gpu.buffers import TextureReader
from limen.gpu.device import Device
from limen.layers.common.contrast_scale import acuity_scale
from limen.layers.common.frame_time import FrameTimeBudget
from limen.layers.common.room_placement import mesh_in_room
from limen.layers.common.simulator import DisplaySimulator
from limen.layers.common.stereo import Anaglyph
from limen.layers.mesh.draw.drawer import SceneLayer, SceneOverlay
from limen.layers.mesh.draw.folded import fold_colours, mesh_of_nodes
from limen.layers.mesh.select import Extent, FoldRequest, FoldTree, MeshCut, select_mesh
from limen.viewing.camera import Camera
from limen.viewing.choices import STEREOS, Depth, Stereo
from limen.viewing.policy import Policy
from limen.viewing.projection import PanelProjections, QuiltPanels, check_quilt_sizes, guard_of
from limen.viewing.tolerance import STANDS, tolerance_of
from limen.viewing.viewer import Viewer

__all__ = ["BACKGROUND", "SceneRenderer", "SceneReport", "Simplified", "Viewers"]

Viewers: TypeAlias = Viewer | Sequence[Viewer]

BACKGROUND = (0.006, 0.007, 0.01)
"""Linear light of an empty scene: a dark slate, from which the display's shape still shows."""

_QUILT_PX = 1 << 26
"""Pixels of one offscreen quilt: 268 MB, and as much for depth."""


@dataclass(frozen=True, slots=True)
class SceneReport:
    """What one frame took."""

    time_s: float
    panels_active: int
    triangles: int
    """Pairs of a triangle and a panel that it touches."""
    sort_ms: float
    draw_ms: float
    policy: str = "full"
    left: int = 0
    """Triangles of the mesh that are not folded."""
    max_error_px: float = 0.0
    """Diameter of the largest region that was folded, in pixels of its panel."""
    distance_factor: float = 0.0
    """How many times farther away all viewers would have to be for nobody to see what is left out: 1 or less, where
    they are nobody can."""
    select_ms: float = 0.0
    scale: float = 1.0
    """Panels were drawn with so many times their true pixels along each side."""

    @property
    def drawn(self) -> str:
        return f"{self.triangles:,} triangles"

    @classmethod
    def of(cls, quilts: Sequence[SceneReport]) -> SceneReport:
        """One report for all quilts of a frame."""
        sums = ("panels_active", "triangles", "sort_ms", "draw_ms", "select_ms")
        largest = ("left", "max_error_px", "distance_factor")
        return replace(
            quilts[0],
            **{part: sum(getattr(report, part) for report in quilts) for part in sums},
            **{part: max(getattr(report, part) for report in quilts) for part in largest},
        )


@dataclass(frozen=True, slots=True, eq=False)
class Simplified:
    """A mesh with its vertex tree, and how nodes of it are folded.

    Parameters
    ----------
    foldable
        Of the mesh's own tree.
    policy
        How viewers decide about detail.
    extent
        See `limen.layers.mesh.select.FoldRequest`.
    """

    foldable: FoldTree
    policy: Policy
    extent: Extent = "displacement"


class _Drawn(NamedTuple):
    quilt: Quilt
    texture: Any  # None where a target was given
    report: SceneReport


class SceneRenderer:
    """One mesh on one display.

    Parameters
    ----------
    device
        Opened by the caller, who also closes it.
    display, mesh
        What is shown, and on what.
    room_from_mesh
        Affine map from the mesh's coordinates to the room, metres: shape (4, 4). By default it stands where
        `limen.layers.common.room_placement.mesh_in_room` puts it.
    stereo
        ``none``: one eye, midway between the two. ``anaglyph``: red of the left eye, cyan of the right.
        ``side-by-side``: pictures of twice the width. ``sequential``: two pictures, the left eye's first.
    depth
        See `limen.layers.mesh.draw.drawer.SceneLayer.draw`.
    background
        Linear light (red, green, blue) where nothing is drawn.
    simplified
        The mesh's vertex tree, where fewer triangles are to be drawn than it has: those that viewers can tell.
    max_quilt_px
        Most pixels drawn at once; a display that has more is drawn in several quilts.

    Raises
    ------
    InputError
        For a ``room_from_mesh`` or a stereo that cannot be.
    DeviceLimitError, DisplayError
        If the adapter cannot hold the mesh or draw a panel.
    """

    def __init__(
        self,
        device: Device,
        display: Display,
        mesh: Mesh,
        *,
        room_from_mesh: Floats | None = None,
        stereo: Stereo = "none",
        depth: Depth = "panel",
        background: tuple[float, float, float] = BACKGROUND,
        simplified: Simplified | None = None,
        max_quilt_px: int = _QUILT_PX,
        clip: bool = True,
    ) -> None:
        if stereo not in STEREOS:
            raise InputError(f"no stereo is named '{stereo}': there are {', '.join(STEREOS)}")
        self.display, self.stereo, self._depth = display, stereo, depth
        stands = (
            mesh_in_room(mesh.bounds, display) if room_from_mesh is None else np.asarray(room_from_mesh, dtype=float)
        )
        if stands.shape != (4, 4) or not np.isfinite(stands).all():
            raise InputError(f"a mesh is placed by finite numbers of the shape (4, 4), not {stands.shape}")
        self.room_from_mesh: Floats = stands
        self.motion: Floats = STANDS
        """How places of the room move with the mesh, (3, 4): what policies with ``+motion`` ask for."""
        self._copies = copies = 1 if stereo == "none" else 2
        widest = max(panel.size_px[0] * panel.size_px[1] for panel in display.panels)
        self.quilts: Sequence[Quilt] = display.quilts or pack_outlines(
            display, max_size_px=device.max_texture_px // copies, max_px=max(max_quilt_px // copies, 2 * widest)
        )
        check_quilt_sizes(self.quilts, device.max_texture_px, copies)
        self.guard_px = min(guard_of(display, quilt) for quilt in self.quilts)
        self._windows = {quilt: QuiltPanels(display, quilt, copies, self.guard_px) for quilt in self.quilts}
        self._device = device
        self.simplified = simplified
        self._whites = [panel.luminance_cd_m2 for panel in display.panels]
        self._nodes = mesh if simplified is None else mesh_of_nodes(mesh, simplified.foldable.tree)
        self._layer = SceneLayer(device, self._nodes, background=background, clip=clip)
        self._anaglyph = Anaglyph(device) if stereo == "anaglyph" else None
        self._tinted = False
        self._last: tuple[Any, MeshCut] | None = None
        self._throttle = FrameTimeBudget(len(self.quilts))
        self._reader = TextureReader(device)

    def move(self, mesh: Mesh) -> None:
        """The same triangles with other places and normals: what the next frames show.

        Raises
        ------
        InputError
            For a mesh that is simplified: its tree is of the places that it was made for.
        """
        if self.simplified is not None:
            raise InputError("a mesh that moves is drawn in full: leave out the policy, or the animation")
        self._layer.move(mesh)

    def frame(
        self,
        viewers: Viewers,
        *,
        quilt: Quilt | None = None,
        overlay: SceneOverlay | None = None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
    ) -> SceneReport:
        """Draw what the viewer (or the first of several) is to see, into own textures or into ``target``.

        All viewers together decide what may be left out.

        ``quilt`` arranges the panels in another way than packing does (a window's unrolled surface).
        """
        chosen = [quilt] if quilt else self.quilts
        drawn = [self._draw(each, viewers, overlay, target, target_format) for each in chosen]
        return SceneReport.of([each.report for each in drawn])

    def pictures(
        self, viewers: Viewers, *, overlay: SceneOverlay | None = None
    ) -> Iterator[tuple[str, NDArray[np.uint8], SceneReport]]:
        """Every panel's picture, quilt by quilt: (name, uint8 (h, w, 4) sRGB, the quilt's report).

        With ``side-by-side`` a picture is (h, 2 w, 4); with ``sequential`` there are two, named ``name@left`` and
        ``name@right``. An array is only valid until the next is asked for.
        """
        for quilt in self.quilts:
            drawn = self._draw(quilt, viewers, overlay)
            image = self._reader.read(drawn.texture)
            if self.stereo in ("none", "anaglyph"):
                for name, picture in pieces(self.display, quilt, image).items():
                    yield name, picture, drawn.report
                continue
            width = quilt.size_px[0]
            lefts, rights = (pieces(self.display, quilt, half) for half in (image[:, :width], image[:, width:]))
            for name, left in lefts.items():
                if self.stereo == "side-by-side":
                    yield name, np.concatenate([left, rights[name]], axis=1), drawn.report
                else:
                    yield f"{name}@left", left, drawn.report
                    yield f"{name}@right", rights[name], drawn.report

    def quilt_pictures(
        self, viewers: Viewers, *, overlay: SceneOverlay | None = None
    ) -> Iterator[tuple[str, NDArray[np.uint8], SceneReport]]:
        """Every quilt as it is drawn, named by its output or its number: (name, uint8 (H, W, 4) sRGB, report).

        Two eyes that are not mixed lie side by side. An array is only valid until the next is asked for.
        """
        for name, quilt in zip(quilt_names(self.quilts), self.quilts, strict=True):
            drawn = self._draw(quilt, viewers, overlay)
            yield name, self._reader.read(drawn.texture), drawn.report

    def seen(
        self, viewers: Viewers, cameras: Sequence[Camera], *, overlay: SceneOverlay | None = None
    ) -> list[NDArray[np.uint8]]:
        """What cameras in the room see of the display while it is lit for a viewer: uint8 (H, W, 4), sRGB, each.

        A camera at the viewer's eye sees the scene; from anywhere else it sees the scene bent.

        Raises
        ------
        InputError
            For two eyes side by side or after each other, which no one camera sees.
        """
        textures, _ = self.textures(viewers, overlay=overlay)
        lit = DisplaySimulator(self._device, self.display, self.quilts, guard_px=self.guard_px)
        try:
            return [lit.read(lit.draw(textures, camera)) for camera in cameras]
        finally:
            lit.destroy()

    def textures(self, viewers: Viewers, *, overlay: SceneOverlay | None = None) -> tuple[list[Any], SceneReport]:
        """The textures of all quilts as they are lit for a viewer; valid until the next frame.

        Raises
        ------
        InputError
            For two eyes side by side or after each other, which no one camera sees.
        DeviceLimitError
            If the quilts do not fit the adapter's memory at once.
        """
        if self.stereo not in ("none", "anaglyph"):
            raise InputError(f"'{self.stereo}' shows two pictures at once; simulate it with 'none' or 'anaglyph'")
        drawn = [self._draw(quilt, viewers, overlay, keep=True) for quilt in self.quilts]
        return [each.texture for each in drawn], SceneReport.of([each.report for each in drawn])

    def close(self) -> None:
        """Free the GPU memory; the device stays open."""
        self._layer.destroy()
        self._reader.destroy()
        if self._anaglyph is not None:
            self._anaglyph.destroy()

    def __enter__(self) -> SceneRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # ------------------------------------------------------------------ steps of a frame

    def _draw(
        self,
        quilt: Quilt,
        viewers: Viewers,
        overlay: SceneOverlay | None,
        target: Any = None,
        target_format: str = "rgba8unorm-srgb",
        *,
        keep: bool = False,
    ) -> _Drawn:
        """``keep``: in a texture of its own, that other quilts of the same size do not draw over."""
        begin = time.perf_counter()
        windows = self._windows.get(quilt)
        if windows is None:
            windows = self._windows[quilt] = QuiltPanels(
                self.display, quilt, self._copies, guard_of(self.display, quilt)
            )
        everybody = [viewers] if isinstance(viewers, Viewer) else list(viewers)
        viewer = everybody[0]
        eyes_m = self._eyes(viewer)
        cut = self._cut(quilt, [windows.seen_from(eye, copy) for copy, eye in enumerate(eyes_m)], everybody, overlay)
        selected_at = time.perf_counter()
        forward = np.repeat(np.array([viewer.direction]), len(eyes_m), axis=0)
        triangles = self._layer.sort(windows, eyes_m, self.room_from_mesh, forward=forward)
        sorted_at = time.perf_counter()
        direct = target if self._anaglyph is None else None
        slot = list(self.quilts).index(quilt) if keep else 0
        texture = self._layer.draw(
            windows, depth=self._depth, overlay=overlay, target=direct, target_format=target_format, slot=slot
        )
        if self._anaglyph is not None:
            texture = self._anaglyph.draw(texture, target=target, target_format=target_format, slot=slot)
        if self.simplified is not None and self.simplified.policy.max_ms is not None:
            self._device.wait()
            self._throttle.spent(self.simplified.policy, (time.perf_counter() - begin) * 1e3)
        active = int(windows.facing(eyes_m[0]).sum())
        clock = (sorted_at - selected_at, time.perf_counter() - sorted_at)
        scale = self.display.scale
        report = SceneReport(viewer.time_s, active, triangles, clock[0] * 1e3, clock[1] * 1e3, scale=scale)
        if cut is not None and self.simplified is not None:
            report = replace(
                report, policy=self.simplified.policy.label, left=len(cut), max_error_px=cut.largest_px,
                distance_factor=cut.reached, select_ms=(selected_at - begin) * 1e3,
            )  # fmt: skip
        else:
            report = replace(report, left=self._nodes.size)
        return _Drawn(quilt, texture, report)

    def _cut(
        self, quilt: Quilt, views: Sequence[PanelProjections], viewers: Sequence[Viewer], overlay: SceneOverlay | None
    ) -> MeshCut | None:
        """Choose the triangles that are left; None where all are."""
        if self.simplified is None:
            return None
        policy = self._throttle.within(self.simplified.policy)
        everybody = tuple(replace(each, time_s=0.0) for each in viewers)
        moves = self.motion.tobytes() if policy.motion else b""
        stands = np.asarray(self.room_from_mesh, dtype=float).tobytes()
        asked = (quilt, everybody, policy, self.simplified, stands, moves)
        if self._last is None or self._last[0] != asked:  # nothing has moved: the cut is that of the frame before
            sight = FoldRequest(
                tuple(views), self.room_from_mesh, tolerance_of(viewers, policy.eyesight, self.motion), policy,
                acuity_scale(policy, self._whites), self.simplified.extent,
            )  # fmt: skip
            self._last = asked, select_mesh(self.simplified.foldable, sight)
            self._layer.choose(self._last[1].triangles)
        cut = self._last[1]
        if overlay == "simplified" or self._tinted:
            self._tinted = overlay == "simplified"
            colours = fold_colours(self.simplified.foldable, cut) if self._tinted else self._nodes.colours
            self._layer.paint(replace(self._nodes, colours=colours))
        return cut

    def _eyes(self, viewer: Viewer) -> Floats:
        if self.stereo == "none":
            return np.array([viewer.position_m])
        eyes = viewer.eyes_m
        return eyes if len(eyes) == 2 else np.repeat(eyes, 2, axis=0)
