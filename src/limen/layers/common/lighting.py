"""How scenes are lit: what decides about detail and what draws it have to agree.

``light = ambient + (1 - ambient) (max(n . l, 0) + n . v) / 2``: half of the light from a fixed place, half from the
viewer, for normals ``n`` toward the viewer (``layers/mesh/draw/scene.wgsl``, function ``lit``).
"""

from __future__ import annotations

import numpy as np

from limen.geometry import Floats

__all__ = ["AMBIENT", "TOWARD_LIGHT"]

TOWARD_LIGHT: Floats = np.array([0.35, 0.8, 0.5]) / np.linalg.norm([0.35, 0.8, 0.5])
"""Unit vector in the room."""

AMBIENT = 0.25
"""Share of light that comes from everywhere."""
