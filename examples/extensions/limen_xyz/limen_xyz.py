"""A file format for limen: text with a point in each line, its place and its colour (0 to 255)."""

import numpy as np

from limen.data.points.build import build_points


def read(path):
    """The points of a file; what is wrong with it is raised as one of `limen.errors`."""
    rows = np.loadtxt(path, ndmin=2)
    return build_points(rows[:, :3], rows[:, 3:6].astype(np.uint8))
