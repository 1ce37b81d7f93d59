"""Meshes of fewer triangles: how fast they are made, how far they are from the mesh, and how they look, beside peers.

limen keeps a tree and chooses anew for every view; peers make one mesh for all views. At equal numbers of triangles
pictures of both are judged by the independent observer, against pictures of all triangles.

References
----------
Luebke, Hallen 2001, *Perceptually Driven Simplification for Interactive Rendering*, sections 5 and 6.
Mantiuk, Hanji, Ashraf, Asano, Chapiro 2024, *ColorVideoVDP*.
"""

from __future__ import annotations

import contextlib
import statistics
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from limen.data.mesh.mesh import Mesh
from limen.data.mesh.tree_build import build_vertex_tree
from limen.data.opening import open_content
from limen.data.samples.mesh import torus_knot
from limen.data.store.atomic import write_bytes
from limen.display.display import Display
from limen.display.quilt import pack
from limen.errors import InputError
from limen.frame.renderer import Renderer
from limen.geometry import Floats
from limen.gpu.device import Device, open_device
from limen.layers.common.contrast_scale import acuity_scale
from limen.layers.mesh.draw.folded import mesh_of_nodes
from limen.layers.mesh.layer import MeshLayer
from limen.layers.mesh.select import FoldRequest, FoldTree, select_mesh
from limen.study.baselines.packages import is_skipped
from limen.study.baselines.simplifiers import PEERS
from limen.study.bench.mesh_plot import MeshComparison, Rgb, mesh_picture
from limen.study.bench.table import FIGURES, Row, Say, Table, figure
from limen.study.bench.timing import median_of, timed
from limen.study.frames import frame_of
from limen.study.observer import INSTALL, WINDOW_PX, Observer, light_of, missing_packages
from limen.study.plots import format_of
from limen.study.surfaces import surface_error
from limen.study.verify_scene import Pose, monitor, pixels_per_degree, random_poses, random_windows, standing
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer

__all__ = ["bench_mesh", "compared", "folded_uniformly"]

_PAPERS = {69_451: 29_866, 871_414: 87_141}
"""Triangles of the bunny and the dragon, and to how many they are simplified; others to 43 %, as the bunny is."""
_SHARE = 0.43
_SAMPLE_TRIANGLES, _QUICK_TRIANGLES, _WARM_TRIANGLES = 200_000, 20_000, 2_000
_VIEWS, _QUICK_VIEWS, _WINDOWS = 40, 6, 4
_SIZE_DEG = 25.0
"""Visual angle of the mesh: most of the monitor, so that its triangles are larger than pixels."""
_FRAMES, _QUICK_FRAMES = 20, 5
_RATE = "million triangles/s"


def bench_mesh(quick: bool, say: Say, content: Path | None = None, plot: Path | None = None) -> list[Table]:
    """The table of ``limen bench mesh``.

    ``content`` is a mesh instead of the sample; ``plot``: a file for pictures of the view in which peers do worst.
    """
    if plot is not None and missing_packages():
        raise InputError(f"--plot draws what the observer judged, and it is not installed: run {INSTALL[0]}")
    rows, seen = compared(quick, say, content)
    if plot is not None and seen is not None:
        write_bytes(plot, mesh_picture(seen, format_of(plot)))
    return [Table(FIGURES, rows)]


def compared(quick: bool, say: Say, content: Path | None = None) -> tuple[list[Row], MeshComparison | None]:
    """All rows, and the view in which peers do worst; None where the observer is not installed."""
    mesh = _opened(content) if content else torus_knot(_QUICK_TRIANGLES if quick else _SAMPLE_TRIANGLES)
    most = _PAPERS.get(mesh.size, int(_SHARE * mesh.size))
    FoldTree(build_vertex_tree(torus_knot(_WARM_TRIANGLES)))  # compiles the kernels, which is not to be timed
    name = content.name if content else "torus knot"
    say(f"{name}: a tree of {mesh.size:,} triangles, and peers that leave {most:,} of them")
    tree, built = timed(lambda: build_vertex_tree(mesh))
    foldable, known = timed(lambda: FoldTree(tree))
    rows = [
        figure(f"{name}: tree built", mesh.size / built.cpu_ms / 1e3, _RATE, "limen"),
        figure(f"{name}: made ready for cuts", mesh.size / known.cpu_ms / 1e3, _RATE, "limen"),
        figure(f"{name}: tree held", tree.nbytes / mesh.size, "bytes/triangle", "limen"),
    ]
    made: dict[str, Mesh] = {}
    for peer, make in PEERS.items():
        if not is_skipped(peer, say):
            made[peer], spent = timed(lambda: make(mesh, most))  # noqa: B023
            what = f"{name}: simplified to {made[peer].size:,}"
            rows.append(figure(what, mesh.size / spent.cpu_ms / 1e3, _RATE, peer))
    say(f"{name}: distances between surfaces")
    rows += _distances(name, mesh, {"limen": folded_uniformly(mesh, foldable, most), **made})
    say(f"{name}: cuts for views")
    rows += _cuts(name, mesh, foldable, most, _QUICK_FRAMES if quick else _FRAMES)
    if missing_packages():
        say("the independent observer is not installed, so pictures were not judged (see `limen verify --help`)")
        return rows, None
    views = _QUICK_VIEWS if quick else _VIEWS
    say(f"{name}: pictures of {views} views, each of {most:,} triangles")
    with open_device() as device:
        judged, seen = _judged(device, name, mesh, foldable, made, most, views)
    return [*rows, *judged], seen


def _opened(content: Path) -> Mesh:
    mesh = open_content(content)
    if not isinstance(mesh, Mesh):
        raise InputError(f"{content}: is no mesh, and this benchmark wants one")
    return mesh


def folded_uniformly(mesh: Mesh, foldable: FoldTree, most: int) -> Mesh:
    """The mesh with what moves its surface least folded, until no more than ``most`` triangles are left."""
    tree = foldable.tree
    order = np.argsort(tree.displacement, kind="stable")
    left = len(tree.triangles) - np.cumsum(foldable.lost[tree.vertices : -1][order])
    enough = int(np.searchsorted(-left, -most)) + 1
    folds = np.zeros(len(tree.position), bool)
    folds[tree.vertices + order[:enough]] = True
    parent = np.where(tree.parent < 0, np.arange(len(tree.parent)), tree.parent)
    stands = np.where(folds[parent], parent, np.arange(len(parent)))
    while (stands != stands[stands]).any():
        stands = stands[stands]
    dies = np.append(folds, False)[foldable.dies_at]
    nodes = mesh_of_nodes(mesh, tree)
    return replace(nodes, triangles=stands[tree.triangles[~dies]].astype(np.uint32))


def _distances(name: str, mesh: Mesh, made: dict[str, Mesh]) -> Iterator[Row]:
    diagonal = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
    for maker, simple in made.items():
        error = surface_error(
            mesh.positions.astype(float), mesh.triangles, simple.positions.astype(float), simple.triangles
        )
        for kind, value in (("root mean square", error.rms), ("largest", error.largest)):
            what = f"{name}: {kind} distance of {simple.size:,} triangles"
            yield figure(what, value / diagonal * 1e4, "1e-4 of the diagonal", maker)


@dataclass(frozen=True, slots=True)
class _Scene:
    """The paper's monitor, and a mesh that stands behind it in some poses."""

    display: Display
    viewer: Viewer
    poses: list[Pose]
    bounds: NDArray[Any]

    @classmethod
    def of(cls, mesh: Mesh, views: int) -> _Scene:
        display, viewer = monitor()
        return cls(display, viewer, [replace(pose, size_deg=_SIZE_DEG) for pose in random_poses(views)], mesh.bounds)

    def stands(self, pose: Pose) -> Floats:
        return standing(self.bounds, self.display.panels[0], self.viewer, pose)


def _cuts(name: str, mesh: Mesh, foldable: FoldTree, most: int, frames: int) -> Iterator[Row]:
    """What choosing costs a frame, processor time; all of the mesh is in sight."""
    scene = _Scene.of(mesh, frames)
    views = QuiltPanels(scene.display, pack(scene.display)[0]).seen_from(scene.viewer.eyes_m[0])
    whites = [panel.luminance_cd_m2 for panel in scene.display.panels]
    for policy in (Policy("contrast"), Policy("contrast", gaze=True), Policy("budget", max_items=most)):
        tolerance = tolerance_of([scene.viewer], policy.eyesight)
        spent = []
        for pose in [scene.poses[0], *scene.poses]:  # the first also compiles
            sight = FoldRequest((views,), scene.stands(pose), tolerance, policy, acuity_scale(policy, whites))
            spent.append(timed(lambda: select_mesh(foldable, sight))[1])  # noqa: B023
        cut_ms = median_of(spent[1:]).cpu_ms
        yield figure(f"{name}: cut, {policy.title}", cut_ms, "ms/frame", "limen")
        nodes = len(foldable.tree.position)
        yield figure(f"{name}: cut, {policy.title}, by nodes", cut_ms / nodes * 1e6, "ns/node", "limen")


def _judged(
    device: Device, name: str, mesh: Mesh, foldable: FoldTree, made: dict[str, Mesh], most: int, views: int
) -> tuple[list[Row], MeshComparison]:
    """The observer's verdict on the same windows of every way's pictures, and outlines that differ."""
    scene, observer = _Scene.of(mesh, views), Observer()
    layers = {
        "all triangles": MeshLayer(mesh),
        "limen": MeshLayer(mesh, policy=Policy("budget", max_items=most), tree=foldable),
        **{peer: MeshLayer(simple) for peer, simple in made.items()},
    }
    with contextlib.ExitStack() as held:
        renderers = {
            maker: held.enter_context(Renderer(device, scene.display, [layer])) for maker, layer in layers.items()
        }
        found = [_seen(scene, pose, renderers, observer) for pose in scene.poses]
    rows = []
    for maker in ("limen", *made):
        jods = [each.jod[maker] for each in found]
        outlines = [_outline_differs(each.pictures["all triangles"], each.pictures[maker]) for each in found]
        what = f"{name}: {most:,} triangles, {views} views"
        rows += [
            figure(f"{what}: mean", statistics.fmean(jods), "JOD", maker),
            figure(f"{what}: worst", min(jods), "JOD", maker),
            figure(f"{what}: silhouette that differs", 100 * statistics.fmean(outlines), "%", maker),
        ]
    return rows, min(found, key=lambda each: min(each.jod.values()))


def _seen(scene: _Scene, pose: Pose, renderers: dict[str, Renderer], observer: Observer) -> MeshComparison:
    pictures = {}
    for maker, renderer in renderers.items():
        frame = frame_of(renderer, [scene.viewer], placement=InRoom.of(scene.stands(pose)))
        ((_, picture, _),) = renderer.pictures(frame)
        pictures[maker] = picture[..., :3].copy()
    full = pictures["all triangles"]
    rate = pixels_per_degree(scene.display.panels[0], scene.viewer)
    parts = [np.s_[y : y + WINDOW_PX, x : x + WINDOW_PX] for x, y in random_windows(_shown(full), pose.seed, _WINDOWS)]
    jod = {}
    for maker in list(pictures)[1:]:
        verdicts = [
            observer.judge_light(light_of(pictures[maker][part]), light_of(full[part]), rate, second_opinion=False)
            for part in parts
        ]
        jod[maker] = statistics.fmean(verdict.jod for verdict in verdicts)
    return MeshComparison(pictures, jod)


def _shown(picture: Rgb) -> NDArray[np.bool_]:
    """Pixels that show anything: the mesh does not reach the picture's first."""
    return np.asarray((picture != picture[0, 0]).any(axis=-1))


def _outline_differs(full: Rgb, other: Rgb) -> float:
    """Pixels that show the mesh in one picture alone, over those along its outline."""
    shown, outline = _shown(full), _shown(full) & ~ndimage.binary_erosion(_shown(full))
    return float((shown != _shown(other)).sum() / max(outline.sum(), 1))
