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
import time
from collections.abc import Callable, Iterator
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
from limen.study.bench_points import PeerRow
from limen.study.frames import frame_of
from limen.study.mesh_peers import PEERS, missing_package
from limen.study.observer import WINDOW_PX, Observer, light_of, missing_packages
from limen.study.peers import INSTALL
from limen.study.surfaces import surface_error
from limen.study.verify_scene import Pose, monitor, pixels_per_degree, random_poses, random_windows, standing
from limen.viewing.placement import InRoom
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltPanels
from limen.viewing.tolerance import tolerance_of
from limen.viewing.viewer import Viewer

__all__ = ["MeshBench", "MeshComparison", "bench_mesh", "folded_uniformly"]

Say = Callable[[str], None]
Picture = NDArray[np.uint8]

_PAPERS = {69_451: 29_866, 871_414: 87_141}
"""Triangles of the bunny and the dragon, and to how many they are simplified; others to 43 %, as the bunny is."""
_SHARE = 0.43
_SAMPLE_TRIANGLES, _QUICK_TRIANGLES, _WARM_TRIANGLES = 200_000, 20_000, 2_000
_VIEWS, _QUICK_VIEWS, _WINDOWS = 40, 6, 4
_SIZE_DEG = 25.0
"""Visual angle of the mesh: most of the monitor, so that its triangles are larger than pixels."""
_FRAMES, _QUICK_FRAMES = 20, 5


@dataclass(frozen=True, slots=True, eq=False)
class MeshComparison:
    """One view of the mesh as each way draws it, and the JOD of its windows (nan of the full mesh)."""

    pictures: dict[str, Picture]
    jod: dict[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class MeshBench:
    rows: list[PeerRow]
    seen: MeshComparison | None
    """The view in which peers do worst; None where the observer is not installed."""


def bench_mesh(quick: bool, say: Say, content: Path | None = None) -> MeshBench:
    """Rows of ``limen bench mesh``; ``content`` is a mesh instead of the sample."""
    mesh = _opened(content) if content else torus_knot(_QUICK_TRIANGLES if quick else _SAMPLE_TRIANGLES)
    most = _PAPERS.get(mesh.size, int(_SHARE * mesh.size))
    FoldTree(build_vertex_tree(torus_knot(_WARM_TRIANGLES)))  # compiles the kernels, which is not to be timed
    name = content.name if content else "torus knot"
    say(f"{name}: a tree of {mesh.size:,} triangles, and peers that leave {most:,} of them")
    begin = time.process_time()
    tree = build_vertex_tree(mesh)
    built_s = time.process_time() - begin
    begin = time.process_time()
    foldable = FoldTree(tree)
    known_s = time.process_time() - begin
    rows = [
        _row(f"{name}: tree built", "limen", mesh.size / built_s / 1e6, "million triangles/s"),
        _row(f"{name}: made ready for cuts", "limen", mesh.size / known_s / 1e6, "million triangles/s"),
        _row(f"{name}: tree held", "limen", tree.nbytes / mesh.size, "bytes/triangle"),
    ]
    made = {}
    for peer, make in PEERS.items():
        if package := missing_package(peer):
            say(f"{peer}: skipped, {package} is not installed ({INSTALL})")
            continue
        begin = time.process_time()
        made[peer] = make(mesh, most)
        rate = mesh.size / (time.process_time() - begin) / 1e6
        rows.append(_row(f"{name}: simplified to {made[peer].size:,}", peer, rate, "million triangles/s"))
    say(f"{name}: distances between surfaces")
    rows += _distances(name, mesh, {"limen": folded_uniformly(mesh, foldable, most), **made})
    say(f"{name}: cuts for views")
    rows += _cuts(name, mesh, foldable, most, _QUICK_FRAMES if quick else _FRAMES)
    if missing_packages():
        say("the independent observer is not installed, so pictures were not judged (see `limen verify --help`)")
        return MeshBench(rows, None)
    views = _QUICK_VIEWS if quick else _VIEWS
    say(f"{name}: pictures of {views} views, each of {most:,} triangles")
    with open_device() as device:
        judged, seen = _judged(device, name, mesh, foldable, made, most, views)
    return MeshBench([*rows, *judged], seen)


def _opened(content: Path) -> Mesh:
    mesh = open_content(content)
    if not isinstance(mesh, Mesh):
        raise InputError(f"{content}: is no mesh, and this benchmark wants one")
    return mesh


def _row(what: str, peer: str, value: float, unit: str) -> PeerRow:
    return PeerRow(what=what, peer=peer, value=value, unit=unit)


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


def _distances(name: str, mesh: Mesh, made: dict[str, Mesh]) -> Iterator[PeerRow]:
    diagonal = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
    for maker, simple in made.items():
        error = surface_error(
            mesh.positions.astype(float), mesh.triangles, simple.positions.astype(float), simple.triangles
        )
        for kind, value in (("root mean square", error.rms), ("largest", error.largest)):
            what = f"{name}: {kind} distance of {simple.size:,} triangles"
            yield _row(what, maker, value / diagonal * 1e4, "1e-4 of the diagonal")


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


def _cuts(name: str, mesh: Mesh, foldable: FoldTree, most: int, frames: int) -> Iterator[PeerRow]:
    """What choosing costs a frame, processor time; all of the mesh is in sight."""
    scene = _Scene.of(mesh, frames)
    views = QuiltPanels(scene.display, pack(scene.display)[0]).seen_from(scene.viewer.eyes_m[0])
    whites = [panel.luminance_cd_m2 for panel in scene.display.panels]
    for policy in (Policy("contrast"), Policy("contrast", gaze=True), Policy("budget", max_items=most)):
        tolerance = tolerance_of([scene.viewer], policy.eyesight)
        spent = []
        for pose in [scene.poses[0], *scene.poses]:  # the first also compiles
            sight = FoldRequest((views,), scene.stands(pose), tolerance, policy, acuity_scale(policy, whites))
            begin = time.process_time()
            select_mesh(foldable, sight)
            spent.append(time.process_time() - begin)
        median_s = statistics.median(spent[1:])
        yield _row(f"{name}: cut, {policy.title}", "limen", median_s * 1e3, "ms/frame")
        nodes = len(foldable.tree.position)
        yield _row(f"{name}: cut, {policy.title}, by nodes", "limen", median_s / nodes * 1e9, "ns/node")


def _judged(
    device: Device, name: str, mesh: Mesh, foldable: FoldTree, made: dict[str, Mesh], most: int, views: int
) -> tuple[list[PeerRow], MeshComparison]:
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
        rows.append(_row(f"{what}: mean", maker, statistics.fmean(jods), "JOD"))
        rows.append(_row(f"{what}: worst", maker, min(jods), "JOD"))
        rows.append(_row(f"{what}: silhouette that differs", maker, 100 * statistics.fmean(outlines), "%"))
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


def _shown(picture: Picture) -> NDArray[np.bool_]:
    """Pixels that show anything: the mesh does not reach the picture's first."""
    return np.asarray((picture != picture[0, 0]).any(axis=-1))


def _outline_differs(full: Picture, other: Picture) -> float:
    """Pixels that show the mesh in one picture alone, over those along its outline."""
    shown, outline = _shown(full), _shown(full) & ~ndimage.binary_erosion(_shown(full))
    return float((shown != _shown(other)).sum() / max(outline.sum(), 1))
