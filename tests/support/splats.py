"""Splats drawn without anybody choosing them."""

from __future__ import annotations

from typing import Any

import numpy as np

from limen.data.points.nodes import CHUNK_NODES, LEVEL_BEGIN
from limen.layers.points.draw.drawer import CHUNK_BYTES, PointsDrawer
from limen.layers.points.layer import PointsLayer, PointsPart
from limen.layers.points.select import PointCut, PointsRequest
from limen.stream.chunks import Arrival, Statistics, Update
from limen.viewing.policy import Policy
from limen.viewing.projection import QuiltView
from limen.viewing.tolerance import tolerance_of

__all__ = ["drawer_of", "leaves_of", "part_of"]


def drawer_of(device: Any, cloud: Any, **fields: Any) -> PointsDrawer:
    """A drawer with all of a cloud's chunks, each in the slot of its number."""
    drawer = PointsDrawer(device, PointsLayer(cloud, **fields), cloud.chunks * CHUNK_BYTES)
    arrived = [Arrival(chunk, (chunk,), cloud.read_chunk(chunk)) for chunk in range(cloud.chunks)]
    drawer.upload(0, Update(arrived, [], Statistics(0, 0, 0, 0, 0, 0, 0, 0, 0, 0.0)))
    return drawer


def part_of(view: QuiltView, stands: Any, pairs: Any, *, lit: bool = True) -> PointsPart:
    """These pairs of a splat and a panel, of a cloud that stands by a map from its own origin."""
    policy = Policy("full")
    request = PointsRequest(view.eyes[0], stands, tolerance_of([], policy), policy, np.ones(256), lit)
    return PointsPart(request, PointCut(pairs, np.zeros(0, np.int64), 1.0, 0.0, 0.0, 0))


def leaves_of(cloud: Any, panels: int = 1) -> Any:
    items = [
        chunk * CHUNK_NODES + LEVEL_BEGIN[0] + np.arange(cloud.points_of_chunk(chunk)) for chunk in range(cloud.chunks)
    ]
    every = np.concatenate(items).astype(np.uint32)
    return np.concatenate([np.stack([every, np.full(len(every), n, np.uint32)], axis=1) for n in range(panels)])
